#!/usr/bin/env python3
"""Compares a measured log with the simulation of the same motion, quantity by quantity.

PYTHONPATH=python .venv/bin/python examples/python/compare_log.py LOG    a log of a real arm, of the same scene
PYTHONPATH=python .venv/bin/python examples/python/compare_log.py        a virtual arm stands for it
"""

import argparse

import multipanda as mp


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("log", nargs="?", help="the measured log, or its folder")
    parser.add_argument("--scene", default="one_arm", help="the scene of both")
    parser.add_argument("--seconds", type=float, default=4, help="duration of both")
    parser.add_argument("--record", default="runs", help="folder for logs and the page")
    options = parser.parse_args()

    real = options.log
    if real is None:  # the arm's own control interface stands between scene and loop, as with a real arm
        real = mp.play(options.scene, backend="virtual", record=options.record, seconds=options.seconds).log
    simulated = mp.play(options.scene, record=options.record, seconds=options.seconds).log

    result = mp.compare(real, simulated, out=f"{options.record}/comparison")
    for arm in result["arms"]:
        for name, quantity in arm["quantities"].items():
            if quantity["available"]:
                print(f"{arm['arm']} {name}: rmse {quantity['rmse_mean']:.2g} {quantity['unit']}")
    print(f"page: {options.record}/comparison/report.html")


if __name__ == "__main__":
    main()
