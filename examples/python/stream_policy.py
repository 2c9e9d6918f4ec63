#!/usr/bin/env python3
"""A policy at 50 Hz: every answer of it is sent as the newest set-point. Silence means hold.

PYTHONPATH=python .venv/bin/python examples/python/stream_policy.py
"""

import argparse
import math
import time

import multipanda as mp

RATE_HZ = 50
RADIUS_M = 0.03


def policy(start, seconds):
    """Poses on a circle that begins and ends at rest; a learned policy would look at the state instead."""
    count = round(seconds * RATE_HZ)
    for k in range(count + 1):
        s = k / count
        angle = 2 * math.pi * (s - math.sin(2 * math.pi * s) / (2 * math.pi))
        yield start.moved(y=RADIUS_M * math.sin(angle), z=RADIUS_M * (1 - math.cos(angle)))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=3, help="duration of the circle")
    options = parser.parse_args()
    with mp.run("one_arm") as run:
        arm = run.arms["arm"]
        start = arm.state.pose
        highest = 0.0
        with run["cartesian"].stream("pose") as stream:
            due = time.monotonic()
            for pose in policy(start, options.seconds):
                stream.send(pose)
                highest = max(highest, arm.state.pose.position_m[2] - start.position_m[2])
                due += 1 / RATE_HZ
                time.sleep(max(0.0, due - time.monotonic()))
            print("received:", stream.counts()["received"])
        print("held:", arm.state.held)
    print(f"highest: {1e3 * highest:.0f} mm above the start")


if __name__ == "__main__":
    main()
