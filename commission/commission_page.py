#!/usr/bin/env python3
"""Makes commission.html and its plots from the state of a tour: each arm beside its virtual twin.

commission_page.py COMMISSION.json   writes commission.html next to it
"""

import json
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent))

import numpy as np
from matplotlib.lines import Line2D

from report import page, style

ARM, TWIN = "#1d4f91", "#d9480f"
# Figures common to arm and twin: key, text, factor, unit, reduction of a list.
COMPARED = (
    ("error_rad", "largest joint error at the end of the motion", 1e3, "mrad", max),
    ("friction_nm", "largest joint friction", 1, "N m", lambda values: max(map(abs, values))),
    ("error_m", "distance of the hand from its goal", 1e3, "mm", None),
    ("stop_s", "time to rest after a stop", 1, "s", None),
    ("stop_rad", "angle turned after a stop", 1e3, "mrad", None),
    ("torque_delay_s", "delay from command to measured torque", 1e3, "ms", None),
    ("noise_dq", "rms velocity noise, worst joint", 1e3, "mrad/s", max),
    ("noise_tau", "rms torque noise, worst joint", 1, "N m", max),
)


def measured(state, name):
    """All figures and curves of an arm, of all steps."""
    merged = {}
    for step in state["steps"].values():
        merged.update(step.get("measured", {}).get(name, {}))
    return merged


def arm_table(of_arm, of_twin):
    def figure(source):
        def cell(row):
            key, _, factor, _, reduce = row
            value = source.get(key)
            return None if value is None else page.figures(factor * (reduce(value) if reduce else value))

        return cell

    cells = {"": lambda row: row[1], "unit": lambda row: row[3], "arm": figure(of_arm), "virtual twin": figure(of_twin)}
    rows = [row for row in COMPARED if row[0] in of_arm]
    return page.columns(rows, cells) if rows else None


def joint_plot(of_arm, of_twin, path):
    joints = of_arm["joints"]
    figure, axes = style.sheet(2, len(joints), 4.2, 12, sharex=True, sharey="row", layout="constrained")
    for j, curve in enumerate(joints):
        for source, color, width in ((of_twin, TWIN, 2.2), (of_arm, ARM, 1.2)):
            if j < len(source.get("joints", [])):
                own = source["joints"][j]
                sign = 1 if own["way_rad"] >= 0 else -1
                t, q, tau = (np.array(own[key]) for key in ("t", "q", "tau"))
                axes[0, j].plot(t, 1e3 * sign * q, color=color, linewidth=width)
                axes[1, j].plot(t, sign * (tau - tau[0]), color=color, linewidth=width)
        axes[0, j].axhline(1e3 * abs(curve["way_rad"]), color=style.FAINT, linewidth=0.8, linestyle=":")
        axes[0, j].set_title(f"joint {j + 1}")
        axes[1, j].set_xlabel("s")
    axes[0, 0].set_ylabel("position [mrad]")
    axes[1, 0].set_ylabel("torque, change [N m]")
    return with_legend(figure, path)


def hand_plot(of_arm, of_twin, path):
    figure, (axes,) = style.sheet(1, 3, 2.9, 12, sharey=True, layout="constrained")
    for axis, name in zip(axes, "xyz"):
        for source, color, width in ((of_twin, TWIN, 2.2), (of_arm, ARM, 1.2)):
            if "hand" in source:
                axis.plot(source["hand"]["t"], 1e3 * np.array(source["hand"][name]), color=color, linewidth=width)
        axis.set(title=f"hand, world {name}", xlabel="s")
    axes[0].set_ylabel("from the start [mm]")
    return with_legend(figure, path)


def with_legend(figure, path):
    arm, twin = Line2D([], [], color=ARM, label="arm"), Line2D([], [], color=TWIN, linewidth=2.2, label="virtual twin")
    figure.legend(handles=[arm, twin], loc="outside upper right", ncols=2, fontsize=9)
    return style.save(figure, path)


def arm_section(state, arm, folder):
    name = arm["name"]
    of_arm, of_twin = measured(state, name), state.get("twin", {}).get(name, {})
    yield page.facts([("address", arm["address"]), ("model in the scene", arm["model"])])
    table = arm_table(of_arm, of_twin)
    yield table or page.absent("The tour ended before the arm's first motion.")
    if table and "joints" in of_arm:
        plant = "the plant of the scene" + (f" ('{state['twin_plant']}')" if "twin_plant" in state else "")
        caption = f"Each joint alone, out and back; the dotted line is the requested position. The twin is {plant}."
        yield page.image(joint_plot(of_arm, of_twin, folder / f"{name}_joints.png"), caption)
    if table and "hand" in of_arm:
        caption = "The hand along z, x and y of the world, each time out and back."
        yield page.image(hand_plot(of_arm, of_twin, folder / f"{name}_hand.png"), caption)


def base_section(state):
    def place(position, rpy):
        texts = [f"{1e3 * x:.2f}" for x in position], [f"{x:.3f}" for x in np.degrees(rpy)]
        return "[{}] mm, rpy [{}] degrees".format(*map(", ".join, texts))

    for name, base in state["steps"].get("bases", {}).get("measured", {}).items():
        found = place(base["position_m"], base["rpy_rad"])
        before = place(base["scene_position_m"], base["scene_rpy_rad"])
        yield page.facts([(f"base of '{name}', measured", found), ("previously in the scene", before)])
        rows = [[f"point {k + 1}", f"{1e3 * value:.2f}"] for k, value in enumerate(base["residual_m"])]
        yield page.table(["", "residual [mm]"], rows)


def limit(reading):
    return "" if reading["limit"] is None else f"{'≥' if reading['at_least'] else '≤'} {reading['limit']:g}"


READING = {
    "arm": lambda reading: reading["arm"],
    "quantity": lambda reading: reading["quantity"],
    "value": lambda reading: page.figures(reading["value"]),
    "limit": limit,
    "unit": lambda reading: reading["unit"],
}
STEP = {"step": lambda s: s["title"], "verdict": lambda s: s["verdict"], "at (UTC)": lambda s: s["at"]}


def step_section(state):
    steps = state["steps"].values()
    yield page.columns(steps, STEP, bad=lambda step: step["verdict"] == "no-go")
    for step in steps:
        readings = step["readings"]
        table = page.columns(readings, READING, bad=lambda reading: not reading["good"]) if readings else None
        yield page.details(step["title"], step["about"], table, page.box(step["notes"], fine=True))


def verdict(state):
    failed = [step for step in state["steps"].values() if step["verdict"] == "no-go"]
    ended = state.get("ended", {})
    if failed:
        last, words = failed[-1], {"found": "found", "expected": "expected", "remedy": "to do"}
        return page.box([f"{last['title']}: no-go", *(f"{word}: {last[key]}" for key, word in words.items())])
    if ended.get("verdict") == "go":
        return page.box(["All steps passed: go."], fine=True)
    return page.box([f"The tour ended before it was complete, at '{ended.get('step', '')}'."])


def make(path):
    state, arms = json.loads(path.read_text(encoding="utf-8")), []
    for arm in state["arms"]:
        arms.append((f"Arm '{arm['name']}' beside its twin", list(arm_section(state, arm, path.parent))))
    sections = [("Steps", verdict(state), list(step_section(state))), *arms, ("Bases", list(base_section(state)))]
    lead = ", ".join(f"{arm['name']} ({arm['address']})" for arm in state["arms"]) + f"; begun {state['begun']}"
    page.write(path.with_name("commission.html"), page.page(f"First hour: {state['scene']}", lead, sections))


if __name__ == "__main__":
    page.run(make, __doc__)
