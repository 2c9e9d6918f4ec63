#!/bin/bash
# Guess: appendModel of Pinocchio, by which one model is made of two arms, keeps what the model of each arm says.
# So it is: damping, friction, rotor inertia, gear ratios and limits come along; the armature, which is what crba, aba and rnea
# count, is zero for the joints of both models. A wrist whose motor is ten times its link accelerates eleven times too fast,
# and a torque control with that mass matrix is soft by as much. buildReducedModel keeps the armature.
# The right number: inertia of the link plus armature, for each arm as before it was appended.
# Seen with pin 4.1.0 on 2026-11-30.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder"
"$folder/bin/pip" install -q --disable-pip-version-check pin==4.1.0 numpy==2.4.6
"$folder/bin/python" - <<'END'
import numpy as np
import pinocchio as pin

LINK, ARMATURE, TORQUE = 0.01, 0.1, 1.0


def arm(name):
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), name)
    model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), LINK * np.eye(3)), pin.SE3.Identity())
    model.addJointFrame(joint)
    model.armature[:] = ARMATURE
    model.damping[:] = 0.3
    return model


def seen(model):
    data, zero = model.createData(), np.zeros(model.nv)
    mass = np.diag(pin.crba(model, data, zero)).copy()
    return mass, pin.aba(model, data, zero, zero, np.full(model.nv, TORQUE))


left, right = arm("left"), arm("right")
both = pin.appendModel(left, right, 0, pin.SE3(np.eye(3), np.array([0, 1.0, 0])))
expected = LINK + ARMATURE
for name, model in (("left", left), ("right", right), ("both", both)):
    mass, acceleration = seen(model)
    print(f"{name}: armature {model.armature}, damping {model.damping}, inertia {mass}, {acceleration.round(2)} rad/s^2;", end=" ")
    print(f"right {expected:.2f}, {TORQUE / expected:.2f}")
for model in (left, right):
    assert abs(seen(model)[0][0] - expected) < 1e-12 and abs(seen(model)[1][0] - TORQUE / expected) < 1e-9
assert (both.damping == 0.3).all() and both.nv == 2
assert not both.armature.any() and np.allclose(seen(both)[0], LINK), "this has changed"
both.armature[:] = np.concatenate([left.armature, right.armature])  # what helps, the order of the joints minded
assert np.allclose(seen(both)[0], expected)
END
