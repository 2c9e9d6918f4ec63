"""Figures against limits. A figure that was not measured counts as a violated limit."""


def chosen(limit, variants):
    """Variants of a limit: those it names, by name or tag, otherwise all that are not only reported."""
    names = limit.get("variants") or []
    return [v for v in variants if (set(names) & set(v["tags"]) if names else not v["reported"])]


def judge(limits, runs, variants, plants, left_out=()):
    """One row per limit, plant and variant: the worst repeat counts. No row for `left_out`: pairs of plant and metric.

    limits, variants: of the plan; runs: [{"plant", "variant", "repeat", "metrics": {...}}]; plants: [""] if none.
    """
    rows = []
    for limit in limits:
        for bound, worst_of in (("at_most", max), ("at_least", min)):
            for plant in plants:
                if plant not in limit[bound] or (plant, limit["metric"]) in left_out:
                    continue
                value = limit[bound][plant]
                for variant in chosen(limit, variants):
                    mine = [r for r in runs if r["plant"] == plant and r["variant"] == variant["name"]]
                    if not mine:
                        continue
                    measured = [(r["metrics"].get(limit["metric"]), r["repeat"]) for r in mine]
                    missing = [repeat for figure, repeat in measured if figure is None]
                    row = {
                        "metric": limit["metric"],
                        "plant": plant,
                        "variant": variant["name"],
                        "bound": bound,
                        "limit": value,
                        "worst": None,
                        "repeat": missing[0] if missing else None,
                        "passed": False,
                    }
                    if not missing:
                        row["worst"], row["repeat"] = worst_of(measured, key=lambda pair: pair[0])
                        row["passed"] = row["worst"] <= value if bound == "at_most" else row["worst"] >= value
                    rows.append(row)
    return rows


def sentence(row, label):
    """One line about a violated limit. label(metric, value): human-readable name, and the value with its unit."""
    where = " ".join(x for x in (row["variant"], f"on {row['plant']}" if row["plant"] else "") if x)
    if row["worst"] is None:
        return f"{where}: {row['metric']} could not be measured in repeat {row['repeat']}"
    word = "at most" if row["bound"] == "at_most" else "at least"
    (what, worst), (_, limit) = (label(row["metric"], row[key]) for key in ("worst", "limit"))
    return f"{where}: {what} {worst} in repeat {row['repeat']}, {word} {limit} allowed"
