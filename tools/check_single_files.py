#!/usr/bin/env python3
"""Checks that every C++ file compiles by itself: check_single_files.py BUILD_FOLDER [--seed N] [FILE...]

The build compiles several files of a target at a time, so one file may hide the missing include of another. Without
FILE this checks a hundredth of the files, drawn by a seed, and all of them with MULTIPANDA_FULL=1 in the environment
(one file takes five seconds). Files whose generated headers the build has not made are left out.
"""

import argparse
import concurrent.futures
import functools
import os
import pathlib
import random
import re
import shlex
import subprocess
import sys
import time

from compile_database import single_files


def syntax_command(entry):
    """The compiler's command for a check of the syntax alone: no cache, no output."""
    words = shlex.split(entry["command"])
    first = next(
        i for i, word in enumerate(words) if re.search(r"(\+\+|g?cc|clang)(-\d+)?$", word) and "ccache" not in word
    )
    words = words[first:]
    for option in ("-o", "-MF", "-MT"):
        while option in words:
            place = words.index(option)
            del words[place : place + 2]
    return [word for word in words if word not in ("-c", "-MD") and not re.fullmatch(r"-O\d", word)] + ["-fsyntax-only"]


@functools.cache
def has_headers(folder):
    return any(pathlib.Path(folder).rglob("*.h*"))


def generated_headers_are_there(entry):
    """Whether the build has made the headers of the ROS messages that the file may include."""
    return all(map(has_headers, re.findall(r"(?<=[ I])/\S*/rosidl_generator_cpp(?= |$)", entry["command"])))


def check(entry):
    begin = time.monotonic()
    result = subprocess.run(syntax_command(entry), cwd=entry["directory"], capture_output=True, text=True, check=False)
    return result, time.monotonic() - begin


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("build", type=pathlib.Path)
    parser.add_argument("files", nargs="*", type=pathlib.Path)
    parser.add_argument("--seed", type=int, default=1, help="seed of the drawn files (default 1)")
    options = parser.parse_args()

    entries = {entry["file"]: entry for entry in single_files(options.build)}  # a file of several targets counts once
    usable = {file: entry for file, entry in entries.items() if generated_headers_are_there(entry)}
    chosen = sorted(usable)
    if options.files:
        chosen = [str(file.resolve()) for file in options.files]
        unknown = [file for file in chosen if file not in usable]
        if unknown:
            print(f"{unknown[0]}: not compiled by the build in {options.build}")
            return 1
    elif not os.environ.get("MULTIPANDA_FULL"):
        chosen = sorted(random.Random(options.seed).sample(chosen, max(1, len(chosen) // 100)))
    if not chosen:
        print("none of these files is in the build, nothing would be checked")
        return 1

    failed, slowest = 0, (0.0, "")
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        for file, (result, seconds) in zip(chosen, pool.map(check, (usable[file] for file in chosen))):
            slowest = max(slowest, (seconds, file))
            if result.returncode:
                failed += 1
                print(f"{file} does not compile by itself:\n{result.stderr}")
    print(
        f"{len(chosen)} of {len(entries)} files checked (seed {options.seed}), {failed} failed,"
        f" {len(entries) - len(usable)} left out; slowest {slowest[0]:.0f} s: {slowest[1]}"
    )
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
