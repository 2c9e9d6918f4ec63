#!/usr/bin/env python3
"""Makes report.html of a study from its study.json and table.csv: study_page.py FOLDER."""

import argparse
import csv
import json
import math
import pathlib
import statistics
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent))

import matplotlib.pyplot as plt  # noqa: E402  the path comes first

from report import page, style  # noqa: E402

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
    drawn, axes = plt.subplots(figsize=(7.6, 0.8 + 0.24 * len(names)), layout="constrained")
    for i, name in enumerate(names):
        found = values(groups[name], figure)
        axes.plot(found, [i] * len(found), ".", color="#1d4f91", alpha=0.35, markersize=5)
        if found:
            axes.plot(statistics.fmean(found), i, "|", color="#d9480f", markersize=12, markeredgewidth=2)
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()
    axes.set_xlabel(figure)
    drawn.savefig(path, dpi=style.DPI)
    plt.close(drawn)
    return path


def figure_table(groups, figures):
    rows = []
    for figure in figures:
        for name, members in groups.items():
            found = values(members, figure)
            if not found:
                continue
            spread = statistics.stdev(found) if len(found) > 1 else None
            cells = [min(found), statistics.fmean(found), max(found)]
            texts = [page.figures(value) for value in cells]
            rows.append([figure, name, str(len(found)), *texts, page.figures(spread) if spread is not None else None])
    head = ["figure", "choices", "runs", "lowest", "mean", "highest", "standard deviation"]
    note = []
    if len(rows) > MOST_ROWS:
        note = [page.absent(f"{len(rows) - MOST_ROWS} more rows: see table.csv")]
    return [
        page.details(f"Figures in numbers ({len(rows)} rows)", page.table(head, rows[:MOST_ROWS], range(2, 7))),
        *note,
    ]


def trouble(study, rows):
    parts = []
    for key, words in (("errors", "without a result"), ("faults", "with a fault")):
        entries = study[key]
        if entries:
            head = [*entries[0]]
            cells = [[str(value) for value in entry.values()] for entry in entries[:MOST_ROWS]]
            parts.append(page.details(f"{words} ({len(entries)})", page.table(head, cells)))
    return parts or [page.box(["Every run has a result, and none reports a fault."], fine=True)]


def make(folder):
    study, rows = load(folder)
    groups, figures = groups_of(rows), telling(rows)
    faulty = sum(not row["success"] for row in rows)
    machine = study["machine"] or {}
    tiles = [
        (f"{len(rows)} of {study['runs']}", "runs with a result", bool(study["errors"])),
        (str(faulty), "of them with a fault", bool(faulty)),
        (str(len(groups)), "combinations of choices", False),
        (f"{study['made']}", f"made now, in {study['elapsed_s']:.0f} s", False),
    ]
    facts = [
        ("File", study["file"]),
        ("Kind", study["kind"]),
        ("Program", f"{study['program']['version']}, sha256 {study['program']['sha256'][:16]}"),
        ("Machine of the first run", machine.get("processor", "–")),
        ("Other machines", "accepted: results may differ in the last bits" if study["any_machine"] else "refused"),
    ]
    libraries = [[name, digest] for name, digest in machine.get("libraries", {}).items()]
    summary = [
        page.tiles(tiles),
        page.facts(facts),
        page.details("Libraries of the first run", page.table(["library", "sha256"], libraries)),
        *trouble(study, rows),
    ]
    pictures = []
    if len(groups) > MOST_GROUPS:
        pictures.append(page.absent(f"{len(groups)} combinations are too many to draw; see table.csv"))
    else:
        for i, figure in enumerate(figures[:MOST_PICTURES]):
            path = picture(groups, figure, folder / f"figure_{i}.png")
            pictures.append(page.image(path, f"{figure}. A dot is a run, a bar the mean over the seeds."))
            path.unlink()
    if len(figures) > MOST_PICTURES:
        pictures.append(page.absent(f"{len(figures) - MOST_PICTURES} more figures: see the table below"))
    if not figures:
        pictures.append(page.absent("All runs have the same figures."))
    sections = [
        ("summary", "Summary", summary),
        ("figures", "Figures", pictures),
        ("numbers", "Numbers", figure_table(groups, figures)),
    ]
    lead = "Every combination of choices with every seed; each run computed on its own, to the bit."
    part = folder / "report.html.part"
    part.write_text(page.page(study["title"], lead, sections), encoding="utf-8")
    part.replace(folder / "report.html")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=pathlib.Path)
    make(parser.parse_args().folder)


if __name__ == "__main__":
    main()
