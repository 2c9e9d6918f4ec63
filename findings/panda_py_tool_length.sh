#!/bin/bash
# Guess: in panda-py the inverse kinematics of the pose of a joint configuration are that configuration.
# So it is: fk and ik assume hands of different lengths, 0.4 mm apart. Every fk then ik, as a program does that nudges the
# arm, moves the tool along its own axis by that much, ten of them by 4 mm: enough to lose or to double a contact force.
# The right number: the arm's published Denavit-Hartenberg parameters with the 0.1034 m of the hand. ik agrees, fk does not.
# Seen with panda-python 1.1.1 on 2026-11-29.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder"
"$folder/bin/pip" install -q --disable-pip-version-check panda-python==1.1.1 numpy==2.4.6
"$folder/bin/python" - <<'END'
import numpy as np
import panda_py

A = [0, 0, 0, 0.0825, -0.0825, 0, 0.088]
D = [0.333, 0, 0.316, 0, 0.384, 0, 0]
ALPHA = np.array([0, -1, 1, 1, -1, 1, 1]) * np.pi / 2


def step(a, d, alpha, theta):
    c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
    return np.array([[c, -s, 0, a], [s * ca, c * ca, -sa, -d * sa], [s * sa, c * sa, ca, d * ca], [0, 0, 0, 1]])


def forward(q):
    pose = np.eye(4)
    for row in zip(A, D, ALPHA, q):
        pose = pose @ step(*row)
    return pose @ step(0, 0.107 + 0.1034, 0, -np.pi / 4)


q = np.array([0, -np.pi / 4, 0, -3 * np.pi / 4, 0, np.pi / 2, np.pi / 4])
along_tool = (np.linalg.inv(forward(q)) @ panda_py.fk(q))[:3, 3]
solved = panda_py.ik(panda_py.fk(q), q, q[6])
print(f"fk lies {along_tool.round(6)} m from the right pose, in its axes")
print(f"ik solves the pose that it is given to {np.abs(forward(solved) - panda_py.fk(q)).max():.1e}")
now = q
for _ in range(10):
    now = panda_py.ik(panda_py.fk(now), now, now[6])
moved = np.linalg.norm(forward(now)[:3, 3] - forward(q)[:3, 3])
print(f"ten times ik(fk(q)): the tool has moved by {moved * 1e3:.2f} mm, q by up to {np.abs(now - q).max():.4f} rad; right: 0")
assert np.abs(forward(solved) - panda_py.fk(q)).max() < 1e-6
assert abs(np.linalg.norm(along_tool) - 4e-4) < 2e-5 and moved > 3e-3, "this has changed"
END
