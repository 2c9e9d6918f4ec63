"""The page of a performance experiment: figures of all conditions, verdicts, plots, and the paper's figures."""

import pathlib

from experiments.pages import frame, in_manager, performance_metrics as metrics, performance_plots
from experiments.pages.performance_metrics import Trace
from report import page, style
from report.series import spread

LABELS = {
    "control_ratio": ("control function, as a multiple of the law alone (medians)", ""),
    "samples_missing": ("cycles missing", ""),
    "delay_error_us": ("delay by correlation, error", "µs"),
    "delay_by_sequence_error_us": ("delay by sequence number, error", "µs"),
    "torques_unmatched": ("torques that the arm never reported", ""),
    "generator_lost": ("set-points lost", ""),
    "switches_late": ("switches later than the next cycle", ""),
    "switches_refused": ("switches refused", ""),
    "switches_missing": ("switches missing", ""),
    "bystander_different": ("cycles in which the bystander differs", ""),
}
DISTURBED_SHARE = 0.01  # largest share of the time in which another process holds the loop's core
# Only a world that waits for the loop can guarantee these; in real time over sockets they are not limited.
OF_LOCK_STEP = ("samples_missing", "delay_error_us", "delay_by_sequence_error_us", "torques_unmatched")


def _label(metric, value):
    what, unit = LABELS.get(metric, (metric, ""))
    return what, f"{page.figures(value)} {unit}".strip()


def _range(values, digits=3):
    low, high = page.figures(min(values), digits), page.figures(max(values), digits)
    return low if low == high else f"{low} to {high}"


# Figures -------------------------------------------------------------------------------------------------------------


def _run(entry, variant, figures, arms=None, repeat=1):
    """One run of the results."""
    run = {"name": entry["name"], "plant": "", "variant": variant, "repeat": repeat, "metrics": figures}
    return run | {"arms": arms or {}, "faults": entry["faults"], "interventions": entry.get("interventions", [])}


def _of_conditions(traces):
    """Runs of the results, and the delays per condition and arm."""
    runs, delays = [], {}
    for entry, trace in traces:
        arms, figures = metrics.delay_figures(trace)
        channels = entry["generator"].get("channels") or []
        figures["samples_missing"] = entry["expected_samples"] - entry["samples"]
        figures["control_ratio"] = metrics.control_ratio(trace)
        figures["generator_lost"] = sum(c.get("lost", 0) for c in channels) if channels else None
        delays.setdefault(entry["condition"], []).append(arms)
        runs.append(_run(entry, entry["condition"], figures, arms, entry["repeat"]))
    return runs, delays


def _variants(plan):
    def variant(name, label, tag):
        return {"name": name, "label": label, "tags": [tag, name], "reported": False}

    out = [variant(c["name"], c["label"], "condition") for c in plan["conditions"]]
    checks = [(c["name"], f"delay of {c['command_delay_s'] * 1e3:g} ms") for c in plan["delay_checks"]]
    out += [variant(name, label, "delay_check") for name, label in checks]
    return out + ([variant("switching", "switching", "switching")] if plan.get("switching") else [])


def _pooled(arm_figures):
    """Delays of one condition, repeats together."""
    out = {}
    for arm, first in arm_figures[0].items():
        windows = [w for one in arm_figures for w in one[arm]["windows_ms"]]
        unmatched = sum(one[arm]["unmatched"] for one in arm_figures)
        out[arm] = {"correlation_ms": spread(windows), "windows_ms": windows, "unmatched": unmatched}
        out[arm]["sequence_ms"] = first["sequence_ms"]
    return out


