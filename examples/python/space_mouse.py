#!/usr/bin/env python3
"""A SpaceMouse leads the hand: it moves while the left button is held. The right button stops the arm.

With --replay no device is needed: its reports come from a pipe, as those of a hand that pushes the cap away for 2 s.

PYTHONPATH=python .venv/bin/python examples/python/space_mouse.py
PYTHONPATH=python .venv/bin/python examples/python/space_mouse.py --replay
"""

import argparse
import contextlib
import os
import struct
import threading
import time

import multipanda as mp


def push(writer):
    """Button down, the cap away from the operator, button up. A device repeats its reports while it is deflected."""
    os.write(writer, struct.pack("<BI", 3, 1))
    end = time.monotonic() + 2
    while time.monotonic() < end:
        os.write(writer, struct.pack("<B6h", 1, 0, -350, 0, 0, 0, 0))
        time.sleep(0.01)
    os.write(writer, struct.pack("<B6h", 1, 0, 0, 0, 0, 0, 0))
    os.write(writer, struct.pack("<BI", 3, 0))


@contextlib.contextmanager
def replayed():
    reader, writer = os.pipe2(os.O_DIRECT)  # keeps reports apart, as a device does
    player = threading.Timer(1, push, [writer])
    yield f"/proc/self/fd/{reader}", player.start
    player.join()
    os.close(writer)
    os.close(reader)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--device", help="its hidraw device; by default the one that is plugged in")
    parser.add_argument("--replay", action="store_true", help="reports from a pipe instead of a device")
    parser.add_argument("--seconds", type=float, help="duration; with a device until Ctrl-C")
    options = parser.parse_args()
    limits = mp.JogLimits(speed_m_per_s=0.05, force_n=15)
    with contextlib.ExitStack() as stack:
        device, begin = stack.enter_context(replayed()) if options.replay else (options.device, lambda: None)
        mouse = stack.enter_context(mp.SpaceMouse(device))
        run = stack.enter_context(mp.run("one_arm", timeline=False))
        arm = run.arms["arm"]
        start = arm.state.pose.position_m
        begin()
        with contextlib.suppress(KeyboardInterrupt):
            mouse.jog(run["cartesian"], limits=limits, seconds=options.seconds or (4 if options.replay else None))
        moved = arm.state.pose.position_m - start
        print("moved: {:.0f} {:.0f} {:.0f} mm".format(*(1e3 * moved)))
        print("held:", arm.state.held)


if __name__ == "__main__":
    main()
