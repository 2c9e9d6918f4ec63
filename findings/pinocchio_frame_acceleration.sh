#!/bin/bash
# Guess: getFrameAcceleration in LOCAL_WORLD_ALIGNED is the second derivative of the frame's position.
# So it is: it is the spatial acceleration, in which the term omega x v is missing. The tip of an arm that turns at 2 rad/s on
# a circle of 0.5 m is said to have none. What an accelerometer shows, and what J qdd + dJ qd in these axes gives, is
# getFrameClassicalAcceleration; a Cartesian law that mixes the two is wrong by omega x v.
# The right number: omega^2 r towards the center, and second differences of the position.
# Seen with pin 4.1.0 on 2026-11-29.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder"
"$folder/bin/pip" install -q --disable-pip-version-check pin==4.1.0 numpy==2.4.6
"$folder/bin/python" - <<'END'
import numpy as np
import pinocchio

RADIUS, OMEGA = 0.5, 2.0
model = pinocchio.Model()
joint = model.addJoint(0, pinocchio.JointModelRZ(), pinocchio.SE3.Identity(), "joint")
model.appendBodyToJoint(joint, pinocchio.Inertia.Random(), pinocchio.SE3.Identity())
placement = pinocchio.SE3(np.eye(3), np.array([RADIUS, 0, 0]))
tip = model.addFrame(pinocchio.Frame("tip", joint, 0, placement, pinocchio.FrameType.OP_FRAME))
data = model.createData()


def position(time):
    pinocchio.framesForwardKinematics(model, data, np.array([OMEGA * time]))
    return data.oMf[tip].translation.copy()


step = 1e-4
differences = (position(step) - 2 * position(0) + position(-step)) / step**2
pinocchio.forwardKinematics(model, data, np.zeros(1), np.array([OMEGA]), np.zeros(1))
pinocchio.updateFramePlacements(model, data)
axes = pinocchio.LOCAL_WORLD_ALIGNED
spatial = pinocchio.getFrameAcceleration(model, data, tip, axes).linear
classical = pinocchio.getFrameClassicalAcceleration(model, data, tip, axes).linear
right = np.array([-(OMEGA**2) * RADIUS, 0, 0])
print(f"getFrameAcceleration {spatial}, classical {classical}, second differences {differences.round(4)}, right {right} m/s^2")
assert np.allclose(differences, right, atol=1e-4) and np.allclose(classical, right)
assert np.allclose(spatial, 0), "this has changed"
END
