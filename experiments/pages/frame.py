"""What the pages of all kinds of experiments share: head, verdict, published figures, how it was measured, index."""

import json
import pathlib

from report import page


def write(folder, plan, results, sections):
    """report.html and results.json; a reader never sees a partial file."""
    folder = pathlib.Path(folder)
    lead = " ".join((plan["description"] or "").split())
    text = page.page(plan["title"], lead, sections)
    for name, content in (
        ("results.json", json.dumps(results, indent=1, allow_nan=False, default=str)),
        ("report.html", text),
    ):
        part = folder / f"{name}.part"
        part.write_text(content, encoding="utf-8")
        part.replace(folder / name)


def verdict(results):
    missed = [row for row in results["limits"] if not row["passed"]]
    tiles = [
        ("passed" if results["passed"] else "FAILED", "verdict", not results["passed"]),
        (f"{len(results['limits']) - len(missed)} of {len(results['limits'])}", "limits held", bool(missed)),
        (str(len(results.get("runs") or [])), "runs", False),
        (str(results["repeats"]), "repeats", False),
        ("unpaced" if results["fast"] else "real time", "pace", False),
    ]
    parts = [page.tiles(tiles)]
    if results["problems"]:
        parts.append(page.box(results["problems"]))
    elif results["limits"]:
        parts.append(page.box(["Every figure is within its limit, in the worst repeat of every variant."], fine=True))
    if results.get("notes"):
        parts.append(
            page.details(f"Variants that are only reported ({len(results['notes'])})", page.box(results["notes"]))
        )
    return parts


def arms_sentence(plan):
    """Which arms `measured` means; virtual arms are named as such."""
    arms = plan.get("arms") or []
    if not arms:
        return "The runs named measured are a log that was recorded elsewhere."
    named = ", ".join(f"{a['arm']} at {a['address']}" for a in arms)
    if all(a["on_this_computer"] for a in arms):
        return f"The runs named measured are of virtual arms in another process ({named}): no real arm took part."
    return f"The runs named measured are of the arms {named}."


def published(plan, summary, plants, variants, number):
    """Figures of the paper next to this project's: the largest over variants, between plants and against the target."""
    if not plan["published"]:
        return []
    rows = []
    for line in plan["published"]:
        metric, row = line["metric"], [line["text"]]
        for plant in plants:
            values = [
                summary[plant, v["name"]]["metrics"].get(metric) for v in variants if (plant, v["name"]) in summary
            ]
            values = [x["max"] for x in values if x]
            row.append(number(metric, max(values)) if values else None)
        values = [s["between_plants"].get(metric) for s in summary.values()]
        values = [x for x in values if x is not None]
        row.append(number(metric, max(values)) if values else None)
        rows.append(row)
    return [
        page.Raw("<h3>Comparison with the paper</h3>"),
        page.table(
            [
                "the paper, simulation against real arm",
                *(f"{p}, against target" for p in plants),
                f"{plants[-1]} against {plants[-2] if plants[-1] == 'measured' else plants[0]}",
            ],
            rows,
            range(1, 2 + len(plants)),
        ),
        page.paragraph(
            (
                "The paper compares its simulation with a real arm; the last column corresponds to it. "
                + arms_sentence(plan)
                if plants[-1] == "measured"
                else "The paper compares its simulation with a real arm; nothing here ran on one. The last column "
                "corresponds to it: two plants under the same controllet."
            )
            + " Ours are the largest of all variants and repeats."
        ),
    ]


def how(plan):
    parts = []
    window = (plan.get("measure") or {}).get("window")
    facts = []
    if window:
        after = {"start": "the start", "contact": "first contact", "motion": "the set-point's motion begins"}[
            window["after"]
        ]
        facts.append(
            (
                "Window",
                f"{window['duration_s']:g} s, beginning {window['offset_s']:g} s after {after}"
                if window["offset_s"]
                else f"{window['duration_s']:g} s, beginning when {after}"
                if window["after"] == "motion"
                else f"{window['duration_s']:g} s from {after}",
            )
        )
    if plan.get("vary"):
        facts.append(
            (
                "Repeats differ by",
                "; ".join(f"{v['key']} ± {v['by']:g}" for v in plan["vary"]) + f" (uniform, seed {plan['seed']})",
            )
        )
    if plan.get("set"):
        facts.append(("Set in every scene", "; ".join(f"{k} = {v}" for k, v in plan["set"].items())))
    facts.append(
        (
            "Force",
            "true: the simulator's contact force; estimate: from joint torques. Limits are about the true one"
            + (", of arms about the estimate." if "measured" in plan.get("plants", []) else "."),
        )
    )
    facts += [(key, value) for key, value in plan["machine"].items()]
    parts.append(page.facts(facts))
    runs = plan.get("runs") or []
    if runs and runs[0].get("scene_text"):
        parts.append(
            page.details(f"Scene of the first run ({runs[0]['name']})", page.preformatted(runs[0]["scene_text"]))
        )
    return parts


def index(entries, folder):
    """index.html about several experiments; entries: [{"name", "passed", "page"}], paths relative to `folder`."""
    folder = pathlib.Path(folder)
    passed = sum(e["passed"] for e in entries)
    rows, bad, parts = [], [], []
    for i, entry in enumerate(entries):
        results = json.loads((folder / entry["page"]).with_name("results.json").read_text(encoding="utf-8"))
        held = sum(row["passed"] for row in results["limits"])
        rows.append(
            [
                page.Raw(f'<a href="{page.escape(entry["page"])}">{page.escape(entry["name"])}</a>'),
                results["title"],
                f"{held} of {len(results['limits'])}",
                str(len(results.get("runs") or [])),
                "passed" if results["passed"] else "FAILED",
            ]
        )
        if not results["passed"]:
            bad.append(i)
        body = []
        if results["problems"]:
            body.append(page.box(results["problems"]))
        for name, caption in (("limits.png", "Figures and limits."), ("six.png", "Errors."), ("index.png", "")):
            picture = (folder / entry["page"]).with_name(name)
            if picture.exists():
                body.append(
                    page.image(
                        picture, page.Raw(f'{caption} <a href="{page.escape(entry["page"])}">The whole page</a>')
                    )
                )
                break
        parts.append((entry["name"], results["title"], body))
    table = page.table(["experiment", "", "limits held", "runs", "verdict"], rows, (2, 3), bad)
    tiles = page.tiles([(f"{passed} of {len(entries)}", "experiments passed", passed < len(entries))])
    text = page.page(
        "Experiments",
        "Every experiment of multipanda, run on simulated arms.",
        [("all", "All", [tiles, table]), *parts],
    )
    target = folder / "index.html"
    target.write_text(text, encoding="utf-8")
    return target
