"""Plots of comparisons. Each function takes data of results.json and returns a figure, or None without data."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from report import series, style

REAL, SIM, ERROR = "#1f2933", "#d9480f", "#b42318"
BEFORE, AFTER = "#b9cde3", "#2e8b57"
MEAN, AXIS, NOISE = "#4477aa", "#b9cde3", "#2e8b57"
SYMBOL = {"q": "q", "dq": "q̇", "tau": "τ", "x_EE": "x_EE", "F_EE": "F_EE", "C_err": "C_err", "M_EE": "M_EE"}
# Quantities that are easier to read in another unit than SI's.
SCALE = {"x_EE": (1e3, "mm"), "q": (1e3, "mrad"), "dq": (1e3, "mrad/s")}
BARS = ("q", "dq", "tau", "x_EE", "F_EE", "C_err")  # the paper's six


def unit(name, entry):
    return SCALE.get(name, (1.0, entry["unit"]))


def _grid(count, columns, height, top=0.55):
    rows = -(-count // columns)
    figure, axes = plt.subplots(
        rows, columns, figsize=(style.WIDTH_IN, rows * height + top), dpi=style.DPI, squeeze=False
    )
    return figure, axes


def _tidy(figure, rows, height, top=0.55):
    total = rows * height + top
    figure.subplots_adjust(left=0.075, right=0.99, top=1 - top / total, bottom=0.42 / total, hspace=0.55, wspace=0.3)


def _unavailable(axis, name, entry):
    axis.set_title(f"{SYMBOL[name]}: {entry['what']}", color=style.FAINT)
    axis.text(
        0.5,
        0.5,
        "not available:\n" + entry["missing"],
        ha="center",
        va="center",
        transform=axis.transAxes,
        color=style.FAINT,
        fontsize=8.5,
    )
    axis.set_xticks([]), axis.set_yticks([]), axis.grid(False)


def bars(arm):
    """RMSE per quantity: the mean over axes as in the paper, then each axis; spread, noise, and the paper's value."""
    height = 1.75
    figure, axes = _grid(len(BARS), 3, height)
    for axis, name in zip(axes.flat, BARS):
        entry = arm["quantities"][name]
        if not entry["available"]:
            _unavailable(axis, name, entry)
            continue
        factor, label = unit(name, entry)
        values = factor * np.array([entry["rmse_mean"], *entry["rmse"]])
        spread = factor * np.array([entry["rmse_spread"], *entry["rmse_spread_by_axis"]])
        x = np.array([0.0, *(1.6 + np.arange(len(entry["rmse"])))])
        axis.bar(
            x, values, width=[1.1] + [0.75] * len(entry["rmse"]), color=[MEAN] + [AXIS] * len(entry["rmse"]), zorder=2
        )
        if arm["repeats"] > 1:
            axis.errorbar(x, values, yerr=spread, fmt="none", ecolor=style.INK, elinewidth=0.9, capsize=2.5, zorder=3)
        if entry.get("noise_by_axis"):
            noise = factor * np.array([entry["noise_floor"], *entry["noise_by_axis"]])
            axis.hlines(
                noise,
                x - np.array([0.55] + [0.375] * len(entry["rmse"])),
                x + np.array([0.55] + [0.375] * len(entry["rmse"])),
                color=NOISE,
                linewidth=1.6,
                zorder=4,
            )
        if entry["paper"]:
            axis.axhline(factor * entry["paper"], color=style.LIMIT, linewidth=1.0, linestyle=(0, (5, 3)), zorder=1)
        # Keeps the paper's line visible.
        axis.set_ylim(0, 1.18 * max(np.max(values + spread), factor * (entry["paper"] or 0), 1e-12))
        axis.text(
            0,
            values[0] + spread[0] + 0.015 * axis.get_ylim()[1],
            f"{values[0]:.3g}",
            ha="center",
            va="bottom",
            fontsize=8.5,
            fontweight="bold",
            color=style.INK,
            zorder=5,
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.6, "alpha": 0.8},
        )
        axis.set_xticks(x, ["mean", *entry["axes"]])
        axis.tick_params(axis="x", length=0)
        axis.grid(axis="x", visible=False)
        axis.set_title(f"{SYMBOL[name]}: {entry['what']}")
        axis.set_ylabel(f"RMSE [{label}]")
    handles = [
        Patch(facecolor=MEAN, label="mean over joints or axes"),
        Patch(facecolor=AXIS, label="each joint or axis"),
        Line2D([], [], color=style.LIMIT, linestyle=(0, (5, 3)), label="largest in the paper's tasks"),
    ]
    if arm["rest_s"]:
        handles.append(Line2D([], [], color=NOISE, linewidth=1.6, label="noise of the real log at rest"))
    if arm["repeats"] > 1:
        handles.append(
            Line2D(
                [], [], color=style.INK, marker="_", linestyle="none", label=f"± spread over {arm['repeats']} repeats"
            )
        )
    figure.legend(handles=handles, loc="upper left", bbox_to_anchor=(0.075, 1), ncols=len(handles), columnspacing=1.3)
    _tidy(figure, 2, height)
    return figure


