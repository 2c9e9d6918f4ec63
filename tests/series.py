#!/usr/bin/env python3
"""Runs long series of a GoogleTest program in full: a study per series, a run per case (core/testing/series.hpp).

    series.py PROGRAM TESTS Suite.Test... [--out FOLDER] [--executor slurm] [--workers N]

PROGRAM is multipanda. Cases whose result is in the folder (default: studies/NAME beside PROGRAM) are not run again, so
that a stopped series goes on. After the last case, each test checks what all cases have recorded.
"""

import argparse
import json
import os
import pathlib
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "python"))
os.environ["PYTHONPATH"] = str(ROOT / "python")  # of workers

import multipanda as mp


def cases_of(tests, name):
    """How many cases the series `name` of the program `tests` has."""
    with tempfile.TemporaryDirectory() as folder:
        report = pathlib.Path(folder) / "report.json"
        words = [tests, f"--gtest_filter={name}", f"--gtest_output=json:{report}"]
        environment = {**os.environ, "MULTIPANDA_SERIES": "count"}
        done = subprocess.run(words, env=environment, capture_output=True, text=True, check=False)
        found = json.loads(report.read_text()) if report.exists() else {"testsuites": []}
    counts = [test.get("cases") for suite in found["testsuites"] for test in suite["testsuite"]]
    if done.returncode != 0 or len(counts) != 1 or not counts[0] or int(counts[0]) == 0:
        raise SystemExit(f"FAILED: {name} is no series of {tests}: {done.stdout[-2000:]}{done.stderr[-2000:]}")
    return int(counts[0])


def study_of(tests, name, cases):
    """The text of the study file."""
    study = {
        "title": name,
        "program": ["env", "MULTIPANDA_SERIES=case:{seed}", str(tests), f"--gtest_filter={name}"]
        + ["--gtest_output=json:{out}/result.json"],
        "files": [str(ROOT / folder) for folder in ("config", "models", "experiments/scenes")],  # scenes and robots
        "seeds": {"first": 0, "count": cases},
    }
    return json.dumps(study, indent=1)  # which is YAML


def whole(tests, name, rows, folder):
    """Whether the test accepts what all cases have recorded together, and what it says."""
    names = dict.fromkeys(figure for row in rows for figure in row if figure not in ("seed", "success"))
    lines = ["cases " + " ".join(str(row["seed"]) for row in rows)]
    lines += [f"{figure} " + " ".join(repr(row[figure]) for row in rows if figure in row) for figure in names]
    table = folder / "figures.txt"
    table.write_text("\n".join(lines) + "\n")
    environment = {**os.environ, "MULTIPANDA_SERIES": f"figures:{table}"}
    words = [tests, f"--gtest_filter={name}", "--gtest_brief=1"]
    done = subprocess.run(words, env=environment, capture_output=True, text=True, check=False)
    return done.returncode == 0, done.stdout.strip()


def run(tests, name, folder, options):
    """Faults of a series, in words."""
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / "study.yaml"
    file.write_text(study_of(tests, name, cases_of(tests, name)))
    print(f"{name}:", flush=True)
    found = mp.study(file, options.executor, out=folder / "results", workers=options.workers, progress=Progress())
    faults = [f"{name}, case {entry['seed']} has no result: {entry['error']}" for entry in found.errors]
    summary = json.loads((found.folder / "study.json").read_text())
    faults += [f"{name}, case {entry['seed']}: {entry['fault']}" for entry in summary["faults"]]
    if not faults:
        accepted, said = whole(tests, name, found.rows, folder)
        print(said, flush=True)
        faults = [] if accepted else [f"{name}, all cases together: {said}"]
    print(f"{name}: {len(found.rows)} cases, {found.skipped} of them done before: {found.page}", flush=True)
    return faults


class Progress:
    """Prints how far it is, at most every tenth of the runs."""

    def __init__(self):
        self._told = -1

    def __call__(self, text):
        words = text.split()
        if words[1:2] == ["of"] and words[3:5] != ["runs", "were"]:
            tenth = 10 * int(words[0]) // int(words[2])
            if tenth == self._told:
                return
            self._told = tenth
        print("  " + text, flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("program", type=pathlib.Path)
    parser.add_argument("tests", type=pathlib.Path)
    parser.add_argument("names", nargs="+")
    parser.add_argument("--out", type=pathlib.Path)
    parser.add_argument("--executor", default="local", help="local, dask:ADDRESS or slurm")
    parser.add_argument("--workers", type=int)
    options = parser.parse_args()
    program, tests = options.program.absolute(), options.tests.absolute()
    os.environ["MULTIPANDA_PROGRAM"] = str(program)
    out = (options.out or program.parent / "studies" / tests.name).absolute()
    faults = []
    for name in options.names:
        faults += run(tests, name, out / name.replace("/", "_"), options)
    for fault in faults:
        print(f"FAILED: {fault}")
    sys.exit(1 if faults else 0)


if __name__ == "__main__":
    main()
