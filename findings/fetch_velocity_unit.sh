#!/bin/bash
# Guess: the velocities in the observation of FetchReach and its sisters are in m/s, as their documentation says.
# So it is: they are velocities times the control period of 0.04 s, that is, meters per step. A policy that is trained on them and
# fed with m/s by a real arm sees a motion 25 times as fast; the fingers' velocities are the same.
# The right number: Jacobian of the gripper's site times the engine's joint velocities.
# Seen with gymnasium-robotics 1.4.2, gymnasium 1.4.0 and mujoco 3.3.7 on 2026-11-30.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder"
"$folder/bin/pip" install -q --disable-pip-version-check gymnasium-robotics==1.4.2 gymnasium==1.4.0 mujoco==3.3.7 numpy==2.4.6
"$folder/bin/python" - 2>/dev/null <<'END'
import gymnasium
import gymnasium_robotics
import mujoco
import numpy as np

gymnasium.register_envs(gymnasium_robotics)
world = gymnasium.make("FetchReach-v4")
observation, _ = world.reset(seed=0)
inside = world.unwrapped
period = inside.n_substeps * inside.model.opt.timestep
for _ in range(4):
    observation, *_ = world.step(np.array([1.0, 0, 0, 0]))
said = observation["observation"][5:8]
jacobian = np.zeros((3, inside.model.nv))
mujoco.mj_jacSite(inside.model, inside.data, jacobian, None, inside.model.site("robot0:grip").id)
right = jacobian @ inside.data.qvel
print(f"observation {said.round(4)}; right {right.round(4)} m/s, times the period of {period} s {(right * period).round(4)}")
assert np.linalg.norm(right) > 0.1
assert np.allclose(said, right * period, rtol=1e-3, atol=1e-6), "this has changed"
END
