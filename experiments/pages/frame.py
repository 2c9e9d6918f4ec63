"""What the pages of all kinds of experiments share: limits, verdict, published figures, how it was measured."""

import json
import pathlib

from report import page

BOUNDS = {"at_most": ("at most", "≤"), "at_least": ("at least", "≥")}

# Limits --------------------------------------------------------------------------------------------------------------


def chosen(limit, variants):
    """Variants of a limit: those it names, by name or tag, otherwise all that are not only reported."""
    names = set(limit.get("variants") or [])
    return [v for v in variants if (names & set(v["tags"]) if names else not v["reported"])]


def judge(limits, runs, variants, plants, left_out=()):
    """One row per limit, plant and variant: the worst repeat counts. No row for `left_out`: pairs of plant and metric.

    A figure that was not measured counts as a violated limit.
    limits, variants: of the plan; runs: [{"plant", "variant", "repeat", "metrics": {...}}]; plants: [""] if none.
    """
    rows, figure_of = [], (lambda pair: pair[0])
    for limit in limits:
        metric = limit["metric"]
        places = [(b, p) for b in BOUNDS for p in plants if p in limit[b] and (p, metric) not in left_out]
        for (bound, plant), variant in ((place, v) for place in places for v in chosen(limit, variants)):
            mine = [r for r in runs if (r["plant"], r["variant"]) == (plant, variant["name"])]
            measured = [(r["metrics"].get(metric), r["repeat"]) for r in mine]
            missing, value = [pair for pair in measured if pair[0] is None], limit[bound][plant]
            if not mine:
                continue
            worst, repeat = missing[0] if missing else (max if bound == "at_most" else min)(measured, key=figure_of)
            passed = worst is not None and (worst <= value if bound == "at_most" else worst >= value)
            row = {"metric": metric, "plant": plant, "variant": variant["name"], "bound": bound, "limit": value}
            rows.append(row | {"worst": worst, "repeat": repeat, "passed": passed})
    return rows


def sentence(row, label):
    """One line about a violated limit. label(metric, value) returns the name and the value with its unit."""
    where = " ".join(x for x in (row["variant"], f"on {row['plant']}" if row["plant"] else "") if x)
    if row["worst"] is None:
        return f"{where}: {row['metric']} could not be measured in repeat {row['repeat']}"
    (what, worst), (_, limit) = (label(row["metric"], row[key]) for key in ("worst", "limit"))
    return f"{where}: {what} {worst} in repeat {row['repeat']}, {BOUNDS[row['bound']][0]} {limit} allowed"


def limit_table(rows, variants, label):
    """All limits with the worst repeat of each."""
    labels = {v["name"]: v["label"] for v in variants}
    cells = {
        "figure": lambda row: label(row["metric"], row["limit"])[0],
        "variant": lambda row: labels[row["variant"]],
        "plant": lambda row: row["plant"],
        "limit": lambda row: f"{BOUNDS[row['bound']][1]} {label(row['metric'], row['limit'])[1]}",
        "worst repeat": lambda row: None if row["worst"] is None else label(row["metric"], row["worst"])[1],
        "": lambda row: "held" if row["passed"] else "missed",
    }
    if not any(row["plant"] for row in rows):
        del cells["plant"]
    table = page.columns(rows, cells, bad=lambda row: not row["passed"])
    return page.details(f"All {len(rows)} limits", table) if rows else None


def verdict(results):
    missed = [row for row in results["limits"] if not row["passed"]]
    total, notes, problems = len(results["limits"]), results.get("notes"), results["problems"]
    held = ["Every figure is within its limit, in the worst repeat of every variant."] if total else []
    return [
        page.tiles(
            ("passed" if results["passed"] else "FAILED", "verdict", not results["passed"]),
            (f"{total - len(missed)} of {total}", "limits held", missed),
            (len(results.get("runs") or []), "runs"),
            (results["repeats"], "repeats"),
            ("unpaced" if results["fast"] else "real time", "pace"),
        ),
        page.box(problems or held, fine=not problems),
        page.details(f"Variants that are only reported ({len(notes)})", page.box(notes)) if notes else None,
    ]


# Parts of the page ---------------------------------------------------------------------------------------------------


def write(folder, plan, results, sections):
    """report.html and results.json."""
    page.write(folder / "results.json", json.dumps(results, indent=1, allow_nan=False, default=str))
    lead = " ".join((plan["description"] or "").split())
    page.write(folder / "report.html", page.page(plan["title"], lead, sections))


def copied(entry, *keys):
    """Some keys of a plan or a run, for the results."""
    return {key: entry[key] for key in keys}


def arms_sentence(plan):
    """Explains the plant `measured`; names virtual arms as such."""
    arms = plan.get("arms") or []
    if not arms:
        return "The measured runs come from a log that was recorded elsewhere."
    named = ", ".join(f"{a['arm']} at {a['address']}" for a in arms)
    if all(a["on_this_computer"] for a in arms):
        return f"The measured runs are of virtual arms in another process ({named}): no real arm took part."
    return f"The measured runs are of the arms {named}."


