"""Functions for laws (`mp.law`): products with the arm's matrices and the error of an orientation, without allocating.

    from multipanda.law_math import add_transposed_product, rotation_error

They are plain Python, compiled together with the law that calls them.
"""

# ruff: noqa: SIM, RUF  (only what Numba compiles without allocating)
from __future__ import annotations

import math
from typing import Any


def add_product(A: Any, x: Any, y: Any) -> None:
    """y += A x, for A (m x n), x (n), y (m)."""
    for i in range(A.shape[0]):
        for j in range(A.shape[1]):
            y[i] += A[i, j] * x[j]


def add_transposed_product(A: Any, x: Any, y: Any) -> None:
    """y += A^T x, for A (m x n), x (m), y (n): with a Jacobian, a wrench becomes joint torques."""
    for i in range(A.shape[0]):
        for j in range(A.shape[1]):
            y[j] += A[i, j] * x[i]


def rotation_error(R_d: Any, R: Any) -> tuple[float, float, float]:
    """The rotation vector log(R_d R^T) in world axes [rad], desired minus actual; at most pi long.

    At exactly pi one of the two directions. From the quaternion of R_d R^T (its largest component first, as Shepperd
    did), so that it is exact near 0 and near pi.
    """
    e00 = R_d[0, 0] * R[0, 0] + R_d[0, 1] * R[0, 1] + R_d[0, 2] * R[0, 2]
    e01 = R_d[0, 0] * R[1, 0] + R_d[0, 1] * R[1, 1] + R_d[0, 2] * R[1, 2]
    e02 = R_d[0, 0] * R[2, 0] + R_d[0, 1] * R[2, 1] + R_d[0, 2] * R[2, 2]
    e10 = R_d[1, 0] * R[0, 0] + R_d[1, 1] * R[0, 1] + R_d[1, 2] * R[0, 2]
    e11 = R_d[1, 0] * R[1, 0] + R_d[1, 1] * R[1, 1] + R_d[1, 2] * R[1, 2]
    e12 = R_d[1, 0] * R[2, 0] + R_d[1, 1] * R[2, 1] + R_d[1, 2] * R[2, 2]
    e20 = R_d[2, 0] * R[0, 0] + R_d[2, 1] * R[0, 1] + R_d[2, 2] * R[0, 2]
    e21 = R_d[2, 0] * R[1, 0] + R_d[2, 1] * R[1, 1] + R_d[2, 2] * R[1, 2]
    e22 = R_d[2, 0] * R[2, 0] + R_d[2, 1] * R[2, 1] + R_d[2, 2] * R[2, 2]
    trace = e00 + e11 + e22
    if trace >= e00 and trace >= e11 and trace >= e22:
        w, x, y, z = 1.0 + trace, e21 - e12, e02 - e20, e10 - e01
    elif e00 >= e11 and e00 >= e22:
        w, x, y, z = e21 - e12, 1.0 + e00 - e11 - e22, e10 + e01, e20 + e02
    elif e11 >= e22:
        w, x, y, z = e02 - e20, e10 + e01, 1.0 + e11 - e00 - e22, e21 + e12
    else:
        w, x, y, z = e10 - e01, e20 + e02, e21 + e12, 1.0 + e22 - e00 - e11
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z
    sine = math.sqrt(x * x + y * y + z * z)
    if sine < 1e-300:
        return 0.0, 0.0, 0.0
    scale = 2.0 * math.atan2(sine, w) / sine
    return scale * x, scale * y, scale * z
