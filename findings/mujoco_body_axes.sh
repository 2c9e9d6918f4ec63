#!/bin/bash
# Guess: mj_objectVelocity of a body with flg_local=1 gives its velocity in the axes of the body.
# So it is: in its principal axes of inertia, and at its center of mass. The axes of the body belong to mjOBJ_XBODY. For a
# link with a full inertia matrix the angular velocity about its own z axis comes out along x.
# The right number: a link on one hinge along its z axis turns about z only, and its origin is at rest.
# Seen with mujoco-core 4.0.1 on 2026-11-29.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder"
"$folder/bin/pip" install -q --disable-pip-version-check mujoco-core==4.0.1 numpy==2.4.6
"$folder/bin/python" - <<'END'
import mujoco
import numpy as np

inertial = '<inertial pos="0.2 0 0" mass="1" fullinertia="0.02 0.02 0.03 0.005 0 0"/>'
link = f'<body name="link"><joint type="hinge" axis="0 0 1"/>{inertial}</body>'
model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{link}</worldbody></mujoco>")
data = mujoco.MjData(model)
data.qvel[0] = 1
mujoco.mj_forward(model, data)


def velocity(kind):
    result = np.zeros(6)  # angular, linear
    mujoco.mj_objectVelocity(model, data, kind, model.body("link").id, result, 1)
    return result


body, xbody = velocity(mujoco.mjtObj.mjOBJ_BODY), velocity(mujoco.mjtObj.mjOBJ_XBODY)
right = np.array([0, 0, 1, 0, 0, 0])
print(f"mjOBJ_BODY {body.round(3)}, mjOBJ_XBODY {xbody.round(3)}, right {right}")
assert abs(abs(body[0]) - 1) < 1e-9 and abs(body[2]) < 1e-9, "this has changed"
assert np.allclose(xbody, right)
# The same motion, said in the axes of inertia.
axes = np.zeros(9)
mujoco.mju_quat2Mat(axes, model.body_iquat[model.body("link").id])
assert np.allclose(axes.reshape(3, 3) @ body[:3], right[:3])
END
