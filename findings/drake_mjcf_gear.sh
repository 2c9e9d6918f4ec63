#!/bin/bash
# Guess: Drake, which reads `gear` of a motor in an MJCF file without a warning, drives the joint as MuJoCo does: torque is gear
# times control.
# So it is: gear becomes the gear ratio of the actuator, by which Drake scales the rotor's inertia and nothing else. The control
# of the file is taken for N m at the joint, and its range for the greatest effort: a motor with gear 50 and controls up
# to 1 gets 1 N m instead of 50, in both. A policy or a gain from MuJoCo moves the arm at a fiftieth.
# The right number: a wheel of inertia I turns at gear times control times t / I; MuJoCo agrees.
# Seen with drake 1.51.1 and mujoco-core 4.0.1 on 2026-11-30.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder"
"$folder/bin/pip" install -q --disable-pip-version-check drake==1.51.1 mujoco-core==4.0.1 numpy==2.3.5
"$folder/bin/python" - <<'END'
import mujoco
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import Simulator

INERTIA, CONTROL, TIME, STEP = 0.2, 1.0, 0.1, 1e-3


def scene(gear):
    wheel = f'<joint name="j" axis="0 0 1"/><inertial pos="0 0 0" mass="1" diaginertia="{INERTIA} {INERTIA} {INERTIA}"/>'
    motor = f'<motor name="m" joint="j" gear="{gear}" ctrlrange="{-CONTROL} {CONTROL}" ctrllimited="true"/>'
    return f'<mujoco model="m"><worldbody><body name="b">{wheel}</body></worldbody><actuator>{motor}</actuator></mujoco>'


def in_mujoco(text):
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.timestep = STEP
    data = mujoco.MjData(model)
    data.ctrl[:] = CONTROL
    for _ in range(round(TIME / STEP)):
        mujoco.mj_step(model, data)
    return float(data.qvel[0])


def in_drake(text):
    plant = MultibodyPlant(STEP)
    Parser(plant).AddModelsFromString(text, "xml")
    plant.Finalize()
    simulator = Simulator(plant)
    context = simulator.get_mutable_context()
    plant.get_actuation_input_port().FixValue(context, [CONTROL])
    simulator.AdvanceTo(TIME)
    return plant.GetVelocities(context)[0], plant.GetJointActuatorByName("m").effort_limit()


for gear in (1, 10, 50):
    right = gear * CONTROL * TIME / INERTIA
    speed, effort = in_drake(scene(gear))
    print(f"gear {gear}: Drake {speed:.2f} rad/s, effort up to {effort} N m; ", end="")
    print(f"MuJoCo {in_mujoco(scene(gear)):.2f} rad/s; right {right:.2f} rad/s, {gear * CONTROL} N m")
    assert abs(in_mujoco(scene(gear)) - right) < 1e-6
    assert abs(speed - CONTROL * TIME / INERTIA) < 1e-6 and effort == CONTROL, "this has changed"
END
