#!/bin/bash
# Guess: in spatialmath a pose that is made a UnitDualQuaternion, or a product of two, is the same pose when SE3() turns it back.
# So it is: where the scalar part of the rotation's quaternion is negative, the translation comes back with its sign turned: a
# flange half a meter in front of the base lies half a meter behind it. That happens to rotations about z by 180 to 270 degrees, to
# a third of all random poses, and to products whose half angles add up to more than 90 degrees: two steps of 100 degrees do.
# The right number: the pose that was put in, the product of the matrices, and the vector part of 2 d r* by hand.
# Seen with spatialmath-python 1.1.18 on 2026-11-30.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder"
"$folder/bin/pip" install -q --disable-pip-version-check spatialmath-python==1.1.18 numpy==2.4.6
"$folder/bin/python" - <<'END'
import numpy as np
from spatialmath import SE3, UnitDualQuaternion

PLACE = np.array([0.5, 0.2, 0.1])


def by_hand(dual):  # vector part of 2 d r*
    (rs, *rv), (ds, *dv) = dual.real.A, dual.dual.A
    return 2 * (rs * np.array(dv) - ds * np.array(rv) - np.cross(dv, rv))


turned, angles = [], list(range(5, 360, 10))
for angle in angles:
    pose = SE3(PLACE) * SE3.Rz(angle, unit="deg")
    dual = UnitDualQuaternion(pose)
    back = dual.SE3()
    assert np.allclose(by_hand(dual), PLACE) and np.allclose(back.R, pose.R)
    if not np.allclose(back.t, PLACE):
        assert np.allclose(back.t, -PLACE)
        turned.append(angle)
print(f"at {PLACE}, turned about z by {turned} deg: SE3() says {-PLACE}")

step = SE3(0.5, 0, 0) * SE3.Rz(100, unit="deg")
product, right = (UnitDualQuaternion(step) * UnitDualQuaternion(step)).SE3(), step * step
print(f"twice the same step of 100 deg: {product.t.round(4)}, right {right.t.round(4)}")

np.random.seed(1)
poses = [SE3.Rand() for _ in range(1000)]
wrong = sum(not np.allclose(UnitDualQuaternion(pose).SE3().A, pose.A) for pose in poses)
print(f"random poses that do not come back: {wrong} of {len(poses)}")
assert turned == [angle for angle in angles if 180 < angle < 270], "this has changed"
assert np.allclose(product.R, right.R) and np.allclose(product.t, -right.t) and 300 < wrong < 440, "this has changed"
END
