#!/bin/bash
# Guess: a library that reads damping and friction of the joints from a URDF uses them in its dynamics.
# So it is: Pinocchio keeps them in its model, and neither rnea nor aba looks at them: a simulation by aba swings without
# loss, and a feed-forward by rnea lacks them. MuJoCo takes the same file's damping into account.
# The right number: a wheel of inertia I with damping d slows down as exp(-d t / I).
# Seen with pin 4.1.0 and mujoco-core 4.0.1 on 2026-11-29.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder"
"$folder/bin/pip" install -q --disable-pip-version-check pin==4.1.0 mujoco-core==4.0.1 numpy==2.4.6
"$folder/bin/python" - <<'END'
import math

import mujoco
import numpy as np
import pinocchio

INERTIA, DAMPING, TIME = 0.1, 0.5, 0.4
inertia = f'<inertia ixx="{INERTIA}" iyy="{INERTIA}" izz="{INERTIA}" ixy="0" ixz="0" iyz="0"/>'
wheel = f'<link name="wheel"><inertial><mass value="1"/>{inertia}</inertial></link>'
ends = '<parent link="base"/><child link="wheel"/><axis xyz="0 0 1"/><limit lower="-9" upper="9" effort="9" velocity="9"/>'
joint = f'<joint name="j" type="revolute">{ends}<dynamics damping="{DAMPING}" friction="0"/></joint>'
text = f'<robot name="r"><link name="base"/>{wheel}{joint}</robot>'

model = pinocchio.buildModelFromXML(text)
data = model.createData()
q, v, step = np.zeros(1), np.ones(1), 1e-4
torque = pinocchio.rnea(model, data, q, v, np.zeros(1))[0]
for _ in range(round(TIME / step)):
    v = v + step * pinocchio.aba(model, data, q, v, np.zeros(1))
    q = pinocchio.integrate(model, q, v * step)

engine = mujoco.MjModel.from_xml_string(text)
engine.opt.timestep = step
state = mujoco.MjData(engine)
state.qvel[0] = 1
for _ in range(round(TIME / step)):
    mujoco.mj_step(engine, state)
right = math.exp(-DAMPING * TIME / INERTIA)
print(f"damping in Pinocchio's model {model.damping}, speed by aba {v[0]:.3f}; MuJoCo {state.qvel[0]:.3f}; right {right:.3f}")
print(f"torque at 1 rad/s by rnea {torque:.3f} N m; right {DAMPING:.3f} N m")
assert abs(state.qvel[0] - right) < 1e-3
assert model.damping[0] == DAMPING and abs(v[0] - 1) < 1e-9 and abs(torque) < 1e-9, "this has changed"
END