def disturbances(plan, conditions):
    """Disturbances of the measurement by the machine, one sentence each; empty: none observed."""
    out, all_of = [], list(conditions.values())
    lost, cycles = (sum(c[key] for c in all_of) for key in ("cycles_lost", "cycles"))
    usage = [c["usage"] for c in all_of]
    others, waited = (
        [u[key]["mean"] for u in usage if u.get(key)] for key in ("others_percent", "loop_waited_percent")
    )
    if lost:
        out.append(
            f"{lost} of {cycles + lost} cycles were lost: the loop woke up more than a period late. Lost cycles are "
            "skipped, not repeated."
        )
    if others and max(others) > 10:
        out.append(
            f"Other processes used {_range(others, 2)} % of a core, out of {int(plan['machine']['cores'])} cores (load "
            f"before {plan['load_before']:.1f}, after {plan['load_after']:.1f}). Medians describe the program; tails "
            "also reflect the other load."
        )
    if waited and max(waited) > 100 * DISTURBED_SHARE:
        out.append(
            "The loop was ready to run but another process had its core for up to "
            f"{page.figures(max(waited), 2)} % of the time of a condition."
        )
    denied = {(s["what"], s["reason"]) for r in plan["runs"] for s in r["thread"] if not s["done"]}
    out += [f"The loop's thread did not get {what}: {reason}." for what, reason in sorted(denied)]
    priority = plan.get("priority") or {"done": True}
    if not priority["done"]:
        out.append(f"The threads around the loop did not get {priority['what']}: {priority['reason']}.")
    generators = [g for c in all_of for g in c["generator"]]
    unsent, slow = sum(g.get("unsent", 0) for g in generators), [g for g in generators if g.get("missed")]
    if unsent:
        out.append(
            f"{unsent} set-points of the generator were not sent, because the receiving process had to wait for a core."
        )
    if slow:
        missed = sum(g["missed"] for g in slow)
        of = missed + sum(g["samples"] for g in slow)
        out.append(f"The generator missed {missed} of its {of} periods in {len(slow)} runs.")
    return out


def limits_of(plan):
    """The limits that hold for the backend of this run."""
    backend, out = plan.get("backend"), []
    if backend not in ("virtual", "fci"):
        return plan["limits"]
    for limit in plan["limits"]:
        metric, variants = limit["metric"], limit["variants"]
        if metric == "bystander_different":  # the number of periods before an arm's first command differs between runs
            continue
        if backend == "fci" and metric in OF_LOCK_STEP:
            continue  # the delay of an arm is not known
        if metric in OF_LOCK_STEP and plan.get("pace") != "lockstep":
            variants = [v for v in variants if v != "condition"]
            if not variants:
                continue
        out.append({**limit, "variants": variants})
    return out


