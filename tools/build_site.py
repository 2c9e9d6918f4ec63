#!/usr/bin/env python3
"""Builds the documentation's site into build/site. Open build/site/index.html to read it.

.venv/bin/python tools/build_site.py               strictly: a broken link or a page outside the navigation fails
.venv/bin/python tools/build_site.py --out FOLDER

The first call installs requirements-docs.txt into build/docs-env, which needs the network; later calls need none.
"""

import argparse
import hashlib
import os
import pathlib
import re
import subprocess
import sys

from project_files import ROOT

REQUIREMENTS = ROOT / "requirements-docs.txt"
# What a page would fetch when opened: scripts, styles, fonts, images, frames. Links do not count.
FETCHED = re.compile(
    r"<(?:script|img|iframe|source|video|audio)\b[^>]*?\ssrc=[\"']?(?P<src>(?:https?:)?//[^\"'\s>]+)"
    r"|<link\b[^>]*?\shref=[\"']?(?P<href>(?:https?:)?//[^\"'\s>]+)"
    r"|(?:url\(|@import\s+)[\"']?(?P<url>(?:https?:)?//[^\"')\s]+)",
    re.I,
)


class SiteError(Exception):
    """The reason why there is no site, and the remedy."""


def environment(folder, requirements=REQUIREMENTS, *options):
    """The interpreter of an environment with the requirements; makes it if it is missing or older than they are.

    `options` are pip's.
    """
    python = folder / "bin" / "python"
    stamp = folder / ".complete"
    key = f"{folder} {sys.version_info[:2]} {hashlib.sha256(requirements.read_bytes()).hexdigest()}"
    if stamp.exists() and stamp.read_text() == key and python.exists():
        return python
    print(f"making {folder} (once, {requirements.name})", flush=True)
    stamp.unlink(missing_ok=True)
    folder.parent.mkdir(parents=True, exist_ok=True)
    log = folder.parent / f"{folder.name}.log"
    install = [python, "-I", "-m", "pip", "--disable-pip-version-check", "--no-input", "install"]
    install += ["--require-hashes", "--only-binary=:all:", *options, "-r", requirements]
    with open(log, "wb") as out:
        for command in ([sys.executable, "-I", "-m", "venv", "--clear", folder], install):
            if subprocess.run(command, stdout=out, stderr=subprocess.STDOUT, check=False).returncode != 0:
                what = (
                    "a file's hash differs from the tested one"
                    if b"DO NOT MATCH" in log.read_bytes()
                    else "see the log"
                )
                raise SiteError(
                    f"the packages of {requirements.name} could not be installed ({what}: {log}). The first build of "
                    "the site needs a package index: check the network and `pip config list`, then try again"
                )
    stamp.write_text(key)
    return python


def build(python, config, out):
    """Builds a site strictly. Returns its messages; raises SiteError with those that are faults."""
    done = subprocess.run(
        [python, "-m", "mkdocs", "build", "--strict", "--clean", "--config-file", config, "--site-dir", out],
        env={**os.environ, "PYTHONPATH": str(ROOT / "tools"), "NO_MKDOCS_2_WARNING": "1"},
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    said = done.stdout + done.stderr
    if done.returncode != 0:
        raise SiteError("\n".join(line for line in said.splitlines() if not line.startswith("INFO")) or said)
    return said


def fetched(site):
    """What the site's pages and styles would fetch from elsewhere, as 'file: address'."""
    found, pages = [], 0
    for path in sorted(site.rglob("*")):
        if path.suffix in (".html", ".css"):
            pages += path.suffix == ".html"
            for match in FETCHED.finditer(path.read_text(encoding="utf-8")):
                found.append(f"{path.relative_to(site)}: {match['src'] or match['href'] or match['url']}")
    return found if pages else [f"{site} has no page"]


def main():
    parser = argparse.ArgumentParser(description="Builds the documentation's site.")
    parser.add_argument("--out", type=pathlib.Path, default=ROOT / "build" / "site", help="default: build/site")
    parser.add_argument("--environment", type=pathlib.Path, default=ROOT / "build" / "docs-env", help=argparse.SUPPRESS)
    options = parser.parse_args()
    try:
        build(environment(options.environment.absolute()), ROOT / "mkdocs.yml", options.out.absolute())
        found = fetched(options.out)
        if found:
            raise SiteError("the site must open without a network, but it fetches:\n" + "\n".join(found))
    except SiteError as wrong:
        print(f"no site: {wrong}", file=sys.stderr)
        return 1
    count = sum(1 for _ in options.out.rglob("*.html"))
    size = sum(path.stat().st_size for path in options.out.rglob("*") if path.is_file())
    print(f"{options.out / 'index.html'}: {count} pages, {size / 1e6:.1f} MB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
