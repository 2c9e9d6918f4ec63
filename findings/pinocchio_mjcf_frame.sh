#!/bin/bash
# Guess: Pinocchio's buildModelFromMJCF understands <frame>, by which newer MJCF files place bodies, or refuses it.
# So it is: what stands in a <frame> inside a body is left out without a word: with it the joint, the link and its mass. An arm
# whose wrist is placed by one ends at the elbow; gravity compensation lacks what comes after.
# The right number: the gravity torque of both masses by hand; MuJoCo agrees.
# Seen with pin 4.1.0 and mujoco-core 4.0.1 on 2026-11-30.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder"
"$folder/bin/pip" install -q --disable-pip-version-check pin==4.1.0 mujoco-core==4.0.1 numpy==2.4.6
"$folder/bin/python" - <<'END'
import pathlib
import tempfile

import mujoco
import numpy as np
import pinocchio

MASS, LENGTH, G = 1.0, 0.5, 9.81
inertial = f'<inertial pos="{LENGTH} 0 0" mass="{MASS}" diaginertia="0.01 0.01 0.01"/>'


def joint(name):
    return f'<joint name="{name}" axis="0 1 0"/>{inertial}'


wrist = f'<body name="wrist">{joint("second")}</body>'
texts = {
    "frame": f'<frame pos="{LENGTH} 0 0">{wrist}</frame>',
    "no frame": wrist.replace("<body", f'<body pos="{LENGTH} 0 0"'),
}
right = -MASS * G * (LENGTH + 2 * LENGTH)  # arm along x: its own mass and the wrist's
seen = {}
for name, end in texts.items():
    text = f'<mujoco><worldbody><body name="arm">{joint("first")}{end}</body></worldbody></mujoco>'
    with tempfile.TemporaryDirectory() as folder:
        file = pathlib.Path(folder) / "arm.xml"
        file.write_text(text)
        model = pinocchio.buildModelFromMJCF(str(file))
    engine = mujoco.MjModel.from_xml_string(text)
    state = mujoco.MjData(engine)
    mujoco.mj_forward(engine, state)
    gravity = pinocchio.computeGeneralizedGravity(model, model.createData(), np.zeros(model.nq))
    seen[name] = model.nv, gravity[0]
    print(f"{name}: joints {engine.nv} in MuJoCo, {model.nv} in Pinocchio;", end=" ")
    print(f"torque of the first {state.qfrc_bias[0]:.2f}, {gravity[0]:.2f}; right {right:.2f} N m")
    assert engine.nv == 2 and abs(state.qfrc_bias[0] - right) < 1e-9
assert seen["no frame"][0] == 2 and abs(seen["no frame"][1] - right) < 1e-9
assert seen["frame"][0] == 1 and abs(seen["frame"][1] + MASS * G * LENGTH) < 1e-9, "this has changed"
END
