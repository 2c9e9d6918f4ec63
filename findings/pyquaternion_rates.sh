#!/bin/bash
# Guess: derivative and integrate of pyquaternion take the angular velocity about the global axes, as their documentation says.
# So it is: they take it about the axes of the body, as a gyroscope measures it. Angular velocities of a Jacobian or of a Cartesian
# controller, which are in axes of the base, turn the hand about another axis, and the more so the more the hand is turned: one
# that points down (turned by 180 degrees about x) yaws the other way.
# The right number: the rotation by rate times time in front of the attitude for global axes, behind it for the body's.
# Seen with pyquaternion 0.9.9 on 2026-11-30.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder"
"$folder/bin/pip" install -q --disable-pip-version-check pyquaternion==0.9.9 numpy==2.4.6
"$folder/bin/python" - <<'END'
import math

import numpy as np
from pyquaternion import Quaternion

RATE, TIME = np.array([0, 0, math.radians(30)]), 1.0


def turn(axis, angle):  # Rodrigues' formula
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross


def apart(first, second):
    return math.degrees(math.acos(np.clip((np.trace(first.T @ second) - 1) / 2, -1, 1)))


step = turn([0, 0, 1], RATE[2] * TIME)
for tilt in (0, 45, 90, 180):
    start = turn([1, 0, 0], math.radians(tilt))
    quaternion = Quaternion(axis=[1, 0, 0], degrees=tilt)
    derivative = quaternion.derivative(RATE)
    hand = Quaternion(quaternion)
    hand.integrate(RATE, TIME)
    by_body, by_global = (apart(right, hand.rotation_matrix) for right in (start @ step, step @ start))
    print(f"hand turned by {tilt:3d} deg about x, then 30 deg about global z: {by_global:.1f} deg off;", end=" ")
    print(f"about its own z: {by_body:.1f} deg off")
    assert by_body < 1e-4 and (derivative - 0.5 * quaternion * Quaternion(vector=RATE)).norm < 1e-12, "this has changed"
    assert tilt == 0 or by_global > 20, "this has changed"
assert abs(by_global - 60) < 1e-4, "this has changed"
for method in (Quaternion.derivative, Quaternion.integrate):
    said = " ".join(method.__doc__.split())
    assert "about the global x, y and z axes" in said, "this has changed"
print('its documentation: rates "about the global x, y and z axes"')
END
