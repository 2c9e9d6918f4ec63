"""The site's pages, the files of the project that they show, and the links between them."""

import os
import posixpath
import re

ROOT_PAGES = {
    "README.md": "index.md",
    "CONVENTIONS.md": "conventions.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
    "SECURITY.md": "security.md",
}
# Code first: link syntax inside code is not a link.
CODE_OR_LINK = re.compile(r"^(?:```|~~~).*?^(?:```|~~~)\s*?$|`[^`\n]*`|\]\((?P<target>[^()\s]+)\)", re.M | re.S)
LARGEST_SOURCE = 200_000  # larger files are not read as text [bytes]
LANGUAGES = {
    ".hpp": "cpp",
    ".cpp": "cpp",
    ".py": "python",
    ".yaml": "yaml",
    ".yml": "yaml",
    ".sh": "bash",
    ".msg": "text",
}


class Tree:
    """The pages of the site and the files that they come from."""

    def __init__(self, root):
        self.root = root
        self.page_of = {}  # path in the tree -> page in the site
        self.path_of = {}  # page in the site -> path in the tree

    def add(self, path, page):
        self.page_of[path], self.path_of[page] = page, path

    def resolve(self, page, target):
        """The path in the tree that a link leads to, and its anchor; None for a link that leaves the project."""
        name, _, anchor = target.partition("#")
        if not name or re.match(r"[a-z]+:", name) or page not in self.path_of:
            return None
        return posixpath.normpath(posixpath.join(posixpath.dirname(self.path_of[page]), name)), anchor

    def linked_from(self, page, text):
        found = (match["target"] for match in CODE_OR_LINK.finditer(text) if match["target"])
        return [place[0] for place in (self.resolve(page, target) for target in found) if place]

    def rewritten(self, page, text):
        """The text with links between pages of the site."""

        def link(match):
            place = self.resolve(page, match["target"]) if match["target"] else None
            if place is None or place[0] not in self.page_of:
                return match[0]  # a missing page stays, and the strict build reports it
            target = posixpath.relpath(self.page_of[place[0]], posixpath.dirname(page) or ".")
            return f"]({target}{'#' + place[1] if place[1] else ''})"

        return CODE_OR_LINK.sub(link, text)

    def source_page(self, path):
        """The text of the page that shows a file or a folder of the tree."""
        place = self.root / path
        head = f"---\ntitle: {posixpath.basename(path)}\nsearch: {{exclude: true}}\n---\n"
        if place.is_dir():
            return head + f"# {path}\n\n" + "\n".join(f"- [{name}]({name})" for name in self.members(path)) + "\n"
        text = place.read_text(encoding="utf-8")
        if place.suffix == ".md":
            return head + text
        return head + f"# {path}\n\n~~~~~~ {LANGUAGES.get(place.suffix, 'text')}\n{text}\n~~~~~~\n"

    def members(self, folder):
        """Names of the files directly in a folder that can be shown."""
        return sorted(
            entry.name
            for entry in os.scandir(self.root / folder)
            if entry.is_file() and not entry.name.startswith(".") and self.is_text(f"{folder}/{entry.name}")
        )

    def is_text(self, path):
        place = self.root / path
        return place.stat().st_size <= LARGEST_SOURCE and b"\0" not in place.read_bytes()

    def add_linked(self, texts):
        """Adds pages for linked files that the site lacks; texts: page -> text. Returns page -> text."""
        added, waiting = {}, list(texts.items())
        while waiting:
            page, text = waiting.pop()
            for path in self.linked_from(page, text):
                place = self.root / path
                if path in self.page_of or path.startswith("../") or not place.exists():
                    continue
                if place.is_dir():  # its links are relative to a file inside it
                    shown = f"sources/{path}/index.md"
                    self.page_of[path], self.path_of[shown] = shown, f"{path}/index.md"
                elif self.is_text(path):
                    shown = f"sources/{path}" + ("" if place.suffix == ".md" else ".md")
                    self.add(path, shown)
                else:
                    continue
                added[shown] = self.source_page(path)
                if place.is_dir() or place.suffix == ".md":  # code stays unchanged
                    waiting.append((shown, added[shown]))
        return added
