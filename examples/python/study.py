#!/usr/bin/env python3
"""Runs a study on a pool of processes: how far does an undeclared load pull the hand down, by stiffness?

study.py [--out DIR] [STUDY]
"""

import argparse
import collections
import concurrent.futures
import pathlib
import statistics

import multipanda as mp


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    default = pathlib.Path(__file__).resolve().parent.parent / "studies" / "stiffness.yaml"
    parser.add_argument("study", nargs="?", default=default)
    parser.add_argument("--out", default="runs/study_stiffness")
    arguments = parser.parse_args()

    def pool():  # a function, so that a pool that a killed worker has broken is replaced
        return concurrent.futures.ProcessPoolExecutor(2)

    found = mp.study(arguments.study, pool, out=arguments.out, page=False, progress=print)
    heights = collections.defaultdict(list)
    for row in found.rows:
        heights[row["stiffness"], row["load"]].append(row["arm/flange_end_z_m"])
    for stiffness in ("200", "400", "800"):
        sunk_m = statistics.mean(heights[stiffness, "none"]) - statistics.mean(heights[stiffness, "half"])
        print(f"{stiffness} N/m: the hand sinks by {1e3 * sunk_m:.1f} mm")
    print(f"{len(found.rows)} runs, {found.skipped} of them done before; table: {found.table}")


if __name__ == "__main__":
    main()
