#!/usr/bin/env python3
"""A policy at 50 Hz: every answer of it is sent as the newest set-point. Silence means hold.

With --chunks the policy answers ten times a second, with its next 16 actions and their times. The run keeps them, so
the motion goes on in time while the next ones are computed.

PYTHONPATH=python .venv/bin/python examples/python/stream_policy.py
PYTHONPATH=python .venv/bin/python examples/python/stream_policy.py --chunks
"""

import argparse
import math
import time

import multipanda as mp

RATE_HZ = 50
CHUNK = 16
RADIUS_M = 0.03


def policy(start, s):
    """A pose on a circle that begins and ends at rest, s from 0 to 1; a learned policy would look at the state."""
    s = min(1.0, s)
    angle = 2 * math.pi * (s - math.sin(2 * math.pi * s) / (2 * math.pi))
    return start.moved(y=RADIUS_M * math.sin(angle), z=RADIUS_M * (1 - math.cos(angle)))


def send_each(stream, start, seconds):
    count, due = round(seconds * RATE_HZ), time.monotonic()
    for k in range(count + 1):
        stream.send(policy(start, k / count))
        yield
        due += 1 / RATE_HZ
        time.sleep(max(0.0, due - time.monotonic()))


def send_chunks(stream, start, seconds, run):
    begin = run.state().t_s
    while (now := run.state().t_s) < begin + seconds:
        times = [now + (k + 1) / RATE_HZ for k in range(CHUNK)]
        stream.send([policy(start, (t - begin) / seconds) for t in times], at=times)  # replaces what is not due
        for _ in range(5):
            yield
            time.sleep(0.02)  # the policy computes


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=3, help="duration of the circle")
    parser.add_argument("--chunks", action="store_true", help="send 16 actions at once, with their times")
    options = parser.parse_args()
    with mp.run("one_arm") as run:
        arm = run.arms["arm"]
        start = arm.state.pose
        highest = 0.0
        with run["cartesian"].stream("pose") as stream:
            chunks = send_chunks(stream, start, options.seconds, run)
            for _ in chunks if options.chunks else send_each(stream, start, options.seconds):
                highest = max(highest, arm.state.pose.position_m[2] - start.position_m[2])
            print("received:", stream.counts()["received"])
        print("held:", arm.state.held)
    print(f"highest: {1e3 * highest:.0f} mm above the start")


if __name__ == "__main__":
    main()
