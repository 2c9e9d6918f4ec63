#!/bin/bash
# Guess: a converter from URDF to MuJoCo's format keeps what both formats can say.
# So it is: urdf2mjcf drops the damping, the friction and the greatest effort of every joint, and frees a fixed base;
# of these it mentions the base alone. MuJoCo reads all from the same URDF by itself.
# The right number: a wheel of inertia I with damping d slows down as exp(-d t / I).
# Seen with urdf2mjcf 0.2.39 and mujoco 4.0.0 on 2026-11-29.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder"
"$folder/bin/pip" install -q --disable-pip-version-check urdf2mjcf==0.2.39 mujoco==4.0.0 numpy==2.4.6
"$folder/bin/python" - <<'END'
import math
import pathlib
import tempfile

import mujoco
from urdf2mjcf.convert import convert_urdf_to_mjcf

DAMPING, INERTIA, TIME = 0.5, 0.1, 0.2


def link(name):
    inertia = f'<inertia ixx="{INERTIA}" iyy="{INERTIA}" izz="{INERTIA}" ixy="0" ixz="0" iyz="0"/>'
    shape = '<geometry><cylinder radius="0.05" length="0.1"/></geometry>'
    inertial = f'<inertial><origin xyz="0 0 0"/><mass value="1"/>{inertia}</inertial>'
    return f'<link name="{name}">{inertial}<visual>{shape}</visual><collision>{shape}</collision></link>'


ends = '<parent link="base"/><child link="wheel"/><origin xyz="0 0 1"/><axis xyz="0 0 1"/>'
limit = '<limit lower="-9" upper="9" effort="12" velocity="9"/>'
dynamics = f'<dynamics damping="{DAMPING}" friction="0.3"/>'
joint = f'<joint name="j" type="revolute">{ends}{limit}{dynamics}</joint>'
with tempfile.TemporaryDirectory() as folder:
    urdf, mjcf = pathlib.Path(folder) / "wheel.urdf", pathlib.Path(folder) / "wheel.xml"
    urdf.write_text(f'<robot name="r">{link("base")}{link("wheel")}{joint}</robot>')
    convert_urdf_to_mjcf(urdf, mjcf)
    models = {"urdf2mjcf": mujoco.MjModel.from_xml_path(str(mjcf)), "MuJoCo": mujoco.MjModel.from_xml_path(str(urdf))}

seen = {}
for name, model in models.items():
    dof = model.joint("j").dofadr[0]
    seen[name] = (model.dof_damping[dof], model.dof_frictionloss[dof], model.jnt_actfrcrange[model.joint("j").id, 1], model.nv)
    print(f"{name}: damping, friction, effort, degrees of freedom {[float(x) for x in seen[name]]}; right [{DAMPING}, 0.3, 12.0, 1.0]")
engine = models["MuJoCo"]
engine.opt.timestep, engine.dof_frictionloss[0] = 1e-4, 0
state = mujoco.MjData(engine)
state.qvel[0] = 1
while state.time < TIME - 1e-9:
    mujoco.mj_step(engine, state)
print(f"speed after {TIME} s: {state.qvel[0]:.3f}, right {math.exp(-DAMPING * TIME / INERTIA):.3f}")
assert seen["MuJoCo"] == (DAMPING, 0.3, 12, 1) and abs(state.qvel[0] - math.exp(-DAMPING * TIME / INERTIA)) < 1e-3
assert seen["urdf2mjcf"] == (0, 0, 0, 7), "this has changed"
END