def make(plan, folder):
    """Writes report.html, results.json and pictures into `folder`; returns the results."""
    folder = pathlib.Path(folder)
    plan = {**plan, "limits": limits_of(plan)}
    traces = [(entry, Trace(entry, folder)) for entry in plan["runs"]]
    runs, delays = _of_conditions(traces)
    by_condition = {c["name"]: [t for e, t in traces if e["condition"] == c["name"]] for c in plan["conditions"]}
    memory, conditions, checks = float(plan["machine"]["memory_mb"]), {}, []
    for c in plan["conditions"]:
        figures = metrics.condition_figures(by_condition[c["name"]], memory)
        conditions[c["name"]] = {"label": c["label"], **figures, "delay": _pooled(delays[c["name"]])}
    for entry in plan["delay_checks"]:
        arms, figures = metrics.delay_figures(Trace(entry, folder))
        checks.append({"name": entry["name"], "configured_ms": entry["command_delay_s"] * 1e3, "arms": arms})
        runs.append(_run(entry, entry["name"], figures, arms))
    inside_traces = in_manager.load(plan, folder)
    inside = {name: in_manager.figures(of_it) for name, of_it in inside_traces.items()}
    switching = metrics.switching_figures(plan["switching"]) if plan.get("switching") else None
    if switching:
        runs.append(_run({"name": "switching", **switching}, "switching", switching["metrics"]))
    variants = _variants(plan)
    rows = frame.judge(plan["limits"], runs, variants, [""])
    problems = [frame.sentence(row, _label) for row in rows if not row["passed"]]
    problems += [f"{run['name']}: {fault}" for run in runs for fault in run["faults"]]
    problems += [
        f"{e['name']}: the motion generator ended before the run ({e['generator'].get('ended_by')})"
        for e in plan["runs"]
        if not e["generator_lasted"]
    ]
    base = next(iter(conditions.values()))["control_us"]["median"]
    results = {
        **frame.copied(plan, "name", "title", "kind", "repeats", "seed", "fast", "duration_s", "published", "machine"),
        "passed": not problems,
        "problems": problems,
        "backend": plan.get("backend", "mujoco"),
        "pace": plan.get("pace", "realtime"),
        "generator": plan.get("generator", "socket"),
        "limits": rows,
        "runs": runs,
        "conditions": conditions,
        "manager": inside,
        "manager_remarks": in_manager.remarks(inside_traces, by_condition, plan["machine"]),
        "delay_checks": checks,
        "switching": switching,
        # Medians compared with the first condition: the cost of each feature.
        "added_us": {name: c["control_us"]["median"] - base for name, c in list(conditions.items())[1:]},
        "disturbances": disturbances(plan, conditions),
    }
    figures = {
        "index": performance_plots.like_the_paper(conditions, plan["runs"][0]["arms"]),
        "stages": performance_plots.stages(conditions),
        "tails": performance_plots.tails(by_condition),
        "usage": performance_plots.usage(by_condition),
        "delays": performance_plots.delay_checks([(c["configured_ms"], c["arms"]) for c in checks]),
        "switching": performance_plots.switching(plan["switching"]) if switching else None,
        **(in_manager.draw(conditions, by_condition, inside, inside_traces) if inside else {}),
    }
    drawn = {name: style.save(figure, folder / f"{name}.png") for name, figure in figures.items() if figure}
    frame.write(folder, plan, results, _sections(plan, results, variants, drawn))
    return results


# Page ---------------------------------------------------------------------------------------------------------------


def _sections(plan, results, variants, drawn):
    def shown(name, caption):
        return page.image(drawn[name], caption) if name in drawn else None

    conditions, switching, disturbed = results["conditions"], results["switching"], results["disturbances"]
    cycles, runs = sum(c["cycles"] for c in conditions.values()), plan["runs"]
    boxes = "Box: quarters; whiskers: 1 and 99 %; line: median; diamond: mean."
    return [
        (
            "Verdict",
            frame.verdict({**results, "fast": False}),
            f"{plan['duration_s']:g} s per condition, {cycles} cycles in all"
            + (", shortened (--fast)." if plan["fast"] else "."),
            [page.heading("Disturbances by the machine"), page.box(disturbed)] if disturbed else None,
            shown("index", f"The three panels of the paper's figure, as distributions. {boxes}"),
            _paper_table(plan, results),
            frame.limit_table(results["limits"], variants, _label),
        ),
        (
            "Cycle time",
            "Control function: from the start of a step until the torques of all arms are computed, including models "
            "and observers, as the paper measured it. Whole step: also stores the records. Start deviation: deviation "
            "of the time between two cycle starts from one period. Law alone: the law of the first condition for both "
            "arms with Pinocchio and Eigen and nothing else, once per millisecond just before and after the condition.",
            _cycle_table(conditions),
            shown("stages", "Medians of the stages of a step."),
            _acting(conditions),
            shown("tails", "Fraction of the cycles above a value, down to the worst one. Dashed: one period."),
        ),
        (
            "Command delay",
            f"{_way(plan)}Two measurements: (a) as in the paper: torques sent and torques in use, interpolated "
            "linearly over the union of their time stamps, then cross-correlated, here for each second; (b) cycle by "
            f"cycle: the packet, by its sequence number, that reports the torque that was sent. {_meaning(plan)}",
            _delay_table(conditions),
            shown("delays", "Plants with known delays, and the delays that both methods find."),
        ),
        (
            "CPU and memory",
            f"Sampled every {_interval(plan):g} s from /proc. The control process consists of the loop, the simulation "
            f"of both arms, {'ROS adapter and ' if plan.get('generator') == 'ros' else ''}live input and this "
            f"measurement (about {_trace_mb(plan):.0f} MB). Its memory is locked, so all of it counts as resident. One "
            "process runs all conditions; memory that it keeps after one condition counts in the next. The generator "
            "is a separate process. Control: the mean step of every cycle, over the period; the rest is the "
            "simulation, the pacing and this measurement. With --backend fci and virtual arms of another process, no "
            "simulation is in it.",
            _load_table(conditions),
            shown("usage", "First repeat of each condition."),
        ),
        (
            "Switching",
            _switch_text(switching),
            _switch_table(switching),
            shown(
                "switching",
                "Each trial starts at a random moment of the cycle, seeded. Band: the paper's mean and standard "
                "deviation.",
            ),
        )
        if switching
        else ("Switching",),
        in_manager.section(conditions, results["manager"], results["manager_remarks"], drawn)
        if results["manager"]
        else ("Inside a controller_manager",),
        (
            "How it was measured",
            _generator_table(plan, conditions),
            frame.how({**plan, "measure": None})[0],
            page.details("Scene of the first condition", page.preformatted(runs[0]["scene_text"])),
        ),
    ]


