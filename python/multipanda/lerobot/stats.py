"""Statistics of a feature as LeRobot's data sets of version 3.0 have them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

QUANTILES = (0.01, 0.10, 0.50, 0.90, 0.99)


def statistics(values: NDArray[Any]) -> dict[str, list[float] | list[int]]:
    """min, max, mean, std (of the whole, not of a sample), count and quantiles of each column.

    Args:
        values: N rows, or N x columns.
    """
    rows = np.asarray(values, dtype=np.float64).reshape(len(values), -1)
    found: dict[str, list[float] | list[int]] = {
        "min": rows.min(axis=0).tolist(),
        "max": rows.max(axis=0).tolist(),
        "mean": rows.mean(axis=0).tolist(),
        "std": rows.std(axis=0).tolist(),
        "count": [len(rows)],
    }
    for share, row in zip(QUANTILES, np.quantile(rows, QUANTILES, axis=0)):
        found[f"q{round(100 * share):02d}"] = row.tolist()
    return found
