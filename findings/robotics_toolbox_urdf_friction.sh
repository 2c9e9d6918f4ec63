#!/bin/bash
# Guess: the Robotics Toolbox takes damping and friction of a URDF's joint as what they are, viscous and dry friction, which
# its links have a place for each (B and Tc), or leaves both out.
# So it is: it puts the dry friction (N m) into the place of the viscous one (N m s/rad), which rne and accel count, and drops
# the damping. A joint of 2 N m dry friction that turns at 4 rad/s is said to need 8 N m, at 0.01 rad/s 0.02 N m; one of
# damping alone nothing.
# The right number: damping times velocity plus friction with the velocity's sign, as URDF defines them.
# Seen with roboticstoolbox-python 1.5.0 on 2026-11-30.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder"
"$folder/bin/pip" install -q --disable-pip-version-check roboticstoolbox-python==1.5.0 numpy==2.4.6
"$folder/bin/python" -W ignore - <<'END'
import pathlib
import tempfile

import numpy as np
import roboticstoolbox


def torque(damping, friction, velocity):
    inertia = '<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/>'
    wheel = f'<link name="wheel"><inertial><mass value="1"/>{inertia}</inertial></link>'
    ends = '<parent link="base"/><child link="wheel"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="99" velocity="9"/>'
    joint = f'<joint name="j" type="revolute">{ends}<dynamics damping="{damping}" friction="{friction}"/></joint>'
    with tempfile.TemporaryDirectory() as folder:
        file = pathlib.Path(folder) / "wheel.urdf"
        file.write_text(f'<robot name="r"><link name="base"/>{wheel}{joint}</robot>')
        robot = roboticstoolbox.Robot.URDF(str(file))
    link = robot.links[-1]
    said = robot.rne(np.zeros(1), np.array([velocity]), np.zeros(1)).item()
    return said, link.B, np.abs(link.Tc).max()


for damping, friction in ((0.0, 2.0), (3.0, 0.0), (3.0, 2.0)):
    for velocity in (4.0, 0.01, -0.01):
        said, viscous, dry = torque(damping, friction, velocity)
        right = damping * velocity + friction * np.sign(velocity)
        print(f"damping {damping}, friction {friction}, {velocity:5.2f} rad/s: {said:6.3f} N m, right {right:6.3f}", end="; ")
        print(f"link: B {viscous}, Tc {dry}")
        assert abs(abs(said) - friction * abs(velocity)) < 1e-9 and viscous == friction and dry == 0, "this has changed"
END
