#!/usr/bin/env python3
"""Checks that no text of the project names a path of somebody's machine; prints file:line, ends with 1 if one does.

Such a path works for its author only, and a newcomer cannot tell.
"""

import pathlib
import re
import sys

from project_files import ROOT, project_files

# Put together from pieces, so that this file passes its own check.
FORBIDDEN = re.compile("|".join(["/" + "work/", "/" + "root/", "shared" + "/facts", r"\.lib" + "rary/",
                                 "/" + r"home/(?!user/|you/)\w+/", "/" + "Users/"]))


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
                faults.append(f"{path.relative_to(root)}:{number}: names '{match.group()}', a place on one machine only")
    return faults


if __name__ == "__main__":
    found = check(pathlib.Path(sys.argv[1]).resolve() if len(sys.argv) > 1 else ROOT)
    print("\n".join(found) or "no text names a place on one machine")
    sys.exit(1 if found else 0)
