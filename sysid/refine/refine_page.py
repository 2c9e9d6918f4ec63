#!/usr/bin/env python3
"""Makes report.html and its plots from the files of `refine`.

refine_page.py REFINE.json   writes report.html next to it
"""

import argparse
import json
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent.parent))

import matplotlib.pyplot as plt  # noqa: E402  the path comes first

from report import page, style  # noqa: E402
from sysid.comparison import plots  # noqa: E402

# Identified figures of an arm: key, text, unit.
FOUND = (
    ("family", "friction model chosen", ""),
    ("seconds_used", "data used", "s"),
    ("rmse_mean", "residual torque, mean over joints", "N m"),
    ("consistent", "physically consistent", ""),
    ("dissipative", "friction dissipative", ""),
    ("delay_s", "command delay", "ms"),
    ("bandwidth_hz", "torque bandwidth", "Hz"),
    ("friction_scale", "friction before the sensor, times the table", ""),
    ("motor_inertia_kg_m2", "inertia that the motors add (0: no gain in cross-validation)", "kg m²"),
    ("torque_noise_nm", "noise of the torque sensor", "N m"),
)


def save(figure, path):
    figure.savefig(path, dpi=style.DPI)
    plt.close(figure)
    return path


def number(name, entry, value):
    factor, label = plots.unit(name, entry)
    return f"{page.figures(factor * value)} {label}"


def change_table(before, after, changes):
    rows, bad = [], []
    for name, change in changes.items():
        entry = before["quantities"][name]
        if change["worse"]:
            bad.append(len(rows))
        floor = entry["noise_floor"]
        rows.append(
            [
                page.Raw(f"<b>{page.escape(plots.SYMBOL[name])}</b> {page.escape(entry['what'])}"),
                number(name, entry, change["before"]),
                number(name, entry, change["after"]),
                f"{change['ratio']:.2f}",
                number(name, entry, change["spread"]),
                number(name, entry, floor) if floor is not None else None,
                number(name, entry, entry["paper"]) if entry["paper"] else "–",
                "WORSE"
                if change["worse"]
                else "better"
                if change["ratio"] < 1 and change["before"] - change["after"] > 2 * change["spread"]
                else "as before",
            ]
        )
    missing = [f"{plots.SYMBOL[n]}: {e['missing']}" for n, e in after["quantities"].items() if not e["available"]]
    head = [
        "RMSE, mean over joints or axes",
        "before",
        "after",
        "after / before",
        "spread over repeats",
        "noise at rest",
        "largest in the paper",
        "",
    ]
    return [
        page.table(head, rows, range(1, 7), bad),
        *([page.absent("Not available: " + "; ".join(missing))] if missing else []),
    ]


def shown(key, value, found):
    """A human-readable figure, with its 95 % interval if there is one."""
    if value is None:
        return None
    if isinstance(value, bool):
        return "yes" if value else "NO"
    if isinstance(value, list):
        return ", ".join(page.figures(v) for v in value) or "none"
    if isinstance(value, str):
        return value
    scale = 1e3 if key == "delay_s" else 1.0
    half = found.get(key.rsplit("_", 1)[0] + "_half95_" + key.rsplit("_", 1)[1]) if "_" in key else None
    return page.figures(scale * value) + (f" ± {page.figures(scale * half, 2)} (95 %)" if half else "")


def model_table(models):
    arms = list(models)
    rows = []
    for key, words, unit in FOUND:
        values = [(models[arm].get("found") or {}) for arm in arms]
        if not any(key in v for v in values):
            continue
        rows.append([words + (f" [{unit}]" if unit else ""), *(shown(key, v.get(key), v) for v in values)])
    rows.append(["model file", *(models[arm]["file"] for arm in arms)])
    return page.table(["figure", *(arm or "arm" for arm in arms)], rows)


def torque_rows(models):
    """Residual torque per joint, in training and on held-out data."""
    parts = []
    for arm, model in models.items():
        found = model.get("found") or {}
        rows = [
            [words, *(page.figures(v) for v in found[key])]
            for key, words in (("rmse_train", "on fitted data"), ("rmse_heldout", "on held-out data"))
            if found.get(key)
        ]
        if rows:
            count = len(rows[0]) - 1
            parts.append(
                page.table(
                    [f"{arm or 'arm'}: residual torque [N m]", *(f"joint {j + 1}" for j in range(count))],
                    rows,
                    range(1, count + 1),
                )
            )
    return parts


def make(path):
    folder = path.parent
    refine = json.loads(path.read_text(encoding="utf-8"))
    rounds = refine["rounds"]
    arms = list(refine["before"])
    force = []
    if rounds:
        for arm in arms:
            change = rounds[-1]["changes"].get(arm, {}).get("F_EE")
            if change:
                force.append((f"× {change['ratio']:.2f}", f"F_EE after / before, {arm or 'arm'}", change["worse"]))
    tiles = [
        ("worse in places" if refine.get("worse") else "nothing worse", "verdict", bool(refine.get("worse"))),
        *force,
        (str(len(rounds)), "rounds", False),
        (str(refine["repeats"]), "repeats", False),
    ]
    parts = [page.tiles(tiles)]
    if refine.get("faults"):
        parts.append(page.box(refine["faults"]))
    facts = [
        ("Task", f"{refine['title']}{' (' + refine['variant_label'] + ')' if refine.get('variant_label') else ''}"),
        ("Target", refine["target"]),
        ("Simulation before", f"nominal model, plant {refine['plant']}"),
        ("Simulation after", "the same scene with the identified models (plant_model)"),
    ]
    parts.append(page.facts(facts))
    sections = [("summary", "Summary", parts)]
    for i, arm in enumerate(arms):
        if not rounds:
            continue
        before, after = refine["before"][arm], rounds[-1]["after"][arm]
        low_pass = before.get("low_pass_hz")
        picture = save(plots.before_after(before, after), folder / f"before_after_{arm or 'arm'}.png")
        sections.append(
            (
                f"arm_{i}",
                f"Arm {arm}" if arm else "Arm",
                [
                    page.image(
                        picture,
                        "Distance between simulation and target before (pale blue) and after (green) identification. "
                        "RMSE, "
                        "mean over joints or axes; whiskers: "
                        f"spread over {before['repeats']} repeats; dashed: the largest value in the paper, if it "
                        "is in range." + (f" Both sides filtered at {low_pass:g} Hz." if low_pass else ""),
                    ),
                    *change_table(before, after, rounds[-1]["changes"][arm]),
                ],
            )
        )
    if rounds:
        entries = [{"arms": refine["before"]}, *({"arms": r["after"]} for r in rounds)]
        picture = save(plots.rounds(entries), folder / "rounds.png")
        sections.append(
            (
                "rounds",
                "Round by round",
                [page.image(picture, "The same figures after every round. Nominal: before any identification.")],
            )
        )
        found = [model_table(rounds[-1]["models"]), *torque_rows(rounds[-1]["models"])]
        warnings = [
            f"{arm or 'arm'}: {w}"
            for r in rounds[-1:]
            for arm, m in r["models"].items()
            for w in m.get("warnings") or []
        ]
        if warnings:
            found.append(page.details(f"Warnings ({len(warnings)})", page.box(warnings)))
        sections.append(("models", "Identified models", found))
    text = page.page(
        f"Refined: {refine['title']}",
        "A task on the target and in simulation, before and after identification from the target's own logs.",
        sections,
    )
    part = folder / "report.html.part"
    part.write_text(text, encoding="utf-8")
    part.replace(folder / "report.html")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("json", type=pathlib.Path)
    make(parser.parse_args().json)


if __name__ == "__main__":
    main()
