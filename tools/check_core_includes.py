#!/usr/bin/env python3
"""Checks what files in core/ include; prints file:line for each fault and ends with 1 if there is one.

The folders of core/ are stages in order. A file may include its own folder and those further down the list, so that
a stage can be read, tested and replaced without what stands above it. The core knows no simulator, no middleware
and no I/O, and Pinocchio (half a minute of compiling) stays in few source files.
Tests (*_test.cpp) may reach up, to drive what they test through the whole cycle, and may use models/; the rest
holds for them, too. core/test_support is what they share: it counts as a test, and only tests may include it.
"""

import pathlib
import re
import sys

from project_files import ROOT, project_files

ORDER = ["cycle", "modes", "safety", "features", "controllets", "reference", "model", "state", "record", "rt",
         "geometry", "types"]
FORBIDDEN = re.compile(r"(mujoco|spdlog|rcl\w*|rmw|rosidl\w*|\w+_msgs)/|iostream$|fstream$")
INCLUDE = re.compile(r'\s*#\s*include\s*([<"])([^>"]+)[>"]')
TEST = re.compile(r"_test\.(cpp|hpp)$|^core/test_support/")


def fault_of(file, opener, target):
    """What is wrong with `#include <target>` in `file` (path relative to the root), or None."""
    is_test = bool(TEST.search(file))
    if FORBIDDEN.match(target):
        return f"core knows no {target}: it has no simulator, middleware or streams"
    if target.startswith("pinocchio/"):
        # A header named pinocchio_* is private to the source files beside it.
        inside = file.startswith("core/model/") and (file.endswith(".cpp") or "/pinocchio_" in file)
        return None if inside else "Pinocchio is included by core/model/*.cpp only; use core/model/arm_model.hpp"
    if opener == "<":
        return None
    parts = target.split("/")
    if parts[0] != "core":
        if is_test and parts[0] == "models":
            return None
        return f'"{target}" is outside core: name files from the root ("core/..."), and only those of core'
    if parts[1] == "test_support":
        return None if is_test else f'"{target}" is for tests only'
    if len(parts) < 3 or parts[1] not in ORDER:
        return f'"{target}" is in no known folder of core ({", ".join(ORDER)})'
    if parts[1] == "model" and parts[2].startswith("pinocchio_") and not file.startswith("core/model/"):
        return f'"{target}" brings Pinocchio with it: it is for core/model/*.cpp only'
    folder = file.split("/")[1]
    if not is_test and ORDER.index(parts[1]) < ORDER.index(folder):
        return f"{folder} may not include {parts[1]}: it stands above it ({' > '.join(ORDER)})"
    return None


def check(root):
    faults = []
    files = project_files(root, {".hpp", ".cpp", ".h", ".cc"})
    core = [f for f in files if f.relative_to(root).parts[0] == "core"]
    if not core:
        return [f"{root}/core: no source file found, nothing would be checked"]
    for path in core:
        file = path.relative_to(root).as_posix()
        if len(path.relative_to(root).parts) < 3 or path.relative_to(root).parts[1] not in [*ORDER, "test_support"]:
            faults.append(f"{file}:1: not in a known folder of core ({', '.join(ORDER)})")
            continue
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
            match = INCLUDE.match(line)
            fault = fault_of(file, *match.groups()) if match else None
            if fault:
                faults.append(f"{file}:{number}: {fault}")
    return faults


if __name__ == "__main__":
    found = check(pathlib.Path(sys.argv[1]).resolve() if len(sys.argv) > 1 else ROOT)
    print("\n".join(found) or "core's includes point down the list")
    sys.exit(1 if found else 0)
