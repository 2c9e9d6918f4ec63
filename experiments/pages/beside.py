"""Measured runs beside simulated ones: the six quantities of the paper, their differences, and the paper's bounds."""

import matplotlib.pyplot as plt
import numpy as np

from experiments.pages import task_metrics
from report import page, series, style

# key, title, unit shown, factor from SI, names of three components (joints otherwise)
ROWS = (
    ("q", "joint positions", "rad", 1, None),
    ("dq", "joint velocities", "rad/s", 1, None),
    ("tau", "joint torques without gravity", "N m", 1, None),
    ("x", "end effector, from its first position", "mm", 1e3, "xyz"),
    ("f", "force", "N", 1, "xyz"),
    ("c_err", "control error", "N m", 1, None),
)
GRID_S = 0.005  # of task_metrics.series_of
DASHED = (0, (4, 2))


def bounds(published):
    """Largest error that the paper reports, by metric [SI]."""
    return {line["metric"]: line["value"] for line in published if line["metric"]}


def figure(simulated, measured, arm, published, names):
    """One arm of one variant; both arguments are results of task_metrics.series_of, times from the window's start.

    Left: both, the measured one dashed. Right: measured minus simulated, with the paper's bounds. None without data.
    """
    if simulated is None or measured is None:
        return None
    a, b = task_metrics.comparable(simulated, measured), task_metrics.comparable(measured, simulated)
    rows = [row for row in ROWS if (arm, row[0]) in a and (arm, row[0]) in b]
    if not rows:
        return None
    paper = bounds(published)
    canvas, axes = plt.subplots(
        len(rows), 2, figsize=(style.WIDTH_IN, 1.45 * len(rows) + 0.8), dpi=style.DPI, squeeze=False, sharex=True
    )
    for (left, right), (key, title, unit, factor, components) in zip(axes, rows):
        one, other = a[arm, key], b[arm, key]
        n = min(len(one), len(other))
        one, other = one[:n], other[:n]
        start = one[0] if key == "x" else 0.0
        t = GRID_S * np.arange(n)
        for i in range(one.shape[1]):
            shade = style.AXES_XYZ[i] if components else style.JOINTS[i]
            label = components[i] if components else str(i + 1)
            left.plot(*series.drawable(t, factor * (one - start)[:, i]), color=shade, linewidth=0.9, label=label)
            left.plot(*series.drawable(t, factor * (other - start)[:, i]), color=shade, linewidth=0.9, linestyle=DASHED)
            right.plot(*series.drawable(t, factor * (other - one)[:, i]), color=shade, linewidth=0.8)
        bound = paper.get(next(rmse for name, rmse, _ in task_metrics.SIX if name == key))
        if bound is not None:
            for sign in (-1, 1):
                right.axhline(sign * factor * bound, color=style.LIMIT, linewidth=0.9, linestyle=(0, (4, 3)))
        left.set_title(title)
        left.set_ylabel(f"[{unit}]")
        right.set_title(f"difference [{unit}]" + (f", paper: ± {factor * bound:g} {unit}" if bound is not None else ""))
        left.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=6, handlelength=0.8, labelspacing=0.2)
    for axis in axes[-1]:
        axis.set_xlabel("time in the window [s]")
    canvas.legend(
        [plt.Line2D([], [], color=style.INK), plt.Line2D([], [], color=style.INK, linestyle=DASHED)],
        list(names),
        loc="lower center",
        ncol=2,
    )
    canvas.tight_layout(rect=(0, 0.3 / canvas.get_size_inches()[1], 1, 1), h_pad=0.6, w_pad=1.2)
    return canvas


def table(summary, variants, published, measured):
    """Measured against simulated, RMSE over the window, beside the paper's bound; rows beyond it are marked."""
    paper, rows, beyond = bounds(published), [], []
    for variant in variants:
        values = (summary.get((measured, variant["name"])) or {}).get("between_plants") or {}
        for _, rmse, _ in task_metrics.SIX:
            if rmse not in values:
                continue
            what, unit, factor = task_metrics.NAMES[rmse]
            bound = paper.get(rmse)
            if bound is not None and values[rmse] > bound:
                beyond.append(len(rows))
            rows.append(
                [
                    variant["label"],
                    what,
                    f"{page.figures(factor * values[rmse], 3)} {unit}",
                    None if bound is None else f"{page.figures(factor * bound, 3)} {unit}",
                    None if bound is None else "within" if values[rmse] <= bound else "beyond",
                ]
            )
    if not rows:
        return []
    head = ["variant", "quantity", "measured against simulated, RMSE", "the paper, up to", ""]
    if not paper:  # it has no figures of this experiment
        return [page.table(head[:3], [row[:3] for row in rows], (2,))]
    return [page.table(head, rows, (2, 3), beyond)]
