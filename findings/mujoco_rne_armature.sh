#!/bin/bash
# Guess: mj_rne with accelerations returns the joint torques that give these accelerations, M qacc plus bias, without
# passive forces and constraints.
# So it is: the mass matrix of mj_fullM and mj_inverse contain the armature of the joints, mj_rne does not. A computed-torque
# law by mj_rne lacks armature times acceleration: where rotors outweigh links, as in the wrists of a light arm, most of it.
# The right number: with that torque as applied force the engine's own acceleration must be the one asked for.
# Seen with mujoco-core 4.0.1 on 2026-11-30.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder"
"$folder/bin/pip" install -q --disable-pip-version-check mujoco-core==4.0.1 numpy==2.4.6
"$folder/bin/python" - <<'END'
import mujoco
import numpy as np

link = '<geom type="capsule" size="0.03" fromto="0 0 0 0.3 0 0" density="1000"/>'
joint = '<joint axis="0 1 0" armature="0.2"/>'
model = mujoco.MjModel.from_xml_string(
    f'<mujoco><worldbody><body>{joint}{link}<body pos="0.3 0 0">{joint}{link}</body></body></worldbody></mujoco>'
)
state = mujoco.MjData(model)
state.qpos[:], state.qvel[:], asked = [0.3, 0.5], [0.4, -0.2], np.array([1.0, 2.0])
mujoco.mj_forward(model, state)


def reached(torque: np.ndarray) -> np.ndarray:
    state.qfrc_applied[:] = torque
    mujoco.mj_forward(model, state)
    return state.qacc.copy()


torque = np.zeros(2)
state.qacc[:] = asked
mujoco.mj_rne(model, state, 1, torque)
short, right = reached(torque), reached(torque + model.dof_armature * asked)
print("asked for [rad/s^2]:", asked, " by mj_rne:", np.round(short, 3), " with armature times acceleration:", np.round(right, 3))
assert np.allclose(right, asked), "armature times acceleration is not what is missing"
assert np.abs(short - asked).max() > 0.3, "mj_rne counts the armature now"
END
