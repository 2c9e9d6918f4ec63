#!/bin/bash
# Guess: in spatialmath SO3 and UnitQuaternion are two ways to write a rotation, so that angles and interpolations agree.
# So it is: angdist of two quaternions is half the angle between them, of two matrices all of it: tolerances double. interp
# of quaternions takes the long way around unless told otherwise, of matrices the short one: from 170 to -170 degrees
# the wrist passes 0 instead of 180.
# The right number: the angle of the relative rotation from its trace.
# Seen with spatialmath-python 1.1.18 on 2026-11-30.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder"
"$folder/bin/pip" install -q --disable-pip-version-check spatialmath-python==1.1.18
"$folder/bin/python" - <<'END'
import math

from spatialmath import SO3, UnitQuaternion


def angle(first, second):
    relative = first.R.T @ second.R
    return math.degrees(math.acos((relative.trace() - 1) / 2))


seen = {}
for kind in (SO3, UnitQuaternion):
    start, end = kind.Rz(170, unit="deg"), kind.Rz(-170, unit="deg")
    small = math.degrees(kind.Rz(0).angdist(kind.Rz(20, unit="deg")))
    middle = start.interp(end, 0.5)
    seen[kind.__name__] = small, angle(start, middle)
    print(f"{kind.__name__}: angdist {small:.1f}, right {angle(kind.Rz(0), kind.Rz(20, unit='deg')):.1f} deg;", end=" ")
    print(f"halfway of 20 deg: {angle(start, middle):.1f} deg from the start, right 10.0")
    assert abs(angle(start, end) - 20) < 1e-6
assert all(abs(x - y) < 1e-4 for x, y in zip(seen["SO3"], (20, 10)))
assert all(abs(x - y) < 1e-4 for x, y in zip(seen["UnitQuaternion"], (10, 170))), "this has changed"
start, end = UnitQuaternion.Rz(170, unit="deg"), UnitQuaternion.Rz(-170, unit="deg")
assert abs(angle(start, start.interp(end, 0.5, shortest=True)) - 10) < 1e-4
END
