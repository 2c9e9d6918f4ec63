#!/usr/bin/env python3
"""Runs experiments as a user would, unpaced and with one repeat, and checks the results against their limits.

    experiments_test.py PROGRAM NAME...

Runs a seeded tenth of each experiment's variants with limits (at least one). With MULTIPANDA_FULL set, all variants run
as well, as a study with a run per variant (docs/studies.md), in studies/NAME beside the program.
"""

import json
import os
import pathlib
import random
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "python"))
os.environ["PYTHONPATH"] = str(ROOT / "python")  # of workers

import multipanda as mp


def variants_of(program, name):
    listed = json.loads(
        subprocess.run([program, "experiment", "list", "--json"], capture_output=True, check=True, text=True).stdout
    )
    return next(entry["variants"] for entry in listed if entry["name"] == name)


def chosen(program, name):
    names = [v["name"] for v in variants_of(program, name) if v["judged"]]
    return sorted(random.Random(f"{name} 1").sample(names, max(1, round(len(names) / 10))))


def judged(name, results):
    """Faults of results against their limits, which are checked again from the runs' own figures."""
    faults = []
    for row in results["limits"]:
        mine = [
            r["metrics"].get(row["metric"])
            for r in results["runs"]
            if (r["plant"], r["variant"]) == (row["plant"], row["variant"])
        ]
        held = all(
            x is not None and (x <= row["limit"] if row["bound"] == "at_most" else x >= row["limit"]) for x in mine
        )
        if not mine or held != row["passed"]:
            faults.append(f"{name}: the result of {row} does not follow from the figures {mine}")
    return faults + [f"{name}: {problem}" for problem in results["problems"]]


def study_all(program, name):
    """Faults of all variants, each a run of a study."""
    os.environ["MULTIPANDA_PROGRAM"] = os.path.abspath(program)
    names = [v["name"] for v in variants_of(program, name)]
    folder = pathlib.Path(program).absolute().parent / "studies" / name
    folder.mkdir(parents=True, exist_ok=True)
    axis = {"name": "variant", "key": "only", "values": names}
    (folder / "study.yaml").write_text(json.dumps({"title": name, "experiment": name, "axes": [axis]}))
    found = mp.study(folder / "study.yaml", out=folder / "results")
    faults = [f"{name}: no result: {entry}" for entry in found.errors]
    for row, path in zip(found.rows, found.files, strict=True):
        results = json.loads(path.read_text())["details"]
        faults += judged(name, results)
        if {r["variant"] for r in results["runs"]} != {row["variant"]} or row["success"] != results["passed"]:
            faults.append(f"{name}: the result of {row['variant']} is one of {results['runs']}")
    print(f"{name}: {len(found.rows)} variants, {found.skipped} of them done before: {found.page}")
    return faults


def check(program, name):
    only = chosen(program, name)
    with tempfile.TemporaryDirectory() as folder:
        words = [
            program,
            "experiment",
            name,
            "--fast",
            "--repeats",
            "1",
            "--json",
            "--out",
            folder,
            "--only",
            ",".join(only),
        ]
        done = subprocess.run(words, capture_output=True, text=True, timeout=900)
        faults = []
        try:
            results = json.loads(done.stdout)
        except ValueError:
            return [f"{name}: no JSON on standard output (exit code {done.returncode}):\n{done.stderr}"]
        if {r["variant"] for r in results["runs"]} != set(only):
            faults.append(f"{name}: requested {only}, ran {sorted({r['variant'] for r in results['runs']})}")
        faults += judged(name, results)
        if results["passed"] != (not results["problems"]) or (done.returncode == 0) != results["passed"]:
            faults.append(
                f"{name}: exit code {done.returncode}, passed {results['passed']}, problems {results['problems']}"
            )
        page = pathlib.Path(results["report"])
        if not page.is_file() or "data:image/png" not in page.read_text(encoding="utf-8"):
            faults.append(f"{name}: no page with pictures at {page}")
        for run in results["runs"]:
            if not (page.parent / run["log"]).is_file():
                faults.append(f"{name}: no log {run['log']}")
        return faults


def main():
    program, names = sys.argv[1], sys.argv[2:]
    faults = [fault for name in names for fault in check(program, name)]
    if os.environ.get("MULTIPANDA_FULL"):
        faults += [fault for name in names for fault in study_all(program, name)]
    print("\n".join(faults) or f"{', '.join(names)}: within the limits")
    sys.exit(1 if faults else 0)


if __name__ == "__main__":
    main()
