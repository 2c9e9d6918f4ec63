#!/bin/bash
# Guess: MuJoCo ignores contacts between a link and its parent, so that overlapping collision shapes at a joint are harmless.
# So it is: not at the first joint of a URDF. The base of a fixed robot becomes part of the world, and the world is exempt
# from that filter: the first joint is jammed by its own base, the second one, of the same shapes, is free.
# The right number: the first link turns by torque * t^2 / (2 I), on smooth bearings alone.
# Seen with mujoco-core 4.0.1 on 2026-11-29.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder"
"$folder/bin/pip" install -q --disable-pip-version-check mujoco-core==4.0.1 numpy==2.4.6
"$folder/bin/python" - <<'END'
import mujoco

TORQUE, TIME, INERTIA = 1.0, 0.2, 0.05


def link(name):
    shape = '<origin xyz="0 0 0.1"/><geometry><cylinder radius="0.05" length="0.24"/></geometry>'
    inertia = f'<inertia ixx="{INERTIA}" iyy="{INERTIA}" izz="{INERTIA}" ixy="0" ixz="0" iyz="0"/>'
    return f'<link name="{name}"><inertial><mass value="1"/>{inertia}</inertial><collision>{shape}</collision></link>'


def joint(name, parent, child):  # the shapes of both links overlap by 4 cm
    ends = f'<parent link="{parent}"/><child link="{child}"/><origin xyz="0 0 0.2"/><axis xyz="0 0 1"/>'
    return f'<joint name="{name}" type="continuous">{ends}</joint>'


def turned(contacts):
    parts = [link(name) for name in ("base", "first", "second")]
    parts += [joint("joint1", "base", "first"), joint("joint2", "first", "second")]
    model = mujoco.MjModel.from_xml_string(f'<robot name="arm">{"".join(parts)}</robot>')
    model.opt.timestep = 1e-4
    if not contacts:
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    data = mujoco.MjData(model)
    data.qfrc_applied[0] = TORQUE
    while data.time < TIME:
        mujoco.mj_step(model, data)
    pairs = {tuple(int(model.geom_bodyid[geom]) for geom in contact.geom) for contact in data.contact}
    return float(data.qpos[0]), pairs


jammed, pairs = turned(True)
free, _ = turned(False)
right = TORQUE * TIME**2 / 2 / INERTIA
print(f"joint 1 turned by {jammed:.1e} rad, contacts of bodies {pairs}; without contacts {free:.4f} rad, right {right:.4f}")
assert abs(jammed) < 1e-3 and pairs == {(0, 1)} and abs(free - right) < 1e-3, "this has changed"
END
