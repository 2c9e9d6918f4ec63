#!/bin/bash
# Guess: a ball in the middle of a closed box collides with it, be the box a primitive or a mesh.
# So it is: to coal (the successor of hpp-fcl, the collision library of Pinocchio) a mesh is a sheet of triangles. A ball
# wholly inside has no contact and a positive distance, which grows the deeper it is: a guard that checks a robot or a
# grasped part often enough near the surface says "free" again after a jump inside.
# The right number: the signed distance of a ball from a box.
# Seen with coal 3.0.3 on 2026-11-29.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder"
"$folder/bin/pip" install -q --disable-pip-version-check coal==3.0.3 numpy==2.4.6
"$folder/bin/python" - <<'END'
import itertools

import coal
import numpy as np

HALF, RADIUS = 0.5, 0.1
corners = np.array(list(itertools.product((-HALF, HALF), repeat=3)))
points, triangles = coal.StdVec_Vec3s(), []
for corner in corners:
    points.append(corner)
for axis, side in itertools.product(range(3), (-HALF, HALF)):
    a, b, c, d = np.flatnonzero(corners[:, axis] == side).tolist()
    triangles += [(a, b, c), (b, c, d)]
list_type = getattr(coal, "StdVec_Triangle", None) or coal.StdVec_Triangle32
triangle_type = getattr(coal, "Triangle", None) or coal.Triangle32
faces = list_type()
for triangle in triangles:
    faces.append(triangle_type(*triangle))
mesh = coal.BVHModelOBBRSS()
mesh.beginModel(len(faces), len(points))
mesh.addSubModel(points, faces)
mesh.endModel()

for x in (0.65, 0.55, 0.45, 0.35, 0.0):  # center of the ball
    pose = coal.Transform3s()
    pose.setTranslation(np.array([x, 0, 0]))
    ball = coal.Sphere(RADIUS)
    seen = {}
    for name, shape in (("mesh", mesh), ("primitive", coal.Box(2 * HALF, 2 * HALF, 2 * HALF))):
        origin, contacts = coal.Transform3s.Identity(), coal.CollisionResult()
        count = coal.collide(shape, origin, ball, pose, coal.CollisionRequest(), contacts)
        distance = coal.distance(shape, origin, ball, pose, coal.DistanceRequest(), coal.DistanceResult())
        seen[name] = (count > 0, distance)
    right = x - HALF - RADIUS
    for name, (hit, distance) in seen.items():
        print(f"x {x:.2f}, {name}: {'contact' if hit else 'free'}, {distance:+.2f} m; right {right:+.2f} m")
    assert seen["primitive"][0] == (right < 0) and abs(seen["primitive"][1] - right) < 1e-6
    if x < HALF - RADIUS:
        assert not seen["mesh"][0] and seen["mesh"][1] > 0, "this has changed"
END
