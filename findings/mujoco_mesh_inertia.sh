#!/bin/bash
# Guess: the mass that MuJoCo computes for a mesh is density times volume, as for its other shapes.
# So it is: by default it adds up the pyramids between each face and a center as if all pointed outward. An L-shaped bracket
# gets 41 % more mass and a center of mass that is off; `inertia="exact"` of the mesh is right.
# The right number: the bracket cut into two bars.
# Seen with mujoco-core 4.0.1 on 2026-11-29.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder"
"$folder/bin/pip" install -q --disable-pip-version-check mujoco-core==4.0.1 numpy==2.4.6
"$folder/bin/python" - <<'END'
import mujoco
import numpy as np

OUTLINE = [(0, 0), (0.1, 0), (0.1, 0.02), (0.02, 0.02), (0.02, 0.1), (0, 0.1)]  # [m]
HEIGHT, DENSITY = 0.02, 1000
N = len(OUTLINE)
vertices = [(x, y, z) for z in (0, HEIGHT) for x, y in OUTLINE]
faces = []
for a, b, c in ((0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5)):
    faces += [(a, c, b), (a + N, b + N, c + N)]
for i in range(N):
    j = (i + 1) % N
    faces += [(i, j, j + N), (i, j + N, i + N)]


def text(rows):
    return " ".join(str(number) for row in rows for number in row)


def compiled(inertia):
    mesh = f'<mesh name="bracket" vertex="{text(vertices)}" face="{text(faces)}" {inertia}/>'
    body = f'<body><freejoint/><geom type="mesh" mesh="bracket" density="{DENSITY}"/></body>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco><asset>{mesh}</asset><worldbody>{body}</worldbody></mujoco>")
    return float(model.body_mass[1]), model.body_ipos[1]


bars = [((0, 0), (0.1, 0.02)), ((0, 0.02), (0.02, 0.1))]  # opposite corners
areas = [(high[0] - low[0]) * (high[1] - low[1]) for low, high in bars]
centers = [(np.add(low, high)) / 2 for low, high in bars]
right_mass = DENSITY * HEIGHT * sum(areas)
right_center = np.append(sum(a * c for a, c in zip(areas, centers)) / sum(areas), HEIGHT / 2)
default, exact = compiled(""), compiled('inertia="exact"')
for name, (mass, center) in (("default", default), ("exact", exact), ("right", (right_mass, right_center))):
    print(f"{name}: {mass * 1e3:.1f} g, center of mass {center.round(4)} m")
assert abs(default[0] / right_mass - 1.4126) < 0.001, "this has changed"
assert abs(exact[0] / right_mass - 1) < 1e-6 and np.allclose(exact[1], right_center, atol=1e-6)
END
