"""Plots of a run. Each function takes a loading.Run and returns a figure, or None if the log lacks the data."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Rectangle

from report import metrics, series, style
from report.style import line

STRIP_IN, PANEL_IN, GAP_IN = 0.24, 1.55, 0.3
EM = 0.0085  # width of a letter relative to its size [in/pt]


def _sheet(run, heights, strip_of=None, colors=None, legend_in=style.RIGHT_IN, times=None):
    """Figure with panels one below the other, each over the whole run, or the given first and last time.

    A strip on top shows the active controllets of the arm `strip_of`. Returns the figure and the axes of the panels.
    """
    strip = strip_of is not None
    rows = ([STRIP_IN] if strip else []) + list(heights)
    top, bottom = 0.12 if strip else 0.3, 0.42
    height = top + bottom + sum(rows) + GAP_IN * (len(rows) - 1)
    figure = plt.figure(figsize=(style.WIDTH_IN, height))
    left, width = style.LEFT_IN / style.WIDTH_IN, 1 - (style.LEFT_IN + legend_in) / style.WIDTH_IN
    axes, y = [], height - top
    for row in rows:
        y -= row
        share = axes[0] if axes else None
        axes.append(figure.add_axes((left, y / height, width, row / height), sharex=share))
        y -= GAP_IN
    first, last = times or run.time_range
    axes[0].set_xlim(first, last if last > first else first + 0.001)
    for axis in axes[:-1]:
        axis.tick_params(labelbottom=False)
    axes[-1].set_xlabel("time [s]")
    if strip:
        _strip(axes[0], run, strip_of, colors)
    return figure, axes[strip:]


def _draw_spans(axis, run, arm, colors, y=0.0, height=1.0):
    """Colored bands with the names of the controllets that owned the arm; long names are cut."""
    first, last = axis.get_xlim()
    inches = axis.get_position().width * style.WIDTH_IN
    for span in run.spans(arm):
        color, duration = colors.get(span.instance, "#fff"), span.end - span.start
        axis.add_patch(Rectangle((span.start, y), duration, height, facecolor=color, edgecolor="white", linewidth=0.8))
        start, end = max(span.start, first), min(span.end, last)
        room = (end - start) / (last - first) * inches
        size, text = next(
            ((size, span.instance) for size in (8, 7, 6.3) if len(span.instance) * size * EM < room - 0.05),
            (6.3, span.instance[: max(0, int((room - 0.05) / (6.3 * EM)) - 1)] + "…"),
        )
        if len(text) >= 4 or text == span.instance:
            place = {"ha": "center", "va": "center", "clip_on": True}
            axis.text((start + end) / 2, y + height / 2, text, fontsize=size, color=style.INK, **place)


def _strip(axis, run, arm, colors):
    axis.set_ylim(0, 1)
    axis.axis("off")
    place = {"transform": axis.transAxes, "ha": "right", "va": "center"}
    axis.text(-0.012, 0.5, arm, fontsize=9, fontweight="bold", color=style.INK, **place)
    _draw_spans(axis, run, arm, colors)
    first, last = axis.get_xlim()
    times = [m["stamp"] for m in run.interventions if m["arm"] in ("", arm) and first <= m["stamp"] <= last]
    axis.plot(times, np.full(len(times), -0.12), "^", color=style.INTERVENTION, markersize=4.5, clip_on=False)


def _vertical(axes, times, color=style.FAINT, dashes=style.DASHED):
    for axis in axes:
        for t in times:
            axis.axvline(t, color=color, linewidth=0.8, linestyle=dashes, zorder=1)


def _markers(axes, run, arm):
    """Vertical lines where the arm changed its owner, and where the safety stage intervened (unless continuously)."""
    _vertical(axes, [span.start for span in run.spans(arm)[1:]])
    interventions = sorted({m["stamp"] for m in run.interventions if m["arm"] in ("", arm)})
    if len(interventions) <= 40:
        _vertical(axes, interventions, style.INTERVENTION, (0, (1, 2)))


def _legend(axis, reverse=False):
    handles, labels = axis.get_legend_handles_labels()
    step = -1 if reverse else 1
    if handles:
        axis.legend(handles[::step], labels[::step], loc="upper left", bbox_to_anchor=(1.008, 1.02))


def _name(axis, title, label):
    axis.set_title(title)
    axis.set_ylabel(label)


def _joint_lines(axis, t, values, legend=False):
    for i in range(values.shape[1]):
        color = style.JOINTS[i % len(style.JOINTS)]
        line(axis, t, values[:, i], color=color, label=f"joint {i + 1}" if legend else None)


def _target_lines(axis, targets, key):
    for n, target in enumerate(targets):
        for i, values in enumerate(target[key].T):
            label = "target" if n == i == 0 else None
            line(axis, target["t"], values, color=style.INK, linewidth=0.9, linestyle=style.SET_POINT, label=label)


def _xyz_lines(axis, t, values, legend=True, norm=True, **how):
    for k, name in enumerate("xyz"[: values.shape[1]]):
        line(axis, t, values[:, k], color=style.AXES_XYZ[k], label=name if legend else None, **how)
    if norm:
        length, label = np.linalg.norm(values, axis=1), "norm" if legend else None
        line(axis, t, length, color=style.INK, linewidth=0.9, label=label)


def _share_panel(axis, t, values, limit, title):
    share = 100 * metrics.used_share(values, limit)
    _joint_lines(axis, t, share)
    _name(axis, title, "% of limit")
    top = np.nanmax(share[np.isfinite(share)], initial=0)
    axis.set_ylim(0, max(10, min(130, 1.15 * top)))
    if axis.get_ylim()[1] > 95:
        axis.axhline(100, color=style.LIMIT, linewidth=0.9)


# One arm -------------------------------------------------------------------------------------------------------------


def joint_positions(run, arm, colors):
    t, q = run.get(f"{arm}/state/t"), run.get(f"{arm}/state/q")
    if q is None:
        return None
    low, high, targets = run.limits(arm, "q_min"), run.limits(arm, "q_max"), metrics.joint_targets(run, arm)
    limits = low is not None and high is not None
    figure, axes = _sheet(run, [2.1] + [PANEL_IN] * (bool(targets) + limits), arm, colors)
    _joint_lines(axes[0], t, q, legend=True)
    _target_lines(axes[0], targets, "q_d")
    _name(axes[0], "joint positions q", "q [rad]")
    _legend(axes[0])
    for target in targets:
        _joint_lines(axes[1], target["t"], 1e3 * target["error"])
        _name(axes[1], "joint tracking error q_d − q, where a controllet had a joint target", "error [mrad]")
    if limits:
        _joint_lines(axes[-1], t, 100 * (q - low) / (high - low))
        _name(axes[-1], "position within the joint's range: 0 % lower limit, 100 % upper limit", "% of range")
        axes[-1].set_ylim(-4, 104)
        for y in (0, 100):
            axes[-1].axhline(y, color=style.LIMIT, linewidth=0.9)
    _markers(axes, run, arm)
    return figure


def joint_velocities(run, arm, colors):
    t, dq, limit = run.get(f"{arm}/state/t"), run.get(f"{arm}/state/dq"), run.limits(arm, "dq_max")
    if dq is None:
        return None
    figure, axes = _sheet(run, [1.9] + ([1.25] if limit is not None else []), arm, colors)
    _joint_lines(axes[0], t, dq, legend=True)
    _name(axes[0], "joint velocities q̇", "q̇ [rad/s]")
    _legend(axes[0])
    if limit is not None:
        _share_panel(axes[1], t, dq, limit, "use of the velocity limit")
    _markers(axes, run, arm)
    return figure


def torques(run, arm, colors):
    command, measured = run.get(f"{arm}/command/tau_cmd"), run.get(f"{arm}/state/tau_j")
    if command is None and measured is None:
        return None
    without_gravity, limit = metrics.torque_without_gravity(run, arm), run.limits(arm, "tau_max")
    feature, external = run.get(f"{arm}/command/tau_feature"), run.get(f"{arm}/state/tau_ext")
    t_command, t_state = run.get(f"{arm}/command/t"), run.get(f"{arm}/state/t")
    if without_gravity is not None:
        link = (without_gravity, "τ_J − g(q): torque measured on the link side, gravity subtracted", "τ_J − g [N m]")
    else:
        title = "τ_J: torque measured on the link side, gravity included (no model summary in the log)"
        link = (measured, title, "τ_J [N m]")
    acting = feature if feature is not None and np.any(feature) else None
    title = "τ_cmd: torque sent, after the safety stage, without gravity"
    panels = [
        (t_command, command, title, "τ_cmd [N m]"),
        (t_state, *link),
        (t_command, acting, "part of τ_cmd: sum of the features' torques", "τ_feature [N m]"),
        (t_state, external, "τ_ext: estimate of what the arm exerts on its environment", "τ_ext [N m]"),
    ]
    panels = [panel for panel in panels if panel[1] is not None]
    with_limit = limit is not None and command is not None
    figure, axes = _sheet(run, [PANEL_IN] * len(panels) + ([1.25] if with_limit else []), arm, colors)
    for axis, (t, values, title, label) in zip(axes, panels):
        _joint_lines(axis, t, values, legend=axis is axes[0])
        _name(axis, title, label)
    _legend(axes[0])
    if with_limit:
        _share_panel(axes[-1], t_command, command, limit, "use of the torque limit by τ_cmd")
    _markers(axes, run, arm)
    return figure


def pose(run, arm, colors):
    t, p = run.get(f"{arm}/model/t"), run.get(f"{arm}/model/pose_position")
    errors, manipulability = metrics.pose_errors(run, arm), run.get(f"{arm}/model/manipulability")
    if p is None and not errors:
        return None
    heights = [2.0] * (p is not None) + [PANEL_IN] * 2 * bool(errors) + [0.8] * (manipulability is not None)
    figure, axes = _sheet(run, heights, arm, colors)
    if p is not None:
        _xyz_lines(axes[0], t, p, norm=False, linewidth=1.4)
        _target_lines(axes[0], metrics.pose_targets(run, arm), "position")
        _name(axes[0], "position of the end effector E in the world", "p_WE [m]")
        _legend(axes[0])
    if errors:
        of_error = axes[p is not None :][:2]
        for n, entry in enumerate(errors):
            _xyz_lines(of_error[0], entry["t"], 1e3 * entry["position"], legend=n == 0)
            _xyz_lines(of_error[1], entry["t"], np.degrees(entry["rotation"]), legend=n == 0)
        _name(of_error[0], "position error, target minus actual, world axes", "error [mm]")
        _name(of_error[1], "orientation error, rotation vector log(R_d Rᵀ), world axes", "error [deg]")
        _legend(of_error[0])
        for axis in of_error:
            _shade_without_target(axis, run, arm, {entry["instance"] for entry in errors})
    if manipulability is not None:
        line(axes[-1], t, manipulability, color=style.BLUE)
        _name(axes[-1], "manipulability √det(J Jᵀ): 0 at a singular configuration", "m")
        axes[-1].set_ylim(0, 1.15 * float(np.nanmax(manipulability)) or 1)
    _markers(axes, run, arm)
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
            middle = ((span.start + span.end) / 2 - first) / (last - first)
            style.note(axis, "target of several arms" if shared else "no pose target", middle, fontsize=7.5)


def wrench(run, arm, colors):
    sources = [
        (metrics.wrench(run, arm, "estimated", "has_estimate"), "estimated by the arm"),
        (metrics.wrench(run, arm, "contact", "has_contact_truth"), "contact forces of the simulator"),
    ]
    sources = [source for source in sources if source[0] is not None]
    if not sources:
        return None
    figure, axes = _sheet(run, [1.4, 1.1] * len(sources), arm, colors)
    for n, ((t, force, torque), name) in enumerate(sources):
        _xyz_lines(axes[2 * n], t, force, norm=False)
        _name(axes[2 * n], f"force, {name}", "force [N]")
        _legend(axes[2 * n])
        _xyz_lines(axes[2 * n + 1], t, torque, norm=False)
        _name(axes[2 * n + 1], f"moment about K, {name}", "moment [N m]")
    for pair in (axes[::2], axes[1::2]):  # same scale for both sources, so that they can be compared
        low, high = min(a.get_ylim()[0] for a in pair), max(a.get_ylim()[1] for a in pair)
        for axis in pair:
            axis.set_ylim(low, high)
    _markers(axes, run, arm)
    return figure


# Controllets that move several arms together -------------------------------------------------------------------------


def shared_task(run, instance, colors):
    """The error outputs of a controllet that belong to several arms together, such as absolute_ and relative_."""
    arms, outputs, ending = run.instances[instance]["arms"], f"{instance}/outputs/", "position_error_m/values"
    single = [metrics.output_prefix(run, instance, arm) for arm in arms]
    names = sorted(name for name in run.names if name.startswith(outputs) and name.endswith(ending))
    prefixes = [name.removeprefix(outputs).removesuffix(ending) for name in names]
    prefixes = [prefix for prefix in prefixes if prefix not in single]
    if not prefixes:
        return None
    active, times = [span for span in run.spans(arms[0]) if span.instance == instance], None
    if active:  # show only this period
        margin = 0.04 * (active[-1].end - active[0].start)
        times = active[0].start - margin, active[-1].end + margin
    figure, axes = _sheet(run, [1.3] * (2 * len(prefixes)), arms[0], colors, times=times)
    for n, prefix in enumerate(prefixes):
        for axis, leaf, scale, unit in (
            (axes[2 * n], "position_error_m", 1e3, "mm"),
            (axes[2 * n + 1], "orientation_error_rad", 180 / np.pi, "deg"),
        ):
            topic, kind = f"{outputs}{prefix}{leaf}", leaf.partition("_")[0]
            what = f"{prefix.replace('_', ' ').strip()} {kind} error, target minus actual"
            _name(axis, f"{instance}: {what}" if axis is axes[0] else what, f"error [{unit}]")
            values = run.get(f"{topic}/values")
            if values is None:
                style.note(axis, "not in the log")
            else:
                _xyz_lines(axis, run.get(f"{topic}/t"), scale * values)
        _legend(axes[2 * n])
    _markers(axes, run, arms[0])
    return figure


# The whole run -------------------------------------------------------------------------------------------------------


def overview(run, colors):
    """Owner and events of each arm, one line per arm."""
    arms = [arm for arm in run.arms if run.spans(arm)]
    if not arms:
        return None
    figure, (axis,) = _sheet(run, [0.36 * (len(arms) + 1)], legend_in=0.25)
    axis.set_ylim(len(arms) + 1, 0)
    axis.grid(axis="y", visible=False)
    for i, arm in enumerate(arms):
        _draw_spans(axis, run, arm, colors, y=i + 0.12, height=0.66)
        times = [m["stamp"] for m in run.interventions if m["arm"] == arm]
        axis.plot(times, np.full(len(times), i + 0.84), "^", color=style.INTERVENTION, markersize=5, clip_on=False)

    def of_kind(*kinds):
        return [e["stamp"] for e in run.events if e["kind"] in kinds]

    settings = of_kind("target_set", "parameter_set", "feature_set")
    for label, marker, color, times in (
        ("switched", "s", "#4477aa", [s["stamp"] for s in run.switches if s.get("accepted")]),
        ("switch refused", "X", "#aa3377", [s["stamp"] for s in run.switches if not s.get("accepted")]),
        ("stop", "P", style.LIMIT, of_kind("stopped")),
        ("resume", ">", "#228833", of_kind("resumed")),
        ("target, parameter or feature set", "|", style.INK, settings),
        ("intervention", "^", style.INTERVENTION, [m["stamp"] for m in run.interventions if m["arm"] == ""]),
    ):
        if times or (label == "intervention" and run.interventions):
            places = np.full(len(times), len(arms) + 0.45)
            axis.plot(times, places, marker, color=color, markersize=6, label=label, linestyle="none")
    axis.set_yticks([i + 0.45 for i in range(len(arms) + 1)], arms + ["events"])
    axis.tick_params(axis="y", length=0)
    axis.legend(loc="lower left", bbox_to_anchor=(0, 1.01), ncol=6, handletextpad=0.2, columnspacing=1.2)
    return figure


def cycle_histogram(run):
    total = run.get("timing/total")
    if total is None:
        return None
    us = np.maximum(1e6 * total, 1e-3)
    figure = plt.figure(figsize=(style.WIDTH_IN, 3.1))
    axis = figure.add_axes((style.LEFT_IN / style.WIDTH_IN, 0.15, 1 - (style.LEFT_IN + 0.25) / style.WIDTH_IN, 0.61))
    low, high = us.min() * 0.9, max(us.max() * 1.15, us.min() * 1.35)
    axis.hist(us, bins=np.geomspace(low, high, 120), color=style.BLUE, edgecolor="none")
    style.log_scale(axis.xaxis)
    axis.set(yscale="log", xlim=(low, high), xlabel="duration of one cycle [µs]", ylabel="cycles")
    axis.set_ylim(bottom=0.7)
    for n, (name, seconds) in enumerate(metrics.cycle_times(run).items()):
        x = 1e6 * seconds
        axis.axvline(x, color=style.INK, linewidth=0.9, linestyle="-" if n == 0 else style.DASHED)
        place = {"xycoords": ("data", "axes fraction"), "textcoords": "offset points", "fontsize": 8}
        place |= {"xytext": (-2, 36), "ha": "right"} if name == "worst" else {"xytext": (2, 3 + 11 * n)}
        axis.annotate(f"{name} {x:.1f} µs", (x, 1.0), **place)
    return figure


def cycle_times_over_time(run):
    t, total, start = run.get("timing/t"), run.get("timing/total"), run.get("timing/start")
    if total is None or len(t) < 2:
        return None
    paced = start is not None and metrics.is_paced(run)
    figure, axes = _sheet(run, [1.9, 1.5] + ([1.2] if paced else []), legend_in=1.15)
    edges = np.linspace(t[0], t[-1], min(400, max(1, len(t) // 5)) + 1)
    edges[-1] += 1e-9
    middle = (edges[:-1] + edges[1:]) / 2

    def us(values, reduce):
        return 1e6 * series.per_bin(t, values, edges, reduce)

    low, high = us(total, np.min), us(total, np.max)
    axes[0].fill_between(middle, low, high, step="mid", color="#c5d5e8", linewidth=0, label="all cycles")
    axes[0].plot(middle, high, color="#7d9cc0", linewidth=0.8, label="worst")
    axes[0].plot(middle, us(total, np.median), color=style.DARK_BLUE, label="median")
    style.log_scale(axes[0].yaxis)
    _name(axes[0], f"duration of the cycle, in steps of {edges[1] - edges[0]:.2g} s", "cycle [µs]")
    _legend(axes[0])
    stages = {name: run.get(f"timing/{name}") for name in ("read", "controllets", "features", "safety", "write")}
    medians = {name: np.nan_to_num(us(x, np.median)) for name, x in stages.items() if x is not None}
    if medians:
        axes[1].stackplot(middle, *medians.values(), labels=list(medians), colors=style.STAGES, linewidth=0)
    _name(axes[1], "median of each stage", "stage [µs]")
    _legend(axes[1], reverse=True)
    if paced:
        line(axes[2], t[1:], 1e3 * np.diff(start), color=style.BLUE, linewidth=0.8)
        _name(axes[2], "from the start of one cycle to the next, on the computer's clock", "period [ms]")
        axes[2].set_ylim(bottom=0)
    _vertical(axes, [s["stamp"] for s in run.switches if s.get("accepted")])
    return figure
