#!/usr/bin/env python3
"""The documentation's site: builds strictly, opens without a network, every link of every page leads to something."""

import html
import html.parser
import os
import pathlib
import re
import shutil
import sys
import tempfile
import unittest
import urllib.parse
from unittest import mock

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tools"))

import build_site
import site_api
import site_tree

ENVIRONMENT = pathlib.Path(sys.argv.pop(1)).absolute() if len(sys.argv) > 1 else ROOT / "build" / "docs-env"


class Page(html.parser.HTMLParser):
    """The links and the anchors of a page of the site."""

    def __init__(self, text):
        super().__init__()
        self.links, self.anchors = [], {""}
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        for name, value in attributes:
            if name in ("href", "src") and value:
                self.links.append(value)
            if name in ("id", "name"):
                self.anchors.add(value)


class Site(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory(prefix="multipanda-site-")
        cls.site = pathlib.Path(cls.folder.name, "site")
        build_site.build(build_site.environment(ENVIRONMENT), ROOT / "mkdocs.yml", cls.site)
        cls.pages = {path: Page(path.read_text(encoding="utf-8")) for path in sorted(cls.site.rglob("*.html"))}

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def test_every_link_leads_to_a_file_and_an_anchor(self):
        faults, count = [], 0
        for path, page in self.pages.items():
            for link in page.links:
                name, _, anchor = link.partition("#")
                if re.match(r"[a-z]+:|//|/", link) or path.name == "404.html":
                    continue
                count += 1
                target = (path.parent / urllib.parse.unquote(name.partition("?")[0])).resolve() if name else path
                if not target.exists():
                    faults.append(f"{path.relative_to(self.site)}: {link}")
                elif anchor and target in self.pages and anchor not in self.pages[target].anchors | {"__search"}:
                    faults.append(f"{path.relative_to(self.site)}: {link}: no such heading")
        self.assertEqual(faults, [])
        self.assertGreater(count, 3000)

    def test_every_page_of_the_project_is_in_it(self):
        for path in sorted((ROOT / "docs").rglob("*.md")):
            self.assertIn(self.site / path.relative_to(ROOT / "docs").with_suffix(".html"), self.pages)
        for page in site_tree.ROOT_PAGES.values():
            self.assertIn(self.site / pathlib.Path(page).with_suffix(".html"), self.pages)

    def test_linked_sources_are_in_it(self):
        """The site has no other place from which it could show them."""
        page = self.site / "sources" / "core" / "cycle" / "control_cycle.cpp.html"
        source = (ROOT / "core" / "cycle" / "control_cycle.cpp").read_text(encoding="utf-8")
        shown = html.unescape(re.sub(r"<[^>]*>", "", page.read_text(encoding="utf-8")))
        self.assertIn(source.strip(), shown)
        links = self.pages[self.site / "architecture.html"].links
        self.assertIn("sources/core/cycle/control_cycle.cpp.html", links)

    def test_nothing_is_fetched(self):
        self.assertEqual(build_site.fetched(self.site), [])
        scripts = (self.site / "index.html").read_text(encoding="utf-8")
        self.assertIn("site/iframe-worker.js", scripts)  # search in files
        self.assertTrue((self.site / "search" / "search_index.js").exists())

    def test_the_index_has_every_page_of_the_navigation(self):
        index = (self.site / "search" / "search_index.js").read_text(encoding="utf-8")
        for word in ("tank_start_j", "collision_avoidance", "mp.Refused", "translational_stiffness_n_per_m"):
            self.assertIn(word, index)
        self.assertNotIn("sources/core", index)

    def test_the_reference_has_every_public_name_once(self):
        sys.path.insert(0, str(ROOT / "python"))
        import multipanda

        placed = [name for page in site_api.PAGES.values() for name in page.names]
        self.assertEqual(len(placed), len(set(placed)))
        self.assertEqual(sorted(set(multipanda.__all__) - set(placed) - {"__version__"}), [])
        for name, page in site_api.PAGES.items():
            anchors = self.pages[self.site / "python_api" / f"{name}.html"].anchors
            for entry in page.names:
                self.assertIn(site_api.full_name(entry), anchors)


class Faults(unittest.TestCase):
    """A small project with the same settings, whose pages have faults."""

    PAGES = {
        "README.md": "# Home\n\n[a page](docs/one.md), [the code](code/law.cpp), [the folder](code)\n",
        "code/law.cpp": "int torque();  // [not](a link.md)\n",
        "docs/one.md": "# One\n\n## A heading\n\n[home](../README.md), [two](two.md#a-part), [code](../code/law.cpp)\n",
        "docs/two.md": "# Two\n\n## A part\n\nText, and `[no](link.md)`.\n",
    }

    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="multipanda-site-")
        self.addCleanup(folder.cleanup)
        self.tree = pathlib.Path(folder.name)
        for name, text in self.PAGES.items():
            self.write(name, text)
        shutil.copytree(ROOT / "docs" / "site", self.tree / "docs" / "site")
        (self.tree / "tools").symlink_to(ROOT / "tools")
        settings = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").partition("\nnav:\n")[0]
        settings = re.sub(r"^  - mkdocstrings:\n(?:      .*\n)+", "", settings, flags=re.M)
        self.write("mkdocs.yml", settings + "\nnav: [index.md, one.md, two.md]\n")

    def write(self, name, text):
        path = self.tree / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")

    def built(self):
        python = build_site.environment(ENVIRONMENT)
        return build_site.build(python, self.tree / "mkdocs.yml", self.tree / "build" / "site")

    def test_each_is_named(self):
        self.built()  # without a fault it builds
        self.write("docs/two.md", "# Two\n\n[nowhere](three.md), [heading](one.md#another), [code](../code/none.cpp)\n")
        self.write("docs/lost.md", "# A page that the navigation does not have\n")
        with self.assertRaises(build_site.SiteError) as caught:
            self.built()
        for fault in ("three.md", "one.md#another", "none.cpp", "lost.md", "two.md#a-part"):
            self.assertIn(fault, str(caught.exception))

    def test_what_a_page_fetches_is_found(self):
        self.write("docs/a.html", '<a href="https://example.org">a link is not fetched</a> <img src="images/a.png">')
        self.assertEqual(build_site.fetched(self.tree / "docs"), [])
        for text in (
            '<script src="https://cdn.example.org/a.js"></script>',
            "<img alt='' src='//example.org/a.png'>",
            '<link rel="stylesheet" href="http://example.org/a.css">',
            "<style>@import 'https://example.org/a.css'</style>",
            "<style>@font-face { src: url(https://example.org/a.woff2) }</style>",
        ):
            self.write("docs/a.html", text)
            self.assertEqual(len(build_site.fetched(self.tree / "docs")), 1, text)
        (self.tree / "docs" / "a.html").unlink()
        self.assertEqual(len(build_site.fetched(self.tree / "docs")), 1)  # no page at all


class Offline(unittest.TestCase):
    def test_a_missing_index_is_said_with_the_next_step(self):
        with tempfile.TemporaryDirectory() as folder:
            nowhere = {"PIP_INDEX_URL": "http://127.0.0.1:9/simple", "PIP_RETRIES": "0", "PIP_CONFIG_FILE": os.devnull}
            with mock.patch.dict(os.environ, nowhere), self.assertRaises(build_site.SiteError) as caught:
                build_site.environment(pathlib.Path(folder, "env"))
            self.assertIn("pip config list", str(caught.exception))
            self.assertIn("requirements-docs.txt", str(caught.exception))
            self.assertFalse(pathlib.Path(folder, "env", ".complete").exists())


if __name__ == "__main__":
    unittest.main()
