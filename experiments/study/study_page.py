#!/usr/bin/env python3
"""Makes report.html of a study from its study.json and table.csv: study_page.py FOLDER."""

import csv
import json
import math
import pathlib
import statistics
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))

from report import page, style

MOST_PICTURES, MOST_GROUPS, MOST_ROWS = 24, 60, 400


def number(text):
    try:
        return float(text)
    except ValueError:
        return {"True": 1.0, "False": 0.0}.get(text, math.nan)


def load(folder):
    """(study, rows): rows with `group`, their combination of choices in words, and numbers by figure."""
    study = json.loads((folder / "study.json").read_text(encoding="utf-8"))
    labels = {axis["name"]: dict(axis["choices"]) for axis in study["axes"]}
    rows = []
    with open(folder / "table.csv", newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            choices = {name: row.pop(name) for name in labels}
            words = ", ".join(labels[name][choice] for name, choice in choices.items()) or "all runs"
            figures = {name: number(text) for name, text in row.items() if name not in ("seed", "success", "digest")}
            rows.append({"group": words, "seed": row["seed"], "success": row["success"] == "True", "figures": figures})
    return study, rows


def groups_of(rows):
    groups = {}
    for row in rows:
        groups.setdefault(row["group"], []).append(row)
    return groups


def values(rows, figure):
    found = [row["figures"].get(figure, math.nan) for row in rows]
    return [value for value in found if math.isfinite(value)]


def telling(rows):
    """Figures that are not the same in all runs, in the table's order."""
    names = dict.fromkeys(name for row in rows for name in row["figures"])
    return [name for name in names if len(set(values(rows, name))) > 1]


def picture(groups, figure, path):
    """A dot for each run over the combinations, and their means."""
    names = list(groups)
    drawn, ((axes,),) = style.sheet(height=0.8 + 0.24 * len(names), width=7.6, layout="constrained")
    for i, name in enumerate(names):
        found = values(groups[name], figure)
        axes.plot(found, [i] * len(found), ".", color=style.DARK_BLUE, alpha=0.35, markersize=5)
        if found:
            axes.plot(statistics.fmean(found), i, "|", color="#d9480f", markersize=12, markeredgewidth=2)
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()
    axes.set_xlabel(figure)
    return style.save(drawn, path)


def figure_table(groups, figures):
    rows = [(figure, name, values(members, figure)) for figure in figures for name, members in groups.items()]
    rows = [row for row in rows if row[2]]

    def value(reduce):
        return lambda row: page.figures(reduce(row[2]))

    cells = {
        "figure": lambda row: row[0],
        "choices": lambda row: row[1],
        "runs": lambda row: len(row[2]),
        "lowest": value(min),
        "mean": value(statistics.fmean),
        "highest": value(max),
        "standard deviation": lambda row: page.figures(statistics.stdev(row[2])) if len(row[2]) > 1 else None,
    }
    return [
        page.details(f"Figures in numbers ({len(rows)} rows)", page.columns(rows[:MOST_ROWS], cells)),
        page.absent(f"{len(rows) - MOST_ROWS} more rows: see table.csv") if len(rows) > MOST_ROWS else None,
    ]


def trouble(study):
    parts = []
    for key, words in (("errors", "without a result"), ("faults", "with a fault")):
        if entries := study[key]:
            cells = [[str(value) for value in entry.values()] for entry in entries[:MOST_ROWS]]
            parts.append(page.details(f"{words} ({len(entries)})", page.table([*entries[0]], cells)))
    return parts or page.box(["Every run has a result, and none reports a fault."], fine=True)


def pictures(groups, figures, folder):
    if not figures:
        yield page.absent("All runs have the same figures.")
    if len(groups) > MOST_GROUPS:
        yield page.absent(f"{len(groups)} combinations are too many to draw; see table.csv")
    else:
        for i, figure in enumerate(figures[:MOST_PICTURES]):
            path = picture(groups, figure, folder / f"figure_{i}.png")
            yield page.image(path, f"{figure}. A dot is a run, a bar the mean over the seeds.")
            path.unlink()
    if len(figures) > MOST_PICTURES:
        yield page.absent(f"{len(figures) - MOST_PICTURES} more figures: see the table below")


def make(folder):
    study, rows = load(folder)
    groups, figures, machine = groups_of(rows), telling(rows), study["machine"] or {}
    faulty, program = sum(not row["success"] for row in rows), study["program"]
    facts = [
        ("File", study["file"]),
        ("Kind", study["kind"]),
        ("Program", f"{program['version']}, sha256 {program['sha256'][:16]}"),
        ("Machine of the first run", machine.get("processor", "–")),
        ("Other machines", "accepted: results may differ in the last bits" if study["any_machine"] else "refused"),
    ]
    summary = [
        page.tiles(
            (f"{len(rows)} of {study['runs']}", "runs with a result", study["errors"]),
            (faulty, "of them with a fault", faulty),
            (len(groups), "combinations of choices"),
            (study["made"], f"made now, in {study['elapsed_s']:.0f} s"),
        ),
        page.facts(facts),
        page.details(
            "Libraries of the first run", page.table("library | sha256", machine.get("libraries", {}).items())
        ),
        trouble(study),
    ]
    sections = [
        ("Summary", summary),
        ("Figures", list(pictures(groups, figures, folder))),
        ("Numbers", figure_table(groups, figures)),
    ]
    lead = "Every combination of choices with every seed; each run computed on its own, bit for bit."
    page.write(folder / "report.html", page.page(study["title"], lead, sections))


if __name__ == "__main__":
    page.run(make, __doc__)
