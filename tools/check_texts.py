#!/usr/bin/env python3
"""Checks paths in the project's texts; prints file:line for each fault, ends with 1 if there is one.

A path of somebody's machine works for its author only. A link of a page must lead to a file, and to a heading of it.
"""

import pathlib
import re
import sys

from project_files import ROOT, project_files

# Put together from pieces, so that this file passes its own check.
FORBIDDEN = re.compile(
    "|".join(
        [
            "/" + "work/",
            "/" + "root/",
            "shared" + "/facts",
            r"\.lib" + "rary/",
            "/" + r"home/(?!user/|you/)\w+/",
            "/" + "Users/",
        ]
    )
)


LINK = re.compile(r"\]\(([^()\s]+)\)")


def anchors(page):
    """The anchors of a page's headings, as GitHub makes them."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    titles = re.findall(r"^#+\s+(.*?)\s*$", text, re.M)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


def check_links(root):
    faults = []
    for page in project_files(root, {".md"}):
        for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), 1):
            for target in LINK.findall(re.sub(r"`[^`]*`", "", line)):
                if re.match(r"[a-z]+:", target):
                    continue
                name, _, anchor = target.partition("#")
                path = (page.parent / name).resolve() if name else page
                place = f"{page.relative_to(root)}:{number}"
                if not path.exists():
                    faults.append(f"{place}: links {target}, which does not exist")
                elif anchor and path.suffix == ".md" and anchor not in anchors(path):
                    faults.append(f"{place}: links {target}, a heading that {path.name} does not have")
    return faults


def check(root):
    faults = []
    files = project_files(root)
    if not files:
        return [f"{root}: no file found, nothing would be checked"]
    for path in files:
        content = path.read_bytes()
        if b"\0" in content:  # not a text
            continue
        for number, line in enumerate(content.decode("utf-8", errors="replace").splitlines(), 1):
            match = FORBIDDEN.search(line)
            if match:
                faults.append(f"{path.relative_to(root)}:{number}: names '{match.group()}', a path of one machine only")
    return faults + check_links(root)


if __name__ == "__main__":
    found = check(pathlib.Path(sys.argv[1]).resolve() if len(sys.argv) > 1 else ROOT)
    print("\n".join(found) or "no machine-specific paths, and every link is valid")
    sys.exit(1 if found else 0)
