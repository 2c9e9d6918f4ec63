"""Plots of a task. Each function returns a figure, or None without data."""

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from experiments.pages import frame, task_metrics
from report import metrics, series, style

PLANTS = {"ideal": "#4477aa", "realistic": "#d98c21"}
OTHERS = ("#228833", "#aa3377", "#7a7a7a")
BETWEEN = "#b9c3cd"
TRUE, ESTIMATE, WINDOW = "#2b5fb8", "#c9a227", "#eef3f8"
DESIRED = {"color": style.INK, "linewidth": 0.9, "linestyle": (0, (4, 2))}
SIX = {"q": "joint position q", "dq": "joint velocity dq", "tau": "joint torque τ", "x": "end effector x"}
SIX |= {"f": "force F", "c_err": "control error C"}
NOT_DRAWN = ("limiter_hits", "held", "contact_to_window_s", "contact_lost_s")


def color(plant, plants):
    return PLANTS.get(plant) or OTHERS[[p for p in plants if p not in PLANTS].index(plant) % len(OTHERS)]


def _bars(axis, groups, names, colors):
    """groups: per name a list with one value (or None) per place. Returns the width of a bar."""
    width = 0.8 / len(names)
    for i, (values, name, shade) in enumerate(zip(groups, names, colors)):
        x = np.arange(len(values)) + (i - (len(names) - 1) / 2) * width
        heights = [0 if v is None else v for v in values]
        axis.bar(x, heights, width * 0.92, color=shade, label=name, edgecolor="white", linewidth=0)
        for at, value in zip(x, values):
            if value is None:
                axis.text(at, 0, "–", ha="center", va="bottom", color=style.FAINT, fontsize=7)
    return width


def _ticks(axis, variants):
    """Names of variants below their bars: horizontal if they fit, otherwise slanted."""
    labels = [v["label"] for v in variants]
    style.name_places(axis, labels)
    room = axis.figure.get_size_inches()[0] / axis.get_subplotspec().get_gridspec().ncols - 0.8  # inches of the panel
    slanted = {} if max(len(x) for x in labels) * 0.062 < room / len(labels) else {"rotation": 38, "ha": "right"}
    axis.set_xticklabels(labels, rotation_mode="anchor", fontsize=7, **slanted)
    axis.tick_params(axis="x", pad=2)


def six_bars(summary, variants, plants, published):
    """The six kinds of error, against targets and between plants, by variant and plant; published figures as lines."""
    figure, axes = style.panels(6, 3, 2.0) if len(variants) <= 5 else style.panels(6, 2, 2.4)
    for axis, (key, rmse, _) in zip(axes, task_metrics.SIX):
        _, unit, factor = task_metrics.NAMES[rmse]

        def values(plant, part):
            found = [(summary.get((plant, v["name"])) or {}).get(part, {}).get(rmse) for v in variants]
            return [None if x is None else factor * (x["mean"] if isinstance(x, dict) else x) for x in found]

        groups = {f"{p}, against target": (values(p, "metrics"), color(p, plants)) for p in plants}
        if len(plants) > 1:
            between = values(plants[-1], "between_plants"), BETWEEN
            groups[f"{plants[-1]} against {frame.other_plant(plants)}"] = between
        _bars(axis, [v for v, _ in groups.values()], list(groups), [shade for _, shade in groups.values()])
        for line in published:
            if line["metric"] == rmse:
                style.level(axis, line["value"] * factor, label="paper: simulation against real arm, up to")
        axis.set(title=SIX[key], ylabel=f"RMSE [{unit}]")
        axis.set_ylim(bottom=0)
        _ticks(axis, variants)
    handles, labels = axes[0].get_legend_handles_labels()
    style.legend_below(figure, handles, labels, 1 if len(labels) <= 4 else 2, h_pad=1.0)
    return figure


