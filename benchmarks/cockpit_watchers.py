#!/usr/bin/env python3
"""Cycle times of the loop while cockpit pages are connected: with four of them, relative to none.

PYTHONPATH=python .venv/bin/python benchmarks/cockpit_watchers.py build/multipanda     # needs an idle computer

Both are measured in turns within one run, so what else the computer does shifts both alike. The pages are processes
that take 60 states a second and every cycle of 14 numbers.
"""

import argparse
import os
import pathlib
import subprocess
import sys
import tempfile
import time

import multipanda as mp
import numpy as np

ROOT = pathlib.Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests/cockpit"))
from page_client import Page

PAGES = 4


def watch(address):
    """Simulates a page until terminated. Reads numbers without parsing them, since a browser is faster."""
    page = Page(address, timeout=60)
    page.ask("subscribe", rate_hz=60)
    page.ask("plot", fields=["left/q_rad", "right/q_rad"])
    while True:
        page.receive()
        page.states.clear()
        page.plots.clear()
        page.news.clear()


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("program")
    parser.add_argument("--turns", type=int, default=6, help="turns of each kind")
    parser.add_argument("--watch", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.watch:
        watch(options.watch)
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "run.sock"
        command = [options.program, "run", "two_arms", "--no-timeline", "--cockpit", "0", "--socket", path]
        process = subprocess.Popen(
            [*command, "--until-input-ends"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        address = next(line for line in process.stdout if line.startswith("http://")).strip()
        times = {0: [], PAGES: []}
        with mp.connect(path) as run:
            for turn in range(2 * options.turns):
                count = PAGES if turn % 2 else 0
                arguments = [sys.executable, __file__, options.program, "--watch", address]
                pages = [subprocess.Popen(arguments, env=os.environ) for _ in range(count)]
                time.sleep(5)
                times[count].append(run.history(3)["total_ns"].ravel() * 1e-3)
                for page in pages:
                    page.terminate()
                    page.wait()
                time.sleep(0.5)
        process.stdin.close()
        process.wait()
    for share in (0.5, 0.99):
        quantile = {n: [float(np.quantile(part, share)) for part in parts] for n, parts in times.items()}
        spread = max(quantile[0]) / min(quantile[0])
        print(
            f"quantile {share}: without pages {np.median(quantile[0]):.1f} us (turns differ by {spread:.2f}), "
            f"with {PAGES} {np.median(quantile[PAGES]):.1f} us, "
            f"ratio {np.median(quantile[PAGES]) / np.median(quantile[0]):.2f}"
        )


if __name__ == "__main__":
    main()
