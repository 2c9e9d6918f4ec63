#!/bin/bash
# Guess: Pinocchio's buildModelFromMJCF reads the whole scene, or says what it leaves out.
# So it is: it reads the first body of the world with all its children and drops every other one without a word. From a scene
# with two arms it reads the left one: no error, no warning, half the joints.
# The right number: the joints and the mass that MuJoCo compiles from the same file, and the sum by hand.
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
import pinocchio


def arm(name, y, mass):
    geom = f'<geom type="capsule" size="0.05" fromto="0 0 0 0 0 0.4" mass="{mass}"/>'
    fore = f'<body name="{name}_fore" pos="0 0 0.4"><joint name="{name}_elbow" axis="0 1 0"/>{geom}</body>'
    return f'<body name="{name}" pos="0 {y} 0"><joint name="{name}_shoulder" axis="0 1 0"/>{geom}{fore}</body>'


xml = f'<mujoco><worldbody>{arm("left", 0.3, 2)}{arm("right", -0.3, 3)}</worldbody></mujoco>'
with tempfile.TemporaryDirectory() as folder:
    path = pathlib.Path(folder) / "two_arms.xml"
    path.write_text(xml)
    read = pinocchio.buildModelFromMJCF(str(path))
read = read[0] if isinstance(read, tuple) else read
compiled = mujoco.MjModel.from_xml_string(xml)
mass = pinocchio.computeTotalMass(read)
print(f"Pinocchio: {read.nv} joints {list(read.names)[1:]}, {mass:.1f} kg")
print(f"MuJoCo: {compiled.nv} joints, {compiled.body_subtreemass[0]:.1f} kg; right: 4 joints, {2 * (2 + 3):.1f} kg")
assert compiled.nv == 4 and abs(compiled.body_subtreemass[0] - 10) < 1e-9
assert read.nv == 2 and abs(mass - 4) < 1e-9, "this has changed"
END