def limit_bars(rows, summary, variants, plants, shown=()):
    """Figures with a limit, and requested ones: mean of the repeats as bar, span as line, limits as red marks."""
    limited = [row["metric"] for row in rows if row["metric"] not in NOT_DRAWN]
    names = [name for name in dict.fromkeys([*limited, *shown]) if name in task_metrics.NAMES]
    if not names:
        return None
    long = max(len(v["label"]) for v in variants) * len(variants) > 30
    columns = 2 if len(variants) > 4 or len(names) < 3 else 3
    figure, axes = style.panels(len(names), columns, 2.7 if long else 2.1)
    for axis, name in zip(axes, names):
        _limited_figure(axis, name, [row for row in rows if row["metric"] == name], summary, variants, plants)
        _ticks(axis, variants)
    handles = [Patch(color=color(p, plants)) for p in plants]
    handles += [Line2D([], [], color=style.LIMIT, linewidth=1.4), Line2D([], [], color=style.INK, linewidth=1.0)]
    style.legend_below(figure, handles, [*plants, "limit", "lowest to highest repeat"], h_pad=1.0)
    return figure


def _limited_figure(axis, name, rows, summary, variants, plants):
    what, unit, factor = task_metrics.NAMES[name]
    found = [[(summary.get((p, v["name"])) or {}).get("metrics", {}).get(name) for v in variants] for p in plants]
    means = [[x and factor * x["mean"] for x in of_plant] for of_plant in found]
    width = _bars(axis, means, plants, [color(p, plants) for p in plants])
    values = [factor * row["limit"] for row in rows]
    for i, of_plant in enumerate(found):
        for k, x in enumerate(of_plant):
            place = k + (i - (len(plants) - 1) / 2) * width
            if x is not None:
                low, high = factor * x["min"], factor * x["max"]
                values += [low, high]
                axis.plot([place, place], [low, high], color=style.INK, linewidth=1.0, solid_capstyle="butt")
            for row in rows:
                if (row["plant"], row["variant"]) == (plants[i], variants[k]["name"]):
                    ends = place - width / 2, place + width / 2
                    axis.hlines(factor * row["limit"], *ends, color=style.LIMIT, linewidth=1.4)
    axis.set(title=what, ylabel=f"[{unit}]" if unit else "")
    if not any(x is not None for of_plant in found for x in of_plant):
        axis.set_visible(False)
        return
    low, high = min(values), max(values)
    banded = any(row["bound"] == "at_least" for row in rows) or name in ("force_low_n", "force_high_n")
    if banded and low > 0.5 * high:  # outside the plotted range
        room = 0.6 * (high - low) + 1e-9
        axis.set_ylim(low - room, high + room)
    else:
        axis.set_ylim(0, 1.12 * high if high > 0 else 1)


# One variant ----------------------------------------------------------------------------------------------------------


def _line(axis, t, y, **looks):
    axis.plot(*series.drawable(t, y), **looks)


def _rows_of(run):
    """Rows of a sheet from the top: (function, height)."""
    rows = []
    if run.forces:
        rows += [(_draw_force, 1.6), (_draw_force_error, 1.2)]
    if run.measure.get("path"):
        rows.append((_draw_path_error, 1.2))
    if run.measure.get("grasp"):
        rows += [(_draw_lift, 1.3), (_draw_tilt, 1.0)]
    if run.measure.get("loss"):
        rows.append((_draw_loss, 1.4))
    instance = run.main_instance
    if run.output(instance, "force_tank_j") is not None:
        rows.append((_draw_tanks, 1.2))
    if run.output(instance, "gamma_f") is not None:
        rows.append((_draw_valves, 1.1))
    if not run.forces:
        arm = run.arms[0]
        if run.joint_errors(arm) is not None:
            rows += [(_draw_joint_positions, 1.9), (_draw_joint_errors, 1.6)]
        elif run.position_errors(arm) is not None:
            rows.append((_draw_position_errors, 1.7))
    rows.append((_draw_torque_rate, 1.1))
    return rows


