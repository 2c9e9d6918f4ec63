#!/bin/bash
# Guess: the sensor framelinacc is the linear acceleration of a frame, the derivative of what framelinvel says.
# So it is: gravity is left in, as in an accelerometer: a box that rests on the floor accelerates upward at 9.81 m/s^2, one that
# falls not at all. The same holds for mj_objectAcceleration. As a feed-forward or as a reward it is off by g.
# The right number: differences of framelinvel over a step, and Newton's law.
# Seen with mujoco-core 4.0.1 on 2026-11-30.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder"
"$folder/bin/pip" install -q --disable-pip-version-check mujoco-core==4.0.1 numpy==2.4.6
"$folder/bin/python" - <<'END'
import mujoco
import numpy as np

box = '<body name="box" pos="0 0 0.1"><freejoint/><geom type="box" size="0.1 0.1 0.1" mass="1"/><site name="s"/></body>'
sensors = "".join(f'<{name} objtype="site" objname="s"/>' for name in ("framelinacc", "framelinvel"))
text = f'<mujoco><worldbody><geom type="plane" size="1 1 0.1"/>{box}</worldbody><sensor>{sensors}</sensor></mujoco>'
model = mujoco.MjModel.from_xml_string(text)
data = mujoco.MjData(model)
G = 9.81
for name, height, steps, right in (("at rest", 0.1, 2000, 0.0), ("falling", 5.0, 100, -G)):
    data.qpos[2], data.qvel[:] = height, 0
    for _ in range(steps):
        mujoco.mj_step(model, data)
    mujoco.mj_forward(model, data)
    said, before = data.sensordata[2], data.sensordata[5]
    function = np.zeros(6)  # angular, linear
    mujoco.mj_objectAcceleration(model, data, mujoco.mjtObj.mjOBJ_XBODY, model.body("box").id, function, 0)
    mujoco.mj_step(model, data)
    mujoco.mj_forward(model, data)
    difference = (data.sensordata[5] - before) / model.opt.timestep
    print(f"{name}: framelinacc {said:+.3f}, mj_objectAcceleration {function[5]:+.3f},", end=" ")
    print(f"from framelinvel {difference:+.3f}; right {right:+.3f} m/s^2")
    assert abs(difference - right) < 1e-6
    assert abs(said - (right + G)) < 1e-4 and abs(function[5] - (right + G)) < 1e-4, "this has changed"
END
