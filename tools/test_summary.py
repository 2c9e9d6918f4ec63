#!/usr/bin/env python3
"""Prints what the tests of a ctest run came to: test_summary.py build/Testing/Temporary/LastTest.log

Counts the cases of GoogleTest programs and of Python's unittest, and any other test as one. Lists what was skipped with
the reasons, and what passed at its second try only: programs and real time share the computer with strangers, but more
than MOST_SECOND_TRIES of them are a fault. The last line is `N passed, N failed, N skipped`.
"""

import pathlib
import re
import sys

# A test in ctest's log: its name, what it printed, and ctest's verdict.
TEST = re.compile(r"^\d+/\d+ Testing: (\S+)\n(.*?)^Test (Passed|Failed|Skipped|[^\n]*)\.$", re.M | re.S)
GTEST_SKIP = re.compile(r"^\S+:\d+: Skipped\n(.*?)^\[  SKIPPED \] (\S+)", re.M | re.S)
MOST_SECOND_TRIES = 3
RAN = re.compile(r"^\[=+\] (\d+) tests? from .* ran\.|^Ran (\d+) tests? in", re.M)


def tally(name, printed, verdict):
    """(passed, failed, reasons of the skipped cases) of one test."""
    if verdict == "Skipped":
        reasons = re.findall(r"^skipped: (.*)$", printed, re.M)
        return 0, 0, [f"{name}: {reasons[-1] if reasons else 'no reason given'}"]
    skipped = [f"{case}: {' '.join(why.split()) or 'no reason given'}" for why, case in GTEST_SKIP.findall(printed)]
    skipped += [f"{name}: {reason}" for reason in re.findall(r"^skipped: (.*)$", printed, re.M)]
    uncounted = sum(map(int, re.findall(r"\bskipped=(\d+)", printed))) - len(skipped)
    skipped += [f"{name}: see its output"] * max(uncounted, 0)
    ran = sum(int(a or b) for a, b in RAN.findall(printed)) or 1
    failed = len(set(re.findall(r"^\[  FAILED  \] (\S+)", printed, re.M)))
    failed += sum(map(int, re.findall(r"\b(?:failures|errors)=(\d+)", printed)))
    if verdict != "Passed":
        failed = max(failed, 1)
    return max(ran - failed - len(skipped), 0), failed, skipped


def main():
    passed, failed, skipped, second = 0, 0, [], []
    log = pathlib.Path(sys.argv[1])
    text = log.read_text(encoding="utf-8", errors="replace") if log.exists() else ""
    tests = TEST.findall(text)
    names = [name for name, _, _ in tests]
    for name, printed, verdict in {test[0]: test for test in tests}.values():  # the last try of each
        good, bad, reasons = tally(name, printed, verdict)
        passed, failed = passed + good, failed + bad
        skipped += reasons
        if verdict == "Passed" and names.count(name) > 1:
            second.append(name)
    for reason in sorted(set(skipped)):
        print(f"skipped: {reason}")
    for name in second:
        print(f"only at the second try: {name}")
    if len(second) > MOST_SECOND_TRIES:
        print(f"{len(second)} tests needed a second try, more than {MOST_SECOND_TRIES}: this run counts as failed")
        failed += 1
    print(f"{passed} passed, {failed} failed, {len(skipped)} skipped")
    return 1 if failed or not passed else 0


if __name__ == "__main__":
    sys.exit(main())
