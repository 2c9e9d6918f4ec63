#!/bin/bash
# Guess: getLinkState of PyBullet gives the velocity of the link's frame, worldLinkLinearVelocity, to go with the position of that
# frame, worldLinkFramePosition; and calculateJacobian takes its point from the center of mass, as wrappers of it say.
# So it is the other way around: the velocity is that of the center of mass, the Jacobian's point counts from the frame's
# origin. A hand that turns about its own axis at 2 rad/s, its mass 0.1 m aside, is said to move at 0.2 m/s, although its
# frame rests, and damping by that velocity pushes the arm; J(0) times the joint velocity is something else.
# The right number: zero, omega times the distance for the center of mass, and differences of the positions.
# Seen with pybullet 3.2.7 on 2026-11-30.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder"
"$folder/bin/pip" install -q --disable-pip-version-check pybullet==3.2.7 numpy==2.4.6
"$folder/bin/python" - "$folder" <<'END' 2>/dev/null
import pathlib
import sys

import numpy as np
import pybullet as bullet

SPEED, ASIDE, STEP = 2.0, 0.1, 1e-4
inertia = '<inertia ixx="0.02" iyy="0.03" izz="0.04" ixy="0" ixz="0" iyz="0"/>'
base = f'<link name="base"><inertial><mass value="0"/>{inertia}</inertial></link>'
hand = f'<link name="hand"><inertial><origin xyz="{ASIDE} 0 0"/><mass value="1"/>{inertia}</inertial></link>'
ends = '<parent link="base"/><child link="hand"/><origin xyz="0.3 0 0.5"/><axis xyz="0 0 1"/>'
file = pathlib.Path(sys.argv[1]) / "hand.urdf"
file.write_text(f'<robot name="r">{base}{hand}<joint name="j" type="continuous">{ends}</joint></robot>')
bullet.connect(bullet.DIRECT)
robot = bullet.loadURDF(str(file), useFixedBase=True, flags=bullet.URDF_USE_INERTIA_FROM_FILE)


def state(angle):
    bullet.resetJointState(robot, 0, angle, SPEED)
    return bullet.getLinkState(robot, 0, computeLinkVelocity=True, computeForwardKinematics=True)


before, now, after = state(-SPEED * STEP), state(0), state(SPEED * STEP)
said = np.array(now[6])
of_frame = (np.array(after[4]) - np.array(before[4])) / 2 / STEP
of_mass = (np.array(after[0]) - np.array(before[0])) / 2 / STEP
jacobian = np.array(bullet.calculateJacobian(robot, 0, [0, 0, 0], [0.0], [0.0], [0.0])[0])
print(f"worldLinkLinearVelocity {said.round(4)} m/s; Jacobian's for (0, 0, 0) {(jacobian[:, 0] * SPEED).round(4)};", end=" ")
print(f"differences: frame {of_frame.round(4)}, center of mass {of_mass.round(4)};", end=" ")
print(f"right for the frame 0, for the center of mass {SPEED * ASIDE}")
assert np.allclose(of_frame, 0, atol=1e-6) and np.allclose(of_mass, [0, SPEED * ASIDE, 0], atol=1e-4)
assert np.allclose(jacobian[:, 0] * SPEED, 0, atol=1e-6)
assert np.allclose(said, [0, SPEED * ASIDE, 0], atol=1e-6), "this has changed"
END
