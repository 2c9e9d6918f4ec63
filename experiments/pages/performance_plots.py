"""Plots of a performance experiment. Each function returns a figure, or None without data."""

import matplotlib
import matplotlib.pyplot as plt
import numpy as np

from experiments.pages.performance_metrics import STAGES
from report import style

PAPER = style.LIMIT
ARMS = ("#4477aa", "#d98c21")
KINDS = {"controllet": "#4477aa", "feature": "#d98c21"}
STAGE_NAMES = {
    "read": "read, models",
    "controllets": "controllets",
    "features": "features",
    "safety": "safety",
    "write": "write",
}


def _colors(conditions):
    return {name: style.JOINTS[i % len(style.JOINTS)] for i, name in enumerate(conditions)}


def _boxes(axis, places, figures, colors, width=0.5):
    """Box: quarters; whiskers: 1 % and 99 %; diamond: mean; dot: 99.9 %. The extremes are in the table."""
    for x, f, color in zip(places, figures, colors):
        if f is None:
            axis.text(x, 0, "–", ha="center", va="bottom", color=style.FAINT)
            continue
        axis.bxp(
            [{"med": f["median"], "q1": f["p25"], "q3": f["p75"], "whislo": f["p1"], "whishi": f["p99"], "fliers": []}],
            positions=[x],
            widths=width,
            showfliers=False,
            patch_artist=True,
            manage_ticks=False,
            boxprops={"facecolor": color, "alpha": 0.55, "linewidth": 0.7},
            medianprops={"color": style.INK, "linewidth": 1.4},
            whiskerprops={"linewidth": 0.8},
            capprops={"linewidth": 0.8},
        )
        axis.plot([x], [f["mean"]], marker="D", color=style.INK, markersize=3.2, linestyle="none")


def _names(axis, names):
    axis.set_xticks(range(len(names)), names)
    axis.set_xlim(-0.6, len(names) - 0.4)
    axis.grid(False, axis="x")
    axis.tick_params(axis="x", length=0)


def like_the_paper(conditions, arms):
    """Delay per arm, loop time and CPU per condition: the three panels of the paper's figure, as distributions."""
    names, colors = list(conditions), _colors(conditions)
    figure, grid = plt.subplot_mosaic(
        [["delay", "delay"], ["loop", "cpu"]], figsize=(style.WIDTH_IN, 6.2), dpi=style.DPI
    )
    axis = grid["delay"]
    width = 0.8 / len(arms)
    for i, arm in enumerate(arms):
        places = np.arange(len(names)) + (i - (len(arms) - 1) / 2) * width
        for k, (x, name) in enumerate(zip(places, names)):
            entry = conditions[name]["delay"].get(arm)
            if entry is None:
                continue
            windows = np.array(entry["windows_ms"])
            spots = x + (np.random.default_rng(k).uniform(-0.3, 0.3, len(windows)) * width)
            axis.plot(
                spots,
                windows,
                "o",
                color=ARMS[i % 2],
                markersize=4,
                markeredgewidth=0.5,
                markeredgecolor="white",
                linestyle="none",
                zorder=3,
                label=f"{arm}: correlation, 1 s each" if k == 0 else None,
            )
            if entry["sequence_ms"] is not None:
                mean = entry["sequence_ms"]["mean"]
                axis.plot(
                    [x - 0.4 * width, x + 0.4 * width],
                    [mean] * 2,
                    color=style.INK,
                    linewidth=1.0,
                    solid_capstyle="butt",
                    zorder=2,
                    label="by sequence number, mean" if k == i == 0 else None,
                )
                axis.annotate(
                    f"{mean:.3f}",
                    (x, mean),
                    (0, 7),
                    textcoords="offset points",
                    ha="center",
                    fontsize=8,
                    color=style.INK,
                )
    axis.axhline(0.5, color=PAPER, linewidth=0.9, linestyle=(0, (4, 3)), label="paper, real arms: about 0.5 ms")
    axis.set_ylim(
        0,
        max(
            1.6,
            1.25
            * max((w for c in conditions.values() for d in c["delay"].values() for w in d["windows_ms"]), default=1),
        ),
    )
    axis.set_title("Delay of the commanded torque, per arm")
    axis.set_ylabel("delay [ms]")
    _names(axis, names)
    axis.legend(loc="upper left", ncols=3, bbox_to_anchor=(0, 1.0))

    axis = grid["loop"]
    figures = [conditions[n]["control_us"] for n in names]
    _boxes(axis, range(len(names)), figures, [colors[n] for n in names])
    axis.axhline(25, color=PAPER, linewidth=0.9, linestyle=(0, (4, 3)), label="paper, DC: < 25 µs")
    top = max([f["p99"] for f in figures if f], default=25)
    axis.set_ylim(0, 1.12 * max(top, 25))
    axis.set_title("Control function")
    axis.set_ylabel("time [µs]")
    _names(axis, names)
    axis.legend(loc="upper left")

    axis = grid["cpu"]
    _boxes(
        axis, range(len(names)), [conditions[n]["usage"]["process_percent"] for n in names], [colors[n] for n in names]
    )
    axis.set_ylim(bottom=0)
    axis.set_title("CPU of the control process, one core = 100 %")
    axis.set_ylabel("CPU [%]")
    _names(axis, names)
    figure.tight_layout(h_pad=1.6)
    return figure


