"""Plots of a performance experiment. Each function returns a figure, or None without data."""

import matplotlib
import numpy as np

from experiments.pages.performance_metrics import STAGES
from report import style

PAPER = style.LIMIT
ARMS = (style.BLUE, "#d98c21")
KINDS = dict(zip(("controllet", "feature"), ARMS))


def _colors(conditions):
    return {name: style.JOINTS[i % len(style.JOINTS)] for i, name in enumerate(conditions)}


def _boxes(axis, figures, colors):
    """Box: quarters; whiskers: 1 % and 99 %; diamond: mean. The extremes are in the table."""
    thin = {"linewidth": 0.8}
    for x, (name, f) in enumerate(figures.items()):
        if f is None:
            axis.text(x, 0, "–", ha="center", va="bottom", color=style.FAINT)
            continue
        box = {"med": f["median"], "q1": f["p25"], "q3": f["p75"], "whislo": f["p1"], "whishi": f["p99"]}
        look = {"facecolor": colors[name], "alpha": 0.55, "linewidth": 0.7}
        lines = {"medianprops": {"color": style.INK, "linewidth": 1.4}, "whiskerprops": thin, "capprops": thin}
        how = {"widths": 0.5, "showfliers": False, "patch_artist": True, "manage_ticks": False}
        axis.bxp([box], positions=[x], boxprops=look, **lines, **how)
        axis.plot([x], [f["mean"]], marker="D", color=style.INK, markersize=3.2, linestyle="none")
    _names(axis, figures)


def _names(axis, names):
    style.name_places(axis, list(names))
    axis.set_xlim(-0.6, len(names) - 0.4)


def _draw_delays(axis, conditions, arms):
    width = 0.8 / len(arms)
    for i, arm in enumerate(arms):
        for k, c in enumerate(conditions.values()):
            if (entry := c["delay"].get(arm)) is None:
                continue
            x, windows = k + (i - (len(arms) - 1) / 2) * width, np.array(entry["windows_ms"])
            spots = x + (np.random.default_rng(k).uniform(-0.3, 0.3, len(windows)) * width)
            label = f"{arm}: correlation, 1 s each" if k == 0 else None
            dots = {"color": ARMS[i % 2], "markersize": 4, "markeredgewidth": 0.5, "markeredgecolor": "white"}
            axis.plot(spots, windows, "o", zorder=3, label=label, **dots)
            if entry["sequence_ms"] is None:
                continue
            mean, label = entry["sequence_ms"]["mean"], "by sequence number, mean" if k == i == 0 else None
            axis.hlines(mean, x - 0.4 * width, x + 0.4 * width, color=style.INK, linewidth=1.0, zorder=2, label=label)
            place = {"textcoords": "offset points", "ha": "center"}
            axis.annotate(f"{mean:.3f}", (x, mean), (0, 7), fontsize=8, color=style.INK, **place)
    style.level(axis, 0.5, label="paper, real arms: about 0.5 ms")
    windows = [w for c in conditions.values() for d in c["delay"].values() for w in d["windows_ms"]]
    axis.set_ylim(0, max(1.6, 1.25 * max(windows, default=1)))
    axis.set(title="Delay of the commanded torque, per arm", ylabel="delay [ms]")
    _names(axis, conditions)
    axis.legend(loc="upper left", ncols=3, bbox_to_anchor=(0, 1.0))


def like_the_paper(conditions, arms):
    """Delay per arm, loop time and CPU per condition: the three panels of the paper's figure, as distributions."""
    colors, panels = _colors(conditions), [["delay", "delay"], ["loop", "cpu"]]
    figure, grid = style.plt.subplot_mosaic(panels, figsize=(style.WIDTH_IN, 6.2))
    _draw_delays(grid["delay"], conditions, arms)
    control = {name: c["control_us"] for name, c in conditions.items()}
    _boxes(grid["loop"], control, colors)
    style.level(grid["loop"], 25, label="paper, DC: < 25 µs")
    grid["loop"].set_ylim(0, 1.12 * max([f["p99"] for f in control.values() if f] + [25]))
    grid["loop"].set(title="Control function", ylabel="time [µs]")
    grid["loop"].legend(loc="upper left")
    _boxes(grid["cpu"], {name: c["usage"]["process_percent"] for name, c in conditions.items()}, colors)
    grid["cpu"].set_ylim(bottom=0)
    grid["cpu"].set(title="CPU of the control process, one core = 100 %", ylabel="CPU [%]")
    figure.tight_layout(h_pad=1.6)
    return figure


