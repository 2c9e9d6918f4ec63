#!/usr/bin/env python3
"""Runs clang-tidy over source files: check_tidy.py BUILD_FOLDER [FILE...]; 77 (skipped) without the right tool.

Without FILE it takes the stages of the core that are quick to parse. The others wait for a whole run by hand: one
file with Pinocchio's headers takes a minute.
"""

import concurrent.futures
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

from project_files import ROOT, project_files

VERSION = 14
SKIPPED = 77
QUICK = ["types", "rt", "reference", "safety", "modes", "cycle"]


def main():
    program = shutil.which(f"clang-tidy-{VERSION}") or shutil.which("clang-tidy")
    text = subprocess.run([program, "--version"], capture_output=True, text=True, check=False).stdout if program else ""
    if not re.search(rf"version {VERSION}\.", text):
        print(f"skipped: no clang-tidy {VERSION} (on Debian 12: ./multipanda setup --dev)")
        return SKIPPED
    build = pathlib.Path(sys.argv[1])
    files = [pathlib.Path(name).resolve() for name in sys.argv[2:]] or [
        p for p in project_files(ROOT, {".cpp"})
        if p.parent.parent == ROOT / "core" and p.parent.name in QUICK and not p.stem.endswith("_test")]
    known = (build / "compile_commands.json").read_text()
    # gcc's precompiled headers are none of clang's: the files are read as they stand.
    own = tempfile.TemporaryDirectory()
    pathlib.Path(own.name, "compile_commands.json").write_text(
        re.sub(r" -Winvalid-pch| -fpch-preprocess| -include [^ ]*cmake_pch\.hxx", "", known))
    files = [f for f in files if str(f) in known]
    if not files:
        print("no file of these is in the build, nothing would be checked")
        return 1

    def tidy(file):
        return subprocess.run([program, "--quiet", "-p", own.name, str(file)], capture_output=True, text=True, check=False)

    failed = False
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        for file, result in zip(files, pool.map(tidy, files)):
            if result.returncode:
                failed = True
                print(result.stdout)
    print(f"{len(files)} files checked")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
