"""The page of a task: figures of all runs, verdicts, pictures."""

import pathlib

import numpy as np

from experiments.pages import beside, frame, task_metrics, task_plots
from experiments.pages.task_metrics import NAMES, SIX
from experiments.pages.task_run import MEASURED, TaskRun
from report import page, pool, style

SYMBOLS = dict(zip((rmse for _, rmse, _ in SIX), ("q", "dq", "τ", "x", "F", "C")))


def _figures(run):
    return (*task_metrics.figures(run), task_metrics.series_of(run), run.window)


def number(metric, value, digits=3):
    """A human-readable value with its unit."""
    _, unit, factor = NAMES.get(metric, (metric, "", 1))
    return f"{page.figures(value * factor, digits)} {unit}".strip()


def _label(metric, value):
    return NAMES.get(metric, (metric,))[0], number(metric, value, 4)


def summarize(plan, runs, series):
    """(plant, variant) -> mean, min, max of each figure; runs against each other."""
    summary, first = {}, frame.other_plant(plan["plants"])
    by_place = {(r["plant"], r["variant"], r["repeat"]): s for r, s in zip(runs, series)}
    for variant, plant in ((v["name"], p) for v in plan["variants"] for p in plan["plants"]):
        mine = [r for r in runs if (r["plant"], r["variant"]) == (plant, variant)]
        if not mine:
            continue
        figures, own = {}, [by_place[plant, variant, r["repeat"]] for r in mine]
        for name in dict.fromkeys(name for r in mine for name in r["metrics"]):
            values = [r["metrics"][name] for r in mine if r["metrics"].get(name) is not None]
            figures[name] = {"mean": float(np.mean(values)), "min": min(values), "max": max(values)}
        mean = task_metrics.mean_series(own)
        others = [by_place.get((first, variant, r["repeat"])) for r in mine] if plant != first else []
        repeats = [task_metrics.difference(one, mean) for one in own] if len(mine) > 1 else []
        plants = [task_metrics.difference(one, other) for one, other in zip(own, others)]
        arms = dict.fromkeys(arm for r in mine for arm in r["arms"])
        summary[plant, variant] = {
            "plant": plant,
            "variant": variant,
            "metrics": figures,
            "arms": {arm: task_metrics.pooled([r["arms"][arm] for r in mine if arm in r["arms"]]) for arm in arms},
            "between_repeats": task_metrics.pooled(repeats),
            "between_plants": task_metrics.pooled(plants),
        }
    return summary


def _draw(job, runs, folder):
    """Draws one picture of some runs, which are named by their numbers. Returns its path, or None."""
    name, function, chosen, *arguments = job

    def found(place):
        if isinstance(place, dict):
            return {key: found(value) for key, value in place.items()}
        return [found(one) for one in place] if isinstance(place, list) else runs[place]

    figure = function([(v, found(of)) for v, of in chosen] if isinstance(chosen, list) else found(chosen), *arguments)
    return None if figure is None else style.save(figure, folder / f"{name}.png")


def _problems(plan, rows, runs):
    """Returns the reasons for not passing, and notes on variants that are only reported."""
    reported = {v["name"] for v in plan["variants"] if v["reported"]}
    # One sentence for each run without figures is enough.
    empty = {(r["plant"], r["variant"], r["repeat"]) for r in runs if not r["metrics"]}
    violated = [r for r in rows if not r["passed"] and (r["plant"], r["variant"], r["repeat"]) not in empty]
    problems, notes = [frame.sentence(row, _label) for row in violated], []
    for run in runs:
        found = list(run["faults"])
        if run["window"] is None and (plan["measure"] or {}).get("window"):
            found.append("the window never began (no contact?)")
        elif not run["metrics"]:
            window = f"{run['window'][0]:.2f} to {run['window'][1]:.2f} s"
            found.append(f"it ended before its window, {window}; nothing was measured")
        (notes if run["variant"] in reported else problems).extend(f"{run['name']}: {fault}" for fault in found)
    return problems, notes


