#!/usr/bin/env python3
"""Makes commission.html and its plots from the state of a tour: each arm beside its virtual twin.

commission_page.py COMMISSION.json   writes commission.html next to it
"""

import argparse
import json
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent))

import matplotlib.pyplot as plt  # noqa: E402  the path comes first
import numpy as np  # noqa: E402

from report import page, style  # noqa: E402

ARM, TWIN = "#1d4f91", "#d9480f"
# Figures of an arm that its twin has, too: key, text, factor, unit, reduction of a list.
COMPARED = (
    ("error_rad", "joint error at the end of the way, worst", 1e3, "mrad", max),
    ("friction_nm", "friction, worst joint", 1, "N m", lambda values: max(map(abs, values))),
    ("error_m", "hand off its goal", 1e3, "mm", None),
    ("stop_s", "time to rest after a stop", 1, "s", None),
    ("stop_rad", "angle turned after a stop", 1e3, "mrad", None),
    ("torque_delay_s", "delay from command to measured torque", 1e3, "ms", None),
    ("noise_dq", "noise of a velocity, worst joint, rms", 1e3, "mrad/s", max),
    ("noise_tau", "noise of a torque, worst joint, rms", 1, "N m", max),
)


def save(figure, path):
    figure.savefig(path, dpi=style.DPI)
    plt.close(figure)
    return path


def measured(state, name):
    """All figures and curves of an arm, of all steps."""
    merged = {}
    for step in state["steps"].values():
        merged.update(step.get("measured", {}).get(name, {}))
    return merged


def arm_table(of_arm, of_twin):
    rows = []
    for key, text, factor, unit, reduce in COMPARED:
        if key not in of_arm:
            continue
        cells = []
        for source in (of_arm, of_twin):
            value = source.get(key)
            if value is not None and reduce is not None:
                value = reduce(value)
            cells.append(None if value is None else page.figures(factor * value))
        rows.append([text, unit, *cells])
    return page.table(["", "unit", "arm", "virtual twin"], rows, numeric=(2, 3)) if rows else None


def joint_plot(of_arm, of_twin, path):
    joints = of_arm["joints"]
    figure, axes = plt.subplots(2, len(joints), figsize=(12, 4.2), sharex=True, sharey="row", layout="constrained")
    axes = axes.reshape(2, -1)
    for j, curve in enumerate(joints):
        sign = 1 if curve["way_rad"] >= 0 else -1
        for source, color, width in ((of_twin, TWIN, 2.2), (of_arm, ARM, 1.2)):
            if len(source.get("joints", [])) <= j:
                continue
            mine = source["joints"][j]
            own = 1 if mine["way_rad"] >= 0 else -1
            t, q, tau = (np.array(mine[key]) for key in ("t", "q", "tau"))
            axes[0, j].plot(t, 1e3 * own * q, color=color, linewidth=width)
            axes[1, j].plot(t, own * (tau - tau[0]), color=color, linewidth=width)
        axes[0, j].axhline(1e3 * sign * curve["way_rad"], color=style.FAINT, linewidth=0.8, linestyle=":")
        axes[0, j].set_title(f"joint {j + 1}", fontsize=9)
        axes[1, j].set_xlabel("s")
        for row in axes:
            row[j].grid(color=style.GRID)
    axes[0, 0].set_ylabel("position [mrad]")
    axes[1, 0].set_ylabel("torque, change [N m]")
    legend(figure)
    return save(figure, path)


def hand_plot(of_arm, of_twin, path):
    figure, axes = plt.subplots(1, 3, figsize=(12, 2.9), sharey=True, layout="constrained")
    for axis, name in zip(axes, "xyz", strict=True):
        for source, color, width in ((of_twin, TWIN, 2.2), (of_arm, ARM, 1.2)):
            if "hand" in source:
                axis.plot(source["hand"]["t"], 1e3 * np.array(source["hand"][name]), color=color, linewidth=width)
        axis.set_title(f"hand, world {name}", fontsize=9)
        axis.set_xlabel("s")
        axis.grid(color=style.GRID)
    axes[0].set_ylabel("from the start [mm]")
    legend(figure)
    return save(figure, path)


def legend(figure):
    handles = [
        plt.Line2D([], [], color=ARM, label="arm"),
        plt.Line2D([], [], color=TWIN, linewidth=2.2, label="virtual twin"),
    ]
    figure.legend(handles=handles, loc="outside upper right", ncols=2, frameon=False, fontsize=9)


