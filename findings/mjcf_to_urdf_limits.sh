#!/bin/bash
# Guess: a converter from MuJoCo's format to URDF makes a joint without limits `continuous`.
# So it is: mjcf_urdf_simple_converter makes it `revolute` with limits from 0 to 0: in a planner, an inverse kinematics
# or a joint limiter that reads the URDF the joint is locked, while the picture looks right.
# The right number: the file says limited="false"; MuJoCo lets the joint pass 2 rad.
# Seen with mjcf-urdf-simple-converter 0.7.3, mujoco 4.0.0 and pin 4.1.0 on 2026-11-29.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder"
"$folder/bin/pip" install -q --disable-pip-version-check mjcf-urdf-simple-converter==0.7.3 mujoco==4.0.0 pin==4.1.0 numpy==2.4.6
"$folder/bin/python" - <<'END'
import pathlib
import tempfile
import xml.etree.ElementTree

import mujoco
import pinocchio
from mjcf_urdf_simple_converter import convert

inertial = '<inertial pos="0 0 0.1" mass="1" diaginertia="0.02 0.02 0.02"/>'
wrist = f'<body name="wrist"><joint name="free_joint" axis="0 0 1" limited="false"/>{inertial}</body>'
arm = f'<body name="arm"><joint name="limited_joint" axis="0 0 1" range="-60 60"/>{inertial}{wrist}</body>'
with tempfile.TemporaryDirectory() as folder:
    mjcf, urdf = pathlib.Path(folder) / "arm.xml", pathlib.Path(folder) / "arm.urdf"
    mjcf.write_text(f"<mujoco><worldbody>{arm}</worldbody></mujoco>")
    convert(str(mjcf), str(urdf))
    joint = xml.etree.ElementTree.parse(urdf).find("joint[@name='free_joint']")
    model = pinocchio.buildModelFromUrdf(str(urdf))
    engine = mujoco.MjModel.from_xml_path(str(mjcf))
state = mujoco.MjData(engine)
state.qvel[1] = 10
while state.time < 0.21:
    mujoco.mj_step(engine, state)
print(f"MuJoCo, from the original: limited {bool(engine.joint('free_joint').limited[0])}, turned to {state.qpos[1]:.2f} rad")
print(f"URDF: {joint.get('type')}, {joint.find('limit').attrib}; limits in Pinocchio {model.lowerPositionLimit} {model.upperPositionLimit}")
assert not engine.joint("free_joint").limited[0] and state.qpos[1] > 2
limit = joint.find("limit")
assert joint.get("type") == "revolute" and float(limit.get("lower")) == float(limit.get("upper")) == 0, "this has changed"
assert model.lowerPositionLimit[1] == model.upperPositionLimit[1] == 0
END
