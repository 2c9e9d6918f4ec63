"""The page of an identification: measured, predicted and residual torque, candidates, intervals."""

import argparse
import json
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
import matplotlib.pyplot as plt  # noqa: E402

from report import page, style  # noqa: E402  (style sets matplotlib up)


def torque_picture(series, file):
    """Per joint: measured and predicted torque, and the residual."""
    joints = len(series["measured"])
    figure, axes = plt.subplots(joints, 2, figsize=(style.WIDTH_IN, 1.25 * joints + 0.6), sharex=True, squeeze=False)
    for j in range(joints):
        measured, predicted, prior = (series[key][j] for key in ("measured", "predicted", "prior"))
        left, right = axes[j]
        left.plot(series["t"], measured, color=style.INK, label="measured")
        left.plot(series["t"], predicted, color="#4477aa", label="identified")
        left.set_ylabel(f"joint{j + 1} [N m]")
        right.plot(series["t"], [p - m for p, m in zip(prior, measured)], color="#c3ccd6", label="prior")
        right.plot(series["t"], [p - m for p, m in zip(predicted, measured)], color="#d9480f", label="identified")
    axes[0][0].set_title("torque"), axes[0][1].set_title("model − measured")
    axes[0][0].legend(ncols=2), axes[0][1].legend(ncols=2)
    axes[-1][0].set_xlabel("time [s]"), axes[-1][1].set_xlabel("time [s]")
    figure.tight_layout()
    figure.savefig(file, dpi=style.DPI)
    plt.close(figure)


def bars_picture(data, file):
    """RMSE per joint of all models."""
    models = [("identified", data["rmse_all"]["joints"])] + [(m["name"], m["joints"]) for m in data["models_beside"]]
    joints = len(models[0][1])
    figure, axes = plt.subplots(figsize=(style.WIDTH_IN, 2.8))
    width = 0.8 / len(models)
    for k, (name, values) in enumerate(models):
        axes.bar(
            [j + (k - (len(models) - 1) / 2) * width for j in range(joints)],
            values,
            width,
            color="#4477aa" if k == 0 else style.STAGES[(k + 1) % len(style.STAGES)] if k < 3 else style.BANDS[k % 8],
            label=f"{name}: mean {sum(values) / joints:.3f}",
        )
    axes.set_xticks(range(joints), [f"joint{j + 1}" for j in range(joints)])
    axes.set_ylabel("RMSE [N m]")
    axes.legend()
    figure.tight_layout()
    figure.savefig(file, dpi=style.DPI)
    plt.close(figure)


def worth(data):
    """What the expected error means: its unit, its motion, how well it was predicted on this file."""
    expected, motion = data["rmse_expected"], data["motion"]
    if not expected:
        return "<p>No figure for new motion: one candidate was given, so that nothing was validated.</p>"
    per_joint = ", ".join(f"{v:.3f}" for v in expected["joints"])
    text = (
        f"<p><b>{expected['mean']:.3f} N m</b> is the expected RMSE of a joint's torque, filtered at 10 Hz, on "
        f"<b>other</b> motion of this arm within the ranges below (per joint {per_joint} N m). It comes from "
        "blocks that were left out of the fit, a third of the motion each. It does not hold for faster motion, other "
        "positions, another load or temperature, nor for contact.</p>"
    )
    known = [c for c in data["cuts"] if c.get("expected")]
    if known:
        apart = [c["expected"]["mean"] / c["test"]["mean"] - 1 for c in known]
        text += (
            f"<p>Tried on this file: fitted to a part of it, the same figure was {100 * min(apart):+.0f} % to "
            f"{100 * max(apart):+.0f} % off the error on the rest (table &ldquo;Cut in time&rdquo;).</p>"
        )
    repeated = [s for s in motion["repeated_after_s"] if s > 0]
    if repeated:
        text += (
            f"<p>The motion repeats itself after {figures_of(repeated)} s; repetitions are left out together, so that "
            "no block was seen before.</p>"
        )
    rows = [
        [f"joint{j + 1}", f"{low:.2f}", f"{high:.2f}", f"{fast:.2f}"]
        for j, (low, high, fast) in enumerate(
            zip(motion["q_min_rad"], motion["q_max_rad"], motion["dq_max_rad_per_s"], strict=True)
        )
    ]
    return text + page.table(["", "from [rad]", "to [rad]", "fastest [rad/s]"], rows, numeric=(1, 2, 3))


def figures_of(values):
    return ", ".join(page.figures(v) for v in values)