def make(plan, folder):
    """Writes report.html, results.json and pictures into `folder`; returns the results."""
    folder, plants = pathlib.Path(folder), plan["plants"]
    loaded = [TaskRun(entry, plan["measure"], folder) for entry in plan["runs"]]
    found = pool.forked(_figures, loaded)
    kept = ("name", "plant", "variant", "repeat", "seed", "log", "faults", "interventions")
    runs = [
        frame.copied(entry, *kept) | {"window": window, "metrics": figures, "arms": arms}
        for entry, (figures, arms, _, window) in zip(plan["runs"], found)
    ]
    series, present = [one for _, _, one, _ in found], {r["variant"] for r in runs}
    variants = [v for v in plan["variants"] if v["name"] in present]
    not_on_arms = {(MEASURED, metric) for metric in task_metrics.NOT_ON_ARMS}
    rows = frame.judge(plan["limits"], runs, variants, plants, not_on_arms)
    summary = summarize(plan, runs, series)
    problems, notes = _problems(plan, rows, runs)
    results = {
        **frame.copied(plan, "name", "title", "kind", "repeats", "seed", "fast", "published", "machine"),
        "passed": not problems,
        "problems": problems,
        "notes": notes,
        "limits": rows,
        "runs": runs,
        "summary": list(summary.values()),
        "arms": plan.get("arms") or [],
        "left_out": plan.get("left_out") or [],
    }
    places = {(r["plant"], r["variant"], r["repeat"]): i for i, r in enumerate(runs)}

    def repeats(variant, count):
        of = {p: [places.get((p, variant["name"], r)) for r in range(1, count + 1)] for p in plants}
        return {p: [i for i in numbers if i is not None] for p, numbers in of.items() if numbers != [None] * count}

    jobs = [(f"runs_{v['name']}", task_plots.sheet, repeats(v, plan["repeats"])) for v in variants]
    first = [(v, {p: numbers[0] for p, numbers in repeats(v, 1).items()}) for v in variants]
    jobs.append(("paths", task_plots.paths, first, plants))
    drawn = dict(zip((job[0] for job in jobs), pool.forked(_draw, jobs, loaded, folder)))
    figures = {
        "six": task_plots.six_bars(summary, variants, plants, plan["published"]),
        "limits": task_plots.limit_bars(rows, summary, variants, plants, plan.get("show") or []),
    }
    simulated = frame.other_plant(plants)
    for v, pair in first if MEASURED in plants else []:
        if simulated in pair and MEASURED in pair:
            both, names = (series[pair[p]] for p in (simulated, MEASURED)), (f"simulated ({simulated})", "measured")
            one, other = both
            for arm in loaded[pair[MEASURED]].arms:
                figure = beside.figure(one, other, arm, plan["published"], names)
                figures[f"beside_{v['name']}_{arm}"] = figure
    drawn |= {name: figure and style.save(figure, folder / f"{name}.png") for name, figure in figures.items()}
    frame.write(folder, plan, results, _sections(plan, results, summary, variants, drawn))
    return results


# Page ---------------------------------------------------------------------------------------------------------------


def _sections(plan, results, summary, variants, drawn):
    def shown(name, caption):
        return page.image(drawn[name], caption) if drawn.get(name) else None

    plants, measured = plan["plants"], MEASURED in plan["plants"]
    pale = "; other repeats in pale colors" if plan["repeats"] > 1 else ""
    first_repeat = f"First repeat{pale}. Pale background: the evaluated window; dashed: first contact."
    between = (
        f" {plants[-1]} against {frame.other_plant(plants)}: the same repeat on both plants, as the paper compares "
        "simulation and real arm."
    )
    arms = sorted({arm for run in plan["runs"] for arms in run["instance_arms"].values() for arm in arms})

    def of_variant(v):
        changed = "; ".join(f"{key} = {value}" for key, value in v["set"].items())
        return (
            v["label"][:1].upper() + v["label"][1:] if v["label"][:1].isascii() else v["label"],
            f"Changed in the scene: {changed}." if changed else None,
            shown(f"runs_{v['name']}", first_repeat),
            _figure_table(summary, v, plants),
        )

    return [
        (
            "Verdict",
            frame.verdict(results),
            _on_arms(plan) if measured else None,
            shown("limits", "Every limited figure: mean of the repeats, their span, and the limits."),
            frame.limit_table(results["limits"], variants, lambda metric, x: (_label(metric, x)[0], number(metric, x))),
        ),
        (
            "Errors",
            "RMSE over the window: per joint for joints, of the norm for positions and forces in space. Against the "
            "target: joint and position set-points if the controllet has them, torque sent one cycle before against "
            "τ_J − g, desired force (without contact: the estimate against zero), control error C = τ_J_d − (τ_J − g)."
            + (between if len(plants) > 1 else ""),
            shown("six", "The six kinds of error over variants and plants."),
            _six_table(plan, summary, variants),
            frame.published(plan, summary, plants, variants, number),
        ),
        (
            "Measured beside simulated",
            f"{frame.arms_sentence(plan)} Forces of both are the estimated ones.",
            beside.table(summary, variants, plan["published"], MEASURED),
            *(
                shown(f"beside_{v['name']}_{arm}", f"{v['label']}, arm '{arm}', first repeat.")
                for v in variants
                for arm in arms
            ),
        )
        if measured
        else ("Measured beside simulated",),
        ("Paths", shown("paths", "Path of the end effector in the window, seen from above, first repeat.")),
        *(of_variant(v) for v in variants if drawn.get(f"runs_{v['name']}")),
        ("Runs", _run_table(results)),
        ("How it was measured", frame.how(plan)),
    ]


