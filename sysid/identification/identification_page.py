#!/usr/bin/env python3
"""The page of an identification: measured, predicted and residual torque, candidates, intervals.

identification_page.py DATA.json --out FOLDER   writes identification.html and its plots
"""

import argparse
import json
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))

import numpy as np

from report import page, style
from report.page import figures

GRAY = "#c3ccd6"
CONSTRAINED = {"yes": "", "hardly": "hardly constrained", "no": "unconstrained"}


def torque_picture(series):
    """Per joint: measured and predicted torque, and the residual."""
    joints, t = len(series["measured"]), series["t"]
    figure, axes = style.sheet(joints, 2, 1.25 * joints + 0.6, sharex=True)
    for j, (left, right) in enumerate(axes):
        measured, predicted, prior = (np.array(series[key][j]) for key in ("measured", "predicted", "prior"))
        left.plot(t, measured, color=style.INK, label="measured")
        left.plot(t, predicted, color=style.BLUE, label="identified")
        left.set_ylabel(f"joint{j + 1} [N m]")
        right.plot(t, prior - measured, color=GRAY, label="prior")
        right.plot(t, predicted - measured, color="#d9480f", label="identified")
    for top, bottom, title in zip(axes[0], axes[-1], ("torque", "model − measured")):
        top.set_title(title)
        top.legend(ncols=2)
        bottom.set_xlabel("time [s]")
    figure.tight_layout()
    return figure


def bars_picture(data):
    """RMSE per joint of all models."""
    models = {"identified": data["rmse_all"]["joints"]} | {m["name"]: m["joints"] for m in data["models_beside"]}
    figure, ((axes,),) = style.sheet()
    width, colors = 0.8 / len(models), [style.BLUE, style.STAGES[2], style.STAGES[3], *style.BANDS[3:], *style.BANDS]
    for k, (name, values) in enumerate(models.items()):
        x = np.arange(len(values)) + (k - (len(models) - 1) / 2) * width
        axes.bar(x, values, width, color=colors[k % len(colors)], label=f"{name}: mean {np.mean(values):.3f}")
    axes.set_xticks(range(len(values)), joint_names(values))
    axes.set_ylabel("RMSE [N m]")
    axes.legend()
    figure.tight_layout()
    return figure


def joint_names(values):
    return [f"joint{j + 1}" for j in range(len(values))]


def by_joint(rows, values):
    """Table columns with one figure per joint [N m]; values(row) returns them."""
    names = joint_names(values(rows[0]))
    return {name: lambda row, j=j: f"{values(row)[j]:.3f}" for j, name in enumerate(names)}


def worth(data):
    """Explains the expected error: unit, range of motion, and how well it was predicted on this file."""
    expected, motion = data["rmse_expected"], data["motion"]
    if not expected:
        return "No error is predicted for other motion: with a single candidate there is no cross-validation."
    per_joint = ", ".join(f"{v:.3f}" for v in expected["joints"])
    apart = [c["expected"]["mean"] / c["test"]["mean"] - 1 for c in data["cuts"] if c.get("expected")]
    repeated = ", ".join(figures(s) for s in motion["repeated_after_s"] if s > 0)
    ranges = [motion[key] for key in ("q_min_rad", "q_max_rad", "dq_max_rad_per_s")]
    rows = zip(joint_names(ranges[0]), *([f"{v:.2f}" for v in values] for values in ranges))
    return [
        f"{expected['mean']:.3f} N m is the expected RMSE of a joint's torque, filtered at 10 Hz, on other motion of "
        f"this arm within the ranges below (per joint {per_joint} N m). It comes from blocks that were left out of the "
        "fit, a third of the motion each. It does not hold for faster motion, other positions, another load or "
        "temperature, nor for contact.",
        f"Test on this file: fitted to a part of it, the same figure was {100 * min(apart):+.0f} % to "
        f"{100 * max(apart):+.0f} % off the error on the rest (table “Cut in time”)."
        if apart
        else None,
        f"The motion repeats after {repeated} s; all repetitions of a block are left out together."
        if repeated
        else None,
        page.table(" | from [rad] | to [rad] | fastest [rad/s]", rows),
    ]


def links(data):
    """Masses and centers of mass as written, marked by how well the torque determines them."""
    base = data["base_parameters"]
    alone, combined = set(base["identifiable_alone"]), set(base["identifiable_combined"])

    def cell(name, value):
        def shown(item):
            parameter = f"{item[0]} {name}"
            mark = "" if parameter in alone else " °" if parameter in combined else " ✗"
            return f"{value(item[1]):.4f}{mark}"

        return shown

    cells = {"link": lambda item: item[0], "mass [kg]": cell("m", lambda body: body["mass_kg"])}
    for k, axis in enumerate("xyz"):
        cells[f"{axis} [m]"] = cell(f"m{axis}", lambda body, k=k: body["com_m"][k])
    bodies = {n: body for n, body in data["parameters"].items() if n.startswith("link") and "mass_kg" in body}
    return [
        "No mark: the torque determines it (a center: its product with the mass). ° : it acts only in sums with other "
        "parameters, and the prior decides how the sum is divided; do not take it as the mass of the link. ✗ : no "
        "torque "
        "depends on it, and it is the prior's value.",
        page.columns(bodies.items(), cells),
    ]