def links_table(data):
    """Masses and centers as written, marked by what the torque tells of them."""
    base = data["base_parameters"]
    alone, combined = set(base["identifiable_alone"]), set(base["identifiable_combined"])

    def cell(link, name, value):
        mark = "" if f"{link} {name}" in alone else " °" if f"{link} {name}" in combined else " ✗"
        return f"{value:.4f}{mark}"

    rows = [
        [link]
        + [cell(link, "m", body["mass_kg"])]
        + [cell(link, f"m{axis}", value) for axis, value in zip("xyz", body["com_m"], strict=True)]
        for link, body in data["parameters"].items()
        if link.startswith("link") and "mass_kg" in body
    ]
    return (
        "<h2>Links as written</h2><p>No mark: the torque determines it (a center: its product with the mass). "
        "° : it acts only in sums with other parameters, and the prior decides how such a sum is divided; do not "
        "read it as a weight. ✗ : no torque depends on it, and it is the prior's value.</p>"
        + page.table(["link", "mass [kg]", "x [m]", "y [m]", "z [m]"], rows, numeric=(1, 2, 3, 4))
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data")
    parser.add_argument("--out", required=True)
    words = parser.parse_args()
    data = json.loads(pathlib.Path(words.data).read_text())
    out = pathlib.Path(words.out)
    figures = page.figures
    parts = [
        "<h1>Identification</h1>",
        f'<p class="lead">{page.escape(data["family"])}, from {data["seconds"]:.1f} s of data. '
        "RMSE over time in N m, filtered at 10 Hz; means are over joints.</p>",
    ]
    tiles = [
        ("expected on new motion [N m]", data["rmse_expected"]["mean"] if data["rmse_expected"] else None),
        ("fitted to all [N m]", data["rmse_all"]["mean"]),
        ("first two thirds, fitted [N m]", data["rmse_train"]),
        ("last third, not fitted [N m]", data["rmse_heldout"]),
    ]
    parts.append(
        '<div class="tiles">'
        + "".join(
            f'<div class="tile"><b>{figures(value)}</b><span>{name}</span></div>'
            for name, value in tiles
            if value is not None
        )
        + f'<div class="tile"><b>{"yes" if data["consistent"] else "no"}</b>'
        + "<span>physically possible</span></div></div>"
    )
    for warning in data["warnings"]:
        parts.append(f'<div class="box">{page.escape(warning)}</div>')
    parts.append("<h2>What the model is worth</h2>" + worth(data))
    bars_picture(data, out / "models.png")
    parts.append(
        '<h2>Comparison with other models</h2><figure><img src="models.png" alt="RMSE per joint and model"></figure>'
    )
    for k, series in enumerate(data["series"]):
        torque_picture(series, out / f"torque_{k}.png")
        parts.append(
            f'<h2>Torque</h2><figure><img src="torque_{k}.png" alt="torque of every joint">'
            f"<figcaption>{page.escape(series['source'])}</figcaption></figure>"
        )
    scores = data["cross_validation"]
    joints = len(data["rmse_all"]["joints"])
    if scores:
        rows = [
            [
                ("▶ " if s["chosen"] else "") + s["family"] + ("" if s["eligible"] else " (for comparison)"),
                str(s["coefficients"]),
                f"{s['mean']:.4f}",
            ]
            + [f"{v:.3f}" for v in s["joints"]]
            for s in scores
        ]
        parts.append(
            "<h2>Candidates</h2><p>RMSE [N m] on blocks that were left out of the fit. Such a fit has fewer data than "
            "the final one, so that its error is larger than the expected one.</p>"
            + page.table(
                ["family", "coefficients", "mean"] + [f"joint{j + 1}" for j in range(joints)],
                rows,
                numeric=range(1, joints + 3),
            )
        )
    rows = [
        [
            f"{100 * c['trained_from']:.0f}–{100 * c['trained_to']:.0f} %",
            f"{c['train']['mean']:.4f}",
            f"{c['test']['mean']:.4f}",
            f"{c['expected']['mean']:.4f}" if c.get("expected") else "",
        ]
        + [f"{v:.3f}" for v in c["test"]["joints"]]
        for c in data["cuts"]
    ]
    if rows:
        parts.append(
            "<h2>Cut in time</h2><p>RMSE [N m]. One part is fitted, and the rest is predicted as a separate file. "
            "Expected: the error on the rest, estimated from the fitted part alone.</p>"
            + page.table(
                ["fitted", "train", "test", "expected"] + [f"joint{j + 1}" for j in range(joints)],
                rows,
                numeric=range(1, joints + 4),
            )
        )
    base = data["base_parameters"]
    marks = {"yes": "", "hardly": "hardly constrained", "no": "unconstrained"}
    rows = [
        [v["name"], figures(v["value"], 4), figures(v["half95"], 2), v["unit"], marks[v["constrained"]]]
        for v in base["values"]
    ]
    parts.append(links_table(data))
    loose = [sum(v["constrained"] == word for v in base["values"]) for word in ("hardly", "no")]
    parts.append(
        "<h2>Identifiable parameters</h2>"
        f"<p>{base['rank']} combinations of inertial parameters act on torque. Condition number "
        f"{figures(base['condition_raw'])}; {figures(base['condition_scaled'])} with columns scaled to unit length. "
        f"Unidentifiable: {page.escape(', '.join(base['unidentifiable']))}.</p>"
        "<p>These values come from <b>unconstrained</b> linear least squares, without prior and without bounds, so "
        "that "
        "their intervals are meaningful. A friction amplitude can be negative here. The model that was written comes "
        "from the constrained fit: all its amplitudes except offsets are at least 0, and every link is physically "
        f"possible.</p><p>Of {len(rows)} figures {loose[0]} are hardly constrained by the data (± more than 30 %), and "
        f"{loose[1]} are unconstrained: their interval contains zero.</p>"
        + page.table(
            ["parameter", "value, no prior", "± 95 %", "unit", ""],
            rows,
            numeric=(1, 2),
            bad=[i for i, v in enumerate(base["values"]) if v["constrained"] == "no"],
        )
    )
    (out / "identification.html").write_text(
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>Identification</title>'
        f"<style>{page.CSS}</style></head><body>{''.join(parts)}</body></html>",
        encoding="utf-8",
    )


if __name__ == "__main__":
    main()
