"""The page of a task: figures of all runs, verdicts, pictures."""

import concurrent.futures
import multiprocessing
import os
import pathlib

import numpy as np

from experiments.pages import beside, frame, task_metrics, task_plots, verdicts
from experiments.pages.task_run import MEASURED, TaskRun
from report import page, style

_runs = []  # of this process and of the workers that are forked from it


def _pool(function, jobs):
    workers = min(len(os.sched_getaffinity(0)), 4, len(jobs))
    if workers < 2:
        return [function(job) for job in jobs]
    with concurrent.futures.ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("fork")) as pool:
        return list(pool.map(function, jobs))


def _figures(index):
    run = _runs[index]
    return (*task_metrics.figures(run), task_metrics.series_of(run), run.window)


def number(metric, value, digits=3):
    """A human-readable value with its unit."""
    _, unit, factor = task_metrics.NAMES.get(metric, (metric, "", 1))
    return f"{page.figures(value * factor, digits)} {unit}".strip()


def _label(metric, value):
    return task_metrics.NAMES.get(metric, (metric,))[0], number(metric, value, 4)


def summarize(plan, runs, series):
    """(plant, variant) -> mean, min, max of each figure; runs against each other."""
    summary = {}
    by_place = {(r["plant"], r["variant"], r["repeat"]): s for r, s in zip(runs, series)}
    for variant in plan["variants"]:
        for plant in plan["plants"]:
            mine = [r for r in runs if r["plant"] == plant and r["variant"] == variant["name"]]
            if not mine:
                continue
            names = [n for n in dict.fromkeys(name for r in mine for name in r["metrics"])]
            figures = {}
            for name in names:
                values = [r["metrics"][name] for r in mine if r["metrics"].get(name) is not None]
                figures[name] = {"mean": float(np.mean(values)), "min": min(values), "max": max(values)}
            mean = task_metrics.mean_series([by_place[plant, variant["name"], r["repeat"]] for r in mine])
            repeats = (
                [task_metrics.difference(by_place[plant, variant["name"], r["repeat"]], mean) for r in mine]
                if len(mine) > 1
                else []
            )
            first = _simulated(plan["plants"])
            plants = (
                [
                    task_metrics.difference(
                        by_place[plant, variant["name"], r["repeat"]],
                        by_place.get((first, variant["name"], r["repeat"])),
                    )
                    for r in mine
                ]
                if plant != first
                else []
            )
            arms = {
                arm: task_metrics.pooled([r["arms"][arm] for r in mine if arm in r["arms"]])
                for arm in dict.fromkeys(a for r in mine for a in r["arms"])
            }
            summary[plant, variant["name"]] = {
                "plant": plant,
                "variant": variant["name"],
                "metrics": figures,
                "arms": arms,
                "between_repeats": task_metrics.pooled(repeats),
                "between_plants": task_metrics.pooled(plants),
            }
    return summary


def _simulated(plants):
    """The plant that the others are compared with: the first, or the one that a measured run corresponds to."""
    return plants[-2] if plants[-1] == MEASURED and len(plants) > 1 else plants[0]


def _draw(job):
    name, function, arguments = job
    figure = (
        function(*arguments)
        if function is not task_plots.sheet
        else task_plots.sheet({plant: [_runs[i] for i in rows] for plant, rows in arguments[0].items()}, arguments[1])
    )
    if function is task_plots.paths:
        pass
    if figure is None:
        return name, None
    file = _draw.out / f"{name}.png"
    figure.savefig(file, dpi=style.DPI)
    task_plots.plt.close(figure)
    return name, file.name


def _paths(chosen, plants):
    return task_plots.paths([(v, {p: _runs[i] for p, i in runs.items()}) for v, runs in chosen], plants)


