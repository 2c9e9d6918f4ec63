#!/usr/bin/env python3
"""Runs clang-tidy over source files: check_tidy.py BUILD_FOLDER [FILE...]; 77 (skipped) without the right tool.

Without FILE it checks the folders of the core that are quick to parse. One file with Pinocchio's headers takes a
minute, so the others are checked by hand: name their files.
"""

import concurrent.futures
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

from compile_database import single_files
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
        p
        for p in project_files(ROOT, {".cpp"})
        if p.parent.parent == ROOT / "core" and p.parent.name in QUICK and not p.stem.endswith("_test")
    ]
    # clang cannot use gcc's precompiled headers: each file is parsed without them.
    commands = {entry["file"]: entry for entry in single_files(build)}
    files = [f for f in files if str(f) in commands]
    if not files:
        print("none of these files is in the build, nothing would be checked")
        return 1
    # Parsing external headers dominates, so the files of a folder are parsed as one.
    own = tempfile.TemporaryDirectory()
    batches = []
    for folder in sorted({f.parent for f in files}):
        members = [f for f in files if f.parent == folder]
        batch = pathlib.Path(own.name, f"{folder.name}_{len(batches)}.cpp")
        batch.write_text("".join(f'#include "{f}"\n' for f in members))
        entry = commands[str(members[0])]
        command = entry["command"].replace(str(members[0]), str(batch))
        batches.append({"directory": entry["directory"], "file": str(batch), "command": command})
    pathlib.Path(own.name, "compile_commands.json").write_text(json.dumps(batches))
    checked = re.search(r"HeaderFilterRegex: '\((.*)\)", (ROOT / ".clang-tidy").read_text()).group(1)

    def tidy(batch):
        # clang does not know gcc's options, either.
        options = [
            "--quiet",
            "--extra-arg=-Qunused-arguments",
            "--checks=-bugprone-suspicious-include",
            f"--config-file={ROOT / '.clang-tidy'}",
        ]
        options.append(f"--header-filter={ROOT}/({checked})/.*\\.[ch]pp$")
        return subprocess.run(
            [program, *options, "-p", own.name, batch["file"]], capture_output=True, text=True, check=False
        )

    failed = False
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        for _batch, result in zip(batches, pool.map(tidy, batches)):
            if result.returncode:
                failed = True
                print(result.stdout)
    print(f"{len(files)} files checked")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