def sheet(runs_by_plant):
    """One variant: plants side by side, measured quantities one below the other; other repeats in pale colors."""
    plants, (first, *_) = list(runs_by_plant), next(iter(runs_by_plant.values()))
    rows = _rows_of(first)
    heights = [h for _, h in rows]
    height = sum(heights) + 0.34 * len(rows) + 0.75
    figure, axes = style.sheet(len(rows), len(plants), height, sharex=True, sharey="row", height_ratios=heights)
    # Set manually: tight_layout would draw everything again to find the same result.
    vertical = {"top": 1 - 0.27 / height, "bottom": 0.45 / height, "hspace": 0.36 / (sum(heights) / len(rows))}
    figure.subplots_adjust(left=0.7 / style.WIDTH_IN, right=1 - 1.75 / style.WIDTH_IN, wspace=0.05, **vertical)
    for column, (plant, runs) in enumerate(runs_by_plant.items()):
        run, top, bottom = runs[0], axes[0][column], axes[-1][column]
        for axis, (draw, _) in zip(axes[:, column], rows):
            draw(axis, runs)
            if run.window is not None:
                end = min(run.window[1], run.run.time_range[1])
                axis.axvspan(run.window[0], end, color=WINDOW, zorder=0, linewidth=0)
            if run.contact is not None:
                axis.axvline(run.contact, color=style.FAINT, linewidth=0.7, linestyle=style.DASHED, zorder=1)
            if column > 0:
                axis.set_ylabel("")
        top.set_title(f"{plant}: {top.get_title(loc='left')}", loc="left")
        bottom.set_xlabel("time [s]")
        bottom.set_xlim(*first.run.time_range)
        if len(plants) > 2:  # in narrow columns the last tick label would touch the first one of the next column
            bottom.xaxis.set_major_locator(MaxNLocator(3, integer=True))
    for row in axes:
        if getattr(row[0], "from_zero", False):  # the limits are known once all plots of the shared axis are drawn
            row[0].set_ylim(0, None)
        shown = {}  # entries of all plants: arms draw other lines than simulations
        for axis in row:
            for handle, name in zip(*axis.get_legend_handles_labels()):
                shown.setdefault(name, handle)
        if shown:
            row[-1].legend(shown.values(), shown.keys(), loc="upper left", bbox_to_anchor=(1.01, 1.0))
    return figure


def _of_repeats(axis, runs, series_of, shade, title, label):
    """One series per repeat from zero, the first in full color; series_of(run): t, y, or None if it has none."""
    for number, run in enumerate(runs):
        if (found := series_of(run)) is None:
            style.note(axis, "not measured on arms")
            break
        _line(axis, *found, color=shade, alpha=1 if number == 0 else 0.25, linewidth=0.9)
    axis.set(title=title, ylabel=label)
    axis.from_zero = True


def _arm_styles(run):
    return ["-", (0, (5, 1.5)), (0, (1, 1))][: max(1, len(run.forces))]


def _draw_force(axis, runs):
    run = runs[0]
    for force, looks in zip(run.forces, _arm_styles(run)):
        t, who = force["t"], f", {force['arm']}" if len(run.forces) > 1 else ""
        _line(axis, t, force["estimate"], color=ESTIMATE, linewidth=0.8, linestyle=looks, label=f"estimate{who}")
        if not run.measured:
            _line(axis, t, force["true"], color=TRUE, linewidth=1.0, linestyle=looks, label=f"true{who}")
        if force is run.forces[-1]:
            _line(axis, t, force["desired"], label="desired", **DESIRED)
    axis.set(title="force", ylabel="force [N]")