def _interval(plan):
    rows = plan["runs"][0]["usage"]
    return round((rows[-1][0] - rows[0][0]) / (len(rows) - 1), 2) if len(rows) > 1 else 0.3


def _trace_mb(plan):
    per_cycle = 5 * 16 * 8 * len(plan["runs"][0]["arms"]) + 120
    return plan["runs"][0]["expected_samples"] * per_cycle / 2**20


def _paper_table(plan, results):
    conditions, fci = results["conditions"], plan.get("backend") == "fci"
    all_of, usage = list(conditions.values()), [c["usage"] for c in conditions.values()]
    first, ours = next(iter(conditions)), {}
    ours["control_us"] = f"{page.figures(conditions[first]['control_us']['median'])} µs median ({first})"
    delays = [d["sequence_ms"]["mean"] for c in all_of for d in c["delay"].values() if d["sequence_ms"]]
    if delays:
        computing = f"computing adds {_range([c['whole_us']['median'] for c in all_of])} µs on an arm"
        how = "end to end" if fci else f"by the plant, as configured; {computing}"
        ours["delay_ms"] = f"{_range(delays)} ms{', ' if fci else ' '}{how}"
    parts = [
        f"{name} {page.figures(conditions[name]['stages_us']['features']['median'])} µs ({added:+.1f} µs against "
        f"{first})"
        for name, added in results["added_us"].items()
    ]
    if parts:
        ours["manipulability_us"] = "stage of the features, median (the whole control function): " + ", ".join(parts)
    switch = (results["switching"] or {}).get("controllet", {})
    if f := switch.get("received_to_first_torque_ms"):
        in_time = f"in the next cycle {switch['in_the_next_cycle']} of {switch['trials']}"
        ours["switch_ms"] = f"{f['mean']:.3f} ± {f['deviation']:.3f} ms; {in_time}"
    if memory := [u for u in usage if u.get("memory_mb")]:
        share, used = ([u[key]["median"] for u in memory] for key in ("memory_percent", "memory_mb"))
        total = float(plan["machine"]["memory_mb"]) / 1024
        ours["memory_percent"] = f"{_range(share, 2)} % of {total:.0f} GB ({_range(used)} MB)"
    rows = [[line["text"], ours.get(line["metric"])] for line in plan["published"]]
    if cpu := [u["process_percent"]["median"] for u in usage if u.get("process_percent")]:
        shown = f"{_range(cpu, 2)} %" + ("" if fci else ", simulation included")
        rows.append(["CPU of one core: small in the paper, which gives no number.", shown])
    return [
        page.heading("Comparison with the paper"),
        page.table("the paper: two real arms, a 16-core mini PC | this run", rows),
        "The paper used another computer, so times are comparable only in their order of magnitude.",
    ]