def _problems(plan, rows, runs):
    """Returns the reasons for not passing, and notes on variants that are only reported."""
    reported = {v["name"] for v in plan["variants"] if v["reported"]}
    empty = {
        (r["plant"], r["variant"], r["repeat"]) for r in runs if not r["metrics"]
    }  # one sentence for each is enough
    problems = [
        verdicts.sentence(row, _label)
        for row in rows
        if not row["passed"] and (row["plant"], row["variant"], row["repeat"]) not in empty
    ]
    notes = []
    for run in runs:
        found = [f"{run['name']}: {fault}" for fault in run["faults"]]
        if run["window"] is None and (plan["measure"] or {}).get("window"):
            found.append(f"{run['name']}: the window never began (no contact?)")
        elif not run["metrics"]:
            found.append(
                f"{run['name']}: it ended before its window, {run['window'][0]:.2f} to {run['window'][1]:.2f} s; "
                "nothing was measured"
            )
        (notes if run["variant"] in reported else problems).extend(found)
    return problems, notes


def make(plan, folder):
    """Writes report.html, results.json and pictures into `folder`; returns the results."""
    folder = pathlib.Path(folder)
    _runs[:] = [TaskRun(entry, plan["measure"], folder) for entry in plan["runs"]]
    found = _pool(_figures, list(range(len(_runs))))
    runs, series = [], []
    for entry, (figures, arms, one, window) in zip(plan["runs"], found):
        runs.append(
            {
                key: entry[key]
                for key in ("name", "plant", "variant", "repeat", "seed", "log", "faults", "interventions")
            }
            | {"window": window, "metrics": figures, "arms": arms}
        )
        series.append(one)
    present = {r["variant"] for r in runs}
    variants = [v for v in plan["variants"] if v["name"] in present]
    plants = plan["plants"]
    not_on_arms = {(MEASURED, metric) for metric in task_metrics.NOT_ON_ARMS}
    rows = verdicts.judge(plan["limits"], runs, variants, plants, not_on_arms)
    summary = summarize(plan, runs, series)
    problems, notes = _problems(plan, rows, runs)
    results = {
        "name": plan["name"],
        "title": plan["title"],
        "kind": plan["kind"],
        "passed": not problems,
        "problems": problems,
        "notes": notes,
        "repeats": plan["repeats"],
        "seed": plan["seed"],
        "fast": plan["fast"],
        "limits": rows,
        "runs": runs,
        "summary": list(summary.values()),
        "published": plan["published"],
        "arms": plan.get("arms") or [],
        "left_out": plan.get("left_out") or [],
        "machine": plan["machine"],
    }

    places = {(r["plant"], r["variant"], r["repeat"]): i for i, r in enumerate(runs)}
    jobs = [
        ("six", task_plots.six_bars, (summary, variants, plants, plan["published"])),
        ("limits", task_plots.limit_bars, (rows, summary, variants, plants, plan.get("show") or [])),
        (
            "paths",
            _paths,
            (
                [(v, {p: places[p, v["name"], 1] for p in plants if (p, v["name"], 1) in places}) for v in variants],
                plants,
            ),
        ),
    ]
    for v in variants:
        by_plant = {
            p: [places[p, v["name"], r] for r in range(1, plan["repeats"] + 1) if (p, v["name"], r) in places]
            for p in plants
        }
        jobs.append(
            (f"runs_{v['name']}", task_plots.sheet, ({p: rows for p, rows in by_plant.items() if rows}, v["label"]))
        )
    if MEASURED in plants:
        simulated = _simulated(plants)
        for v in variants:
            pair = [places.get((p, v["name"], 1)) for p in (simulated, MEASURED)]
            if None in pair:
                continue
            one, other = (series[i] for i in pair)
            for arm in _runs[pair[1]].arms:
                jobs.append(
                    (f"beside_{v['name']}_{arm}", beside.figure,
                     (one, other, arm, plan["published"], (f"simulated ({simulated})", "measured")))
                )  # fmt: skip
    _draw.out = folder
    drawn = dict(_pool(_draw, sorted(jobs, key=lambda job: job[1] is not task_plots.sheet)))
    frame.write(folder, plan, results, _sections(plan, results, summary, variants, drawn, folder))
    return results


# Page ---------------------------------------------------------------------------------------------------------------


