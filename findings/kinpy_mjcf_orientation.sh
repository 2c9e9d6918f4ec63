#!/bin/bash
# Guess: kinpy builds a chain from an MJCF file with the kinematics that the file describes, or refuses what it can't read.
# So it is: of the ways to write a body's orientation it reads `quat` alone; `euler`, `axisangle`, `xyaxes` and `zaxis`, and an
# axis that stands in <default>, are left out without a word. A forearm tilted by 90 degrees stands straight: the hand of an
# arm of 0.8 m is 0.5 m off. A chain from the same file with quaternions is right.
# The right number: the product of the rotations by hand; MuJoCo agrees.
# Seen with kinpy 0.6.1 and mujoco-core 4.0.1 on 2026-11-30.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder"
"$folder/bin/pip" install -q --disable-pip-version-check kinpy==0.6.1 mujoco-core==4.0.1 numpy==2.4.6
"$folder/bin/python" - <<'END'
import kinpy
import mujoco
import numpy as np

UPPER, FORE, Q = 0.4, 0.4, np.array([0.3, 0.5])
HALF = 0.5**0.5
AXIS = 'axis="0 1 0"'


def arm(tilt, axis, default=""):
    geom = '<geom type="sphere" size="0.05"/>'
    hand = f'<body name="hand" pos="0 0 {FORE}">{geom}</body>'
    fore = f'<body name="fore" pos="0 0 {UPPER}" {tilt}><joint name="elbow" type="hinge" {axis}/>{geom}{hand}</body>'
    upper = f'<body name="upper"><joint name="shoulder" type="hinge" {axis}/>{geom}{fore}</body>'
    return f"<mujoco>{default}<worldbody>{upper}</worldbody></mujoco>"


def about_y(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def by_hand(tilt):
    return about_y(Q[0]) @ (np.array([0, 0, UPPER]) + tilt @ about_y(Q[1]) @ np.array([0, 0, FORE]))


about_x = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])  # by 90 degrees
default = f"<default><joint {AXIS}/></default>"
files = {
    "quat": (arm(f'quat="{HALF} {HALF} 0 0"', AXIS), about_x),
    "euler": (arm('euler="90 0 0"', AXIS), about_x),
    "axisangle": (arm('axisangle="1 0 0 90"', AXIS), about_x),
    "xyaxes": (arm('xyaxes="1 0 0 0 0 1"', AXIS), about_x),
    "zaxis": (arm('zaxis="0 -1 0"', AXIS), about_x),
    "axis in <default>": (arm("", "", default), np.eye(3)),
}
for name, (text, tilt) in files.items():
    chain = kinpy.build_chain_from_mjcf(text)
    assert chain.get_joint_parameter_names() == ["shoulder", "elbow"]
    said = chain.forward_kinematics(Q)["hand"].pos
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qpos[:] = Q
    mujoco.mj_kinematics(model, data)
    right = by_hand(tilt)
    off = np.linalg.norm(said - right)
    print(f"{name}: hand at {said.round(3)}, MuJoCo {data.body('hand').xpos.round(3)}, right {right.round(3)}: {off:.3f} m off")
    assert np.allclose(data.body("hand").xpos, right, atol=1e-6)
    if name == "quat":
        assert off < 1e-6
    else:
        assert off > 0.3 and np.allclose(said, by_hand(np.eye(3)) if tilt is about_x else [0, 0, UPPER + FORE]), "this has changed"
END
