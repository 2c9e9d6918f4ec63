#!/usr/bin/env python3
"""Checks the whole tree against the table of layers (tools/layers.py); prints file:line for each fault, ends with 1.

    check_layers.py [FOLDER]   check the includes and the links of CMake targets

Besides the table: core includes no simulator, middleware or stream. Pinocchio, half a minute of compiling per file,
stays in the source files of core/model. Folders named testing/ hold test support: only tests may include
them, and only test targets may link them. Every source file is part of a CMake target.
"""

import pathlib
import re
import sys

from layers import LAYERS, LIBRARIES
from project_files import ROOT, project_files

NAMES = {layer.folder: layer for layer in LAYERS}
INCLUDE = re.compile(r'\s*#\s*include\s*([<"])([^>"]+)[>"]')
TEST_SUPPORT = re.compile(r"(^|/)testing/")
TEST = re.compile(rf"_test\.(cpp|hpp)$|^tests/|^ros/tests/|{TEST_SUPPORT.pattern}")
NOT_IN_CORE = re.compile(r"(mujoco|spdlog|yaml-cpp|nlohmann|rcl\w*|rmw|rosidl\w*|\w+_msgs)/|iostream$|fstream$")


def layer_of(path):
    """The layer of a file or folder by its longest matching path, or None."""
    parts = path.split("/")
    for length in range(len(parts), 0, -1):
        if "/".join(parts[:length]) in NAMES:
            return NAMES["/".join(parts[:length])]
    return None


def allowed(layer, target, uses):
    return layer is target or any(target.folder == use or target.folder.startswith(f"{use}/") for use in uses)


def fault_of(file, opener, target, root):
    """The fault of `#include <target>` in `file` (path relative to the root), or None."""
    is_test = bool(TEST.search(file))
    layer = layer_of(file)
    in_core = layer.folder.startswith("core/")
    if in_core and NOT_IN_CORE.match(target):
        return f"core may not include {target}: it has no simulator, middleware or streams"
    library = target.split("/")[0]
    if library == "pinocchio" and in_core:
        # A header named pinocchio_* is private to the source files next to it.
        private = layer.folder == "core/model" and (file.endswith(".cpp") or "/pinocchio_" in file)
        return None if private else "only core/model/*.cpp may include Pinocchio; use core/model/arm_model.hpp"
    if "/" in target and library in LIBRARIES and not is_test and layer.folder not in LIBRARIES[library].split():
        return f"{layer.folder} may not include {library}: only {LIBRARIES[library].replace(' ', ', ')} may"
    if opener == "<" or (root / file).parent.joinpath(target).is_file() and not in_core:
        return None
    other = layer_of(target)
    if other is None:  # a generated header, or one of another ROS package
        return f'"{target}" is outside core: write the path from the root ("core/...")' if in_core else None
    if TEST_SUPPORT.search(target) and not is_test:
        return f'"{target}" is test support: only tests may include it'
    if target.startswith("core/model/pinocchio_") and layer is not other:
        return f'"{target}" is private to core/model: it includes Pinocchio'
    if layer.folder == "tests" or allowed(layer, other, layer.uses):
        return None
    # A test may drive its subject through higher layers of the same folder.
    if is_test and (allowed(layer, other, layer.tests_use) or in_core and allowed(layer, other, ("core", "models"))):
        return None
    if is_test and any(allowed(NAMES[use], other, NAMES[use].uses) for use in layer.uses if use in NAMES):
        return None
    return f"{layer.folder} may not include {other.folder}; its row in tools/layers.py: {uses_text(layer) or 'nothing'}"


def check_includes(root):
    faults = []
    files = [f.relative_to(root).as_posix() for f in project_files(root, {".hpp", ".cpp", ".h", ".cc"})]
    if not files:
        return [f"{root}: no source file found, nothing would be checked"]
    for file in files:
        if layer_of(file) is None:
            faults.append(f"{file}:1: not in a known folder; give its folder a row in tools/layers.py")
            continue
        for number, line in enumerate((root / file).read_text(encoding="utf-8").splitlines(), 1):
            match = INCLUDE.match(line)
            fault = fault_of(file, *match.groups(), root) if match else None
            if fault:
                faults.append(f"{file}:{number}: {fault}")
    return faults


def check_table():
    """Faults of the table itself: a row may use only rows above it."""
    faults, above = [], set()
    for layer in LAYERS:
        for use in layer.uses:
            if use not in above and not (use == "core" and "core/cycle" in above):
                faults.append(f"tools/layers.py: {layer.folder} uses {use}, which is not listed above it")
        above.add(layer.folder)
    known = {*NAMES, "core"}
    faults += [
        f"tools/layers.py: {layer.folder} names the unknown layer {use}"
        for layer in LAYERS
        for use in (*layer.uses, *layer.tests_use)
        if use not in known
    ]
    return faults


CALL = re.compile(r"\b(\w+)\s*\(([^()]*)\)")
KEYWORD = re.compile(r"^(SHARED|STATIC|MODULE|OBJECT|INTERFACE|PUBLIC|PRIVATE|[A-Z_]*DEPS|LABELS|EXCLUDE_FROM_ALL)$")


def check_links(root):
    """Faults of CMake targets: sources without target; test support linked by other targets than tests."""
    listed, links, tests = set(), {}, set()
    for path in project_files(root, {".txt"}):
        if path.name != "CMakeLists.txt":
            continue
        folder = path.parent.relative_to(root).as_posix()
        text = re.sub(r"#.*|\"[^\"\n]*\"|\$<[^>]*>", lambda m: " " * len(m.group()), path.read_text(encoding="utf-8"))
        for match in CALL.finditer(text):
            command, words = match.group(1), match.group(2).split()
            if not words or not re.fullmatch(
                r"(nanobind_)?add_(library|executable|module)|multipanda_\w*(library|module|program|plugin|test)|target_link_libraries|"
                r"target_sources",
                command,
            ):
                continue
            name, line = words[0], text.count("\n", 0, match.start()) + 1
            is_test = command.endswith("_test")
            for word in words[1:]:
                word = word.replace("${CMAKE_CURRENT_SOURCE_DIR}", str(path.parent))
                word = word.replace("${CMAKE_SOURCE_DIR}", str(root))
                if re.search(r"\.(cpp|cc|c)$", word):
                    file = (path.parent / word).resolve()
                    file = file.relative_to(root.resolve()).as_posix() if file.is_relative_to(root) else word
                    is_test = is_test or bool(TEST.search(file))
                    listed.add(file)
                elif not KEYWORD.match(word):
                    links.setdefault(name, []).append((word, f"{path.relative_to(root).as_posix()}:{line}"))
            if is_test or folder.split("/")[0] == "tests":
                tests.add(name)
    faults = [
        f"{file}:1: no CMakeLists.txt names it: it is not compiled"
        for file in (f.relative_to(root).as_posix() for f in project_files(root, {".cpp"}))
        if file not in listed
    ]
    return faults + [
        f"{place}: {name} links {other}, which is test support"
        for name, others in links.items()
        if name not in tests
        for other, place in others
        if other in tests or other.startswith("GTest::")
    ]


def uses_text(layer):
    return ", ".join(layer.uses)


def check(root):
    return check_table() + check_includes(root) + check_links(root)


if __name__ == "__main__":
    found = check(pathlib.Path(sys.argv[1]).resolve() if len(sys.argv) > 1 else ROOT)
    print("\n".join(found) or "every file includes only what its layer may use")
    sys.exit(1 if found else 0)