def stages(conditions):
    """Where the time of a step goes: medians of the stages, stacked."""
    names = list(conditions)
    figure, ((axis,),) = style.sheet(height=1.0 + 0.42 * len(names))
    left = np.zeros(len(names))
    for stage, color in zip(STAGES, style.STAGES):
        values = np.array([conditions[n]["stages_us"][stage]["median"] for n in names])
        label = "read, models" if stage == "read" else stage
        axis.barh(range(len(names)), values, left=left, color=color, height=0.62, label=label)
        left += values
    for y, (name, value) in enumerate(zip(names, left)):
        axis.text(value, y, f"  {value:.1f} µs", va="center", fontsize=8, color=style.INK)
    axis.set_yticks(range(len(names)), names)
    axis.invert_yaxis()
    axis.set_xlim(0, 1.12 * max(left.max(), 1))
    axis.grid(False, axis="y")
    axis.set_xlabel("median of each stage [µs]")
    axis.set_title("Stages of a step")
    figure.tight_layout(rect=(0, 0, 0.86, 1))
    axis.legend(loc="center left", bbox_to_anchor=(1.01, 0.5))
    return figure


def tails(traces):
    """Fraction of the cycles that took longer, down to the worst one. traces: condition -> runs."""
    figure, (axes,) = style.sheet(1, 3, 3.1, sharey=True)
    period = 1e6 * next(iter(traces.values()))[0].entry["period_s"]
    for axis, title, values in (
        (axes[0], "Control function longer than", lambda t: t.control_us),
        (axes[1], "Whole step longer than", lambda t: t["whole_us"]),
        (axes[2], "Start of cycles off by more than", lambda t: np.abs(t.period_us - period)),
    ):
        for name, color in _colors(traces).items():
            ordered = np.sort(np.concatenate([values(t) for t in traces[name]]))
            share = 1 - np.arange(len(ordered)) / len(ordered)
            axis.plot(np.maximum(ordered, 1e-2), share, color=color, label=name, drawstyle="steps-pre")
        axis.set(xscale="log", yscale="log", title=title, xlabel="[µs]")
        low, high = axis.get_xlim()
        axis.set_xlim(10 ** np.floor(np.log10(low)), 10 ** np.ceil(np.log10(high)))
        axis.xaxis.set_major_formatter(matplotlib.ticker.StrMethodFormatter("{x:g}"))
        axis.xaxis.set_minor_formatter(matplotlib.ticker.NullFormatter())
    axes[2].axvline(period, color=style.FAINT, linewidth=0.8, linestyle=style.DASHED)
    axes[0].set_ylabel("fraction of the cycles")
    axes[0].legend(loc="lower left")
    figure.tight_layout()
    return figure


def usage(traces):
    """CPU and memory over time, one column per condition (first repeat)."""
    figure, axes = style.sheet(3, len(traces), 4.9, sharey="row", sharex="col", height_ratios=(2, 1, 1))
    panels = (
        (0, "process_percent", "control process", style.JOINTS[0]),
        (0, "loop_percent", "its loop", style.JOINTS[2]),
        (0, "generator_percent", "generator", style.JOINTS[3]),
        (1, "others_percent", "other processes", style.JOINTS[6]),
        (2, "memory_mb", "memory of the control process", style.JOINTS[5]),
    )
    for k, (name, runs) in enumerate(traces.items()):
        columns = runs[0].entry["usage_columns"]
        rows = np.array(runs[0].entry["usage"], dtype=float).reshape(-1, len(columns))
        for row, column, label, color in panels:
            axes[row, k].plot(rows[:, 0], rows[:, columns.index(column)], color=color, label=label)
        axes[0, k].set_title(name)
        axes[2, k].set_xlabel("t [s]")
    for row, label in enumerate(("CPU [% of one core]", "CPU [%]", "memory [MB]")):
        axes[row, 0].set_ylabel(label)
        axes[row, 0].set_ylim(0, 1.1 * axes[row, 0].get_ylim()[1])  # shared axis: set it after everything is drawn
    figure.tight_layout(rect=(0, 0, 1, 0.95))
    handles = [h for row in range(3) for h in axes[row, 0].get_lines()]
    figure.legend(handles=handles, loc="upper left", ncols=5, bbox_to_anchor=(0.06, 1.0), columnspacing=1.3)
    return figure


