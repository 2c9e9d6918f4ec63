#!/usr/bin/env python3
"""Makes report.html and pictures of a comparison from results.json and series.npz in FOLDER.

compare_page.py FOLDER
"""

import json
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))

import numpy as np

from report import page, style
from sysid.comparison import plots
from sysid.comparison.plots import number, symbol

ALIGNED = {"given": "as given", "start": "starting together", "timeline": "the scenes' timeline"}


def table(arm):
    def value(shown):
        return lambda q: shown(*q) if q[1]["available"] else None

    def mean(name, entry):
        if not entry["available"]:
            return page.Raw(f'<span class="missing">{page.escape(entry["missing"])}</span>')
        spread = (
            f" ± {page.figures(plots.unit(name, entry)[0] * entry['rmse_spread'], 2)}" if arm["repeats"] > 1 else ""
        )
        return number(name, entry, entry["rmse_mean"]) + spread

    def worst(name, entry):
        k = int(np.argmax(entry["rmse"]))
        return f"{number(name, entry, entry['rmse'][k])} ({plots.axis_name(entry['axes'][k])})"

    def noise(name, entry):
        return number(name, entry, entry["noise_floor"]) if entry["noise_floor"] is not None else None

    cells = {
        "": lambda q: symbol(*q),
        "RMSE, mean over joints or axes": lambda q: mean(*q),
        "RMSE of the worst": value(worst),
        "largest error": value(lambda name, entry: number(name, entry, entry["max"])),
        "noise at rest": value(noise),
        "largest in the paper": value(
            lambda name, entry: number(name, entry, entry["paper"]) if entry["paper"] else "–"
        ),
    }
    return page.columns(arm["quantities"].items(), cells)


def by_axis(arm):
    """RMSE of every joint and axis."""
    for name, entry in arm["quantities"].items():
        if entry["available"]:
            factor, label = plots.unit(name, entry)
            rows = {"RMSE": entry["rmse"], "largest": entry["max_by_axis"], "noise at rest": entry.get("noise_by_axis")}
            head = [f"{plots.SYMBOL[name]} [{label}]", *entry["axes"]]
            yield page.table(head, [[what, *(page.figures(factor * v) for v in of)] for what, of in rows.items() if of])


def alignment(arm):
    def milliseconds(key):
        return lambda pair: None if pair[key] is None else f"{1e3 * pair[key]:.2f} ms"

    cells = {
        "real": lambda pair: pair["real"],
        "simulated": lambda pair: pair["sim"],
        "shifted by": milliseconds("lag_s"),
        "aligned by": lambda pair: ALIGNED.get(pair["aligned_by"], f"correlation of {pair['aligned_by']}"),
        "lag by correlation": milliseconds("measured_lag_s"),
        "correlation": lambda pair: f"{pair['correlation']:.4f}",
        "compared": lambda pair: f"{pair['from_s']:.2f} – {pair['to_s']:.2f} s",
    }
    return [
        page.heading("Alignment"),
        page.columns(arm["pairs"], cells),
        "The simulation shows at t + lag what the real log shows at t. It is shifted by the lag before the errors are "
        "computed. Two runs of one timeline are compared by their time stamps; the lag by correlation shows how far "
        "one arm trails the other.",
    ]


def of_arm(i, arm, series, folder):
    label = arm["arm"] or "arm"
    caption = (
        "RMSE of simulated minus real. Dark: mean over joints or axes, the paper's single figure per quantity. Dashed: "
        "the largest that the paper reports over its tasks 1 to 5."
    )
    if arm.get("low_pass_hz"):
        caption += f" Both sides filtered at {arm['low_pass_hz']:g} Hz."
    bars = style.save(plots.bars(arm), folder / f"bars_{label}.png")
    yield page.image(bars, caption, f"RMSE per quantity of {label}")
    yield table(arm)
    yield page.details("Every joint and axis", list(by_axis(arm)))
    for name, entry in arm["quantities"].items():
        if f"{i}/{name}/real" in series:
            t, real, sim = (series[f"{i}/{of}"] for of in ("t", f"{name}/real", f"{name}/sim"))
            path = style.save(plots.overlay(name, entry, t[:, 0], real, sim), folder / f"{name}_{label}.png")
            yield page.image(path, f"{entry['what'].capitalize()} of the first repeat, after alignment.")
    yield alignment(arm)


def make(folder):
    results = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    series, arms = np.load(folder / "series.npz"), results["arms"]
    lags = [pair["measured_lag_s"] or 0.0 for arm in arms for pair in arm["pairs"]]
    judged = [g for arm in arms for g in arm["gate"]]
    broken = [g["text"] for g in judged if not g["held"]]
    held = [f"All {len(judged)} limits are met."] if judged else []
    limits = f"{len(judged) - len(broken)} of {len(judged)}"
    summary = (
        "Summary",
        page.tiles(
            *([(limits, "limits held", broken)] if judged else []),
            (len(arms), "arms"),
            (arms[0]["repeats"], "repeats"),
            (f"{1e3 * max(lags, key=abs):.1f} ms", "largest lag of the simulation by correlation"),
        ),
        page.box(broken or held, fine=not broken),
        page.box(list(dict.fromkeys(w for arm in arms for w in arm["warnings"]))),
    )
    sections = [(f"Arm {arm['arm']}".strip(), *of_arm(i, arm, series, folder)) for i, arm in enumerate(arms)]
    lead = f"{results['real']} (real) and {results['sim']} (simulated)."
    page.write(folder / "report.html", page.page("Simulation against measurement", lead, [summary, *sections]))


if __name__ == "__main__":
    page.run(make, __doc__)