def other_plant(plants):
    """The plant that the last one is compared with: the first, or the one that a measured run corresponds to."""
    return plants[-2] if plants[-1] == "measured" and len(plants) > 1 else plants[0]


def published(plan, summary, plants, variants, number):
    """Figures of the paper next to this project's: the largest over variants, between plants and against the target."""
    if not plan["published"]:
        return None
    measured = plants[-1] == "measured"

    def largest(values, metric):
        values = [x for x in values if x is not None]
        return number(metric, max(values)) if values else None

    def of_plant(plant):
        figures = [summary[plant, v["name"]]["metrics"] for v in variants if (plant, v["name"]) in summary]
        return lambda line: largest([f.get(line["metric"], {}).get("max") for f in figures], line["metric"])

    def between(line):
        return largest([s["between_plants"].get(line["metric"]) for s in summary.values()], line["metric"])

    cells = {"the paper, simulation against real arm": lambda line: line["text"]}
    cells |= {f"{plant}, against target": of_plant(plant) for plant in plants}
    cells[f"{plants[-1]} against {other_plant(plants)}"] = between
    return [
        page.heading("Comparison with the paper"),
        page.columns(plan["published"], cells),
        "The paper compares its simulation with a real arm; "
        + (
            f"the last column corresponds to it. {arms_sentence(plan)}"
            if measured
            else "nothing here ran on one. The last column corresponds to it: two plants under the same controllet."
        )
        + " Ours are the largest of all variants and repeats.",
    ]


def how(plan):
    """How it was measured: facts, and the scene of the first run."""
    window, runs, facts = (plan.get("measure") or {}).get("window"), plan.get("runs") or [], []
    if window:
        begins = {"start": "the start", "contact": "first contact", "motion": "the set-point's motion begins"}
        after, offset, duration = begins[window["after"]], window["offset_s"], window["duration_s"]
        when = (
            f"beginning {offset:g} s after" if offset else "beginning when" if window["after"] == "motion" else "from"
        )
        facts.append(("Window", f"{duration:g} s{'' if when == 'from' else ','} {when} {after}"))
    if plan.get("vary"):
        varied = "; ".join(f"{v['key']} ± {v['by']:g}" for v in plan["vary"])
        facts.append(("Repeats differ by", f"{varied} (uniform, seed {plan['seed']})"))
    if plan.get("set"):
        facts.append(("Set in every scene", "; ".join(f"{k} = {v}" for k, v in plan["set"].items())))
    force = "true: the simulator's contact force; estimate: from joint torques. Limits apply to the true force"
    arms = ", on arms to the estimate." if "measured" in plan.get("plants", []) else "."
    scene = runs[0].get("scene_text") if runs else None
    return [
        page.facts([*facts, ("Force", force + arms), *plan["machine"].items()]),
        page.details(f"Scene of the first run ({runs[0]['name']})", page.preformatted(scene)) if scene else None,
    ]


# All experiments -----------------------------------------------------------------------------------------------------


def index(entries, folder):
    """index.html about several experiments; entries: [{"name", "passed", "page"}], paths relative to `folder`."""
    folder, passed = pathlib.Path(folder), sum(e["passed"] for e in entries)
    for entry in entries:
        entry["file"] = folder / entry["page"]
        entry["results"] = json.loads(entry["file"].with_name("results.json").read_text(encoding="utf-8"))

    def link(entry, text):
        return f'<a href="{page.escape(entry["page"])}">{page.escape(text)}</a>'

    def limits(entry):
        rows = entry["results"]["limits"]
        return f"{sum(row['passed'] for row in rows)} of {len(rows)}"

    def picture(entry):
        for name, caption in (("limits.png", "Figures and limits."), ("six.png", "Errors."), ("index.png", "")):
            if (file := entry["file"].with_name(name)).exists():
                return page.image(file, page.Raw(f"{caption} {link(entry, 'The whole page')}"))
        return None

    cells = {
        "experiment": lambda e: page.Raw(link(e, e["name"])),
        "": lambda e: e["results"]["title"],
        "limits held": limits,
        "runs": lambda e: len(e["results"].get("runs") or []),
        "verdict": lambda e: "passed" if e["results"]["passed"] else "FAILED",
    }
    tiles = page.tiles((f"{passed} of {len(entries)}", "experiments passed", passed < len(entries)))
    table = page.columns(entries, cells, bad=lambda e: not e["results"]["passed"])
    parts = [(e["results"]["title"], page.box(e["results"]["problems"]), picture(e)) for e in entries]
    text = page.page(
        "Experiments", "Every experiment of multipanda, run on simulated arms.", [("All", tiles, table), *parts]
    )
    return page.write(folder / "index.html", text)
