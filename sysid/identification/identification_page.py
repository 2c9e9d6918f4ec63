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
        ("fitted to all", data["rmse_all"]["mean"]),
        ("train", data["rmse_train"]),
        ("held out", data["rmse_heldout"]),
    ]
    parts.append(
        '<div class="tiles">'
        + "".join(f'<div class="tile"><b>{figures(value)}</b><span>{name}</span></div>' for name, value in tiles)
        + f'<div class="tile"><b>{"yes" if data["consistent"] else "no"}</b>'
        + "<span>physically possible</span></div></div>"
    )
    for warning in data["warnings"]:
        parts.append(f'<div class="box">{page.escape(warning)}</div>')
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
            "<h2>Candidates</h2><p>Each block of the data is predicted by a fit to the others.</p>"
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
        ]
        + [f"{v:.3f}" for v in c["test"]["joints"]]
        for c in data["cuts"]
    ]
    if rows:
        parts.append(
            "<h2>Cut in time</h2><p>One part is fitted, and the rest is predicted as a separate file.</p>"
            + page.table(
                ["fitted", "train", "test"] + [f"joint{j + 1}" for j in range(joints)],
                rows,
                numeric=range(1, joints + 3),
            )
        )
    base = data["base_parameters"]
    rows = [[v["name"], figures(v["value"], 4), figures(v["half95"], 2), v["unit"]] for v in base["values"]]
    parts.append(
        "<h2>Identifiable parameters</h2>"
        f"<p>{base['rank']} combinations of inertial parameters act on torque. Condition number "
        f"{figures(base['condition_raw'])}; {figures(base['condition_scaled'])} with columns scaled to unit length. "
        f"Unidentifiable: {page.escape(', '.join(base['unidentifiable']))}.</p>"
        "<p>These values come from <b>unconstrained</b> linear least squares, without prior and without bounds, so "
        "that "
        "their intervals are meaningful. A friction amplitude can be negative here. The model that was written comes "
        "from the constrained fit: all its amplitudes except offsets are at least 0, and every link is physically "
        "possible.</p>" + page.table(["parameter", "value, unconstrained", "± 95 %", "unit"], rows, numeric=(1, 2))
    )
    (out / "identification.html").write_text(
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>Identification</title>'
        f"<style>{page.CSS}</style></head><body>{''.join(parts)}</body></html>",
        encoding="utf-8",
    )


if __name__ == "__main__":
    main()
