#!/bin/bash
# Guess: a joint whose frictionloss is twice the load on it stays where it is.
# So it is: it creeps, for friction is a soft constraint: here at 1.2 degrees a second, 12 in 10 s. An unpowered arm
# that friction should hold sinks, and a controller without an integral term meets no stiction. A solimpfriction near 1 slows it.
# The right number: Coulomb's law says 0. The creep is load / (b I d / (1 - d)), from MuJoCo's description of its constraints,
# with d = 0.9, b = 2 / (0.95 * 0.02 s) and the joint's inertia I.
# Seen with mujoco-core 4.0.1 on 2026-11-30.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder"
"$folder/bin/pip" install -q --disable-pip-version-check mujoco-core==4.0.1 numpy==2.4.6
"$folder/bin/python" - <<'END'
import mujoco

INERTIA, LOAD, FRICTION, TIME = 0.25, 5.0, 10.0, 10.0


def creep(options):
    inertial = f'<inertial pos="0 0 0" mass="1" diaginertia="{INERTIA} {INERTIA} {INERTIA}"/>'
    joint = f'<joint name="j" axis="0 0 1" frictionloss="{FRICTION}" {options}/>'
    drive = '<actuator><motor joint="j"/></actuator>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody><body>{joint}{inertial}</body></worldbody>{drive}</mujoco>")
    data = mujoco.MjData(model)
    data.ctrl[0] = LOAD
    while data.time < TIME:
        mujoco.mj_step(model, data)
    return data.qpos[0], data.qvel[0]


turned, speed = creep("")
soft = LOAD / (2 / (0.95 * 0.02) * INERTIA * 0.9 / 0.1)
harder = creep('solimpfriction="0.9999 0.9999 0.001"')[0]
print(f"turned {turned:.4f} rad in {TIME:.0f} s at {speed:.5f} rad/s; MuJoCo's softness gives {soft:.5f}; Coulomb 0")
print(f"with solimpfriction 0.9999: {harder:.6f} rad")
assert abs(harder) < 1e-3
assert abs(speed / soft - 1) < 1e-3 and turned > 0.2, "this has changed"
END
