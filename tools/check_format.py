#!/usr/bin/env python3
"""Checks the layout of C++ files with clang-format; ends with 1 on a fault, with 77 (skipped) without the right tool.

Versions of clang-format differ in what they print, so only the one that the files were formatted with counts.
"""

import re
import shutil
import subprocess
import sys

from project_files import ROOT, project_files

VERSION = 14
SKIPPED = 77


def clang_format():
    """The program of the right version, or None."""
    for name in (f"clang-format-{VERSION}", "clang-format"):
        program = shutil.which(name)
        if program:
            text = subprocess.run([program, "--version"], capture_output=True, text=True, check=False).stdout
            found = re.search(r"version (\d+)", text)
            if found and int(found.group(1)) == VERSION:
                return program
    return None


def main():
    program = clang_format()
    if program is None:
        print(f"skipped: no clang-format {VERSION} (on Debian 12: ./multipanda setup --dev)")
        return SKIPPED
    files = project_files(ROOT, {".hpp", ".cpp"})
    if not files:
        print("no C++ file found, nothing would be checked")
        return 1
    result = subprocess.run([program, "--dry-run", "-Werror", *map(str, files)], check=False)
    if result.returncode:
        print("mend it with: clang-format -i FILE")
    return 1 if result.returncode else 0


if __name__ == "__main__":
    sys.exit(main())
