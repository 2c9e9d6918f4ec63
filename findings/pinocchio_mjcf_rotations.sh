#!/bin/bash
# Guess: Pinocchio's buildModelFromMJCF places bodies as MuJoCo does, or refuses the file.
# So it is: two of MJCF's ways to write a rotation are misread. `eulerseq` in capitals (fixed axes: X, then Y, then Z, as in
# URDF) is read with the order of the factors reversed, and the axis of `axisangle`, which MuJoCo normalizes, is not.
# The right number: the product of elementary rotations, and Rodrigues' formula; MuJoCo agrees with both.
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


def rotation(axis, angle):  # Rodrigues
    x, y, z = np.divide(axis, np.linalg.norm(axis))
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def degrees_apart(A, B):
    return np.degrees(np.arcsin(np.clip(np.linalg.norm(A - B) / np.sqrt(8), 0, 1)) * 2)


def read(attribute):
    compiler = '<compiler angle="radian" eulerseq="XYZ"/>'
    body = f'<body name="link" {attribute}><joint name="j"/><geom size=".1" pos=".1 .2 .3"/></body>'
    xml = f"<mujoco>{compiler}<worldbody>{body}</worldbody></mujoco>"
    compiled = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(compiled)
    mujoco.mj_forward(compiled, data)
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "link.xml"
        path.write_text(xml)
        model = pinocchio.buildModelFromMJCF(str(path))
    model = model[0] if isinstance(model, tuple) else model
    return model.jointPlacements[1].rotation, data.body("link").xmat.reshape(3, 3)


X, Y, Z = np.eye(3)
cases = {
    'euler="0.5 1 0.3"': rotation(Z, 0.3) @ rotation(Y, 1) @ rotation(X, 0.5),
    'axisangle="0 1.2 1.6 0.7"': rotation([0, 1.2, 1.6], 0.7),
}
for attribute, right in cases.items():
    ours, theirs = read(attribute)
    error, unit = degrees_apart(ours, right), np.linalg.norm(ours @ ours.T - np.eye(3))
    print(f"{attribute}: Pinocchio off by {error:.1f} degrees (R R' - 1: {unit:.3f}); MuJoCo by {degrees_apart(theirs, right):.0e}")
    assert degrees_apart(theirs, right) < 1e-6
    assert error > 5, "this has changed"
END
