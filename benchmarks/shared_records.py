#!/usr/bin/env python3
"""Figures of the shared records: cost of a read, its age, and the loop's cycle times with a busy client.

PYTHONPATH=python .venv/bin/python benchmarks/shared_records.py     # needs a computer that does nothing else

Everything that is compared is measured in turns within one run, so what else the computer does shifts both alike.
"""

import argparse
import time

import multipanda as mp
import numpy as np

PERIOD_NS = 1_000_000


def cost_us(call, batches=200, count=20):
    """Median and best over batches [us]."""
    costs = []
    for _ in range(batches):
        begin = time.perf_counter()
        for _ in range(count):
            call()
        costs.append(1e6 * (time.perf_counter() - begin) / count)
    return float(np.median(costs)), min(costs)


def ages_us(run, count):
    """Ages of records when an iterator returns them [us], since the start of their cycle."""
    with run.records() as records:
        for _ in range(20):
            next(records)
        return [1e6 * next(records).age_s for _ in range(count)]


def lateness_us(count):
    """Lateness of a bare 1 ms timer in the same process [us]."""
    late, due = [], time.monotonic_ns() + PERIOD_NS
    for _ in range(count):
        time.sleep(max(0, due - time.monotonic_ns()) * 1e-9)
        late.append(1e-3 * (time.monotonic_ns() - due))
        due += PERIOD_NS
    return late


def wait_busy(seconds):
    """Holds the interpreter's lock in a loop of Python."""
    end, count = time.monotonic() + seconds, 0
    while time.monotonic() < end:
        count += 1


def cycles_us(run, wait, seconds):
    """Durations of the loop's cycles while this process waits [us]."""
    wait(seconds)
    return run.history(seconds)["total_ns"].ravel() * 1e-3


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=3, help="duration of each turn (at most 3.5)")
    parser.add_argument("--turns", type=int, default=4, help="turns of each kind")
    options = parser.parse_args()
    with mp.run("four_arms") as run:
        while run.state().cycle < 200:
            time.sleep(0.01)
        print("reading one record of four arms [us]: median, best")
        for name, call in (
            ("run.record()", run.record),
            ("run.state()", run.state),
            ("by a request, for comparison", lambda: run.ask({"do": "state"})),
        ):
            batches = 5 if "request" in name else 200
            print(f"  {name}: {', '.join(f'{cost:.1f}' for cost in cost_us(call, batches))}")

        records, timer = [], []
        for _ in range(options.turns):
            count = round(250 * options.seconds)
            records += ages_us(run, count)
            timer += lateness_us(count)
        age, late = np.percentile(records, [50, 99]), np.percentile(timer, [50, 99])
        print("age of a record when it is read, and lateness of a bare 1 ms timer [us]: median, p99")
        print(f"  record: {age[0]:.0f}, {age[1]:.0f}; timer: {late[0]:.0f}, {late[1]:.0f}")

        turns = {"idle": [], "busy": []}
        for _ in range(options.turns):
            for kind, wait in (("idle", time.sleep), ("busy", wait_busy)):
                turns[kind].append(cycles_us(run, wait, options.seconds))
        print("cycles of the loop while this client sleeps, and while it holds the interpreter's lock [us]")
        for name, share in (("median", 50), ("p99.9", 99.9)):
            idle, busy = (np.array([np.percentile(turn, share) for turn in turns[kind]]) for kind in turns)
            noise = idle.max() / idle.min()
            print(
                f"  {name}: idle {np.median(idle):.1f}, busy {np.median(busy):.1f}, "
                f"ratio {np.median(busy) / np.median(idle):.2f}; idle turns differ by {noise:.2f}"
            )


if __name__ == "__main__":
    main()
