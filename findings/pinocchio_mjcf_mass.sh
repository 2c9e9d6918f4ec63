#!/bin/bash
# Guess: whether a shape collides does not change its mass, in MJCF as elsewhere.
# So it is: in MuJoCo it does not; Pinocchio's buildModelFromMJCF takes shapes with contype="0" conaffinity="0" for pictures and
# leaves their mass out, `mass` given or not. An arm whose contacts are off weighs nothing, and its gravity torque is zero.
# The right number: mass, and m g l.
# Seen with pin 4.1.0 and mujoco-core 4.0.1 on 2026-11-29.
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

MASS, ARM = 2.0, 0.2


def read(attributes):
    geom = f'<geom type="box" size="0.05 0.05 0.2" pos="0 0 {ARM}" mass="{MASS}" {attributes}/>'
    xml = f'<mujoco><worldbody><body name="link"><joint name="j" axis="0 1 0"/>{geom}</body></worldbody></mujoco>'
    compiled = mujoco.MjModel.from_xml_string(xml)
    state = mujoco.MjData(compiled)
    state.qpos[0] = np.pi / 2
    mujoco.mj_forward(compiled, state)
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "link.xml"
        path.write_text(xml)
        model = pinocchio.buildModelFromMJCF(str(path))
    model = model[0] if isinstance(model, tuple) else model
    torque = pinocchio.computeGeneralizedGravity(model, model.createData(), np.array([np.pi / 2]))[0]
    return (pinocchio.computeTotalMass(model), torque), (compiled.body_mass[1], state.qfrc_bias[0])


right = (MASS, -MASS * 9.81 * ARM)
for attributes in ("", 'contype="0" conaffinity="0"'):
    ours, theirs = read(attributes)
    for name, (mass, torque) in (("Pinocchio", ours), ("MuJoCo", theirs), ("right", right)):
        print(f"{attributes or 'collides'}: {name} {mass:.1f} kg, {torque:.2f} N m")
    assert np.allclose(theirs, right)
    assert np.allclose(ours, 0 if attributes else right), "this has changed"
END
