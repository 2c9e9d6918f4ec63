#!/bin/bash
# Guess: for a number of steps, jtraj of the Robotics Toolbox gives velocities per step of its time axis, as its sister
# functions quintic, trapezoidal and mtraj do.
# So it is: positions run over the steps, velocities and accelerations over a time of 1. With 51 steps the velocity is 51
# times what the positions do, the acceleration 2,600 times: as a feed-forward it is a kick. The time axis itself is off, too: its
# 51 entries run from 0 to 51, so that a step has 1.02. With an array of times jtraj is right.
# The right number: 15/8 of the mean velocity at the middle of a quintic, and differences of the positions.
# Seen with roboticstoolbox-python 1.5.0 on 2026-11-29.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder"
"$folder/bin/pip" install -q --disable-pip-version-check roboticstoolbox-python==1.5.0 numpy==2.4.6
"$folder/bin/python" - <<'END'
import numpy as np
import roboticstoolbox

STEPS = 51
zero, one = np.zeros(1), np.ones(1)
by_count = roboticstoolbox.jtraj(zero, one, STEPS)
by_time = roboticstoolbox.jtraj(zero, one, np.arange(STEPS))
sister = roboticstoolbox.mtraj(roboticstoolbox.quintic, zero, one, STEPS)
right = 15 / 8 / (STEPS - 1)
for name, motion in (("jtraj, count", by_count), ("jtraj, times", by_time), ("mtraj, count", sister)):
    differences = np.diff(motion.q[:, 0]).max()
    print(f"{name}: t up to {motion.t[-1]:.0f}, velocity up to {motion.qd.max():.4f}, steps up to {differences:.4f}; right {right:.4f}")
    assert abs(differences / right - 1) < 0.01
assert abs(by_time.qd.max() / right - 1) < 0.01 and abs(sister.qd.max() / right - 1) < 0.01
assert abs(by_count.qd.max() - 15 / 8) < 1e-6 and by_count.t[-1] == STEPS, "this has changed"
END