def candidates(scores):
    cells = {
        "family": lambda s: (
            ("▶ " if s["chosen"] else "") + s["family"] + ("" if s["eligible"] else " (for comparison)")
        ),
        "coefficients": lambda s: s["coefficients"],
        "mean": lambda s: f"{s['mean']:.4f}",
        **by_joint(scores, lambda s: s["joints"]),
    }
    return [
        "RMSE [N m] on blocks that were left out of the fit. Such a fit has fewer data than the final one, so that its "
        "error is larger than the expected one.",
        page.columns(scores, cells),
    ]


def cuts(cuts):
    cells = {
        "fitted": lambda c: f"{100 * c['trained_from']:.0f}–{100 * c['trained_to']:.0f} %",
        "train": lambda c: f"{c['train']['mean']:.4f}",
        "test": lambda c: f"{c['test']['mean']:.4f}",
        "expected": lambda c: f"{c['expected']['mean']:.4f}" if c.get("expected") else "",
        **by_joint(cuts, lambda c: c["test"]["joints"]),
    }
    return [
        "RMSE [N m]. One part is fitted, and the rest is predicted as a separate file. Expected: the error on the "
        "rest, estimated from the fitted part alone.",
        page.columns(cuts, cells),
    ]


def parameters(base):
    cells = {
        "parameter": lambda v: v["name"],
        "value, no prior": lambda v: figures(v["value"], 4),
        "± 95 %": lambda v: figures(v["half95"], 2),
        "unit": lambda v: v["unit"],
        "": lambda v: CONSTRAINED[v["constrained"]],
    }
    hardly, loose = (sum(v["constrained"] == word for v in base["values"]) for word in ("hardly", "no"))
    return [
        f"{base['rank']} combinations of inertial parameters affect the torque. Condition number "
        f"{figures(base['condition_raw'])}; {figures(base['condition_scaled'])} with columns scaled to unit length. "
        f"Unidentifiable: {', '.join(base['unidentifiable'])}.",
        "These values come from unconstrained linear least squares, without prior and without bounds, so that their "
        "intervals are meaningful. A friction amplitude can be negative here. The model that was written comes from "
        "the constrained fit: all its amplitudes except offsets are at least 0, and every link is physically possible.",
        f"Of {len(base['values'])} figures {hardly} are hardly constrained by the data (± more than 30 %), and {loose} "
        "are unconstrained: their interval contains zero.",
        page.columns(base["values"], cells, bad=lambda v: v["constrained"] == "no"),
    ]


def make(data, out):
    tiles = {
        "expected on new motion [N m]": data["rmse_expected"]["mean"] if data["rmse_expected"] else None,
        "fitted to all [N m]": data["rmse_all"]["mean"],
        "first two thirds, fitted [N m]": data["rmse_train"],
        "last third, not fitted [N m]": data["rmse_heldout"],
    }
    shown = [(figures(value), name) for name, value in tiles.items() if value is not None]
    bars = style.save(bars_picture(data), out / "models.png")
    torques = [
        page.image(style.save(torque_picture(one), out / f"torque_{k}.png"), one["source"], "torque of every joint")
        for k, one in enumerate(data["series"])
    ]
    sections = [
        (
            "Quality of the model",
            page.tiles(*shown, ("yes" if data["consistent"] else "no", "physically possible")),
            page.box(data["warnings"]),
            worth(data),
        ),
        ("Comparison with other models", page.image(bars, "RMSE per joint and model")),
        ("Torque", *torques),
        ("Candidates", candidates(data["cross_validation"]) if data["cross_validation"] else None),
        ("Cut in time", cuts(data["cuts"]) if data["cuts"] else None),
        ("Links as written", links(data)),
        ("Identifiable parameters", parameters(data["base_parameters"])),
    ]
    lead = (
        f"{data['family']}, from {data['seconds']:.1f} s of data. RMSE over time in N m, filtered at 10 Hz; means are "
        "over joints."
    )
    page.write(out / "identification.html", page.page("Identification", lead, sections))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=pathlib.Path)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    words = parser.parse_args()
    make(json.loads(words.data.read_text()), words.out)


if __name__ == "__main__":
    main()