def stages(conditions):
    """Where the time of a step goes: medians of the stages, stacked."""
    names = list(conditions)
    figure, axis = plt.subplots(figsize=(style.WIDTH_IN, 0.5 + 0.42 * len(names) + 0.5), dpi=style.DPI)
    left = np.zeros(len(names))
    for stage, color in zip(STAGES, style.STAGES):
        values = np.array([conditions[n]["stages_us"][stage]["median"] for n in names])
        axis.barh(range(len(names)), values, left=left, color=color, height=0.62, label=STAGE_NAMES[stage])
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


def _tail(axis, values, color, label):
    values = np.sort(np.asarray(values))
    share = 1 - np.arange(len(values)) / len(values)
    axis.plot(np.maximum(values, 1e-2), share, color=color, label=label, drawstyle="steps-pre")


def tails(traces):
    """Fraction of the cycles that took longer, down to the worst one. traces: condition -> runs."""
    names, colors = list(traces), _colors(traces)
    figure, axes = plt.subplots(1, 3, figsize=(style.WIDTH_IN, 3.1), dpi=style.DPI, sharey=True)
    period = 1e6 * next(iter(traces.values()))[0].entry["period_s"]
    for axis, title, values in (
        (axes[0], "Control function longer than", lambda t: t.control_us),
        (axes[1], "Whole step longer than", lambda t: t.whole_us),
        (axes[2], "Start of cycles off by more than", lambda t: np.abs(t.period_us - period)),
    ):
        for name in names:
            _tail(axis, np.concatenate([values(t) for t in traces[name]]), colors[name], name)
        axis.set_xscale("log")
        axis.set_yscale("log")
        low, high = axis.get_xlim()
        axis.set_xlim(10 ** np.floor(np.log10(low)), 10 ** np.ceil(np.log10(high)))
        axis.xaxis.set_major_formatter(matplotlib.ticker.StrMethodFormatter("{x:g}"))
        axis.xaxis.set_minor_formatter(matplotlib.ticker.NullFormatter())
        axis.set_title(title)
        axis.set_xlabel("[µs]")
    axes[2].axvline(period, color=style.FAINT, linewidth=0.8, linestyle=(0, (4, 3)))
    axes[0].set_ylabel("fraction of the cycles")
    axes[0].legend(loc="lower left")
    figure.tight_layout()
    return figure


def usage(traces):
    """CPU and memory over time, one column per condition (first repeat)."""
    names = list(traces)
    figure, axes = plt.subplots(
        3,
        len(names),
        figsize=(style.WIDTH_IN, 4.9),
        dpi=style.DPI,
        sharey="row",
        sharex="col",
        squeeze=False,
        height_ratios=(2, 1, 1),
    )
    panels = (
        (0, "process_percent", "control process", style.JOINTS[0]),
        (0, "loop_percent", "its loop", style.JOINTS[2]),
        (0, "generator_percent", "generator", style.JOINTS[3]),
        (1, "others_percent", "everybody else", style.JOINTS[6]),
        (2, "memory_mb", "memory of the control process", style.JOINTS[5]),
    )
    for k, name in enumerate(names):
        entry = traces[name][0].entry
        columns = entry["usage_columns"]
        rows = np.array(entry["usage"], dtype=float).reshape(-1, len(columns))
        for row, column, label, color in panels:
            axes[row, k].plot(rows[:, 0], rows[:, columns.index(column)], color=color, label=label)
        axes[0, k].set_title(name)
        axes[2, k].set_xlabel("t [s]")
    for row, label in enumerate(("CPU [% of one core]", "CPU [%]", "memory [MB]")):
        axes[row, 0].set_ylabel(label)
        axes[row, 0].set_ylim(0, 1.1 * axes[row, 0].get_ylim()[1])  # shared axis: set it after everything is drawn
    figure.tight_layout(rect=(0, 0, 1, 0.95))
    handles = [h for row in range(3) for h in axes[row, 0].get_lines()]
    figure.legend(
        handles,
        [h.get_label() for h in handles],
        loc="upper left",
        ncols=5,
        bbox_to_anchor=(0.06, 1.0),
        columnspacing=1.3,
    )
    return figure


