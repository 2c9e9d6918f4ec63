#!/usr/bin/env python3
"""Checks paths in the project's texts; prints file:line for each fault, ends with 1 if there is one.

Paths of one machine are refused. A link of a page must lead to a file, and to one of its headings. A
promise of docs/promises.md and a row of docs/paper.md must name tests, and the sources must have them.
"""

import pathlib
import re
import sys

from project_files import ROOT, project_files

# Assembled from pieces, so that this file passes its own check.
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


PROVED = [pathlib.Path("docs/promises.md"), pathlib.Path("docs/paper.md")]
GTEST = re.compile(r"^\s*(?:TYPED_)?TEST(?:_F|_P)?\(\s*(\w+)\s*,\s*(\w+)\s*\)", re.M)


def tests_in_sources(root):
    """Names of all tests: Suite.Name in C++, Class.test_name in Python."""
    found = set()
    for path in project_files(root, {".cpp", ".py"}):
        text = path.read_text(encoding="utf-8")
        if path.suffix == ".cpp":
            found |= {f"{suite}.{name}" for suite, name in GTEST.findall(text)}
            continue
        for body in re.split(r"^(?=class )", text, flags=re.M)[1:]:
            suite = re.match(r"class (\w+)", body).group(1)
            found |= {f"{suite}.{name}" for name in re.findall(r"^    def (test_\w+)\(", body, re.M)}
    return found


def check_proofs(root, page, existing):
    """Every row of a table with the column 'proved by' names at least one test, and each exists."""
    if not (root / page).exists():
        return []
    faults, rows, column = [], 0, None
    for number, line in enumerate((root / page).read_text(encoding="utf-8").splitlines(), 1):
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")] if line.startswith("|") else []
        if not cells or set(line) <= set("|-: "):
            column = column if cells else None
            continue
        if "proved by" in cells:
            column = cells.index("proved by")
            continue
        if column is None:
            continue
        rows += 1
        names = re.findall(r"`([^`]+)`", cells[column]) if column < len(cells) else []
        if not names:
            faults.append(f"{page}:{number}: a promise without a test: '{cells[0]}'")
        faults += [
            f"{page}:{number}: names the test {name}, which no source file has"
            for name in names
            if name not in existing
        ]
    return faults or ([] if rows else [f"{page}:1: no row with the column 'proved by', nothing would be checked"])


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
    existing = tests_in_sources(root)
    return faults + check_links(root) + [fault for page in PROVED for fault in check_proofs(root, page, existing)]


if __name__ == "__main__":
    found = check(pathlib.Path(sys.argv[1]).resolve() if len(sys.argv) > 1 else ROOT)
    print("\n".join(found) or "no machine-specific paths, every link is valid and every promise has its tests")
    sys.exit(1 if found else 0)
