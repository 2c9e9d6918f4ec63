#!/usr/bin/env python3
"""Makes report.html and its plots from the files of `refine`.

refine_page.py REFINE.json   writes report.html next to it
"""

import json
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))

from report import page, style
from sysid.comparison import plots

# Identified quantities of an arm: text and unit, by key.
FOUND = {
    "family": "friction model chosen",
    "seconds_used": "data used [s]",
    "rmse_mean": "residual torque, mean over joints [N m]",
    "consistent": "physically consistent",
    "dissipative": "friction dissipative",
    "delay_s": "command delay [ms]",
    "bandwidth_hz": "torque bandwidth [Hz]",
    "friction_scale": "scale of the friction table before the sensor",
    "motor_inertia_kg_m2": "additional motor inertia (0: no gain in cross-validation) [kg m²]",
    "torque_noise_nm": "noise of the torque sensor [N m]",
}


def verdict(change):
    if change["worse"]:
        return "WORSE"
    gain = change["before"] - change["after"]
    return "better" if change["ratio"] < 1 and gain > 2 * change["spread"] else "as before"


def change_table(before, after, changes):
    def value(key):
        return lambda q: plots.number(q[0], q[1], q[2][key])

    def known(key, absent=None):
        return lambda q: plots.number(q[0], q[1], q[1][key]) if q[1][key] else absent

    cells = {
        "RMSE, mean over joints or axes": lambda q: plots.symbol(q[0], q[1]),
        "before": value("before"),
        "after": value("after"),
        "after / before": lambda q: f"{q[2]['ratio']:.2f}",
        "spread over repeats": value("spread"),
        "noise at rest": known("noise_floor"),
        "largest in the paper": known("paper", "–"),
        "": lambda q: verdict(q[2]),
    }
    rows = [(name, before["quantities"][name], change) for name, change in changes.items()]
    missing = [f"{plots.SYMBOL[n]}: {e['missing']}" for n, e in after["quantities"].items() if not e["available"]]
    absent = page.absent("Not available: " + "; ".join(missing)) if missing else None
    return [page.columns(rows, cells, bad=lambda q: q[2]["worse"]), absent]


def shown(key, found):
    """A human-readable figure, with its 95 % interval if there is one."""
    value = found.get(key)
    if isinstance(value, bool):
        return "yes" if value else "NO"
    if isinstance(value, list):
        return ", ".join(map(page.figures, value)) or "none"
    if value is None or isinstance(value, str):
        return value
    scale, (name, _, unit) = 1e3 if key == "delay_s" else 1.0, key.rpartition("_")
    half = found.get(f"{name}_half95_{unit}")
    return page.figures(scale * value) + (f" ± {page.figures(scale * half, 2)} (95 %)" if half else "")


def model_table(models):
    """Figures of each arm's model, and residual torque per joint on fitted and held-out data."""
    found = {arm: model.get("found") or {} for arm, model in models.items()}
    keys = [key for key in FOUND if any(key in of for of in found.values())]
    rows = [[FOUND[key], *(shown(key, of) for of in found.values())] for key in keys]
    yield page.table(
        ["figure", *(arm or "arm" for arm in models)], [*rows, ["model file", *(m["file"] for m in models.values())]]
    )
    for arm, of in found.items():
        parts = {"on fitted data": of.get("rmse_train"), "on held-out data": of.get("rmse_heldout")}
        rows = [[words, *map(page.figures, values)] for words, values in parts.items() if values]
        if rows:
            joints = [f"joint {j}" for j in range(1, len(rows[0]))]
            yield page.table([f"{arm or 'arm'}: residual torque [N m]", *joints], rows)


def of_arm(arm, before, last, folder):
    picture = style.save(plots.before_after(before, last["after"][arm]), folder / f"before_after_{arm or 'arm'}.png")
    caption = (
        "Distance between simulation and target before (pale blue) and after (green) identification. RMSE, mean over "
        f"joints or axes; whiskers: spread over {before['repeats']} repeats; dashed: the largest value in the paper, "
        "if it is in range."
    )
    if before.get("low_pass_hz"):
        caption += f" Both sides filtered at {before['low_pass_hz']:g} Hz."
    return page.image(picture, caption), change_table(before, last["after"][arm], last["changes"][arm])


def of_rounds(refine, folder):
    """Sections of the arms, the rounds and the models."""
    last = refine["rounds"][-1]
    entries = [{"arms": refine["before"]}, *({"arms": r["after"]} for r in refine["rounds"])]
    picture = style.save(plots.rounds(entries), folder / "rounds.png")
    warnings = [f"{arm or 'arm'}: {w}" for arm, m in last["models"].items() for w in m.get("warnings") or []]
    for arm, before in refine["before"].items():
        yield f"Arm {arm}".strip(), *of_arm(arm, before, last, folder)
    caption = "The same figures after every round. Nominal: before any identification."
    yield "Round by round", page.image(picture, caption)
    more = page.details(f"Warnings ({len(warnings)})", page.box(warnings)) if warnings else None
    yield "Identified models", list(model_table(last["models"])), more


def make(path):
    refine = json.loads(path.read_text(encoding="utf-8"))
    rounds, worse = refine["rounds"], bool(refine.get("worse"))
    changes = {arm: rounds[-1]["changes"].get(arm, {}).get("F_EE") for arm in refine["before"] if rounds}
    force = [
        (f"× {change['ratio']:.2f}", f"F_EE after / before, {arm or 'arm'}", change["worse"])
        for arm, change in changes.items()
        if change
    ]
    facts = [
        ("Task", f"{refine['title']}{' (' + refine['variant_label'] + ')' if refine.get('variant_label') else ''}"),
        ("Target", refine["target"]),
        ("Simulation before", f"nominal model, plant {refine['plant']}"),
        ("Simulation after", "the same scene with the identified models (plant_model)"),
    ]
    tiles = page.tiles(
        ("worse for some quantities" if worse else "nothing worse", "verdict", worse),
        *force,
        (len(rounds), "rounds"),
        (refine["repeats"], "repeats"),
    )
    summary = ("Summary", tiles, page.box(refine.get("faults")), page.facts(facts))
    lead = "A task on the target and in simulation, before and after identification from the target's own logs."
    sections = [summary, *(of_rounds(refine, path.parent) if rounds else [])]
    page.write(path.with_name("report.html"), page.page(f"Refined: {refine['title']}", lead, sections))


if __name__ == "__main__":
    page.run(make, __doc__)
