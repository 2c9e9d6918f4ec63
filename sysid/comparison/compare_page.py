#!/usr/bin/env python3
"""Makes report.html and pictures of a comparison from results.json and series.npz in FOLDER.

compare_page.py FOLDER
"""

import argparse
import json
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent.parent))

import matplotlib.pyplot as plt  # noqa: E402  the path comes first
import numpy as np  # noqa: E402

from report import page, style  # noqa: E402
from sysid.comparison import plots  # noqa: E402


def save(figure, path):
    figure.savefig(path, dpi=style.DPI)
    plt.close(figure)
    return path


def number(name, entry, value):
    factor, label = plots.unit(name, entry)
    return f"{page.figures(factor * value)} {label}"


def table(arm):
    rows, bad = [], []
    for name, entry in arm["quantities"].items():
        what = page.Raw(f"<b>{page.escape(plots.SYMBOL[name])}</b> {page.escape(entry['what'])}")
        if not entry["available"]:
            rows.append(
                [
                    what,
                    page.Raw(f'<span class="missing">{page.escape(entry["missing"])}</span>'),
                    None,
                    None,
                    None,
                    None,
                ]
            )
            continue
        worst = int(np.argmax(entry["rmse"]))
        axis = entry["axes"][worst]
        rows.append(
            [
                what,
                number(name, entry, entry["rmse_mean"])
                + (
                    f" ± {page.figures(plots.unit(name, entry)[0] * entry['rmse_spread'], 2)}"
                    if arm["repeats"] > 1
                    else ""
                ),
                f"{number(name, entry, entry['rmse'][worst])} ({'joint ' if axis.isdigit() else ''}{axis})",
                number(name, entry, entry["max"]),
                number(name, entry, entry["noise_floor"]) if entry["noise_floor"] is not None else None,
                number(name, entry, entry["paper"]) if entry["paper"] else "–",
            ]
        )
    head = [
        "",
        "RMSE, mean over joints or axes",
        "RMSE of the worst",
        "largest error",
        "noise at rest",
        "largest in the paper",
    ]
    return page.table(head, rows, range(1, 6), bad)


def by_axis(arm):
    """RMSE of every joint and axis."""
    parts = []
    for name, entry in arm["quantities"].items():
        if not entry["available"]:
            continue
        factor, label = plots.unit(name, entry)
        head = [f"{plots.SYMBOL[name]} [{label}]", *entry["axes"]]
        rows = [
            ["RMSE", *(page.figures(factor * v) for v in entry["rmse"])],
            ["largest", *(page.figures(factor * v) for v in entry["max_by_axis"])],
        ]
        if entry.get("noise_by_axis"):
            rows.append(["noise at rest", *(page.figures(factor * v) for v in entry["noise_by_axis"])])
        parts.append(page.table(head, rows, range(1, len(head))))
    return page.Raw("".join(parts))


def alignment(arm):
    how = {"given": "as given", "start": "starting together", "timeline": "the scenes' timeline"}

    def milliseconds(value):
        return None if value is None else f"{1e3 * value:.2f} ms"

    rows = [
        [
            pair["real"],
            pair["sim"],
            milliseconds(pair["lag_s"]),
            how.get(pair["aligned_by"], f"correlation of {pair['aligned_by']}"),
            milliseconds(pair["measured_lag_s"]),
            f"{pair['correlation']:.4f}",
            f"{pair['from_s']:.2f} – {pair['to_s']:.2f} s",
        ]
        for pair in arm["pairs"]
    ]
    return page.table(
        ["real", "simulated", "shifted by", "aligned by", "lag by correlation", "correlation", "compared"],
        rows,
        (2, 4, 5),
    )


def gate(results):
    judged = [g for arm in results["arms"] for g in arm["gate"]]
    if not judged:
        return []
    broken = [g["text"] for g in judged if not g["held"]]
    return [page.box(broken) if broken else page.box([f"All {len(judged)} limits are held."], fine=True)]


def make(folder):
    results = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    series = np.load(folder / "series.npz")
    lags = [pair["measured_lag_s"] or 0.0 for arm in results["arms"] for pair in arm["pairs"]]
    judged = [g for arm in results["arms"] for g in arm["gate"]]
    tiles = [
        (str(len(results["arms"])), "arms", False),
        (str(results["arms"][0]["repeats"]), "repeats", False),
        (f"{1e3 * max(lags, key=abs):.1f} ms", "lag of the simulation by correlation, largest", False),
    ]
    if judged:
        held = sum(g["held"] for g in judged)
        tiles.insert(0, (f"{held} of {len(judged)}", "limits held", held < len(judged)))
    warnings = list(dict.fromkeys(w for arm in results["arms"] for w in arm["warnings"]))
    sections = [
        ("summary", "Summary", [page.tiles(tiles), *gate(results), *([page.box(warnings)] if warnings else [])])
    ]
    for i, arm in enumerate(results["arms"]):
        label = arm["arm"] or "arm"
        parts = [
            page.image(
                save(plots.bars(arm), folder / f"bars_{label}.png"),
                "RMSE of simulated minus real. Dark: mean over joints or axes, the paper's single figure per quantity. "
                "Dashed: the largest that the paper reports over its tasks 1 to 5."
                + (f" Both sides filtered at {arm['low_pass_hz']:g} Hz." if arm.get("low_pass_hz") else ""),
                f"RMSE per quantity of {label}",
            ),
            table(arm),
        ]
        parts.append(page.details("Every joint and axis", by_axis(arm)))
        t = series[f"{i}/t"][:, 0]
        for name, entry in arm["quantities"].items():
            if f"{i}/{name}/real" not in series:
                continue
            figure = plots.overlay(name, entry, t, series[f"{i}/{name}/real"], series[f"{i}/{name}/sim"])
            path = save(figure, folder / f"{name}_{label}.png")
            parts.append(page.image(path, f"{entry['what'].capitalize()} of the first repeat, after alignment."))
        parts += [
            page.Raw("<h3>Alignment</h3>"),
            alignment(arm),
            page.paragraph(
                "The simulation shows at t + lag what the real log shows at t. It is shifted by the lag before "
                "the errors "
                "are computed. "
                "Two runs of one timeline are compared as stamped; their lag by correlation shows how far one arm "
                "trails "
                "the other."
            ),
        ]
        sections.append((f"arm_{i}", f"Arm {label}" if arm["arm"] else "Arm", parts))
    text = page.page(
        "Simulation against measurement", f"{results['real']} (real) and {results['sim']} (simulated).", sections
    )
    part = folder / "report.html.part"
    part.write_text(text, encoding="utf-8")
    part.replace(folder / "report.html")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=pathlib.Path)
    make(parser.parse_args().folder)


if __name__ == "__main__":
    main()
