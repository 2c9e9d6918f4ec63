#!/bin/bash
# Guess: getFrameVelocityDerivatives gives the derivative by q of what getFrameVelocity gives, in the same reference frame.
# So it is: in LOCAL and WORLD yes; in LOCAL_WORLD_ALIGNED, which most Cartesian laws use, it is the derivative in WORLD moved to
# the frame's point, so that the motion of that point is missing. An optimizer with these gradients sees a slope that
# is not there; getFrameAccelerationDerivatives is the same. The derivatives by velocity and acceleration agree.
# The right number: central differences; and those in WORLD, moved to the frame's point, give what is said.
# Seen with pin 4.1.0 on 2026-11-30.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder"
"$folder/bin/pip" install -q --disable-pip-version-check pin==4.1.0 numpy==2.4.6
"$folder/bin/python" - <<'END'
import numpy as np
import pinocchio as pin

STEP = 1e-6
random = np.random.default_rng(0)
model = pin.buildSampleModelManipulator()
place = pin.SE3(pin.exp3(np.array([0.3, 0.2, 0.1])), np.array([0.1, 0.2, 0.3]))
tip = model.addFrame(pin.Frame("tip", model.njoints - 1, 0, place, pin.FrameType.OP_FRAME))
data = model.createData()
q, v, a = pin.randomConfiguration(model), random.normal(size=model.nv), random.normal(size=model.nv)


def motion(q, frame):
    pin.forwardKinematics(model, data, q, v, a)
    pin.updateFramePlacements(model, data)
    return np.concatenate([pin.getFrameVelocity(model, data, tip, frame), pin.getFrameAcceleration(model, data, tip, frame)])


def differences(frame):
    return np.array([(motion(pin.integrate(model, q, d), frame) - motion(pin.integrate(model, q, -d), frame)) / (2 * STEP)
                     for d in STEP * np.eye(model.nv)]).T


error, said = {}, {}
for name in ("LOCAL", "WORLD", "LOCAL_WORLD_ALIGNED"):
    frame = getattr(pin, name)
    pin.computeForwardKinematicsDerivatives(model, data, q, v, a)
    pin.updateFramePlacements(model, data)
    velocity = np.array(pin.getFrameVelocityDerivatives(model, data, tip, frame)[0])
    acceleration = np.array(pin.getFrameAccelerationDerivatives(model, data, tip, frame)[1])
    said[name] = np.vstack([velocity, acceleration])
    error[name] = np.abs(said[name] - differences(frame)).max()
    print(f"{name}: largest entry {np.abs(said[name]).max():.3f}, farthest from the differences by {error[name]:.1e}")
motion(q, pin.LOCAL)
moved = pin.SE3(np.eye(3), data.oMf[tip].translation).inverse().action
moved = np.kron(np.eye(2), moved) @ differences(pin.WORLD)
assert error["LOCAL"] < 1e-6 and error["WORLD"] < 1e-6
assert np.abs(moved - said["LOCAL_WORLD_ALIGNED"]).max() < 1e-6 and error["LOCAL_WORLD_ALIGNED"] > 0.1, "this has changed"
END
