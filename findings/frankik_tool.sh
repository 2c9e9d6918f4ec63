#!/bin/bash
# Guess: forward of frankik without a tool is the flange's pose and with a tool's pose the tool's, as inverse takes them.
# So it is: without a tool, forward gives the pose of Franka's hand, 103.4 mm further and turned by 45 degrees, while inverse takes
# the flange's. With a tool of length L forward gives a point 206.8 mm - L beyond the flange: the longer the tool, the
# shorter the arm. Only for Franka's own hand both agree, which is the example of its page. A tool of 200 mm that is nudged by
# inverse(forward(q)) jumps by 193 mm.
# The right number: the arm's published Denavit-Hartenberg parameters times the tool's pose; inverse agrees.
# Seen with frankik 1.0.1 on 2026-11-30.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder"
"$folder/bin/pip" install -q --disable-pip-version-check frankik==1.0.1 numpy==2.3.5
"$folder/bin/python" - <<'END'
import frankik
import numpy as np

A = [0, 0, 0, 0.0825, -0.0825, 0, 0.088]
D = [0.333, 0, 0.316, 0, 0.384, 0, 0]
ALPHA = np.array([0, -1, 1, 1, -1, 1, 1]) * np.pi / 2


def step(a, d, alpha, theta):
    c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
    return np.array([[c, -s, 0, a], [s * ca, c * ca, -sa, -d * sa], [s * sa, c * sa, ca, d * ca], [0, 0, 0, 1]])


def flange(q):
    pose = np.eye(4)
    for row in zip(A, D, ALPHA, q):
        pose = pose @ step(*row)
    return pose @ step(0, 0.107, 0, 0)


q = np.array([0.1, -np.pi / 4, 0.2, -3 * np.pi / 4, 0.1, np.pi / 2, np.pi / 4 + 0.1])
solver = frankik.FrankaKinematics(frankik.RobotType.PANDA)
said = np.linalg.inv(flange(q)) @ solver.forward(q)
turned = np.degrees(np.arctan2(said[1, 0], said[0, 0]))
print(f"no tool: forward is {said[2, 3] * 1e3:.1f} mm beyond the flange, turned by {turned:.0f} deg; right 0, 0")
assert np.allclose(solver.inverse(flange(q), q0=q, q7=q[6]), q, atol=1e-6)
assert abs(said[2, 3] - 0.1034) < 1e-6 and abs(turned + 45) < 1e-6, "this has changed"
for length in (0.05, 0.1034, 0.2):
    tool = step(0, length, 0, -np.pi / 4)
    right = flange(q) @ tool
    forward = solver.forward(q, tcp_offset=tool)
    beyond = (np.linalg.inv(flange(q)) @ forward)[2, 3]
    assert np.allclose(solver.inverse(right, q0=q, tcp_offset=tool, q7=q[6]), q, atol=1e-6)
    nudged = solver.inverse(forward, q0=q, tcp_offset=tool, q7=q[6])
    jump = np.linalg.norm((flange(nudged) @ tool)[:3, 3] - right[:3, 3])
    print(f"tool of {length * 1e3:.1f} mm: forward is {beyond * 1e3:.1f} mm beyond the flange;", end=" ")
    print(f"inverse(forward(q)) moves the tool by {jump * 1e3:.1f} mm, right 0")
    assert abs(beyond - (0.2068 - length)) < 1e-5 and abs(jump - abs(0.2068 - 2 * length)) < 1e-3, "this has changed"
END
