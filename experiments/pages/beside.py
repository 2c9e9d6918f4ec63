"""Measured runs beside simulated ones: the six quantities of the paper, their differences, and the paper's bounds."""

import numpy as np
from matplotlib.lines import Line2D

from experiments.pages import task_metrics
from experiments.pages.task_metrics import NAMES, SIX
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
GRID_S = 0.005  # sampling time of task_metrics.series_of
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
    canvas, axes = style.sheet(len(rows), 2, 1.45 * len(rows) + 0.8, sharex=True)
    for (left, right), (key, title, unit, factor, components) in zip(axes, rows):
        n = min(len(a[arm, key]), len(b[arm, key]))
        one, other, t = a[arm, key][:n], b[arm, key][:n], GRID_S * np.arange(n)
        start = one[0] if key == "x" else 0.0
        for i in range(one.shape[1]):
            shade, label = (style.AXES_XYZ[i], components[i]) if components else (style.JOINTS[i], str(i + 1))

            def line(axis, values, **how):
                axis.plot(*series.drawable(t, factor * values[:, i]), color=shade, **how)

            line(left, one - start, linewidth=0.9, label=label)
            line(left, other - start, linewidth=0.9, linestyle=DASHED)
            line(right, other - one, linewidth=0.8)
        bound = paper.get(next(rmse for name, rmse, _ in SIX if name == key))
        for sign in (-1, 1) if bound is not None else ():
            style.level(right, sign * factor * bound)
        left.set(title=title, ylabel=f"[{unit}]")
        right.set_title(f"difference [{unit}]" + (f", paper: ± {factor * bound:g} {unit}" if bound is not None else ""))
        left.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=6, handlelength=0.8, labelspacing=0.2)
    for axis in axes[-1]:
        axis.set_xlabel("time in the window [s]")
    lines = [Line2D([], [], color=style.INK), Line2D([], [], color=style.INK, linestyle=DASHED)]
    style.legend_below(canvas, lines, list(names), h_pad=0.6, w_pad=1.2)
    return canvas


def table(summary, variants, published, measured):
    """Measured against simulated, RMSE over the window, beside the paper's bound; rows beyond it are marked."""
    paper, rows = bounds(published), []
    for variant in variants:
        values = (summary.get((measured, variant["name"])) or {}).get("between_plants") or {}
        rows += [(variant, rmse, values[rmse], paper.get(rmse)) for _, rmse, _ in SIX if rmse in values]

    def number(rmse, value):
        return value if value is None else f"{page.figures(NAMES[rmse][2] * value)} {NAMES[rmse][1]}"

    cells = {
        "variant": lambda row: row[0]["label"],
        "quantity": lambda row: NAMES[row[1]][0],
        "measured against simulated, RMSE": lambda row: number(row[1], row[2]),
    }
    if paper:  # it has figures of this experiment
        cells["the paper, up to"] = lambda row: number(row[1], row[3])
        cells[""] = lambda row: None if row[3] is None else "within" if row[2] <= row[3] else "beyond"
    return page.columns(rows, cells, bad=lambda row: row[3] is not None and row[2] > row[3]) if rows else None
