"""Plots of a task. Each function returns a figure, or None without data."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.ticker import MaxNLocator

from experiments.pages import task_metrics
from report import metrics, series, style

PLANTS = {"ideal": "#4477aa", "realistic": "#d98c21"}
OTHERS = ("#228833", "#aa3377", "#7a7a7a")
BETWEEN = "#b9c3cd"
DESIRED, TRUE, ESTIMATE = "#1f2933", "#2b5fb8", "#c9a227"
WINDOW = "#eef3f8"


def color(plant, plants):
    return PLANTS.get(plant) or OTHERS[[p for p in plants if p not in PLANTS].index(plant) % len(OTHERS)]


def _width(variants, plants, extra=0):
    return max(2.7, 0.55 + len(variants) * (0.16 * (len(plants) + extra) + 0.16))


def _grid(panels, columns, height=1.75, width=style.WIDTH_IN):
    rows = -(-panels // columns)
    figure, axes = plt.subplots(rows, columns, figsize=(width, rows * height + 0.55), dpi=style.DPI, squeeze=False)
    for axis in axes.flat[panels:]:
        axis.set_visible(False)
    return figure, list(axes.flat[:panels])


def _bars(axis, groups, names, colors, hatches=None):
    """groups: per name a list with one value (or None) per place."""
    places = np.arange(len(groups[0]))
    width = 0.8 / len(names)
    for i, (values, name) in enumerate(zip(groups, names)):
        x = places + (i - (len(names) - 1) / 2) * width
        heights = [0 if v is None else v for v in values]
        axis.bar(
            x,
            heights,
            width * 0.92,
            color=colors[i],
            label=name,
            hatch=(hatches or {}).get(i),
            edgecolor="white",
            linewidth=0,
        )
        for at, value in zip(x, values):
            if value is None:
                axis.text(at, 0, "–", ha="center", va="bottom", color=style.FAINT, fontsize=7)
    return places


def _ticks(axis, variants):
    """Names of variants below their bars: horizontal if they fit, otherwise slanted."""
    labels = [v["label"] for v in variants]
    axis.set_xticks(range(len(labels)))
    room = axis.figure.get_size_inches()[0] / axis.get_subplotspec().get_gridspec().ncols - 0.8  # inches of the panel
    fits = max(len(x) for x in labels) * 0.062 < room / len(labels)
    axis.set_xticklabels(
        labels, rotation=0 if fits else 38, ha="center" if fits else "right", rotation_mode="anchor", fontsize=7
    )
    axis.grid(False, axis="x")
    axis.tick_params(axis="x", length=0, pad=2)


def six_bars(summary, variants, plants, published):
    """The six kinds of error, against targets and between plants, by variant and plant; published figures as lines."""
    titles = {
        "q": "joint position q",
        "dq": "joint velocity dq",
        "tau": "joint torque τ",
        "x": "end effector x",
        "f": "force F",
        "c_err": "control error C",
    }
    figure, axes = _grid(6, 3, 2.0) if len(variants) <= 5 else _grid(6, 2, 2.4)
    for axis, (key, rmse, _) in zip(axes, task_metrics.SIX):
        _, unit, factor = task_metrics.NAMES[rmse]

        def values(plant, part):
            found = [(summary.get((plant, v["name"])) or {}).get(part, {}).get(rmse) for v in variants]
            return [None if x is None else factor * (x["mean"] if isinstance(x, dict) else x) for x in found]

        groups = [values(p, "metrics") for p in plants]
        names, colors = [f"{p}, against target" for p in plants], [color(p, plants) for p in plants]
        if len(plants) > 1:
            groups.append(values(plants[-1], "between_plants"))
            names.append(f"{plants[-1]} against {plants[-2] if plants[-1] == 'measured' else plants[0]}")
            colors.append(BETWEEN)
        _bars(axis, groups, names, colors)
        for line in published:
            if line["metric"] == rmse:
                axis.axhline(
                    line["value"] * factor,
                    color=style.LIMIT,
                    linewidth=0.9,
                    linestyle=(0, (4, 3)),
                    label="paper: simulation against real arm, up to",
                )
        axis.set_title(titles[key])
        axis.set_ylabel(f"RMSE [{unit}]")
        axis.set_ylim(bottom=0)
        _ticks(axis, variants)
    handles, labels = axes[0].get_legend_handles_labels()
    lines = 1 if len(labels) <= 4 else 2  # what one line has room for
    figure.legend(handles, labels, loc="lower center", ncol=-(-len(labels) // lines), bbox_to_anchor=(0.5, 0.0))
    figure.tight_layout(rect=(0, (0.1 + 0.2 * lines) / figure.get_size_inches()[1], 1, 1), h_pad=1.0)
    return figure


def limit_bars(rows, summary, variants, plants, shown=()):
    """Figures with a limit, and requested ones: mean of the repeats as bar, span as line, limits as red marks."""
    names = list(
        dict.fromkeys(
            row["metric"]
            for row in rows
            if row["metric"] in task_metrics.NAMES
            and row["metric"] not in ("limiter_hits", "held", "contact_to_window_s", "contact_lost_s")
        )
    )
    names += [name for name in shown if name in task_metrics.NAMES and name not in names]
    if not names:
        return None
    long = max(len(v["label"]) for v in variants) * len(variants) > 30
    columns = 2 if len(variants) > 4 or len(names) < 3 else 3
    figure, axes = _grid(len(names), columns, 2.7 if long else 2.1)
    for axis, name in zip(axes, names):
        what, unit, factor = task_metrics.NAMES[name]
        groups, spans = [], []
        for plant in plants:
            found = [(summary.get((plant, v["name"])) or {}).get("metrics", {}).get(name) for v in variants]
            groups.append([None if x is None else factor * x["mean"] for x in found])
            spans.append([(None, None) if x is None else (factor * x["min"], factor * x["max"]) for x in found])
        _bars(axis, groups, plants, [color(p, plants) for p in plants])
        width = 0.8 / len(plants)
        for i, plant in enumerate(plants):
            for place, (low, high) in enumerate(spans[i]):
                x = place + (i - (len(plants) - 1) / 2) * width
                if low is not None and high > low:
                    axis.plot([x, x], [low, high], color=style.INK, linewidth=1.0, solid_capstyle="butt")
                for row in rows:
                    if row["metric"] == name and row["plant"] == plant and row["variant"] == variants[place]["name"]:
                        axis.plot(
                            [x - width / 2, x + width / 2],
                            [factor * row["limit"]] * 2,
                            color=style.LIMIT,
                            linewidth=1.4,
                            solid_capstyle="butt",
                        )
        axis.set_title(what)
        axis.set_ylabel(f"[{unit}]" if unit else "")
        if not any(x is not None for values in groups for x in values):
            axis.set_visible(False)
            continue
        bottom = [row["limit"] * factor for row in rows if row["metric"] == name and row["bound"] == "at_least"]
        everything = [x for pair in spans for span in pair for x in span if x is not None] + [
            row["limit"] * factor for row in rows if row["metric"] == name
        ]
        if (bottom or name in ("force_low_n", "force_high_n")) and min(everything) > 0.5 * max(
            everything
        ):  # a band: zero is far away
            room = 0.6 * (max(everything) - min(everything)) + 1e-9
            axis.set_ylim(min(everything) - room, max(everything) + room)
        else:
            axis.set_ylim(0, 1.12 * max(everything) if max(everything) > 0 else 1)
        _ticks(axis, variants)
    handles = [plt.Rectangle((0, 0), 1, 1, color=color(p, plants)) for p in plants]
    handles += [
        plt.Line2D([], [], color=style.LIMIT, linewidth=1.4),
        plt.Line2D([], [], color=style.INK, linewidth=1.0),
    ]
    figure.legend(
        handles,
        [*plants, "limit", "lowest to highest repeat"],
        loc="lower center",
        ncol=len(plants) + 2,
        bbox_to_anchor=(0.5, 0.0),
    )
    figure.tight_layout(rect=(0, 0.35 / figure.get_size_inches()[1], 1, 1), h_pad=1.0)
    return figure


# One variant ----------------------------------------------------------------------------------------------------------


def _line(axis, t, y, **looks):
    axis.plot(*series.drawable(t, y), **looks)


def _rows_of(run):
    """Which rows a sheet needs, from the top: (function, height)."""
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


def sheet(runs_by_plant, label):
    """One variant: plants side by side, measured quantities one below the other; other repeats in pale colors."""
    plants = list(runs_by_plant)
    first = runs_by_plant[plants[0]][0]
    rows = _rows_of(first)
    height = sum(h for _, h in rows) + 0.34 * len(rows) + 0.75
    figure, axes = plt.subplots(
        len(rows),
        len(plants),
        figsize=(style.WIDTH_IN, height),
        dpi=style.DPI,
        squeeze=False,
        sharex=True,
        sharey="row",
        gridspec_kw={"height_ratios": [h for _, h in rows]},
    )
    # Set manually: tight_layout would draw everything again to find the same result.
    mean = (height - 0.75) / len(rows) - 0.34
    figure.subplots_adjust(
        left=0.7 / style.WIDTH_IN,
        right=1 - 1.75 / style.WIDTH_IN,
        top=1 - 0.27 / height,
        bottom=0.45 / height,
        hspace=0.36 / mean,
        wspace=0.05,
    )
    for column, plant in enumerate(plants):
        for row, (draw, _) in enumerate(rows):
            axis = axes[row][column]
            draw(axis, runs_by_plant[plant])
            run = runs_by_plant[plant][0]
            if run.window is not None:
                axis.axvspan(
                    run.window[0], min(run.window[1], run.run.time_range[1]), color=WINDOW, zorder=0, linewidth=0
                )
            if run.contact is not None:
                axis.axvline(run.contact, color=style.FAINT, linewidth=0.7, linestyle=(0, (4, 3)), zorder=1)
            if column > 0:
                axis.set_ylabel("")
        axes[0][column].set_title(f"{plant}: {axes[0][column].get_title(loc='left')}", loc="left")
        axes[-1][column].set_xlabel("time [s]")
        axes[-1][column].set_xlim(*first.run.time_range)
        if len(plants) > 2:  # narrow columns, whose last number would meet the next first one
            axes[-1][column].xaxis.set_major_locator(MaxNLocator(3, integer=True))
    for row in range(len(rows)):
        if getattr(axes[row][0], "from_zero", False):  # only now are all plots that share the axis drawn
            axes[row][0].set_ylim(0, None)
        shown = {}  # of all plants: arms show other things than simulations
        for axis in axes[row]:
            for handle, name in zip(*axis.get_legend_handles_labels()):
                shown.setdefault(name, handle)
        if shown:
            axes[row][-1].legend(shown.values(), shown.keys(), loc="upper left", bbox_to_anchor=(1.01, 1.0))
    return figure


def _arm_styles(run):
    return ["-", (0, (5, 1.5)), (0, (1, 1))][: max(1, len(run.forces))]


def _draw_force(axis, runs):
    run = runs[0]
    several = len(run.forces) > 1
    for force, looks in zip(run.forces, _arm_styles(run)):
        who = f", {force['arm']}" if several else ""
        _line(
            axis, force["t"], force["estimate"], color=ESTIMATE, linewidth=0.8, linestyle=looks, label=f"estimate{who}"
        )
        if not run.measured:
            _line(axis, force["t"], force["true"], color=TRUE, linewidth=1.0, linestyle=looks, label=f"true{who}")
        if force is run.forces[-1]:
            _line(
                axis, force["t"], force["desired"], color=DESIRED, linewidth=0.9, linestyle=(0, (4, 2)), label="desired"
            )
    axis.set_title("force")
    axis.set_ylabel("force [N]")


def _draw_force_error(axis, runs):
    limit = 0.1
    for number, run in enumerate(runs):
        for force, looks in zip(run.forces, _arm_styles(run)):
            error = force["true"] - force["desired"]
            _line(axis, force["t"], error, color=TRUE, alpha=1 if number == 0 else 0.25, linewidth=0.9, linestyle=looks)
            inside = run.inside(force["t"])
            if inside.any():
                limit = max(limit, 1.15 * float(np.nanmax(np.abs(error[inside]))))
    low, high = axis.get_ylim()
    old = getattr(axis.figure, "_force_error_limit", 0.0)
    axis.figure._force_error_limit = limit = max(limit, old)
    axis.set_ylim(-limit, limit)
    which = "estimated" if runs[0].measured else "true"
    axis.set_title(f"{which} minus desired force" + (", all repeats" if len(runs) > 1 else ""))
    axis.set_ylabel("error [N]")


def _draw_path_error(axis, runs):
    for number, run in enumerate(runs):
        t, error = run.path_errors
        columns = [0, 1] if run.measure["path"]["plane"] == "xy" else [0, 1, 2]
        _line(
            axis,
            t,
            1e3 * np.linalg.norm(error[:, columns], axis=1),
            color="#7b3fa0",
            alpha=1 if number == 0 else 0.25,
            linewidth=0.9,
        )
    axis.set_title(
        "distance from the moving set-point"
        + (", along the surface" if runs[0].measure["path"]["plane"] == "xy" else "")
    )
    axis.set_ylabel("path [mm]")
    axis.from_zero = True


def _draw_lift(axis, runs):
    run = runs[0]
    grasp = run.measure["grasp"]
    pose = run.object_pose(grasp["name"])
    target = run.target(grasp["instance"], grasp["input"])
    if pose is not None:
        _line(axis, pose[0], 1e3 * (pose[1][:, 2] - pose[1][0, 2]), color=TRUE, label=f"{grasp['name']}, up")
    else:  # the hands show what they carry
        for arm, looks in zip(run.arms, _arm_styles(run)):
            t, p, _ = run.pose(arm)
            _line(axis, t, 1e3 * (p[:, 2] - p[0, 2]), color=ESTIMATE, linestyle=looks, label=f"hand, {arm}, up")
    if target is not None:
        _line(
            axis,
            target[0],
            1e3 * (target[1][:, 2] - target[1][0, 2]),
            color=DESIRED,
            linewidth=0.9,
            linestyle=(0, (4, 2)),
            label="set-point, up",
        )
    axis.set_title("lift")
    axis.set_ylabel("height [mm]")


def _draw_tilt(axis, runs):
    for number, run in enumerate(runs):
        pose = run.object_pose(run.measure["grasp"]["name"])
        if pose is None:
            axis.text(0.5, 0.5, "not measured on arms", transform=axis.transAxes, ha="center", color=style.FAINT)
            break
        t, _, q = pose
        tilt = np.linalg.norm(metrics.rotation_error(np.repeat(q[:1], len(q), axis=0), q), axis=1)
        _line(axis, t, np.degrees(tilt), color="#7b3fa0", alpha=1 if number == 0 else 0.25, linewidth=0.9)
    axis.set_title("rotation of the object since the start")
    axis.set_ylabel("tilt [°]")
    axis.from_zero = True


def _draw_loss(axis, runs):
    for number, run in enumerate(runs):
        t, speed = run.speed(run.measure["loss"]["arm"])
        _line(axis, t, speed, color=TRUE, alpha=1 if number == 0 else 0.25, linewidth=0.9)
    axis.axvline(runs[0].measure["loss"]["at_s"], color=style.INTERVENTION, linewidth=0.9)
    axis.set_title("speed; the surface is removed at the line")
    axis.set_ylabel("speed [m/s]")
    axis.from_zero = True


def _draw_tanks(axis, runs):
    run, instance = runs[0], runs[0].main_instance
    for name, label, looks in (
        ("force_tank_j", "force tank", {"color": "#2e8b57"}),
        ("impedance_tank_j", "impedance tank", {"color": "#c0392b"}),
        ("stored_energy_j", "all stored", {"color": style.INK, "linewidth": 0.8, "linestyle": (0, (4, 2))}),
    ):
        found = run.output(instance, name)
        if found is not None:
            first = found[1][np.flatnonzero(np.isfinite(found[1]))[0]]
            _line(axis, found[0], found[1] - first, label=f"{label} ({first:.3g} J)", **looks)
    axis.set_title("energy since the start")
    axis.set_ylabel("change [J]")


def _draw_valves(axis, runs):
    run, instance = runs[0], runs[0].main_instance
    for name, label, shade in (
        ("gamma_f", "γ", "#7b3fa0"),
        ("alpha_f", "α force", "#2e8b57"),
        ("alpha_i", "α impedance", "#c0392b"),
        ("in_contact", "in contact", "#9aa5b1"),
    ):
        found = run.output(instance, name)
        if found is not None:
            values = found[1] if np.ndim(found[1]) == 1 else found[1][:, 0]
            _line(axis, found[0], values, color=shade, label=label, linewidth=0.9)
    axis.set_title("shaping and valves")
    axis.set_ylabel("[1]")
    axis.set_ylim(-1.08, 1.08)


def _draw_joint_positions(axis, runs):
    run = runs[0]
    arm = run.arms[0]
    t, q = run.state(arm, "q")
    target = metrics.joint_targets(run.run, arm)[0]
    for i in range(q.shape[1]):
        _line(axis, t, q[:, i], color=style.JOINTS[i], label=f"joint {i + 1}")
        _line(axis, target["t"], target["q_d"][:, i], color=style.JOINTS[i], linestyle=(0, (4, 2)), linewidth=0.8)
    axis.set_title("joint positions, set-points dashed")
    axis.set_ylabel("position [rad]")


def _draw_joint_errors(axis, runs):
    t, error, _ = runs[0].joint_errors(runs[0].arms[0])
    for i in range(error.shape[1]):
        _line(axis, t, 1e3 * error[:, i], color=style.JOINTS[i], linewidth=0.9)
    axis.set_title("set-point minus position")
    axis.set_ylabel("error [mrad]")


def _draw_position_errors(axis, runs):
    t, error = runs[0].position_errors(runs[0].arms[0])
    for i, name in enumerate("xyz"):
        _line(axis, t, 1e3 * error[:, i], color=style.AXES_XYZ[i], linewidth=0.9, label=name)
    axis.set_title("set-point minus end effector")
    axis.set_ylabel("error [mm]")


def _draw_torque_rate(axis, runs):
    run = runs[0]
    looks = _arm_styles(run)
    for arm, line in zip(run.arms, looks * 2):
        t = run.run.get(f"{arm}/command/t")
        requested = run.run.get(f"{arm}/command/tau_controllet") + run.run.get(f"{arm}/command/tau_feature")
        rate = np.abs(np.diff(requested, axis=0)).max(axis=1) / np.diff(t)
        rate[run.run.get(f"{arm}/command/owner")[1:] != run.run.get(f"{arm}/command/owner")[:-1]] = np.nan
        _line(axis, t[1:], rate, color="#5d6d7e", linewidth=0.7)
    axis.set_title("fastest joint torque before the limiter")
    axis.set_ylabel("[N m/s]")
    axis.from_zero = True


# All variants ---------------------------------------------------------------------------------------------------------


def paths(chosen, plants):
    """Paths in the window seen along z, with the set-point's; one panel each. chosen: [(variant, {plant: run})]."""
    chosen = [(v, runs) for v, runs in chosen if any(r.path_errors is not None for r in runs.values())]
    if not chosen:
        return None
    columns = min(4, len(chosen))
    rows = -(-len(chosen) // columns)
    size = style.WIDTH_IN / max(columns, 2.6)
    figure, axes = plt.subplots(
        rows,
        columns,
        figsize=(size * columns, rows * (size + 0.15) + 0.45),
        dpi=style.DPI,
        squeeze=False,
        sharex=True,
        sharey=True,
    )
    for axis in axes.flat[len(chosen) :]:
        axis.set_visible(False)
    for axis, (variant, runs) in zip(axes.flat, chosen):
        for number, (plant, run) in enumerate(runs.items()):
            path = run.measure["path"]
            target = run.target(path["instance"], path["input"])
            if number == 0 and target is not None:
                inside = run.inside(target[0])
                axis.plot(
                    1e3 * target[1][inside, 0],
                    1e3 * target[1][inside, 1],
                    color=DESIRED,
                    linewidth=0.9,
                    linestyle=(0, (4, 2)),
                    label="set-point",
                    zorder=3,
                )
            t, p, _ = run.pose(path["arm"])
            inside = run.inside(t)
            axis.plot(1e3 * p[inside, 0], 1e3 * p[inside, 1], color=color(plant, plants), linewidth=1.0, label=plant)
        axis.set_aspect("equal", adjustable="box")
        axis.set_title(variant["label"], fontsize=8)
    for column in range(columns):
        last = [axis for axis in axes[:, column] if axis.get_visible()][-1]
        last.tick_params(labelbottom=True)
        last.set_xlabel("x [mm]")
    for axis in axes[:, 0]:
        axis.set_ylabel("y [mm]")
    handles, labels = axes.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="lower center", ncol=len(labels), bbox_to_anchor=(0.5, 0.0))
    figure.tight_layout(rect=(0, 0.3 / figure.get_size_inches()[1], 1, 1))
    return figure