def _on_arms(plan):
    """Notes on figures of arms."""
    limited = {row["metric"] for row in plan["limits"]}
    absent = ", ".join(NAMES[name][0] for name in task_metrics.NOT_ON_ARMS if name in limited)
    left_out = ", ".join(plan.get("left_out") or [])
    limits = (
        f"The limits are those of the plant {plan['plants'][0]}." if plan.get("arms") else "No limit applies to them."
    )
    lines = [
        f"{frame.arms_sentence(plan)} Their forces are those that the arm estimates from its joint torques: true "
        f"forces are not measured. {limits}",
        absent and f"Not measured on arms, and not judged there: {absent}.",
        left_out and f"Left out, since they change the simulated plant: {left_out}.",
    ]
    return page.box([line for line in lines if line], fine=True)


def _six_table(plan, summary, variants):
    rows = []
    for v, plant in ((v, p) for v in variants for p in plan["plants"]):
        if (entry := summary.get((plant, v["name"]))) is None:
            continue
        parts = {"target": entry["metrics"]}
        if len(entry["arms"]) > 1:
            parts |= {f"target, {arm}": values for arm, values in entry["arms"].items()}
        parts["mean of repeats"] = entry["between_repeats"]
        parts[frame.other_plant(plan["plants"])] = entry["between_plants"]
        rows += [
            {"variant": v["label"], "plant": plant, "against": against, "values": values}
            for against, values in parts.items()
            if any(rmse in values for _, rmse, _ in SIX)
        ]

    def error(rmse, largest):
        def shown(row):
            if rmse not in row["values"]:
                return None
            a, b, factor = row["values"][rmse], row["values"].get(largest), NAMES[rmse][2]
            a, b = (a["mean"], b["max"]) if isinstance(a, dict) else (a, b)
            return f"{page.figures(a * factor, 2)} ({page.figures(b * factor, 2)})"

        return shown

    cells = {name: lambda row, name=name: row[name] for name in ("variant", "plant", "against")}
    cells |= {f"{SYMBOLS[rmse]} [{NAMES[rmse][1]}]": error(rmse, largest) for _, rmse, largest in SIX}
    return [page.columns(rows, cells), "RMSE, with the largest error of any repeat in brackets."]


def _figure_table(summary, variant, plants):
    entries = {plant: (summary.get((plant, variant["name"])) or {}).get("metrics", {}) for plant in plants}
    six = {name for _, *names in SIX for name in names}

    def value(figures):
        def shown(name):
            if (x := figures.get(name)) is None:
                return None
            low, high = (number(name, x[key]).split(" ")[0] for key in ("min", "max"))
            return number(name, x["mean"]) + (f" ({low} … {high})" if x["max"] > x["min"] else "")

        return shown

    cells = {"figure: mean (lowest … highest repeat)": lambda name: NAMES[name][0]}
    cells |= {plant: value(figures) for plant, figures in entries.items()}
    names = [n for n in NAMES if n not in six and any(n in figures for figures in entries.values())]
    return page.columns(names, cells)


def _run_table(results):
    def seen(run):
        return ", ".join(f"{x['count']} × {x['rule']} ({x['arm']})" for x in run["interventions"]) or "none"

    def window(run):
        return f"{run['window'][0]:.2f} … {run['window'][1]:.2f} s" if run["window"] else None

    cells = {name: lambda run, name=name: run[name] for name in ("variant", "plant", "repeat", "seed")}
    cells |= {"window": window, "interventions": seen, "faults": lambda run: "; ".join(run["faults"]) or "–"}
    cells["log"] = lambda run: run["log"]
    table = page.columns(results["runs"], cells, bad=lambda run: run["faults"])
    return page.details(f"All {len(results['runs'])} runs", table)
