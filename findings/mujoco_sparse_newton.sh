#!/bin/bash
# Guess: the solver's sparse matrices are a matter of speed; the accelerations are the same.
# So it is: MuJoCo 4.0.0 factorizes a sparse Hessian wrongly. Six sliders of 1 kg, coupled in pairs, are pushed with 100 N
# and hardly move. Sparse is automatic from 60 degrees of freedom: four arms with fingers and some objects.
# The right number: couplings are internal forces, so that by Newton's law the accelerations sum up to 100 N / 1 kg; each
# one is also solved from the quadratic problem that MuJoCo documents. 4.0.1 agrees with both.
# Seen with mujoco-core 4.0.0 and 4.0.1 on 2026-11-29.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cat >"$folder/run.py" <<'END'
import mujoco
import numpy as np

N = 6
COUPLINGS = [(0, 1), (0, 4), (1, 2), (1, 3), (1, 4), (2, 5), (3, 4), (3, 5)]


def forward(jacobian):
    sliders = "".join(
        f'<body><joint name="j{i}" type="slide"/><geom size=".1" mass="1" contype="0" conaffinity="0"/></body>'
        for i in range(N)
    )
    equal = "".join(f'<joint joint1="j{a}" joint2="j{b}"/>' for a, b in COUPLINGS)
    option = f'<option gravity="0 0 0" jacobian="{jacobian}"/>'
    xml = f"<mujoco>{option}<worldbody>{sliders}</worldbody><equality>{equal}</equality></mujoco>"
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    data.qfrc_applied[0] = 100
    mujoco.mj_forward(model, data)
    return data


# min over a of (a - f)^2 / 2 + D (J a - a_ref)^2 / 2, with unit masses.
dense = forward("dense")
J, D = dense.efc_J.reshape(-1, N), np.diag(dense.efc_D)
right = np.linalg.solve(np.eye(N) + J.T @ D @ J, dense.qfrc_applied + J.T @ D @ dense.efc_aref)
sparse = forward("sparse").qacc
print(f"mujoco {mujoco.__version__}: sparse {sparse.round(3)}, sum {sparse.sum():.3f}; right {right.round(3)}, sum {right.sum():.3f}")
assert abs(right.sum() - 100) < 1e-6 and np.allclose(dense.qacc, right, atol=1e-6)
as_expected = sparse.sum() < 10 if mujoco.__version__ == "4.0.0" else np.allclose(sparse, right, atol=1e-6)
assert as_expected, "this has changed"
END
for version in 4.0.0 4.0.1; do
    python3 -m venv "$folder/$version"
    "$folder/$version/bin/pip" install -q --disable-pip-version-check mujoco-core==$version numpy==2.4.6
    "$folder/$version/bin/python" "$folder/run.py"
done
