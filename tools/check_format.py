#!/usr/bin/env python3
"""Checks the layout of C++ files with clang-format, layout and rules of Python files with ruff; ends with 1 on a fault.

Versions differ in what they print, so the pinned ones of .venv are used (requirements.txt). Run it with --fix to
rewrite the files.
"""

import pathlib
import subprocess
import sys

from project_files import ROOT, project_files

PROGRAMS = pathlib.Path(sys.prefix, "bin")


def run(program, *arguments):
    return subprocess.run([PROGRAMS / program, *arguments], cwd=ROOT, check=False).returncode == 0


def main():
    fix = "--fix" in sys.argv
    for program in ("clang-format", "ruff"):
        if not (PROGRAMS / program).exists():
            print(f"{PROGRAMS} has no {program}: run ./multipanda setup, then this check with .venv/bin/python")
            return 1
    cpp = [f for f in project_files(ROOT, {".hpp", ".cpp"}) if "vendored_interfaces" not in f.parts]
    python = project_files(ROOT, {".py"})
    if not cpp or not python:
        print("no C++ or no Python file found, nothing would be checked")
        return 1
    good = [
        run("clang-format", *(["-i"] if fix else ["--dry-run", "-Werror"]), *map(str, cpp)),
        run("ruff", "format", *([] if fix else ["--check"]), "--force-exclude", *map(str, python)),
        run("ruff", "check", "--force-exclude", *map(str, python)),
    ]
    if not all(good):
        print("to rewrite the files: .venv/bin/python tools/check_format.py --fix")
        return 1
    print(f"{len(cpp)} C++ and {len(python)} Python files checked")
    return 0


if __name__ == "__main__":
    sys.exit(main())