def _sections(plan, results, summary, variants, drawn, folder):
    def shown(name, caption):
        return [page.image(folder / drawn[name], caption)] if drawn.get(name) else []

    plants = plan["plants"]
    pale = "; other repeats in pale colors" if plan["repeats"] > 1 else ""
    sections = [
        (
            "verdict",
            "Verdict",
            [
                *frame.verdict(results),
                *_on_arms(plan),
                *shown("limits", "Every limited figure: mean of the repeats, their span, and the limits."),
                *_limit_table(results, variants),
            ],
        )
    ]
    sections.append(
        (
            "six",
            "Errors",
            [
                page.paragraph(
                    "RMSE over the window: per joint for joints, of the norm for positions and forces in space. "
                    "Against the target: "
                    "joint and position set-points if the controllet has them, torque sent one cycle before "
                    "against τ_J − g, "
                    "desired force "
                    "(without contact: the estimate against zero), control error C = τ_J_d − (τ_J − g)."
                    + (
                        f" {plants[-1]} against {_simulated(plants)}: the same repeat on both plants, as the paper "
                        "compares simulation and real arm."
                        if len(plants) > 1
                        else ""
                    )
                ),
                *shown("six", "The six kinds of error over variants and plants."),
                _six_table(plan, summary, variants),
                *frame.published(plan, summary, plants, variants, number),
            ],
        )
    )
    if MEASURED in plants:
        pictures = [
            part
            for v in variants
            for arm in sorted({arm for run in plan["runs"] for arms in run["instance_arms"].values() for arm in arms})
            for part in shown(f"beside_{v['name']}_{arm}", f"{v['label']}, arm '{arm}', first repeat.")
        ]
        sections.append(
            (
                "beside",
                "Measured beside simulated",
                [
                    page.paragraph(frame.arms_sentence(plan) + " Forces of both are the estimated ones."),
                    *beside.table(summary, variants, plan["published"], MEASURED),
                    *pictures,
                ],
            )
        )
    if drawn.get("paths"):
        sections.append(
            ("paths", "Paths", shown("paths", "Path of the end effector in the window, seen from above, first repeat."))
        )
    for v in variants:
        if drawn.get(f"runs_{v['name']}"):
            changed = "; ".join(f"{key} = {value}" for key, value in v["set"].items())
            sections.append(
                (
                    f"v-{v['name']}",
                    v["label"][:1].upper() + v["label"][1:] if v["label"][:1].isascii() else v["label"],
                    [
                        *([page.paragraph(f"Changed in the scene: {changed}.")] if changed else []),
                        *shown(
                            f"runs_{v['name']}",
                            f"First repeat{pale}. Pale background: the evaluated window; dashed: first contact.",
                        ),
                        _figure_table(summary, v, plants),
                    ],
                )
            )
    sections.append(("runs", "Runs", [_run_table(results)]))
    sections.append(("how", "How it was measured", frame.how(plan)))
    return sections


def _on_arms(plan):
    """What a reader must know about figures of arms."""
    if MEASURED not in plan["plants"]:
        return []
    limited = {row["metric"] for row in plan["limits"]}
    absent = [task_metrics.NAMES[name][0] for name in task_metrics.NOT_ON_ARMS if name in limited]
    lines = [
        frame.arms_sentence(plan)
        + " Their forces are those that the arm estimates from its joint torques: nothing measures the true ones. "
        + (
            f"The limits are those of the plant {plan['plants'][0]}."
            if plan.get("arms")
            else "No limit applies to them."
        )
    ]
    if absent:
        lines.append("Not measured on arms, and not judged there: " + ", ".join(absent) + ".")
    if plan.get("left_out"):
        lines.append("Left out, since they change the simulated plant: " + ", ".join(plan["left_out"]) + ".")
    return [page.box(lines, fine=True)]