def _cycle_table(conditions):
    def ratio(row):
        found = row["what"] == "control function" and row["control_us"] and row["bare_us"]
        return page.figures(row["control_us"]["median"] / row["bare_us"]) if found else ""

    cells = {
        "condition": lambda row: row["name"] if row["what"] == "control function" else "",
        "[µs]": lambda row: row["what"],
        **metrics.time_cells({"as a multiple of the law alone": ratio}),
    }
    return page.columns(
        [{"name": name, "what": what, **c} for name, c in conditions.items() for what in metrics.TIMES], cells
    )


def _acting(conditions):
    def near(f):
        near = f.get("control_three_pairs_us")
        return f"{page.figures(near['median'])} µs ({near['count']} cycles)" if near else "–"

    cells = {
        "condition": lambda f: f["name"],
        "cycles with a torque of a feature": lambda f: f"{100 * f['acting_share']:.0f} %",
        "largest": lambda f: f"{f['largest_torque_nm']:.2f} N m",
        "most pairs in range": lambda f: f.get("pairs_largest", "–"),
        "three or more pairs": lambda f: f"{100 * f['three_pairs_share']:.0f} %" if "three_pairs_share" in f else "–",
        "control function in these cycles, median": near,
        "least manipulability m": lambda f: f"{f['manipulability_least']:.3f}" if "manipulability_least" in f else "–",
    }
    rows = [{"name": name, **c["features"]} for name, c in conditions.items()]
    return [page.heading("Features at work"), page.columns(rows, cells)]


def _way(plan):
    if plan.get("backend") == "fci":
        return frame.arms_sentence(plan) + " End to end, per arm: client, network, arm, and back. "
    delay, plant = plan["runs"][0]["command_delay_s"] * 1e3, plan["runs"][0]["plant"]
    over_sockets = (
        "End to end, per arm: client, sockets, virtual arm, and back; every torque and every state went over the wire. "
    )
    return (over_sockets if plan.get("backend") == "virtual" else "") + (
        f"The arms use a torque {delay:g} ms after it was sent (fidelity set {plant}). "
    )


def _meaning(plan):
    if plan.get("backend") == "fci":
        return (
            "Arms keep their own time: a torque that arrives too late for its period is used in a later one, or never "
            "('not found'). Their own delay is not known, so no limit applies."
        )
    if plan.get("backend") == "virtual" and plan.get("pace") == "lockstep":
        return (
            "The virtual arms run in lock-step: they wait for the torque. So the measured delay is that of the plant "
            "and of injected network faults, not of the computer."
        )
    if plan.get("backend") == "virtual":
        return (
            "The conditions run in real time: a torque that arrives too late for its period is used in a later one, or "
            "never ('not found'). The plants with known delays run in lock-step."
        )
    return (
        "In lock-step the world is paused while the controller computes, so the measured delay is that of the plant "
        "alone; on an arm the time of the whole step is added."
    )


def _delay_table(conditions):
    rows = [
        {"name": name if i == 0 else "", "arm": arm, "plant": c["configured_delay_ms"], **d}
        for name, c in conditions.items()
        for i, (arm, d) in enumerate(c["delay"].items())
    ]

    def value(key, shown):
        return lambda row: shown.format(**row[key], beyond=row[key]["median"] - row["plant"]) if row[key] else None

    windows = "{least:.4f} … {worst:.4f}"
    cells = {
        "condition": lambda row: row["name"],
        "arm": lambda row: row["arm"],
        "configured [ms]": lambda row: f"{row['plant']:g}",
        "correlation, median [ms]": value("correlation_ms", "{median:.4f}"),
        "its windows [ms]": value("correlation_ms", windows),
        "median beyond the plant [ms]": value("correlation_ms", "{beyond:.4f}"),
        "sequence number, mean [ms]": value("sequence_ms", "{mean:.4f}"),
        "its cycles [ms]": value("sequence_ms", windows),
        "torques found": lambda row: row["sequence_ms"]["count"] if row["sequence_ms"] else 0,
        "not found": lambda row: row["unmatched"],
    }
    return page.columns(rows, cells)


