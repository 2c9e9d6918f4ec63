#!/usr/bin/env python3
"""A control law of your own in Python, compiled into the loop: checked as a gradient, then run and compared.

PYTHONPATH=python .venv/bin/python examples/python/own_law.py
"""

import argparse
import math

import multipanda as mp
import numpy as np


@mp.law(
    inputs={"joints": "joints"},
    parameters={
        "torque_nm": mp.LawParameter(
            [20, 20, 20, 20, 8, 8, 4], 0, 40, unit="N m", size="joints", doc="Largest torque."
        ),
        "width_rad": mp.LawParameter(0.1, 0.02, 1, unit="rad", doc="Distance above which the torque hardly increases."),
        "damping_nms_per_rad": mp.LawParameter([8, 8, 8, 8, 2, 2, 1], 0, 20, unit="N m s/rad", size="joints"),
    },
    outputs={"energy_j": 1},
)
def soft_joints(arm, inputs, parameters, outputs, tau):
    """Springs whose torque never exceeds a bound, however far the set-point is.

    The energy of a joint is t w (sqrt(1 + x^2) - 1), x = (q_d - q) / w, so its torque is t x / sqrt(1 + x^2).
    """
    for i in range(len(tau)):
        x = (inputs.joints.q[i] - arm.q[i]) / parameters.width_rad
        root = math.sqrt(1 + x * x)
        outputs.energy_j[0] += parameters.torque_nm[i] * parameters.width_rad * (root - 1)
        tau[i] = parameters.torque_nm[i] * x / root
        tau[i] += arm.c[i] - parameters.damping_nms_per_rad[i] * arm.dq[i]


def largest_gradient_error(law, seed=1, states=100, h=1e-6):
    """The spring part against minus the slope of the energy, by central differences [N m]."""
    random, worst = np.random.default_rng(seed), 0.0
    for _ in range(states):
        q, q_d = random.uniform(-1, 1, 7), random.uniform(-1, 1, 7)

        def energy(q, q_d=q_d):
            return law.evaluate({"q": q}, inputs={"joints": q_d}).outputs["energy_j"][0]

        slope = [(energy(q + h * e) - energy(q - h * e)) / (2 * h) for e in np.eye(7)]
        tau = law.evaluate({"q": q}, inputs={"joints": q_d}).tau
        worst = max(worst, np.abs(tau + np.array(slope)).max())
    return worst


def largest_difference(law, path):
    """Between the loop's torques and those of the Python function, on the states of the log [N m]."""
    log, worst = mp.read_log(path), 0.0
    owned = {cycle: row for row, cycle in enumerate(log["soft/joints/cycle"])}
    states = {cycle: row for row, cycle in enumerate(log["arm/state/cycle"])}
    for row, cycle in enumerate(log["arm/model/cycle"]):  # every tenth, with the Coriolis torque
        if cycle not in owned:
            continue
        at = states[cycle]
        arm = {"q": log["arm/q"][at], "dq": log["arm/dq"][at], "c": log["arm/model/tau_coriolis"][row]}
        set_point = log["soft/joints/value"][owned[cycle]]
        tau = law.evaluate(arm, inputs={"joints": set_point}, compiled=False).tau
        worst = max(worst, np.abs(tau - log["arm/command/tau_controllet"][at]).max())
    return worst


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--record", default="runs", help="folder of the log (default runs)")
    options = parser.parse_args()

    print(f"gradient: {largest_gradient_error(soft_joints):.1e} N m")
    trial = soft_joints.trial  # compiles it, and tries it on 10 000 random states
    print(f"a tick: {trial['median_us']:.1f} us, 99.9 % {trial['p999_us']:.1f} us")

    with mp.run("one_arm", laws=[soft_joints.on("arm", name="soft")], record=options.record) as run:
        arm, law = run.arms["arm"], run["soft"]
        run.switch("soft")
        goal = arm.state.q_rad.copy()
        goal[0] += 0.3
        law.goal("joints", goal, duration_s=1).wait()
        print(f"arrived: {1e3 * np.abs(arm.state.q_rad - goal).max():.1f} mrad away")
        try:
            law.width_rad = 0
        except mp.Refused as refused:
            print("refused:", refused.reason)
    print(run.summary)

    print(f"torques of the log against the Python function: {largest_difference(soft_joints, run.log):.1e} N m")


if __name__ == "__main__":
    main()
