"""Plots of a run. Each function takes a loading.Run and returns a figure, or None if the log lacks the data."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Rectangle

from report import metrics, series, style

STRIP_IN, PANEL_IN, GAP_IN = 0.24, 1.55, 0.3
EM = 0.0085  # width of a letter over its size [in/pt]


def _sheet(run, heights, strip, legend_in=style.RIGHT_IN, title_gap=GAP_IN):
    """Figure with panels one below the other, each over the whole run; a strip on top shows the active controllets."""
    rows = ([STRIP_IN] if strip else []) + list(heights)
    top, bottom = 0.12, 0.42
    height = top + bottom + sum(rows) + title_gap * (len(rows) - 1) + (0 if strip else 0.18)
    figure = plt.figure(figsize=(style.WIDTH_IN, height), dpi=style.DPI)
    axes, y = [], height - top - (0 if strip else 0.18)
    for i, row in enumerate(rows):
        y -= row
        share = axes[0] if axes else None
        width = style.WIDTH_IN - style.LEFT_IN - legend_in
        axes.append(
            figure.add_axes(
                (style.LEFT_IN / style.WIDTH_IN, y / height, width / style.WIDTH_IN, row / height), sharex=share
            )
        )
        y -= title_gap
    first, last = run.time_range
    axes[0].set_xlim(first, last if last > first else first + 0.001)
    for axis in axes[:-1]:
        axis.tick_params(labelbottom=False)
    axes[-1].set_xlabel("time [s]")
    return figure, axes


def _draw_spans(axis, run, arm, colors, y=0.0, height=1.0):
    """Colored bands with the names of the controllets that owned the arm; long names are cut."""
    first, last = axis.get_xlim()
    inches = axis.get_position().width * style.WIDTH_IN
    for span in run.spans(arm):
        axis.add_patch(
            Rectangle(
                (span.start, y),
                span.end - span.start,
                height,
                facecolor=colors.get(span.instance, "#fff"),
                edgecolor="white",
                linewidth=0.8,
            )
        )
        room = (min(span.end, last) - max(span.start, first)) / (last - first) * inches
        size, text = next(
            ((size, span.instance) for size in (8, 7, 6.3) if len(span.instance) * size * EM < room - 0.05),
            (6.3, span.instance[: max(0, int((room - 0.05) / (6.3 * EM)) - 1)] + "…"),
        )
        if len(text) >= 4 or text == span.instance:
            axis.text(
                (max(span.start, first) + min(span.end, last)) / 2,
                y + height / 2,
                text,
                ha="center",
                va="center",
                fontsize=size,
                color=style.INK,
                clip_on=True,
            )


def _strip(axis, run, arm, colors):
    axis.set_ylim(0, 1)
    axis.axis("off")
    axis.text(
        -0.012,
        0.5,
        arm,
        transform=axis.transAxes,
        ha="right",
        va="center",
        fontsize=9,
        fontweight="bold",
        color=style.INK,
    )
    _draw_spans(axis, run, arm, colors)
    first, last = axis.get_xlim()
    times = [m["stamp"] for m in run.interventions if m["arm"] in ("", arm) and first <= m["stamp"] <= last]
    if times:
        axis.plot(times, np.full(len(times), -0.12), "^", color=style.INTERVENTION, markersize=4.5, clip_on=False)


def _markers(axes, run, arm):
    """Vertical lines where the arm changed its owner, and where the safety stage intervened (unless continuously)."""
    switches = [span.start for span in run.spans(arm)[1:]]
    interventions = sorted({m["stamp"] for m in run.interventions if m["arm"] in ("", arm)})
    for axis in axes:
        for t in switches:
            axis.axvline(t, color=style.FAINT, linewidth=0.8, linestyle=(0, (4, 3)), zorder=1)
        if len(interventions) <= 40:
            for t in interventions:
                axis.axvline(t, color=style.INTERVENTION, linewidth=0.8, linestyle=(0, (1, 2)), zorder=1)


def _line(axis, t, y, **how):
    """Draws a line; draws a noisy series as its mean with a pale band from minimum to maximum."""
    y = np.asarray(y, dtype=float)
    jitter = series.band_and_mean(t, y)
    if jitter is None:
        axis.plot(*series.drawable(t, y), **how)
        return
    times, low, high, mean = jitter
    axis.fill_between(times, low, high, facecolor=how["color"], edgecolor="none", alpha=0.22, zorder=1.5)
    axis.plot(times, mean, **how)


def _legend(axis, **how):
    handles, _ = axis.get_legend_handles_labels()
    if handles:
        axis.legend(loc="upper left", bbox_to_anchor=(1.008, 1.02), **how)


def _joint_lines(axis, t, values, legend=True, **how):
    for i in range(values.shape[1]):
        _line(
            axis,
            t,
            values[:, i],
            color=style.JOINTS[i % len(style.JOINTS)],
            label=f"joint {i + 1}" if legend else None,
            **how,
        )


def _share_panel(axis, t, values, limit, title):
    share = 100 * metrics.used_share(values, limit)
    _joint_lines(axis, t, share, legend=False)
    axis.set_title(title)
    axis.set_ylabel("% of limit")
    top = np.nanmax(share[np.isfinite(share)], initial=0)
    axis.set_ylim(0, max(10, min(130, 1.15 * top)))
    if axis.get_ylim()[1] > 95:
        axis.axhline(100, color=style.LIMIT, linewidth=0.9)


# One arm -------------------------------------------------------------------------------------------------------------


def joint_positions(run, arm, colors):
    t, q = run.get(f"{arm}/state/t"), run.get(f"{arm}/state/q")
    if q is None:
        return None
    low, high = run.limits(arm, "q_min"), run.limits(arm, "q_max")
    targets = metrics.joint_targets(run, arm)
    limits = low is not None and high is not None
    figure, axes = _sheet(run, [2.1] + [PANEL_IN] * (bool(targets) + limits), strip=True)
    _strip(axes[0], run, arm, colors)
    _joint_lines(axes[1], t, q)
    for target in targets:
        for i in range(target["q_d"].shape[1]):
            _line(
                axes[1],
                target["t"],
                target["q_d"][:, i],
                color=style.INK,
                linewidth=0.9,
                linestyle=(0, (2, 2)),
                label="target" if i == 0 and target is targets[0] else None,
            )
    axes[1].set_title("joint positions q")
    axes[1].set_ylabel("q [rad]")
    _legend(axes[1])
    panel = 2
    if targets:
        for target in targets:
            _joint_lines(axes[panel], target["t"], 1e3 * target["error"], legend=False)
        axes[panel].set_title("joint tracking error q_d − q, where a controllet had a joint target")
        axes[panel].set_ylabel("error [mrad]")
        panel += 1
    if limits:
        _joint_lines(axes[panel], t, 100 * (q - low) / (high - low), legend=False)
        axes[panel].set_title("position within the joint's range: 0 % lower limit, 100 % upper limit")
        axes[panel].set_ylabel("% of range")
        axes[panel].set_ylim(-4, 104)
        for y in (0, 100):
            axes[panel].axhline(y, color=style.LIMIT, linewidth=0.9)
    _markers(axes[1:], run, arm)
    return figure


def joint_velocities(run, arm, colors):
    t, dq = run.get(f"{arm}/state/t"), run.get(f"{arm}/state/dq")
    if dq is None:
        return None
    limit = run.limits(arm, "dq_max")
    figure, axes = _sheet(run, [1.9] + ([1.25] if limit is not None else []), strip=True)
    _strip(axes[0], run, arm, colors)
    _joint_lines(axes[1], t, dq)
    axes[1].set_title("joint velocities q̇")
    axes[1].set_ylabel("q̇ [rad/s]")
    _legend(axes[1])
    if limit is not None:
        _share_panel(axes[2], t, dq, limit, "use of the velocity limit")
    _markers(axes[1:], run, arm)
    return figure


def torques(run, arm, colors):
    command, measured = run.get(f"{arm}/command/tau_cmd"), run.get(f"{arm}/state/tau_j")
    if command is None and measured is None:
        return None
    without_gravity = metrics.torque_without_gravity(run, arm)
    feature, external = run.get(f"{arm}/command/tau_feature"), run.get(f"{arm}/state/tau_ext")
    limit = run.limits(arm, "tau_max")
    t_command, t_state = run.get(f"{arm}/command/t"), run.get(f"{arm}/state/t")
    panels = []
    if command is not None:
        panels.append(
            (t_command, command, "τ_cmd: torque sent, after the safety stage, without gravity", "τ_cmd [N m]")
        )
    if without_gravity is not None:
        panels.append(
            (
                t_state,
                without_gravity,
                "τ_J − g(q): torque measured on the link side, gravity subtracted",
                "τ_J − g [N m]",
            )
        )
    elif measured is not None:
        panels.append(
            (
                t_state,
                measured,
                "τ_J: torque measured on the link side, gravity included (no model summary in the log)",
                "τ_J [N m]",
            )
        )
    if feature is not None and np.any(feature):
        panels.append((t_command, feature, "part of τ_cmd: sum of the features' torques", "τ_feature [N m]"))
    if external is not None:
        panels.append((t_state, external, "τ_ext: estimate of what the arm exerts on its environment", "τ_ext [N m]"))
    with_limit = limit is not None and command is not None
    figure, axes = _sheet(run, [PANEL_IN] * len(panels) + ([1.25] if with_limit else []), strip=True)
    _strip(axes[0], run, arm, colors)
    for axis, (t, values, title, label) in zip(axes[1:], panels):
        _joint_lines(axis, t, values, legend=axis is axes[1])
        axis.set_title(title)
        axis.set_ylabel(label)
    _legend(axes[1])
    if with_limit:
        _share_panel(axes[-1], t_command, command, limit, "use of the torque limit by τ_cmd")
    _markers(axes[1:], run, arm)
    return figure


def pose(run, arm, colors):
    t, p = run.get(f"{arm}/model/t"), run.get(f"{arm}/model/pose_position")
    errors = metrics.pose_errors(run, arm)
    manipulability = run.get(f"{arm}/model/manipulability")
    if p is None and not errors:
        return None
    figure, axes = _sheet(
        run,
        ([2.0] if p is not None else [])
        + ([PANEL_IN, PANEL_IN] if errors else [])
        + ([0.8] if manipulability is not None else []),
        strip=True,
    )
    _strip(axes[0], run, arm, colors)
    panel = 1
    if p is not None:
        for k, name in enumerate("xyz"):
            _line(axes[panel], t, p[:, k], color=style.AXES_XYZ[k], label=name, linewidth=1.4)
        for n, target in enumerate(metrics.pose_targets(run, arm)):
            for k in range(3):
                _line(
                    axes[panel],
                    target["t"],
                    target["position"][:, k],
                    color=style.INK,
                    linewidth=0.9,
                    linestyle=(0, (2, 2)),
                    label="target" if n == 0 and k == 0 else None,
                )
        axes[panel].set_title("position of the end effector E in the world")
        axes[panel].set_ylabel("p_WE [m]")
        _legend(axes[panel])
        panel += 1
    if errors:
        for n, entry in enumerate(errors):
            for axis, key, scale in ((axes[panel], "position", 1e3), (axes[panel + 1], "rotation", 180 / np.pi)):
                for k, name in enumerate("xyz"):
                    _line(
                        axis,
                        entry["t"],
                        scale * entry[key][:, k],
                        color=style.AXES_XYZ[k],
                        label=name if n == 0 else None,
                    )
                _line(
                    axis,
                    entry["t"],
                    scale * np.linalg.norm(entry[key], axis=1),
                    color=style.NORM,
                    linewidth=0.9,
                    label="norm" if n == 0 else None,
                )
        axes[panel].set_title("position error, target minus actual, world axes")
        axes[panel].set_ylabel("error [mm]")
        _legend(axes[panel])
        axes[panel + 1].set_title("orientation error, rotation vector log(R_d Rᵀ), world axes")
        axes[panel + 1].set_ylabel("error [deg]")
        for axis in axes[panel : panel + 2]:
            _shade_without_target(axis, run, arm, {entry["instance"] for entry in errors})
    if manipulability is not None:
        _line(axes[-1], t, manipulability, color="#4477aa")
        axes[-1].set_title("manipulability √det(J Jᵀ): 0 at a singular configuration")
        axes[-1].set_ylabel("m")
        axes[-1].set_ylim(0, 1.15 * float(np.nanmax(manipulability)) or 1)
    _markers(axes[1:], run, arm)
    return figure


def _shade_without_target(axis, run, arm, with_target):
    first, last = axis.get_xlim()
    inches = axis.get_position().width * style.WIDTH_IN
    for span in run.spans(arm):
        if span.instance in with_target:
            continue
        axis.axvspan(span.start, span.end, facecolor="#f4f5f7", edgecolor="none", zorder=0)
        shared = len(run.instances.get(span.instance, {}).get("arms") or []) > 1
        if (span.end - span.start) / (last - first) * inches > (1.3 if shared else 1.05):
            axis.text(
                (span.start + span.end) / 2,
                0.5,
                "target of several arms" if shared else "no pose target",
                transform=axis.get_xaxis_transform(),
                ha="center",
                va="center",
                fontsize=7.5,
                color=style.FAINT,
            )


def wrench(run, arm, colors):
    estimate = metrics.wrench(run, arm, "estimated", "has_estimate")
    contact = metrics.wrench(run, arm, "contact", "has_contact_truth")
    if estimate is None and contact is None:
        return None
    sources = [
        (which, name)
        for which, name in ((estimate, "estimated by the arm"), (contact, "contact forces of the simulator"))
        if which is not None
    ]
    figure, axes = _sheet(run, [1.4, 1.1] * len(sources), strip=True)
    _strip(axes[0], run, arm, colors)
    for n, ((t, force, torque), name) in enumerate(sources):
        for axis, values, what, unit in (
            (axes[1 + 2 * n], force, "force", "N"),
            (axes[2 + 2 * n], torque, "moment about K", "N m"),
        ):
            for k, letter in enumerate("xyz"):
                _line(axis, t, values[:, k], color=style.AXES_XYZ[k], label=letter)
            axis.set_title(f"{what}, {name}")
            axis.set_ylabel(f"{what.split()[0]} [{unit}]")
        _legend(axes[1 + 2 * n])
    # The same scale for both sources, so that they can be compared at a glance.
    for offset in (1, 2):
        pair = [axes[offset + 2 * n] for n in range(len(sources))]
        low, high = min(a.get_ylim()[0] for a in pair), max(a.get_ylim()[1] for a in pair)
        for axis in pair:
            axis.set_ylim(low, high)
    _markers(axes[1:], run, arm)
    return figure


# Controllets that move several arms together -------------------------------------------------------------------------


def shared_task(run, instance, colors):
    """The error outputs of a controllet that belong to several arms together, such as absolute_ and relative_."""
    mine = [metrics.output_prefix(run, instance, arm) for arm in run.instances[instance]["arms"]]
    prefixes = sorted(
        name[len(f"{instance}/outputs/") :].removesuffix("position_error_m/values")
        for name in run.names
        if name.startswith(f"{instance}/outputs/") and name.endswith("position_error_m/values")
    )
    prefixes = [prefix for prefix in prefixes if prefix not in mine]
    if not prefixes:
        return None
    figure, axes = _sheet(run, [1.3] * (2 * len(prefixes)), strip=True)
    arm = run.instances[instance]["arms"][0]
    active = [span for span in run.spans(arm) if span.instance == instance]
    if active:  # nothing else is shown
        margin = 0.04 * (active[-1].end - active[0].start)
        axes[0].set_xlim(active[0].start - margin, active[-1].end + margin)
    _strip(axes[0], run, arm, colors)
    for n, prefix in enumerate(prefixes):
        topic = f"{instance}/outputs/{prefix}"
        for axis, leaf, scale, label in (
            (axes[1 + 2 * n], "position_error_m", 1e3, "error [mm]"),
            (axes[2 + 2 * n], "orientation_error_rad", 180 / np.pi, "error [deg]"),
        ):
            values, t = run.get(f"{topic}{leaf}/values"), run.get(f"{topic}{leaf}/t")
            kind = "position" if leaf.startswith("position") else "orientation"
            what = prefix.replace("_", " ").strip()
            axis.set_title((f"{instance}: " if axis is axes[1] else "") + f"{what} {kind} error, target minus actual")
            axis.set_ylabel(label)
            if values is None:
                axis.text(0.5, 0.5, "not in the log", transform=axis.transAxes, ha="center", color=style.FAINT)
                continue
            for k, name in enumerate("xyz"[: values.shape[1]]):
                _line(axis, t, scale * values[:, k], color=style.AXES_XYZ[k], label=name)
            _line(axis, t, scale * np.linalg.norm(values, axis=1), color=style.NORM, linewidth=0.9, label="norm")
        _legend(axes[1 + 2 * n])
    _markers(axes[1:], run, arm)
    return figure


# The whole run -------------------------------------------------------------------------------------------------------


def overview(run, colors):
    """Owner and events of each arm, one line per arm."""
    arms = [arm for arm in run.arms if run.spans(arm)]
    if not arms:
        return None
    row = 0.36
    figure, (axis,) = _sheet(run, [row * (len(arms) + 1)], strip=False, legend_in=0.25)
    axis.set_ylim(len(arms) + 1, 0)
    axis.grid(axis="y", visible=False)
    for i, arm in enumerate(arms):
        _draw_spans(axis, run, arm, colors, y=i + 0.12, height=0.66)
        times = [m["stamp"] for m in run.interventions if m["arm"] == arm]
        axis.plot(times, np.full(len(times), i + 0.84), "^", color=style.INTERVENTION, markersize=5, clip_on=False)
    marks = (
        ("switched", "s", "#4477aa", [s["stamp"] for s in run.switches if s.get("accepted")]),
        ("switch refused", "X", "#aa3377", [s["stamp"] for s in run.switches if not s.get("accepted")]),
        ("stop", "P", style.LIMIT, [e["stamp"] for e in run.events if e["kind"] == "stopped"]),
        ("resume", ">", "#228833", [e["stamp"] for e in run.events if e["kind"] == "resumed"]),
        (
            "target, parameter or feature set",
            "|",
            style.INK,
            [e["stamp"] for e in run.events if e["kind"] in ("target_set", "parameter_set", "feature_set")],
        ),
        ("intervention", "^", style.INTERVENTION, [m["stamp"] for m in run.interventions if m["arm"] == ""]),
    )
    for label, marker, color, times in marks:
        if times or (label == "intervention" and run.interventions):
            axis.plot(
                times,
                np.full(len(times), len(arms) + 0.45),
                marker,
                color=color,
                markersize=6,
                label=label,
                linestyle="none",
            )
    axis.set_yticks([i + 0.45 for i in range(len(arms) + 1)], arms + ["events"])
    axis.tick_params(axis="y", length=0)
    axis.legend(loc="lower left", bbox_to_anchor=(0, 1.01), ncol=6, handletextpad=0.2, columnspacing=1.2)
    return figure


def cycle_histogram(run):
    total = run.get("timing/total")
    if total is None:
        return None
    us = np.maximum(1e6 * total, 1e-3)
    figure = plt.figure(figsize=(style.WIDTH_IN, 3.1), dpi=style.DPI)
    axis = figure.add_axes((style.LEFT_IN / style.WIDTH_IN, 0.15, 1 - (style.LEFT_IN + 0.25) / style.WIDTH_IN, 0.61))
    low, high = us.min() * 0.9, us.max() * 1.15
    axis.hist(us, bins=np.geomspace(low, max(high, low * 1.5), 120), color="#4477aa", edgecolor="none")
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.set_ylim(bottom=0.7)
    axis.set_xlim(low, max(high, low * 1.5))
    axis.xaxis.set_major_locator(plt.matplotlib.ticker.LogLocator(subs=(1, 2, 5)))
    axis.xaxis.set_major_formatter(plt.matplotlib.ticker.FuncFormatter(lambda x, _: f"{x:g}"))
    axis.xaxis.set_minor_formatter(plt.matplotlib.ticker.NullFormatter())
    axis.set_xlabel("duration of one cycle [µs]")
    axis.set_ylabel("cycles")
    figures = metrics.cycle_times(run)
    names = {"p50": "median", "p99": "p99", "p99.9": "p99.9", "max": "worst"}
    for n, (key, name) in enumerate(names.items()):
        x = 1e6 * figures[key]
        axis.axvline(x, color=style.INK, linewidth=0.9, linestyle="-" if key == "p50" else (0, (4, 3)), ymax=1.0)
        axis.annotate(
            f"{name} {x:.1f} µs",
            (x, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(-2 if n == 3 else 2, 3 + 11 * n),
            textcoords="offset points",
            ha="right" if n == 3 else "left",
            fontsize=8,
        )
    return figure


def cycle_times_over_time(run):
    t, total = run.get("timing/t"), run.get("timing/total")
    if total is None or len(t) < 2:
        return None
    start = run.get("timing/start")
    paced = start is not None and metrics.is_paced(run)
    figure, axes = _sheet(run, [1.9, 1.5] + ([1.2] if paced else []), strip=False, legend_in=1.15)
    bins = min(400, max(1, len(t) // 5))
    edges = np.linspace(t[0], t[-1], bins + 1)
    edges[-1] += 1e-9
    middle = (edges[:-1] + edges[1:]) / 2
    axes[0].fill_between(
        middle,
        1e6 * series.per_bin(t, total, edges, np.min),
        1e6 * series.per_bin(t, total, edges, np.max),
        step="mid",
        color="#c5d5e8",
        linewidth=0,
        label="all cycles",
    )
    axes[0].plot(middle, 1e6 * series.per_bin(t, total, edges, np.max), color="#7d9cc0", linewidth=0.8, label="worst")
    axes[0].plot(middle, 1e6 * series.per_bin(t, total, edges, np.median), color="#1d4f91", label="median")
    axes[0].set_yscale("log")
    axes[0].yaxis.set_major_locator(plt.matplotlib.ticker.LogLocator(subs=(1, 2, 5)))
    axes[0].yaxis.set_major_formatter(plt.matplotlib.ticker.FuncFormatter(lambda y, _: f"{y:g}"))
    axes[0].yaxis.set_minor_formatter(plt.matplotlib.ticker.NullFormatter())
    axes[0].set_title(f"duration of the cycle, in steps of {edges[1] - edges[0]:.2g} s")
    axes[0].set_ylabel("cycle [µs]")
    _legend(axes[0])
    stages = [(name, run.get(f"timing/{name}")) for name in ("read", "controllets", "features", "safety", "write")]
    stages = [(name, values) for name, values in stages if values is not None]
    if stages:
        axes[1].stackplot(
            middle,
            [np.nan_to_num(1e6 * series.per_bin(t, values, edges, np.median)) for _, values in stages],
            labels=[name for name, _ in stages],
            colors=style.STAGES,
            linewidth=0,
        )
    axes[1].set_title("median of each stage")
    axes[1].set_ylabel("stage [µs]")
    handles, labels = axes[1].get_legend_handles_labels()
    axes[1].legend(handles[::-1], labels[::-1], loc="upper left", bbox_to_anchor=(1.008, 1.02))
    if paced:
        _line(axes[2], t[1:], 1e3 * np.diff(start), color="#4477aa", linewidth=0.8)
        axes[2].set_title("from the start of one cycle to the next, on the computer's clock")
        axes[2].set_ylabel("period [ms]")
        axes[2].set_ylim(bottom=0)
    switches = [s["stamp"] for s in run.switches if s.get("accepted")]
    for axis in axes:
        for x in switches:
            axis.axvline(x, color=style.FAINT, linewidth=0.8, linestyle=(0, (4, 3)), zorder=1)
    return figure
