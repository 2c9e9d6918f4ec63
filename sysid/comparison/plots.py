"""Plots of comparisons. Each function takes data of results.json and returns a figure."""

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from report import page, style
from report.style import line

REAL, SIM = style.INK, "#d9480f"
BEFORE, AFTER = style.PALE_BLUE, "#2e8b57"
MEAN, AXIS, NOISE = style.BLUE, style.PALE_BLUE, "#2e8b57"
SYMBOL = {"q": "q", "dq": "q̇", "tau": "τ", "x_EE": "x_EE", "F_EE": "F_EE", "C_err": "C_err", "M_EE": "M_EE"}
# Quantities that are not shown in SI units.
SCALE = {"x_EE": (1e3, "mm"), "q": (1e3, "mrad"), "dq": (1e3, "mrad/s")}
BARS = ("q", "dq", "tau", "x_EE", "F_EE", "C_err")  # the six of the paper
WHISKERS = {"fmt": "none", "ecolor": style.INK, "elinewidth": 0.9, "zorder": 3}


def unit(name, entry):
    return SCALE.get(name, (1.0, entry["unit"]))


def number(name, entry, value):
    factor, label = unit(name, entry)
    return f"{page.figures(factor * value)} {label}"


def symbol(name, entry):
    return page.Raw(f"<b>{page.escape(SYMBOL[name])}</b> {page.escape(entry['what'])}")


def axis_name(axis):
    return f"joint {axis}" if axis.isdigit() else axis


def _tidy(figure, rows, height, handles):
    """Margins that leave room for all labels, and the legend at the top."""
    figure.legend(handles=handles, loc="upper left", bbox_to_anchor=(0.01, 1), ncols=len(handles), columnspacing=1.3)
    figure.tight_layout(rect=(0, 0, 1, 1 - 0.25 / (rows * height + 0.55)))
    return figure


def _unavailable(axis, name, entry):
    axis.set_title(f"{SYMBOL[name]}: {entry['what']}", color=style.FAINT)
    style.note(axis, "not available:\n" + entry["missing"])
    axis.set(xticks=[], yticks=[])


def _paper(axis, value):
    axis.axhline(value, color=style.LIMIT, linewidth=1.0, linestyle=(0, (5, 3)), zorder=1)


def bars(arm):
    """RMSE per quantity: the mean over axes as in the paper, then each axis; spread, noise, and the paper's value."""
    height = 1.75
    figure, axes = style.panels(len(BARS), 3, height)
    for axis, name in zip(axes, BARS):
        entry = arm["quantities"][name]
        if not entry["available"]:
            _unavailable(axis, name, entry)
            continue
        factor, label = unit(name, entry)
        count, paper = len(entry["rmse"]), factor * (entry["paper"] or 0)
        values = factor * np.array([entry["rmse_mean"], *entry["rmse"]])
        spread = factor * np.array([entry["rmse_spread"], *entry["rmse_spread_by_axis"]])
        x, widths = np.array([0.0, *(1.6 + np.arange(count))]), np.array([1.1] + [0.75] * count)
        axis.bar(x, values, width=widths, color=[MEAN] + [AXIS] * count, zorder=2)
        if arm["repeats"] > 1:
            axis.errorbar(x, values, yerr=spread, capsize=2.5, **WHISKERS)
        if entry.get("noise_by_axis"):
            noise = factor * np.array([entry["noise_floor"], *entry["noise_by_axis"]])
            axis.hlines(noise, x - widths / 2, x + widths / 2, color=NOISE, linewidth=1.6, zorder=4)
        if paper:
            _paper(axis, paper)
        axis.set_ylim(0, 1.18 * max(np.max(values + spread), paper, 1e-12))  # keeps the paper's line in view
        top = values[0] + spread[0] + 0.015 * axis.get_ylim()[1]
        behind = {"facecolor": "white", "edgecolor": "none", "pad": 0.6, "alpha": 0.8}
        how = {"ha": "center", "va": "bottom", "fontsize": 8.5, "fontweight": "bold", "color": style.INK}
        axis.text(0, top, f"{values[0]:.3g}", zorder=5, bbox=behind, **how)
        axis.set_xticks(x, ["mean", *entry["axes"]])
        axis.tick_params(axis="x", length=0)
        axis.grid(axis="x", visible=False)
        axis.set(title=f"{SYMBOL[name]}: {entry['what']}", ylabel=f"RMSE [{label}]")
    handles = [
        Patch(facecolor=MEAN, label="mean over joints or axes"),
        Patch(facecolor=AXIS, label="each joint or axis"),
        Line2D([], [], color=style.LIMIT, linestyle=(0, (5, 3)), label="largest in the paper's tasks"),
    ]
    if arm["rest_s"]:
        handles.append(Line2D([], [], color=NOISE, linewidth=1.6, label="noise of the real log at rest"))
    if arm["repeats"] > 1:
        label = f"± spread over {arm['repeats']} repeats"
        handles.append(Line2D([], [], color=style.INK, marker="_", linestyle="none", label=label))
    return _tidy(figure, 2, height, handles)


