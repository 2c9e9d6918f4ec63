#!/bin/bash
# Guess: the force sensor of a joint in PyBullet (enableJointForceTorqueSensor) gives the wrench at that joint, in its axes, as a
# sensor between flange and tool does.
# So it is: the moments are about the center of mass of the link behind it, and all is in the axes of that link's inertia.
# A tool of 2 kg whose center of mass lies 0.2 m aside shows no moment at all; the weight of a tool whose inertia is
# written in turned axes points aside. setPhysicsEngineParameter(jointFeedbackMode=JOINT_FEEDBACK_IN_JOINT_FRAME) moves the
# moments to the joint; the axes stay those of the inertia.
# The right number: m g, and the lever times m g, in the joint's axes.
# Seen with pybullet 3.2.7 on 2026-11-30.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder"
"$folder/bin/pip" install -q --disable-pip-version-check pybullet==3.2.7 numpy==2.4.6
"$folder/bin/python" - "$folder" <<'END' 2>/dev/null
import math
import pathlib
import sys

import numpy as np
import pybullet as bullet

MASS, GRAVITY = 2.0, 9.81
LEVER = np.array([0.1, 0.2, 0.3])
bullet.connect(bullet.DIRECT)


def sensed(name, mode, turned):
    inertia = '<inertia ixx="0.02" iyy="0.03" izz="0.04" ixy="0" ixz="0" iyz="0"/>'
    origin = f'<origin xyz="{" ".join(map(str, LEVER))}" rpy="{turned} 0 0"/>'
    base = f'<link name="base"><inertial><mass value="0"/>{inertia}</inertial></link>'
    tool = f'<link name="tool"><inertial>{origin}<mass value="{MASS}"/>{inertia}</inertial></link>'
    joint = '<joint name="sensor" type="fixed"><parent link="base"/><child link="tool"/></joint>'
    file = pathlib.Path(sys.argv[1]) / f"{name}.urdf"
    file.write_text(f'<robot name="r">{base}{tool}{joint}</robot>')
    bullet.resetSimulation()
    bullet.setGravity(0, 0, -GRAVITY)
    if mode is not None:
        bullet.setPhysicsEngineParameter(jointFeedbackMode=mode)
    robot = bullet.loadURDF(str(file), useFixedBase=True, flags=bullet.URDF_USE_INERTIA_FROM_FILE)
    bullet.enableJointForceTorqueSensor(robot, 0, True)
    for _ in range(100):
        bullet.stepSimulation()
    return np.array(bullet.getJointState(robot, 0)[2])


force = np.array([0, 0, MASS * GRAVITY])  # of the flange on the tool
moment = np.cross(LEVER, force)
right = np.concatenate([force, moment])
about_x = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])  # the joint's axes seen in axes turned by 90 degrees about x
expected = {
    "default": np.concatenate([force, np.zeros(3)]),
    "default, turned inertia": np.concatenate([about_x @ force, np.zeros(3)]),
    "joint frame": right,
    "joint frame, turned inertia": np.concatenate([about_x @ force, about_x @ moment]),
}
for name, seen in expected.items():
    mode = bullet.JOINT_FEEDBACK_IN_JOINT_FRAME if "joint" in name else None
    got = sensed(name.replace(" ", "_"), mode, math.pi / 2 if "turned" in name else 0)
    print(f"{name}: force {got[:3].round(2) + 0.0} N, moment {got[3:].round(2) + 0.0} N m; right {force}, {moment.round(2)}")
    assert np.allclose(got, seen, atol=1e-3), "this has changed"
END
