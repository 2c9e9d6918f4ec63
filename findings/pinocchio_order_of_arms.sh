#!/bin/bash
# Guess: the joints of a URDF come in the order of the file, so that two programs that read it agree on q.
# So it is: Pinocchio visits the children of a link by the alphabet, MuJoCo as they stand in the file. In a URDF of two arms
# that names the right arm first, q of MuJoCo means (right, left), q of Pinocchio (left, right): gravity compensation
# with vectors handed over as they are holds each arm with the other's torques.
# The right number: m g l sin(q) of each arm.
# Seen with pin 4.1.0 and mujoco-core 4.0.1 on 2026-11-29.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder"
"$folder/bin/pip" install -q --disable-pip-version-check pin==4.1.0 mujoco-core==4.0.1 numpy==2.4.6
"$folder/bin/python" - <<'END'
import mujoco
import numpy as np
import pinocchio

MASS = {"right": 1.0, "left": 3.0}


def arm(side):
    inertia = '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/>'
    inertial = f'<inertial><origin xyz="0 0 0.5"/><mass value="{MASS[side]}"/>{inertia}</inertial>'
    ends = f'<parent link="torso"/><child link="{side}"/><axis xyz="0 1 0"/>'
    return f'<link name="{side}">{inertial}</link><joint name="{side}_joint" type="continuous">{ends}</joint>'


def urdf(limits):
    text = f'<robot name="two"><link name="torso"/>{arm("right")}{arm("left")}</robot>'
    return text.replace('"continuous">', f'"revolute">{limits}')  # so that Pinocchio has one number for each


text = urdf('<limit lower="-3" upper="3" effort="100" velocity="2"/>')
engine, model = mujoco.MjModel.from_xml_string(text), pinocchio.buildModelFromXML(text)
q = np.array([1.0, 0.2])  # in the order of the file: right, left
state = mujoco.MjData(engine)
state.qpos[:] = q
mujoco.mj_forward(engine, state)
gravity = pinocchio.computeGeneralizedGravity(model, model.createData(), q)
right = np.array([-MASS[side] * 9.81 * 0.5 * np.sin(angle) for side, angle in zip(("right", "left"), q)])
print("MuJoCo", [engine.joint(i).name for i in range(2)], state.qfrc_bias.round(3))
print("Pinocchio", list(model.names)[1:], gravity.round(3), "; right, in the order of the file", right.round(3))
assert np.allclose(state.qfrc_bias, right)
assert list(model.names)[1:] == ["left_joint", "right_joint"] and not np.allclose(gravity, right, atol=1), "this has changed"
swapped = pinocchio.computeGeneralizedGravity(model, model.createData(), q[::-1])[::-1]
assert np.allclose(swapped, right)
END