def _line(axis, t, y, **how):
    """Draws a line; draws a noisy series as its mean with a pale band from minimum to maximum."""
    jitter = series.band_and_mean(t, y)
    if jitter is None:
        axis.plot(*series.drawable(t, y), **how)
        return
    times, low, high, mean = jitter
    axis.fill_between(times, low, high, facecolor=how["color"], edgecolor="none", alpha=0.25, zorder=1.5)
    axis.plot(times, mean, **how)


def overlay(name, entry, t, real, sim):
    """Real and simulated series of each joint or axis, overlaid."""
    if real is None:
        return None
    factor, label = unit(name, entry)  # of the distance; the series themselves are large
    shown, shown_label = (factor, label) if name == "x_EE" else (1.0, entry["unit"])
    count, columns, height = real.shape[1], 4 if real.shape[1] > 3 else 3, 1.55
    figure, axes = _grid(count, columns, height)
    for axis in axes.flat[count:]:
        axis.axis("off")
    for i, axis in enumerate(axes.flat[:count]):
        error = np.sqrt(np.mean((sim[:, i] - real[:, i]) ** 2))
        _line(axis, t, shown * real[:, i], color=REAL, linewidth=1.3)
        _line(axis, t, shown * sim[:, i], color=SIM, linewidth=0.9)
        which = f"joint {entry['axes'][i]}" if entry["axes"][i].isdigit() else entry["axes"][i]
        axis.set_title(f"{which}   RMSE {factor * error:.3g} {label}")
        axis.set_xlim(t[0], t[-1])
        axis.margins(y=0.08)
        if i % columns == 0:
            axis.set_ylabel(f"{SYMBOL[name]} [{shown_label}]")
        if i >= count - columns:
            axis.set_xlabel("time [s]")
    figure.legend(
        handles=[Line2D([], [], color=REAL, linewidth=1.6, label="real"), Line2D([], [], color=SIM, label="simulated")],
        loc="upper left",
        bbox_to_anchor=(0.075, 1),
        ncols=2,
    )
    _tidy(figure, -(-count // columns), height)
    return figure


def before_after(before, after):
    """Bars of one arm before (pale blue) and after (green), one panel per quantity, with the spread over repeats."""
    height = 1.7
    figure, axes = _grid(len(BARS), 6, height + 0.5)
    for axis, name in zip(axes.flat, BARS):
        b, a = before["quantities"][name], after["quantities"][name]
        if not (b["available"] and a["available"]):
            axis.set_title(SYMBOL[name], color=style.FAINT)
            axis.text(0.5, 0.5, "not\navailable", ha="center", va="center", transform=axis.transAxes, color=style.FAINT)
            axis.set_xticks([]), axis.set_yticks([]), axis.grid(False)
            continue
        factor, label = unit(name, b)
        values = factor * np.array([b["rmse_mean"], a["rmse_mean"]])
        spread = factor * np.array([b["rmse_spread"], a["rmse_spread"]])
        axis.bar([0, 1], values, width=0.72, color=[BEFORE, AFTER], zorder=2)
        if max(before["repeats"], after["repeats"]) > 1:
            axis.errorbar(
                [0, 1], values, yerr=spread, fmt="none", ecolor=style.INK, elinewidth=0.9, capsize=3, zorder=3
            )
        if b["paper"] and factor * b["paper"] < 2.5 * np.max(values):
            axis.axhline(factor * b["paper"], color=style.LIMIT, linewidth=1.0, linestyle=(0, (5, 3)), zorder=1)
        top = max(np.max(values + spread), 1e-12)
        axis.set_ylim(
            0,
            1.28
            * max(top, axis.get_ylim()[1] / 1.28 if b["paper"] and factor * b["paper"] < 2.5 * np.max(values) else 0),
        )
        for x, value, s in zip((0, 1), values, spread):
            axis.text(x, value + s + 0.02 * axis.get_ylim()[1], f"{value:.3g}", ha="center", va="bottom", fontsize=8)
        ratio = a["rmse_mean"] / b["rmse_mean"] if b["rmse_mean"] > 0 else 1.0
        axis.set_xticks([0, 1], ["before", "after"])
        axis.set_xlabel(f"× {ratio:.2f}", fontweight="bold")
        axis.tick_params(axis="x", length=0)
        axis.grid(axis="x", visible=False)
        axis.set_title(f"{SYMBOL[name]} [{label}]")
    total = height + 0.5 + 0.3
    figure.set_size_inches(style.WIDTH_IN, total)
    figure.subplots_adjust(left=0.05, right=0.99, top=1 - 0.3 / total, bottom=0.52 / total, wspace=0.5)
    return figure


def rounds(entries):
    """Each quantity over the rounds, one line per arm. entries: [{"arms": {name: comparison}}], the first: before."""
    height = 1.6
    figure, axes = _grid(len(BARS), 3, height)
    names = list(entries[0]["arms"])
    x = np.arange(len(entries))
    for axis, name in zip(axes.flat, BARS):
        first = entries[0]["arms"][names[0]]["quantities"][name]
        if not first["available"]:
            _unavailable(axis, name, first)
            continue
        factor, label = unit(name, first)
        for i, arm in enumerate(names):
            values = np.array([e["arms"][arm]["quantities"][name].get("rmse_mean", np.nan) for e in entries])
            spread = np.array([e["arms"][arm]["quantities"][name].get("rmse_spread", 0.0) for e in entries])
            axis.errorbar(
                x + 0.04 * i,
                factor * values,
                yerr=factor * spread if np.any(spread) else None,
                color=style.JOINTS[i],
                marker="o",
                markersize=4,
                capsize=2.5,
                label=arm or "arm",
            )
        if first["noise_floor"] is not None:
            axis.axhline(factor * first["noise_floor"], color=NOISE, linewidth=1.2, linestyle=(0, (1, 1.5)))
        axis.set_ylim(0, 1.1 * axis.get_ylim()[1])
        axis.set_xlim(-0.25, len(entries) - 0.75)
        axis.set_xticks(x, ["nominal", *(f"round {k}" for k in x[1:])])
        axis.set_title(f"{SYMBOL[name]}: {first['what']}")
        axis.set_ylabel(f"RMSE [{label}]")
    handles = [
        Line2D([], [], color=style.JOINTS[i], marker="o", markersize=4, label=arm or "arm")
        for i, arm in enumerate(names)
    ]
    if any(q.get("noise_floor") is not None for q in entries[0]["arms"][names[0]]["quantities"].values()):
        handles.append(Line2D([], [], color=NOISE, linestyle=(0, (1, 1.5)), label="noise of the real log at rest"))
    figure.legend(handles=handles, loc="upper left", bbox_to_anchor=(0.075, 1), ncols=len(handles))
    _tidy(figure, 2, height)
    return figure
