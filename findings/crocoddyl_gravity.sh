#!/bin/bash
# Guess: an arm without torques and contacts falls in crocoddyl's forward dynamics, as gravity in its Pinocchio model says.
# So it is: DifferentialActionModelFreeFwdDynamics leaves gravity out, so that optimal control on top of it plans in space: an arm
# at rest stays where it is with zero torques. DifferentialActionModelContactFwdDynamics with no contacts has gravity.
# The right number: aba of the same Pinocchio, and M^-1 (tau - rnea) by hand; the difference is M^-1 times gravity's torque.
# Seen with crocoddyl 3.2.1 and pin 4.1.0, which it requires, on 2026-11-30.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder"
"$folder/bin/pip" install -q --disable-pip-version-check crocoddyl==3.2.1 pin==4.1.0 numpy==2.4.6
"$folder/bin/python" - <<'END'
import crocoddyl
import numpy as np
import pinocchio as pin

random = np.random.default_rng(1)
model = pin.buildSampleModelManipulator()
data = model.createData()
q, v, tau = pin.neutral(model) + 0.3, 0.1 * random.normal(size=model.nv), random.normal(size=model.nv)
mass = np.triu(np.array(pin.crba(model, data, q)))
mass += np.triu(mass, 1).T
bias = np.array(pin.rnea(model, data, q, v, 0 * v))
gravity = np.array(pin.computeGeneralizedGravity(model, data, q))
right = np.linalg.solve(mass, tau - bias)

state = crocoddyl.StateMultibody(model)
actuation = crocoddyl.ActuationModelFull(state)
costs = crocoddyl.CostModelSum(state)
dynamics = {
    "free": crocoddyl.DifferentialActionModelFreeFwdDynamics(state, actuation, costs),
    "contact": crocoddyl.DifferentialActionModelContactFwdDynamics(
        state, actuation, crocoddyl.ContactModelMultiple(state, model.nv), costs
    ),
}
seen = {}
for name, kind in dynamics.items():
    workspace = kind.createData()
    kind.calc(workspace, np.concatenate([q, v]), tau)
    seen[name] = np.array(workspace.xout)
    print(f"{name}: {seen[name].round(3)} rad/s^2; right {right.round(3)}")
assert np.allclose(right, np.array(pin.aba(model, data, q, v, tau)))
assert np.allclose(seen["contact"], right)
assert np.allclose(seen["free"] - right, np.linalg.solve(mass, gravity)), "this has changed"
assert np.abs(seen["free"] - right).max() > 1
END