def _load_table(conditions):
    rows = [{"name": name, "control": c["control_percent"], **c["usage"]} for name, c in conditions.items()]
    cells = {
        "condition": lambda u: u["name"],
        "control process [%]": lambda u: "{median:.1f} ({p1:.1f} … {p99:.1f})".format(**u["process_percent"]),
        "its loop [%]": lambda u: f"{u['loop_percent']['median']:.1f}",
        "control [%]": lambda u: f"{u['control']:.1f}",
        "simulation and the rest [%]": lambda u: f"{max(u['process_percent']['mean'] - u['control'], 0):.1f}",
        "generator [%]": lambda u: f"{u['generator_percent']['median']:.1f}",
        "other processes [%]": lambda u: f"{u['others_percent']['mean']:.0f}",
        "loop waited for a core [%]": lambda u: f"{u['loop_waited_percent']['mean']:.2f}",
        "memory [MB]": lambda u: f"{u['memory_mb']['median']:.0f} ({u['memory_percent']['median']:.2f} %)",
        "readings": lambda u: u["process_percent"]["count"],
    }
    return page.columns([u for u in rows if u.get("process_percent")], cells)


def _switch_text(s):
    taken = (
        "A request that arrives during a cycle is taken at the next boundary; the new law gives its first torque in "
        "that same cycle. "
    )
    if not s["bystander_cycles"]:
        return f"{taken}Arms cannot repeat a run bit for bit, so the third arm of the scene was not compared."
    different, of = s["bystander_different"], f"{s['bystander_cycles']} cycles"
    same = f"different in {different} of {of} from" if different else f"identical bit for bit in all {of} to"
    return (
        f"{taken}The third arm of the scene ({s['bystander']}), which no request concerns, is {same} a run in which "
        "nothing was switched: positions, measured torques, torques sent and in use."
    )


def _switch_table(switching):
    def time(name):
        return lambda k: "{mean:.3f} ± {deviation:.3f} ({worst:.3f})".format(**k[name]) if k[name] else None

    def step(k):
        shown = k["kind"] == "controllet" and k["torque_step_nm"]
        return f"{k['torque_step_nm']['worst']:.2f}" if shown else "–"

    cells = {
        "switch of a": lambda k: k["kind"],
        "trials": lambda k: k["trials"],
        "in the next cycle": lambda k: f"{k['in_the_next_cycle']} of {k['trials']}",
        "request to taken [ms]": time("received_to_taken_ms"),
        "taken to first torque [ms]": time("taken_to_first_torque_ms"),
        "request to first torque [ms]": time("received_to_first_torque_ms"),
        "largest step [N m]": step,
    }
    rows = [{"kind": kind, **switching[kind]} for kind in ("controllet", "feature")]
    return [page.columns(rows, cells), "Mean ± standard deviation (worst)."]


def _generator_table(plan, conditions):
    def total(key):
        return lambda g: sum(x.get(key, 0) for x in g.get("channels") or [{}])

    def late(key):
        return lambda g: page.figures(g.get("late_us", {}).get(key))

    cells = {
        "condition": lambda g: g["name"],
        "rate [Hz]": lambda g: f"{g.get('rate_hz', 0):.2f}",
        "periods": lambda g: str(g.get("samples")),
        "missed": lambda g: str(g.get("missed")),
        "no room": lambda g: str(g.get("unsent")),
        "received": total("received"),
        "lost on the way": total("lost"),
        "late, median [µs]": late("median"),
        "99 %": late("p99"),
        "worst": late("worst"),
    }
    way = (
        "Its set-points arrive on ROS topics (DDS, shared memory of this machine). A run reads the newest message of "
        "each topic, so an older unread one counts as lost."
        if plan.get("generator") == "ros"
        else "Its set-points arrive as packets on the run's live-input socket."
    )
    rows = [{"name": name, **g} for name, c in conditions.items() for g in c["generator"]]
    return [page.heading("Motion generator"), way, page.columns(rows, cells)]