def _draw_force_error(axis, runs):
    limit = getattr(axis.figure, "_force_error_limit", 0.1)  # the same for all plants
    for number, run in enumerate(runs):
        for force, looks in zip(run.forces, _arm_styles(run)):
            t, error = force["t"], force["true"] - force["desired"]
            _line(axis, t, error, color=TRUE, alpha=1 if number == 0 else 0.25, linewidth=0.9, linestyle=looks)
            inside = run.inside(t)
            if inside.any():
                limit = max(limit, 1.15 * float(np.nanmax(np.abs(error[inside]))))
    axis.figure._force_error_limit = limit
    axis.set_ylim(-limit, limit)
    which, all_of = "estimated" if runs[0].measured else "true", ", all repeats" if len(runs) > 1 else ""
    axis.set(title=f"{which} minus desired force{all_of}", ylabel="error [N]")


def _draw_path_error(axis, runs):
    where = ", along the surface" if runs[0].measure["path"]["plane"] == "xy" else ""

    def distance(run):
        t, error = run.path_errors
        return t, 1e3 * run.path_distance(error)

    _of_repeats(axis, runs, distance, style.PURPLE, f"distance from the moving set-point{where}", "path [mm]")


def _draw_lift(axis, runs):
    run = runs[0]
    grasp = run.measure["grasp"]
    pose, target = run.object_pose(grasp["name"]), run.target(grasp["instance"], grasp["input"])

    def up(t, p, **how):
        _line(axis, t, 1e3 * (p[:, 2] - p[0, 2]), **how)

    if pose is not None:
        up(*pose[:2], color=TRUE, label=f"{grasp['name']}, up")
    else:  # without the object's pose, the hands' motion stands for it
        for arm, looks in zip(run.arms, _arm_styles(run)):
            up(*run.pose(arm)[:2], color=ESTIMATE, linestyle=looks, label=f"hand, {arm}, up")
    if target is not None:
        up(*target, label="set-point, up", **DESIRED)
    axis.set(title="lift", ylabel="height [mm]")


def _draw_tilt(axis, runs):
    def tilt(run):
        pose = run.object_pose(run.measure["grasp"]["name"])
        if pose is None:
            return None
        t, _, q = pose
        turned = metrics.rotation_error(np.repeat(q[:1], len(q), axis=0), q)
        return t, np.degrees(np.linalg.norm(turned, axis=1))

    _of_repeats(axis, runs, tilt, style.PURPLE, "rotation of the object since the start", "tilt [°]")


def _draw_loss(axis, runs):
    loss = runs[0].measure["loss"]
    title = "speed; the surface is removed at the line"
    _of_repeats(axis, runs, lambda run: run.speed(loss["arm"]), TRUE, title, "speed [m/s]")
    axis.axvline(loss["at_s"], color=style.INTERVENTION, linewidth=0.9)


def _outputs(run, looks):
    """(label, t, y, style) of the main controllet's outputs; looks: label and style by output name."""
    for name, (label, how) in looks.items():
        if (found := run.output(run.main_instance, name)) is not None:
            yield label, found[0], found[1] if np.ndim(found[1]) == 1 else found[1][:, 0], how


def _draw_tanks(axis, runs):
    looks = {
        "force_tank_j": ("force tank", {"color": "#2e8b57"}),
        "impedance_tank_j": ("impedance tank", {"color": "#c0392b"}),
        "stored_energy_j": ("all stored", DESIRED | {"linewidth": 0.8}),
    }
    for label, t, energy, how in _outputs(runs[0], looks):
        first = energy[np.flatnonzero(np.isfinite(energy))[0]]
        _line(axis, t, energy - first, label=f"{label} ({first:.3g} J)", **how)
    axis.set(title="energy since the start", ylabel="change [J]")


def _draw_valves(axis, runs):
    looks = {
        "gamma_f": ("γ", {"color": style.PURPLE}),
        "alpha_f": ("α force", {"color": "#2e8b57"}),
        "alpha_i": ("α impedance", {"color": "#c0392b"}),
        "in_contact": ("in contact", {"color": "#9aa5b1"}),
    }
    for label, t, values, how in _outputs(runs[0], looks):
        _line(axis, t, values, label=label, linewidth=0.9, **how)
    axis.set(title="inertia shaping and valves", ylabel="[1]", ylim=(-1.08, 1.08))