def switching(plan_switching):
    """Every switch: from the request to the cycle that took it, and to the first torque."""
    figure, ((totals, taken),) = style.sheet(1, 2, 2.7, width_ratios=(2, 1))
    for kind, color in KINDS.items():
        rows = [x for x in plan_switching["list"] if x["kind"] == kind and x["accepted"]]
        total = [(x["received_to_taken_us"] + x["taken_to_first_torque_us"]) * 1e-3 for x in rows]
        values = np.sort([x["taken_to_first_torque_us"] for x in rows])
        if rows:
            dots = {"markersize": 3.6, "markeredgewidth": 0, "alpha": 0.85}
            totals.plot(range(1, len(rows) + 1), total, "o", color=color, label=kind, **dots)
            share = np.arange(1, len(values) + 1) / len(values)
            taken.plot(values, share, color=color, drawstyle="steps-post", label=kind)
    totals.axhspan(2.117 - 0.493, 2.117 + 0.493, color=PAPER, alpha=0.12, linewidth=0)
    style.level(totals, 2.117, label="paper: 2.117 ± 0.493 ms")
    totals.set_ylim(bottom=0)
    totals.set_ylim(top=max(3.6, totals.get_ylim()[1]))
    totals.xaxis.set_major_locator(matplotlib.ticker.MaxNLocator(integer=True))
    totals.set(title="From the request to the first torque", xlabel="trial", ylabel="[ms]")
    totals.legend(loc="upper left", ncols=3, columnspacing=1.2)
    taken.set(title="Taken to first torque", xlabel="[µs]", ylabel="fraction of the trials")
    taken.legend(loc="lower right")
    figure.tight_layout()
    return figure


def delay_checks(checks):
    """Configured delays of the plant, and those that both methods find. checks: [(configured_ms, {arm: figures})]"""
    if not checks:
        return None
    figure, ((axis, errors),) = style.sheet(1, 2, 2.9)
    x = np.array([c for c, _ in checks])
    axis.plot([0, x.max()], [0, x.max()], color="#b9c3cd", linewidth=1, label="as configured", zorder=1)
    errors.axhline(0, color="#b9c3cd", linewidth=1)
    hollow = {"markersize": 5.5, "linestyle": "none", "markerfacecolor": "none"}
    for i, arm in enumerate(checks[0][1]):
        for key, marker, what in (("correlation_ms", "o", "correlation"), ("sequence_ms", "x", "sequence number")):
            found = np.array([np.nan if a[arm][key] is None else a[arm][key]["median"] for _, a in checks])
            look = {"color": ARMS[i % 2], "label": f"{arm}: {what}", **hollow}
            axis.plot(x + 0.06 * (i - 0.5), found, marker, **look)
            errors.plot(x + 0.06 * (i - 0.5), 1e3 * (found - x), marker, **look)
    for panel, what in ((axis, "measured delay [ms]"), (errors, "measured minus configured [µs]")):
        panel.set(xlabel="delay of the simulated plant [ms]", ylabel=what)
        panel.xaxis.set_major_locator(matplotlib.ticker.MultipleLocator(1))
    span = max(1.0, 1.4 * max(abs(v) for v in errors.get_ylim()))
    errors.set_ylim(-span, span)
    axis.legend(loc="upper left")
    figure.tight_layout()
    return figure
