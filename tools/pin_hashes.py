#!/usr/bin/env python3
"""Renews the hashes in requirements*.txt, or checks without a network that all are there.

    .venv/bin/python tools/pin_hashes.py           asks the package index, rewrites the files
    .venv/bin/python tools/pin_hashes.py --check   names each line without a version or a hash

To change a version, edit it and run the tool. A line gets the hashes of every published file that this version offers
to the supported Pythons on Linux x86-64, so that pip installs the same bytes on each computer or refuses. The index is
the one that pip is configured for. pip has no command that lists the files of a version, so this uses pip's modules.
"""

import argparse
import contextlib
import pathlib
import re
import sys
from typing import NamedTuple

from project_files import ROOT

FILES = sorted(ROOT.glob("requirements*.txt"))
PYTHONS = ["3.10", "3.11", "3.12", "3.13"]
# No supported distribution has Python 3.13 yet: its files are listed if they exist.
OPTIONAL = {"3.13"}
# glibc of the newest supported distribution is 2.39; pip accepts every older tag.
PLATFORMS = [f"manylinux_2_{minor}_x86_64" for minor in range(5, 40)]
PLATFORMS += ["manylinux1_x86_64", "manylinux2010_x86_64", "manylinux2014_x86_64", "linux_x86_64"]

PIN = re.compile(r"(?P<name>[A-Za-z0-9._-]+)==(?P<version>[A-Za-z0-9._+!-]+)\s*(?:;\s*(?P<marker>[^\\#]+?))?\s*")
HASH = re.compile(r"--hash=sha256:([0-9a-f]{64})")


class Requirement(NamedTuple):
    """One logical line of a file: its text without hashes, and the hashes."""

    line: int
    text: str
    hashes: tuple


def read(text):
    """Returns the logical lines; comments and options are lines without hashes."""
    found, number = [], 0
    lines = text.splitlines()
    while number < len(lines):
        first, whole = number, lines[number]
        while whole.rstrip().endswith("\\") and number + 1 < len(lines):
            number += 1
            whole = whole.rstrip()[:-1] + " " + lines[number].strip()
        found.append(Requirement(first + 1, HASH.sub("", whole).rstrip(" \\"), tuple(HASH.findall(whole))))
        number += 1
    return found


def is_pin(requirement):
    return bool(requirement.text.strip()) and not requirement.text.lstrip().startswith(("#", "-"))


def faults(text):
    """Returns 'line: what is wrong' for each requirement that is not pinned by a version and a hash."""
    found, pins, seen = [], 0, set()
    for requirement in filter(is_pin, read(text)):
        pins += 1
        match = PIN.fullmatch(requirement.text)
        if not match:
            found.append(f"{requirement.line}: '{requirement.text}' has no exact version; write NAME==VERSION")
            continue
        if not requirement.hashes:
            found.append(f"{requirement.line}: {match['name']} has no hash; run tools/pin_hashes.py")
        key = re.sub(r"[-_.]+", "-", match["name"]).lower(), match["marker"]
        if key in seen:
            found.append(f"{requirement.line}: {match['name']} is listed twice")
        seen.add(key)
    return found or ([] if pins else ["1: no requirement found, nothing would be checked"])


def applies(marker, python):
    from pip._vendor.packaging.markers import Marker

    environment = {"python_version": python, "python_full_version": python + ".0"}
    return marker is None or Marker(marker).evaluate(environment)


class Index:
    """Files of pip's configured index for one Python version."""

    def __init__(self, resources):
        self.resources, self.finders = resources, {}

    def finder(self, python, source):
        from pip._internal.commands import create_command
        from pip._internal.models.target_python import TargetPython

        if (python, source) not in self.finders:
            command = create_command("download")  # one for each finder: pip keeps these options inside the command
            options, _ = command.parse_args(["--no-binary=:all:" if source else "--only-binary=:all:", "none"])
            major, minor = (int(part) for part in python.split("."))
            self.resources.enter_context(command.main_context())
            target = TargetPython(
                platforms=PLATFORMS, py_version_info=(major, minor), abis=[f"cp{major}{minor}"], implementation="cp"
            )
            self.finders[python, source] = command._build_package_finder(
                options=options, session=command.get_default_session(options), target_python=target
            )
        return self.finders[python, source]

    def hashes(self, name, version, python, source):
        return {
            candidate.link.hash
            for candidate in self.finder(python, source).find_all_candidates(name)
            if str(candidate.version) == version and candidate.link.hash_name == "sha256"
        }


def source_only(requirements):
    """The names of `--no-binary NAME` lines."""
    lines = [r.text.split() for r in requirements]
    return {line[1] for line in lines if len(line) == 2 and line[0] == "--no-binary"}


def renew(text, hashes_of):
    """Returns the text with new hashes, and what is missing. hashes_of(name, version, python, source) -> set."""
    requirements, result, missing = read(text), [], []
    sources = source_only(requirements)
    for requirement in requirements:
        match = PIN.fullmatch(requirement.text) if is_pin(requirement) else None
        if not match:
            result.append(requirement.text)
            continue
        found = set()
        for python in PYTHONS:
            if not applies(match["marker"], python):
                continue
            offered = hashes_of(match["name"], match["version"], python, match["name"] in sources)
            if not offered and python not in OPTIONAL:
                pin = f"{match['name']}=={match['version']}"
                missing.append(f"{requirement.line}: {pin} has no file for Python {python}")
            found |= offered
        result.append(" \\\n".join([requirement.text, *(f"    --hash=sha256:{value}" for value in sorted(found))]))
    return "\n".join(result) + "\n", missing


def main():
    parser = argparse.ArgumentParser(description="Renews or checks the hashes of the pinned Python packages.")
    parser.add_argument("--check", action="store_true", help="only check that every line is pinned, without network")
    parser.add_argument("files", nargs="*", type=pathlib.Path, help="default: the requirements of the project")
    options = parser.parse_args()
    problems = []
    with contextlib.ExitStack() as resources:
        index = Index(resources)
        for path in options.files or FILES:
            text = path.read_text(encoding="utf-8")
            missing = []
            if not options.check:
                text, missing = renew(text, index.hashes)
            found = missing or faults(text)
            if not found and not options.check:
                path.write_text(text, encoding="utf-8")
            problems += [f"{path.name}:{fault}" for fault in found]
    print("\n".join(problems) or "every requirement has a version and a hash")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