def switching(plan_switching):
    """Every switch: from the request to the cycle that took it, and to the first torque."""
    figure, axes = plt.subplots(1, 2, figsize=(style.WIDTH_IN, 2.7), dpi=style.DPI, width_ratios=(2, 1))
    for kind, color in KINDS.items():
        rows = [x for x in plan_switching["list"] if x["kind"] == kind and x["accepted"]]
        if not rows:
            continue
        total = [(x["received_to_taken_us"] + x["taken_to_first_torque_us"]) * 1e-3 for x in rows]
        axes[0].plot(
            range(1, len(rows) + 1), total, "o", color=color, markersize=3.6, markeredgewidth=0, alpha=0.85, label=kind
        )
        values = np.sort([x["taken_to_first_torque_us"] for x in rows])
        axes[1].plot(
            values, np.arange(1, len(values) + 1) / len(values), color=color, drawstyle="steps-post", label=kind
        )
    axes[0].axhspan(2.117 - 0.493, 2.117 + 0.493, color=PAPER, alpha=0.12, linewidth=0)
    axes[0].axhline(2.117, color=PAPER, linewidth=0.9, linestyle=(0, (4, 3)), label="paper: 2.117 ± 0.493 ms")
    axes[0].set_ylim(bottom=0)
    axes[0].set_ylim(top=max(3.6, axes[0].get_ylim()[1]))
    axes[0].set_xlabel("trial")
    axes[0].xaxis.set_major_locator(matplotlib.ticker.MaxNLocator(integer=True))
    axes[0].set_ylabel("[ms]")
    axes[0].set_title("From the request to the first torque")
    axes[0].legend(loc="upper left", ncols=3, columnspacing=1.2)
    axes[1].set_xlabel("[µs]")
    axes[1].set_ylabel("fraction of the trials")
    axes[1].set_title("Taken to first torque")
    axes[1].legend(loc="lower right")
    figure.tight_layout()
    return figure


def delay_checks(checks):
    """Configured delays of the plant, and those that both methods find. checks: [(configured_ms, {arm: figures})]"""
    if not checks:
        return None
    figure, (axis, errors) = plt.subplots(1, 2, figsize=(style.WIDTH_IN, 2.9), dpi=style.DPI)
    largest = max(c for c, _ in checks)
    axis.plot([0, largest], [0, largest], color="#b9c3cd", linewidth=1, label="as configured", zorder=1)
    errors.axhline(0, color="#b9c3cd", linewidth=1)
    x = np.array([c for c, _ in checks])
    for i, arm in enumerate(checks[0][1]):
        for panel, less in ((axis, 0 * x), (errors, x)):
            for key, marker, what in (("correlation_ms", "o", "correlation"), ("sequence_ms", "x", "sequence number")):
                found = np.array([np.nan if a[arm][key] is None else a[arm][key]["median"] for _, a in checks])
                panel.plot(
                    x + 0.06 * (i - 0.5),
                    (found - less) * (1 if panel is axis else 1e3),
                    marker,
                    color=ARMS[i % 2],
                    markersize=5.5,
                    linestyle="none",
                    markerfacecolor="none",
                    label=f"{arm}: {what}",
                )
    for panel, what in ((axis, "measured delay [ms]"), (errors, "measured minus configured [µs]")):
        panel.set_xlabel("delay of the simulated plant [ms]")
        panel.set_ylabel(what)
        panel.xaxis.set_major_locator(matplotlib.ticker.MultipleLocator(1))
    span = max(1.0, 1.4 * max(abs(v) for v in errors.get_ylim()))
    errors.set_ylim(-span, span)
    axis.legend(loc="upper left")
    figure.tight_layout()
    return figure
