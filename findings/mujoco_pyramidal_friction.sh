#!/bin/bash
# Guess: a box with friction 0.5 that slides on a floor slows down by 0.5 g, whichever way it slides.
# So it is: with MuJoCo's default pyramidal cone the slowdown depends on the direction; along the diagonal of the contact's
# axes it is 30 % less than along an axis, and between them the path bends. `cone="elliptic"` is near the law.
# The right number: Coulomb's mu g, against the velocity.
# Seen with mujoco-core 4.0.1 on 2026-11-29.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder"
"$folder/bin/pip" install -q --disable-pip-version-check mujoco-core==4.0.1 numpy==2.4.6
"$folder/bin/python" - <<'END'
import math

import mujoco

MU, SPEED, TIME = 0.5, 2.0, 0.2


def slide(cone, degrees):
    geoms = f'<geom type="plane" size="5 5 .1" friction="{MU}"/><body pos="0 0 .05"><freejoint/>'
    geoms += f'<geom type="box" size=".1 .1 .05" mass="1" friction="{MU}"/></body>'
    option = f'<option cone="{cone}" timestep="0.0005" impratio="10"/>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco>{option}<worldbody>{geoms}</worldbody></mujoco>")
    data = mujoco.MjData(model)
    while data.time < 0.5:  # settle
        mujoco.mj_step(model, data)
    data.qvel[:2] = SPEED * math.cos(math.radians(degrees)), SPEED * math.sin(math.radians(degrees))
    start = data.time
    while data.time < start + TIME - 1e-9:
        mujoco.mj_step(model, data)
    vx, vy = data.qvel[:2]
    return (SPEED - math.hypot(vx, vy)) / TIME, math.degrees(math.atan2(vy, vx))


print(f"right: {MU * 9.81:.2f} m/s^2")
seen = {(cone, angle): slide(cone, angle) for cone in ("pyramidal", "elliptic") for angle in (0, 20, 45)}
for (cone, angle), (slowdown, direction) in seen.items():
    print(f"{cone}, sliding at {angle} degrees: {slowdown:.2f} m/s^2, after {TIME} s at {direction:.1f} degrees")
right = MU * 9.81
assert abs(seen["pyramidal", 45][0] / right - 0.7) < 0.03 and seen["pyramidal", 20][1] > 30, "this has changed"
assert all(abs(seen["elliptic", angle][0] / right - 1) < 0.03 for angle in (0, 20, 45))
END
