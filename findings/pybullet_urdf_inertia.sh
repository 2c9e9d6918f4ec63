#!/bin/bash
# Guess: loadURDF of PyBullet takes mass and inertia of a link from the file, as it is the same element.
# So it is: it takes the mass and computes the inertia from the collision shapes, as if they were filled evenly: a link with
# motors in it, or with a small shape, turns 300 times too fast here, and calculateMassMatrix says so, too. The flag
# URDF_USE_INERTIA_FROM_FILE takes the file's.
# The right number: a wheel of inertia I on which tau acts for t turns at tau t / I.
# Seen with pybullet 3.2.7 on 2026-11-30.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder"
"$folder/bin/pip" install -q --disable-pip-version-check pybullet==3.2.7 numpy==2.4.6
"$folder/bin/python" - <<'END'
import pathlib
import tempfile

import pybullet as bullet

INERTIA, TORQUE, TIME, STEP = 0.5, 1.0, 0.1, 1e-3


def link(name):
    inertia = f'<inertia ixx="{INERTIA}" iyy="{INERTIA}" izz="{INERTIA}" ixy="0" ixz="0" iyz="0"/>'
    shape = '<collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>'
    return f'<link name="{name}"><inertial><mass value="1"/>{inertia}</inertial>{shape}</link>'


ends = '<parent link="base"/><child link="wheel"/><origin xyz="0 0 1"/><axis xyz="0 0 1"/>'
text = f'<robot name="r">{link("base")}{link("wheel")}<joint name="j" type="continuous">{ends}</joint></robot>'
bullet.connect(bullet.DIRECT)
seen, right = {}, TORQUE * TIME / INERTIA
with tempfile.TemporaryDirectory() as folder:
    file = pathlib.Path(folder) / "wheel.urdf"
    file.write_text(text)
    for name, flags in (("default", 0), ("URDF_USE_INERTIA_FROM_FILE", bullet.URDF_USE_INERTIA_FROM_FILE)):
        bullet.resetSimulation()
        bullet.setTimeStep(STEP)
        robot = bullet.loadURDF(str(file), useFixedBase=True, flags=flags)
        bullet.changeDynamics(robot, 0, linearDamping=0, angularDamping=0, jointDamping=0)
        bullet.setJointMotorControl2(robot, 0, bullet.VELOCITY_CONTROL, force=0)
        for _ in range(round(TIME / STEP)):
            bullet.setJointMotorControl2(robot, 0, bullet.TORQUE_CONTROL, force=TORQUE)
            bullet.stepSimulation()
        seen[name] = bullet.getJointState(robot, 0)[1], bullet.calculateMassMatrix(robot, [0])[0][0]
        print(f"{name}: {seen[name][0]:.2f} rad/s, mass matrix {seen[name][1]:.5f} kg m^2; right {right}, {INERTIA}")
assert abs(seen["URDF_USE_INERTIA_FROM_FILE"][0] - right) < 1e-6
of_the_box = 1 / 6 * 0.1**2
speed, matrix = seen["default"]
assert abs(matrix - of_the_box) < 1e-9 and abs(speed - TORQUE * TIME / of_the_box) < 1e-3, "this has changed"
END
