#!/usr/bin/env python3
"""Checks that refinement improves the simulation of tasks 1 to 5 for arms with unknown plants.

    hidden_plants_test.py PROGRAM                 seed 1, and task 4 of seed 2; all of 20 seeds with MULTIPANDA_FULL=1
    hidden_plants_test.py PROGRAM --seeds 1 20 --table FILE.md

Every seed draws the plants of virtual arms in another process (`virtual-arm --hidden SEED`); `refine` uses only their
logs. Limits: the ratio of task 4's force RMSE after and before refinement has a median of at most 0.5 and a worst value
of at most 0.8. No figure of any task and arm grows by more than twice its spread over repeats.
"""

import argparse
import json
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile

VARIANTS = {"task-1": None, "task-2": None, "task-3": "k10", "task-4": "mu03_k10", "task-5": "known"}
REPEATS = 3
MEDIAN, WORST = 0.5, 0.8
FULL = os.environ.get("MULTIPANDA_FULL") == "1"


def refine(program, task, seed, folder):
    """The result of `refine --json` for one task and seed."""
    words = [
        program,
        "refine",
        task,
        "--hidden",
        str(seed),
        "--repeats",
        str(REPEATS),
        "--no-page",
        "--json",
        "--out",
        str(folder),
    ]
    if VARIANTS[task]:
        words += ["--variant", VARIANTS[task]]
    done = subprocess.run(words, capture_output=True, text=True, timeout=900, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"{' '.join(words[1:])} ended with {done.returncode}:\n{done.stderr[-3000:]}")
    return json.loads(done.stdout)


def changes_of(results):
    """Rows of (task, seed, arm, change) of the last round."""
    for (task, seed), result in sorted(results.items()):
        for arm, changes in result["rounds"][-1]["changes"].items():
            for name, change in changes.items():
                yield task, seed, arm, {"name": name, **change}


def table(results):
    """One row per task, arm and quantity over all seeds, in Markdown."""
    groups = {}
    for task, _, arm, change in changes_of(results):
        groups.setdefault((task, arm, change["name"], change["unit"]), []).append(change)
    lines = [
        "| task | arm | quantity | before, median | after, median | after/before: median | worst | worse |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for (task, arm, name, unit), changes in groups.items():
        ratios = [c["ratio"] for c in changes]
        lines.append(
            f"| {task} | {arm} | {name} [{unit}] | {statistics.median(c['before'] for c in changes):.3g} | "
            f"{statistics.median(c['after'] for c in changes):.3g} | {statistics.median(ratios):.2f} | "
            f"{max(ratios):.2f} | {sum(c['worse'] for c in changes)} of {len(changes)} |"
        )
    return "\n".join(lines) + "\n"


def verdicts(results):
    """(failures, lines to print)."""
    lines, failures = [], []
    ratios = [c["ratio"] for task, _, _, c in changes_of(results) if task == "task-4" and c["name"] == "F_EE"]
    if not ratios:
        return [], []
    median, worst = statistics.median(ratios), max(ratios)
    lines.append(
        f"task 4, force RMSE after/before: median {median:.3f} (at most {MEDIAN}), worst {worst:.3f} (at most {WORST})"
    )
    if median > MEDIAN or worst > WORST:
        failures.append(lines[-1])
    for task, seed, arm, change in changes_of(results):
        if change["worse"]:
            text = (
                f"{task}, seed {seed}, {arm}: {change['name']} grew from {change['before']:.4g} "
                f"to {change['after']:.4g} {change['unit']}, spread {change['spread']:.3g}"
            )
            lines.append("worse: " + text)
            failures.append(text)
    return failures, lines


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("program")
    parser.add_argument("--seeds", nargs=2, type=int, metavar=("FIRST", "LAST"))
    parser.add_argument("--tasks", nargs="+", default=list(VARIANTS))
    parser.add_argument("--table", type=pathlib.Path)
    parser.add_argument("--results", type=pathlib.Path, help="JSON file of all results; new ones are added")
    arguments = parser.parse_args()
    first, last = arguments.seeds or (1, 20 if FULL else 1)
    jobs = [(task, seed) for seed in range(first, last + 1) for task in arguments.tasks]
    if not arguments.seeds and not FULL:
        jobs.append(("task-4", 2))
    results = {}
    if arguments.results and arguments.results.exists():
        results = {(r["task"], r["seed"]): r["result"] for r in json.loads(arguments.results.read_text())}
    for task, seed in [job for job in jobs if job not in results]:
        with tempfile.TemporaryDirectory() as folder:
            results[task, seed] = refine(arguments.program, task, seed, folder)
        forces = [
            f"{arm} {changes['F_EE']['ratio']:.2f}"
            for arm, changes in results[task, seed]["rounds"][-1]["changes"].items()
        ]
        print(f"{task}, seed {seed}: force after/before {', '.join(forces)}", flush=True)
        if arguments.results:
            arguments.results.write_text(
                json.dumps([{"task": t, "seed": s, "result": r} for (t, s), r in results.items()])
            )
    print(table(results))
    if arguments.table:
        arguments.table.write_text(table(results))
    failures, lines = verdicts(results)
    print("\n".join(lines))
    if failures:
        print(f"FAILED: {len(failures)}")
        sys.exit(1)


if __name__ == "__main__":
    main()