def overlay(name, entry, t, real, sim):
    """Real and simulated series of each joint or axis, overlaid."""
    factor, label = unit(name, entry)  # for the RMSE; the series themselves are shown in SI units
    shown, shown_label = (factor, label) if name == "x_EE" else (1.0, entry["unit"])
    count, columns, height = real.shape[1], 4 if real.shape[1] > 3 else 3, 1.55
    figure, axes = style.panels(count, columns, height)
    for i, axis in enumerate(axes):
        error = np.sqrt(np.mean((sim[:, i] - real[:, i]) ** 2))
        line(axis, t, shown * real[:, i], color=REAL, linewidth=1.3)
        line(axis, t, shown * sim[:, i], color=SIM, linewidth=0.9)
        axis.set_title(f"{axis_name(entry['axes'][i])}   RMSE {factor * error:.3g} {label}")
        axis.set_xlim(t[0], t[-1])
        axis.margins(y=0.08)
        if i % columns == 0:
            axis.set_ylabel(f"{SYMBOL[name]} [{shown_label}]")
        if i >= count - columns:
            axis.set_xlabel("time [s]")
    handles = [Line2D([], [], color=c, linewidth=1.6, label=of) for c, of in ((REAL, "real"), (SIM, "simulated"))]
    return _tidy(figure, -(-count // columns), height, handles)


def before_after(before, after):
    """Bars of one arm before (pale blue) and after (green), one panel per quantity, with the spread over repeats."""
    total = 2.5
    figure, axes = style.sheet(1, len(BARS), total)
    for axis, name in zip(axes.flat, BARS):
        b, a = before["quantities"][name], after["quantities"][name]
        if not (b["available"] and a["available"]):
            axis.set_title(SYMBOL[name], color=style.FAINT)
            style.note(axis, "not\navailable")
            axis.set(xticks=[], yticks=[])
            continue
        factor, label = unit(name, b)
        values, spread = (factor * np.array([b[key], a[key]]) for key in ("rmse_mean", "rmse_spread"))
        axis.bar([0, 1], values, width=0.72, color=[BEFORE, AFTER], zorder=2)
        if max(before["repeats"], after["repeats"]) > 1:
            axis.errorbar([0, 1], values, yerr=spread, capsize=3, **WHISKERS)
        top, paper = max(np.max(values + spread), 1e-12), factor * (b["paper"] or 0)
        if paper and paper < 2.5 * np.max(values):
            _paper(axis, paper)
            top = max(top, axis.get_ylim()[1] / 1.28)
        axis.set_ylim(0, 1.28 * top)
        for x, value, s in zip((0, 1), values, spread):
            axis.text(x, value + s + 0.02 * axis.get_ylim()[1], f"{value:.3g}", ha="center", va="bottom", fontsize=8)
        ratio = a["rmse_mean"] / b["rmse_mean"] if b["rmse_mean"] > 0 else 1.0
        style.name_places(axis, ["before", "after"])
        axis.set_xlabel(f"× {ratio:.2f}", fontweight="bold")
        axis.set_title(f"{SYMBOL[name]} [{label}]")
    figure.subplots_adjust(left=0.05, right=0.99, top=1 - 0.3 / total, bottom=0.52 / total, wspace=0.5)
    return figure


def rounds(entries):
    """Each quantity over the rounds, one line per arm. entries: [{"arms": {name: comparison}}], the first: before."""
    height, names, x = 1.6, list(entries[0]["arms"]), np.arange(len(entries))
    figure, axes = style.panels(len(BARS), 3, height)
    look = {"marker": "o", "markersize": 4}
    for axis, name in zip(axes, BARS):
        first = entries[0]["arms"][names[0]]["quantities"][name]
        if not first["available"]:
            _unavailable(axis, name, first)
            continue
        factor, label = unit(name, first)
        for i, arm in enumerate(names):
            of_rounds = [e["arms"][arm]["quantities"][name] for e in entries]
            values = factor * np.array([q.get("rmse_mean", np.nan) for q in of_rounds])
            spread = factor * np.array([q.get("rmse_spread", 0.0) for q in of_rounds])
            bars = spread if np.any(spread) else None
            axis.errorbar(x + 0.04 * i, values, yerr=bars, color=style.JOINTS[i], capsize=2.5, **look)
        if first["noise_floor"] is not None:
            axis.axhline(factor * first["noise_floor"], color=NOISE, linewidth=1.2, linestyle=(0, (1, 1.5)))
        axis.set_ylim(0, 1.1 * axis.get_ylim()[1])
        axis.set_xlim(-0.25, len(entries) - 0.75)
        axis.set_xticks(x, ["nominal", *(f"round {k}" for k in x[1:])])
        axis.set(title=f"{SYMBOL[name]}: {first['what']}", ylabel=f"RMSE [{label}]")
    handles = [Line2D([], [], color=style.JOINTS[i], label=arm or "arm", **look) for i, arm in enumerate(names)]
    if any(q.get("noise_floor") is not None for q in entries[0]["arms"][names[0]]["quantities"].values()):
        handles.append(Line2D([], [], color=NOISE, linestyle=(0, (1, 1.5)), label="noise of the real log at rest"))
    return _tidy(figure, 2, height, handles)