def _draw_joint_positions(axis, runs):
    run = runs[0]
    t, q = run.state(run.arms[0], "q")
    target = metrics.joint_targets(run.run, run.arms[0])[0]
    for i in range(q.shape[1]):
        shade = style.JOINTS[i]
        _line(axis, t, q[:, i], color=shade, label=f"joint {i + 1}")
        _line(axis, target["t"], target["q_d"][:, i], **DESIRED | {"color": shade, "linewidth": 0.8})
    axis.set(title="joint positions, set-points dashed", ylabel="position [rad]")


def _draw_joint_errors(axis, runs):
    t, error, _ = runs[0].joint_errors(runs[0].arms[0])
    for i in range(error.shape[1]):
        _line(axis, t, 1e3 * error[:, i], color=style.JOINTS[i], linewidth=0.9)
    axis.set(title="set-point minus position", ylabel="error [mrad]")


def _draw_position_errors(axis, runs):
    t, error = runs[0].position_errors(runs[0].arms[0])
    for i, name in enumerate("xyz"):
        _line(axis, t, 1e3 * error[:, i], color=style.AXES_XYZ[i], linewidth=0.9, label=name)
    axis.set(title="set-point minus end effector", ylabel="error [mm]")


def _draw_torque_rate(axis, runs):
    run = runs[0]
    for arm in run.arms:
        t, requested = run.requested_torque(arm)
        rate, owner = np.abs(np.diff(requested, axis=0)).max(axis=1) / np.diff(t), run.run.get(f"{arm}/command/owner")
        rate[owner[1:] != owner[:-1]] = np.nan
        _line(axis, t[1:], rate, color="#5d6d7e", linewidth=0.7)
    axis.set(title="fastest joint torque before the limiter", ylabel="[N m/s]")
    axis.from_zero = True


# All variants ---------------------------------------------------------------------------------------------------------


def paths(chosen, plants):
    """Paths in the window seen along z, with the set-point's; one panel each. chosen: [(variant, {plant: run})]."""
    chosen = [(v, runs) for v, runs in chosen if any(r.path_errors is not None for r in runs.values())]
    if not chosen:
        return None
    columns = min(4, len(chosen))
    size, rows = style.WIDTH_IN / max(columns, 2.6), -(-len(chosen) // columns)
    height = rows * (size + 0.15) + 0.45
    figure, axes = style.sheet(rows, columns, height, size * columns, sharex=True, sharey=True)
    for axis in axes.flat[len(chosen) :]:
        axis.set_visible(False)
    for axis, (variant, runs) in zip(axes.flat, chosen):
        for number, (plant, run) in enumerate(runs.items()):
            path = run.measure["path"]
            target, (t, p, _) = run.target(path["instance"], path["input"]), run.pose(path["arm"])
            if number == 0 and target is not None:
                inside = 1e3 * target[1][run.inside(target[0])]
                axis.plot(inside[:, 0], inside[:, 1], label="set-point", zorder=3, **DESIRED)
            inside = 1e3 * p[run.inside(t)]
            axis.plot(inside[:, 0], inside[:, 1], color=color(plant, plants), linewidth=1.0, label=plant)
        axis.set_aspect("equal", adjustable="box")
        axis.set_title(variant["label"], fontsize=8)
    for column in axes.T:
        last = [axis for axis in column if axis.get_visible()][-1]
        last.tick_params(labelbottom=True)
        last.set_xlabel("x [mm]")
    for axis in axes[:, 0]:
        axis.set_ylabel("y [mm]")
    style.legend_below(figure, *axes.flat[0].get_legend_handles_labels())
    return figure