def _limit_table(results, variants):
    labels = {v["name"]: v["label"] for v in variants}
    rows, bad = [], []
    for i, row in enumerate(results["limits"]):
        what = task_metrics.NAMES.get(row["metric"], (row["metric"],))[0]
        word = "≤" if row["bound"] == "at_most" else "≥"
        rows.append(
            [
                what,
                labels[row["variant"]],
                row["plant"],
                f"{word} {number(row['metric'], row['limit'])}",
                None if row["worst"] is None else number(row["metric"], row["worst"]),
                "held" if row["passed"] else "missed",
            ]
        )
        if not row["passed"]:
            bad.append(i)
    if not rows:
        return []
    return [
        page.details(
            f"All {len(rows)} limits",
            page.table(["figure", "variant", "plant", "limit", "worst repeat", ""], rows, (3, 4), bad),
        )
    ]


def _six_table(plan, summary, variants):
    rows = []
    for v in variants:
        for plant in plan["plants"]:
            entry = summary.get((plant, v["name"]))
            if entry is None:
                continue
            parts = [(entry["metrics"], "target")]
            parts += (
                [(values, f"target, {arm}") for arm, values in entry["arms"].items()] if len(entry["arms"]) > 1 else []
            )
            for values, what in (
                *parts,
                (entry["between_repeats"], "mean of repeats"),
                (entry["between_plants"], _simulated(plan["plants"])),
            ):
                if not any(rmse in values for _, rmse, _ in task_metrics.SIX):
                    continue
                row = [v["label"], plant, what]
                for _, rmse, largest in task_metrics.SIX:
                    if rmse not in values:
                        row.append(None)
                        continue
                    a, b = values[rmse], values.get(largest)
                    a, b = (a["mean"], b["max"]) if isinstance(a, dict) else (a, b)
                    factor = task_metrics.NAMES[rmse][2]
                    row.append(f"{page.figures(a * factor, 2)} ({page.figures(b * factor, 2)})")
                rows.append(row)
    units = [
        f"{key} [{task_metrics.NAMES[rmse][1]}]"
        for key, rmse, _ in (
            ("q", *task_metrics.SIX[0][1:]),
            ("dq", *task_metrics.SIX[1][1:]),
            ("τ", *task_metrics.SIX[2][1:]),
            ("x", *task_metrics.SIX[3][1:]),
            ("F", *task_metrics.SIX[4][1:]),
            ("C", *task_metrics.SIX[5][1:]),
        )
    ]
    return page.Raw(
        page.table(["variant", "plant", "against", *units], rows, range(3, 9))
        + page.paragraph("RMSE, with the largest error of any repeat in brackets.")
    )


def _figure_table(summary, variant, plants):
    entries = [summary.get((plant, variant["name"])) for plant in plants]
    six = {name for _, *names in task_metrics.SIX for name in names}
    names = [n for n in task_metrics.NAMES if n not in six and any(e and n in e["metrics"] for e in entries)]
    rows = []
    for name in names:
        row = [task_metrics.NAMES[name][0]]
        for e in entries:
            x = e["metrics"].get(name) if e else None
            if x is None:
                row.append(None)
            elif x["max"] > x["min"]:
                row.append(
                    f"{number(name, x['mean'])} ({number(name, x['min']).split(' ')[0]} … "
                    f"{number(name, x['max']).split(' ')[0]})"
                )
            else:
                row.append(number(name, x["mean"]))
        rows.append(row)
    return page.table(["figure: mean (lowest … highest repeat)", *plants], rows, range(1, 1 + len(plants)))


def _run_table(results):
    rows, bad = [], []
    for i, run in enumerate(results["runs"]):
        seen = ", ".join(f"{x['count']} × {x['rule']} ({x['arm']})" for x in run["interventions"]) or "none"
        window = f"{run['window'][0]:.2f} … {run['window'][1]:.2f} s" if run["window"] else None
        rows.append(
            [
                run["variant"],
                run["plant"],
                str(run["repeat"]),
                str(run["seed"]),
                window,
                seen,
                "; ".join(run["faults"]) or "–",
                run["log"],
            ]
        )
        if run["faults"]:
            bad.append(i)
    return page.details(
        f"All {len(rows)} runs",
        page.table(
            ["variant", "plant", "repeat", "seed", "window", "interventions", "faults", "log"], rows, (2, 3), bad
        ),
    )
