#!/bin/bash
# Guess: the gravity torques that libfranka's model computes from a state of the simulated FR3 of franky-sim are an FR3's.
# So it is: they are zero in every pose and with every load, since the simulator sends a gravity vector of zero with its
# states. A law that adds or subtracts them passes here and is off by tens of N m on an arm, where the vector is -9.81.
# The right number: gravity in the simulator's own MuJoCo model of the arm; and libfranka's model once the vector is filled in.
# Seen with franky-sim 1.0.4 and pylibfranka 0.21.3 on 2026-11-29, on loopback.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder"
"$folder/bin/pip" install -q --disable-pip-version-check pylibfranka==0.21.3 franky-sim==1.0.4 numpy==2.4.6
"$folder/bin/python" - <<'END'
import pathlib
import subprocess
import sys
import time

import franky_sim
import mujoco
import numpy as np
import pylibfranka

ADDRESS = "127.0.0.78"
command = [str(pathlib.Path(sys.executable).parent / "franky-sim"), "-s", "mujoco", "--hostname", ADDRESS]
server = subprocess.Popen(command, stdout=subprocess.DEVNULL)
try:
    for attempt in range(60):
        try:
            robot = pylibfranka.Robot(ADDRESS, pylibfranka.RealtimeConfig.kIgnore)
            break
        except pylibfranka.NetworkException:
            time.sleep(0.5)
    state, model = robot.read_once(), robot.load_model()
    seen = np.array(model.gravity(state))
    assets = pathlib.Path(franky_sim.__file__).parent / "assets"
    text = (assets / "fr3.xml").read_text().replace('meshdir="assets"', f'meshdir="{assets / "meshes"}"')
    arm = mujoco.MjModel.from_xml_string(text)
    at_rest = mujoco.MjData(arm)
    at_rest.qpos[:7] = state.q
    mujoco.mj_forward(arm, at_rest)
    right, sent = at_rest.qfrc_bias[:7], list(state.O_ddP_O)
    print(f"gravity vector in the state {sent}, torques from it {seen}; right {right.round(1)} N m")
    state.O_ddP_O = [0, 0, -9.81]
    filled = np.array(model.gravity(state))
    print(f"the vector filled in by hand: {filled.round(1)} N m")
    assert np.abs(filled - right).max() < 2 and np.abs(right).max() > 20
    assert not seen.any() and not any(sent), "this has changed"
finally:
    server.terminate()
    server.wait()
END