def arm_section(state, arm, folder):
    name = arm["name"]
    of_arm, of_twin = measured(state, name), state.get("twin", {}).get(name, {})
    parts = [page.facts([("address", arm["address"]), ("model in the scene", arm["model"])])]
    table = arm_table(of_arm, of_twin)
    if table is None:
        return [*parts, page.absent("The tour ended before the arm's first motion.")]
    parts.append(table)
    plain = "the plant of the scene" + (f" ('{state['twin_plant']}')" if "twin_plant" in state else "")
    if "joints" in of_arm:
        caption = f"Each joint alone, out and back; the dotted line is the requested place. The twin is {plain}."
        parts.append(page.image(joint_plot(of_arm, of_twin, folder / f"{name}_joints.png"), caption))
    if "hand" in of_arm:
        caption = "The hand along z, x and y of the world, each time back."
        parts.append(page.image(hand_plot(of_arm, of_twin, folder / f"{name}_hand.png"), caption))
    return parts


def base_section(state):
    bases = state["steps"].get("bases", {}).get("measured", {})
    parts = []
    for name, base in bases.items():

        def place(position, rpy):
            millimeters, degrees = 1e3 * np.array(position), np.degrees(rpy)
            return "[{:.2f}, {:.2f}, {:.2f}] mm, rpy [{:.3f}, {:.3f}, {:.3f}] degrees".format(*millimeters, *degrees)

        rows = [[f"point {k + 1}", f"{1e3 * value:.2f}"] for k, value in enumerate(base["residual_m"])]
        parts.append(
            page.facts(
                [
                    (f"base of '{name}', measured", place(base["position_m"], base["rpy_rad"])),
                    ("in the scene before", place(base["scene_position_m"], base["scene_rpy_rad"])),
                ]
            )
        )
        parts.append(page.table(["", "residual [mm]"], rows, numeric=(1,)))
    return parts


def step_section(state):
    rows, bad = [], []
    for step in state["steps"].values():
        if step["verdict"] == "no-go":
            bad.append(len(rows))
        rows.append([step["title"], step["verdict"], step["at"]])
    parts = [page.table(["step", "verdict", "at (UTC)"], rows, bad=bad)]
    for step in state["steps"].values():
        lines = []
        for reading in step["readings"]:
            limit = "" if reading["limit"] is None else f"{'≥' if reading['at_least'] else '≤'} {reading['limit']:g}"
            lines.append([reading["arm"], reading["quantity"], page.figures(reading["value"]), limit, reading["unit"]])
        wrong = [k for k, reading in enumerate(step["readings"]) if not reading["good"]]
        content = (
            page.table(["arm", "quantity", "value", "limit", "unit"], lines, numeric=(2, 3), bad=wrong)
            if lines
            else page.Raw("")
        )
        if step["notes"]:
            content = page.Raw(content + page.box(step["notes"], fine=True))
        parts.append(page.details(step["title"], page.Raw(page.paragraph(step["about"]) + content)))
    return parts


def make(state, folder):
    arms = ", ".join(f"{arm['name']} ({arm['address']})" for arm in state["arms"])
    failed = [step for step in state["steps"].values() if step["verdict"] == "no-go"]
    ended = state.get("ended", {})
    if failed:
        step = failed[-1]
        head = page.box(
            [
                f"{step['title']}: no-go",
                f"found: {step['found']}",
                f"expected: {step['expected']}",
                f"to do: {step['remedy']}",
            ]
        )
    elif ended.get("verdict") == "go":
        head = page.box(["All steps are done: go."], fine=True)
    else:
        head = page.box([f"The tour ended before it was complete, at '{ended.get('step', '')}'."])
    sections = [("steps", "Steps", [head, *step_section(state)])]
    sections += [
        (f"arm_{arm['name']}", f"Arm '{arm['name']}' beside its twin", arm_section(state, arm, folder))
        for arm in state["arms"]
    ]
    bases = base_section(state)
    if bases:
        sections.append(("bases", "Bases", bases))
    return page.page(f"First hour: {state['scene']}", f"{arms}; begun {state['begun']}", sections)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("state", type=pathlib.Path)
    path = parser.parse_args().state
    (path.parent / "commission.html").write_text(make(json.loads(path.read_text()), path.parent), encoding="utf-8")


if __name__ == "__main__":
    main()
