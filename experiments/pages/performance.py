"""The page of a performance experiment: figures of all conditions, verdicts, plots, and the paper's figures."""

import pathlib

from experiments.pages import frame, in_manager, performance_metrics, performance_plots, verdicts
from experiments.pages.performance_metrics import Trace
from report import page, style

LABELS = {
    "control_ratio": ("control function over the bare mathematics of its law, medians", ""),
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
DISTURBED_SHARE = 0.01  # of the time that the loop was ready but another process had the core


def _label(metric, value):
    what, unit = LABELS.get(metric, (metric, ""))
    return what, f"{page.figures(value)} {unit}".strip()


def _us(f, name="median", digits=3):
    return None if f is None else page.figures(f[name], digits)


def _runs(plan, traces):
    """All limited figures: conditions, delay checks, switching; and the delays per condition and arm."""
    runs, delays = [], {}
    for entry, trace in traces:
        arms, metrics = performance_metrics.delay_figures(trace)
        metrics["samples_missing"] = entry["wanted_samples"] - entry["samples"]
        metrics["control_ratio"] = performance_metrics.control_ratio(trace)
        channels = entry["generator"].get("channels") or []
        metrics["generator_lost"] = sum(c.get("lost", 0) for c in channels) if channels else None
        delays.setdefault(entry["condition"], []).append(arms)
        runs.append(
            {
                "name": entry["name"],
                "plant": "",
                "variant": entry["condition"],
                "repeat": entry["repeat"],
                "metrics": metrics,
                "arms": arms,
                "faults": entry["faults"],
                "interventions": entry["interventions"],
            }
        )
    return runs, delays


def _variants(plan):
    out = [
        {"name": c["name"], "label": c["label"], "tags": ["condition", c["name"]], "reported": False}
        for c in plan["conditions"]
    ]
    out += [
        {
            "name": c["name"],
            "label": f"delay of {c['command_delay_s'] * 1e3:g} ms",
            "tags": ["delay_check", c["name"]],
            "reported": False,
        }
        for c in plan["delay_checks"]
    ]
    if plan.get("switching"):
        out.append({"name": "switching", "label": "switching", "tags": ["switching"], "reported": False})
    return out


def _pooled(arm_figures):
    """Delays of one condition, repeats together."""
    out = {}
    for arm in arm_figures[0]:
        windows = [w for one in arm_figures for w in one[arm]["windows_ms"]]
        out[arm] = {
            "correlation_ms": performance_metrics.spread(windows),
            "windows_ms": windows,
            "sequence_ms": arm_figures[0][arm]["sequence_ms"],
            "unmatched": sum(one[arm]["unmatched"] for one in arm_figures),
        }
    return out


def disturbances(plan, conditions):
    """Disturbances of the measurement by the machine, one sentence each; empty: none observed."""
    out = []
    lost = sum(c["cycles_lost"] for c in conditions.values())
    cycles = sum(c["cycles"] for c in conditions.values())
    if lost:
        out.append(
            f"{lost} of {cycles + lost} cycles were lost: the loop woke up more than a period late. Lost cycles are "
            "skipped, not repeated."
        )
    others = [c["usage"]["others_percent"]["mean"] for c in conditions.values() if c["usage"].get("others_percent")]
    cores = int(plan["machine"]["cores"])
    if others and max(others) > 10:
        out.append(
            f"Other processes used {_range(others, 2)} % of a core, out of {cores} cores "
            f"(load before {plan['load_before']:.1f}, after {plan['load_after']:.1f}). Medians describe the "
            "program; tails "
            "also reflect the other load."
        )
    waited = [
        c["usage"]["loop_waited_percent"]["mean"] for c in conditions.values() if c["usage"].get("loop_waited_percent")
    ]
    if waited and max(waited) > 100 * DISTURBED_SHARE:
        out.append(
            "The loop was ready to run but another process had its core for up to "
            f"{page.figures(max(waited), 2)} % of the time of a condition."
        )
    denied = {(s["what"], s["reason"]) for r in plan["runs"] for s in r["thread"] if not s["done"]}
    out += [f"The loop's thread did not get {what}: {reason}." for what, reason in sorted(denied)]
    if not (plan.get("priority") or {"done": True})["done"]:
        out.append(f"The threads around the loop did not get {plan['priority']['what']}: {plan['priority']['reason']}.")
    unsent = sum(g.get("unsent", 0) for c in conditions.values() for g in c["generator"])
    if unsent:
        out.append(
            f"{unsent} set-points of the generator were not sent, because the receiving process had to wait for a core."
        )
    slow = [g for c in conditions.values() for g in c["generator"] if g.get("missed")]
    if slow:
        out.append(
            f"The generator missed {sum(g['missed'] for g in slow)} of its "
            f"{sum(g['samples'] + g['missed'] for g in slow)} periods in {len(slow)} runs."
        )
    return out


# Only a world that waits for the loop can guarantee these; in real time over sockets they are not limited.
_OF_LOCK_STEP = ("samples_missing", "delay_error_us", "delay_by_sequence_error_us", "torques_unmatched")


def limits_of(plan):
    """The limits that hold for the backend of this run."""
    if plan.get("backend") not in ("virtual", "fci"):
        return plan["limits"]
    out = []
    for limit in plan["limits"]:
        if limit["metric"] == "bystander_different":  # how many periods pass before an arm's first command, differs
            continue
        if plan.get("backend") == "fci" and limit["metric"] in _OF_LOCK_STEP:
            continue  # the delay of an arm is not known
        if plan.get("pace") == "lockstep":
            out.append(limit)
            continue
        if limit["metric"] in _OF_LOCK_STEP:
            limit = {**limit, "variants": [v for v in limit["variants"] if v != "condition"]}
            if not limit["variants"]:
                continue
        out.append(limit)
    return out


def make(plan, folder):
    """Writes report.html, results.json and pictures into `folder`; returns the results."""
    folder = pathlib.Path(folder)
    plan = {**plan, "limits": limits_of(plan)}
    traces = [(entry, Trace(entry, folder)) for entry in plan["runs"]]
    runs, delays = _runs(plan, traces)
    by_condition = {c["name"]: [t for e, t in traces if e["condition"] == c["name"]] for c in plan["conditions"]}
    memory = float(plan["machine"]["memory_mb"])
    conditions = {}
    for c in plan["conditions"]:
        conditions[c["name"]] = {
            "label": c["label"],
            **performance_metrics.condition_figures(by_condition[c["name"]], memory),
            "delay": _pooled(delays[c["name"]]),
        }
    checks = []
    for entry in plan["delay_checks"]:
        arms, metrics = performance_metrics.delay_figures(Trace(entry, folder))
        checks.append({"name": entry["name"], "configured_ms": entry["command_delay_s"] * 1e3, "arms": arms})
        runs.append(
            {
                "name": entry["name"],
                "plant": "",
                "variant": entry["name"],
                "repeat": 1,
                "metrics": metrics,
                "arms": arms,
                "faults": entry["faults"],
                "interventions": entry["interventions"],
            }
        )
    inside_traces = in_manager.load(plan, folder)
    inside = {name: in_manager.figures(of_it) for name, of_it in inside_traces.items()}
    switching = performance_metrics.switching_figures(plan["switching"]) if plan.get("switching") else None
    if switching:
        runs.append(
            {
                "name": "switching",
                "plant": "",
                "variant": "switching",
                "repeat": 1,
                "metrics": switching["metrics"],
                "arms": {},
                "faults": switching["faults"],
                "interventions": [],
            }
        )
    variants = _variants(plan)
    rows = verdicts.judge(plan["limits"], runs, variants, [""])
    problems = [verdicts.sentence(row, _label) for row in rows if not row["passed"]]
    problems += [f"{run['name']}: {fault}" for run in runs for fault in run["faults"]]
    problems += [
        f"{e['name']}: the motion generator ended before the run ({e['generator'].get('ended_by')})"
        for e in plan["runs"]
        if not e["generator_lasted"]
    ]
    results = {
        "name": plan["name"],
        "title": plan["title"],
        "kind": plan["kind"],
        "passed": not problems,
        "problems": problems,
        "repeats": plan["repeats"],
        "seed": plan["seed"],
        "fast": plan["fast"],
        "backend": plan.get("backend", "mujoco"),
        "pace": plan.get("pace", "realtime"),
        "generator": plan.get("generator", "socket"),
        "duration_s": plan["duration_s"],
        "limits": rows,
        "runs": runs,
        "conditions": conditions,
        "manager": inside,
        "manager_remarks": in_manager.remarks(inside_traces, by_condition, plan["machine"]),
        "delay_checks": checks,
        "switching": switching,
        "added_us": _added(conditions),
        "disturbances": disturbances(plan, conditions),
        "published": plan["published"],
        "machine": plan["machine"],
    }
    arms = plan["runs"][0]["arms"]
    figures = {}
    for name, function, arguments in (
        ("index", performance_plots.like_the_paper, (conditions, arms)),
        ("stages", performance_plots.stages, (conditions,)),
        ("tails", performance_plots.tails, (by_condition,)),
        ("usage", performance_plots.usage, (by_condition,)),
        ("delays", performance_plots.delay_checks, ([(c["configured_ms"], c["arms"]) for c in checks],)),
        ("switching", performance_plots.switching, (plan["switching"],) if switching else None),
    ):
        figures[name] = function(*arguments) if arguments is not None else None
    if inside:
        figures |= in_manager.draw(conditions, by_condition, inside, inside_traces)
    drawn = {}
    for name, figure in figures.items():
        if figure is None:
            continue
        figure.savefig(folder / f"{name}.png", dpi=style.DPI)
        performance_plots.plt.close(figure)
        drawn[name] = folder / f"{name}.png"
    frame.write(folder, plan, results, _sections(plan, results, variants, drawn))
    return results


def _added(conditions):
    """Medians against the first condition: what each feature adds [us]."""
    names = list(conditions)
    base = conditions[names[0]]["control_us"]["median"]
    return {name: conditions[name]["control_us"]["median"] - base for name in names[1:]}


# Page ---------------------------------------------------------------------------------------------------------------


def _sections(plan, results, variants, drawn):
    def shown(name, caption):
        return [page.image(drawn[name], caption)] if name in drawn else []

    conditions = results["conditions"]
    first = next(iter(conditions.values()))
    length = (
        f"{plan['duration_s']:g} s per condition, {sum(c['cycles'] for c in conditions.values())} cycles in all"
        + (", shortened (--fast)" if plan["fast"] else "")
    )
    boxes = "Box: quarters; whiskers: 1 and 99 %; line: median; diamond: mean."
    sections = [
        (
            "verdict",
            "Verdict",
            [
                *frame.verdict({**results, "fast": False}),
                page.paragraph(f"{length}."),
                *_disturbed(results),
                *shown("index", f"The three panels of the paper's figure, as distributions. {boxes}"),
                _paper_table(plan, results),
                *_limit_table(results, variants),
            ],
        )
    ]
    sections.append(
        (
            "cycle",
            "Cycle time",
            [
                page.paragraph(
                    "Control function: from the start of a step until the torques of all arms are computed, including "
                    "models and observers, as the paper "
                    "measured it. Whole step: also stores the records. Start deviation: deviation of the time "
                    "between two cycle "
                    "starts from one period. Bare mathematics: the law of the first condition for both arms with "
                    "Pinocchio and Eigen alone, once per millisecond just before and after the condition."
                ),
                _cycle_table(conditions),
                *shown("stages", "Medians of the stages of a step."),
                _acting(conditions),
                *shown("tails", "Fraction of the cycles above a value, down to the worst one. Dashed: one period."),
            ],
        )
    )
    sections.append(
        (
            "delay",
            "Command delay",
            [
                page.paragraph(
                    _way(plan)
                    + (
                        ""
                        if plan.get("backend") == "fci"
                        else f"The arms use a torque {first['configured_delay_ms']:g} ms after it was sent (fidelity "
                        f"set {plan['runs'][0]['plant']}). "
                    )
                    + "Two measurements: (a) as in the "
                    "paper: torques sent and torques in use, interpolated linearly over the union of their time "
                    "stamps, "
                    "then cross-correlated, here for each "
                    "second; (b) cycle by cycle: the packet, by its sequence number, that reports the torque that "
                    "was sent. " + _meaning(plan)
                ),
                _delay_table(conditions),
                *shown("delays", "Plants with known delays, and the delays that both methods find."),
            ],
        )
    )
    sections.append(
        (
            "load",
            "CPU and memory",
            [
                page.paragraph(
                    f"Sampled every {_interval(plan):g} s from /proc. The control process consists of the loop, "
                    "the simulation "
                    f"of both arms, {_input(plan)} and this measurement (about "
                    f"{_trace_mb(plan):.0f} MB). Its memory is locked, so all of it counts as resident. One process "
                    "runs all conditions; memory that it "
                    "keeps after one condition counts in the next. The generator is a separate process. Control: the "
                    "mean step of every cycle, over the period; the rest is the simulation, the pacing and this "
                    "measurement. With --backend fci and virtual arms of another process, no simulation is in it."
                ),
                _load_table(conditions),
                *shown("usage", "First repeat of each condition."),
            ],
        )
    )
    if results["switching"]:
        sections.append(
            (
                "switching",
                "Switching",
                [
                    *_switch_text(results["switching"]),
                    _switch_table(results["switching"]),
                    *shown(
                        "switching",
                        "Each trial starts at a random moment of the cycle, seeded. Band: the paper's mean and "
                        "standard "
                        "deviation.",
                    ),
                ],
            )
        )
    if results["manager"]:
        sections.append(in_manager.section(conditions, results["manager"], results["manager_remarks"], drawn))
    sections.append(
        (
            "how",
            "How it was measured",
            [
                _generator_table(plan, conditions),
                *frame.how({**plan, "measure": None})[:1],
                page.details("Scene of the first condition", page.preformatted(plan["runs"][0]["scene_text"])),
            ],
        )
    )
    return sections


def _interval(plan):
    rows = plan["runs"][0]["usage"]
    return round((rows[-1][0] - rows[0][0]) / (len(rows) - 1), 2) if len(rows) > 1 else 0.3


def _trace_mb(plan):
    per_cycle = 5 * 16 * 8 * len(plan["runs"][0]["arms"]) + 120
    return plan["runs"][0]["wanted_samples"] * per_cycle / 2**20


def _disturbed(results):
    if not results["disturbances"]:
        return []
    return [page.Raw("<h3>Disturbances by the machine</h3>"), page.box(results["disturbances"])]


def _range(values, digits=3):
    low, high = page.figures(min(values), digits), page.figures(max(values), digits)
    return low if low == high else f"{low} to {high}"


def _paper_table(plan, results):
    conditions, added = results["conditions"], results["added_us"]
    ours = {"control_us": f"{_us(next(iter(conditions.values()))['control_us'])} µs median ({next(iter(conditions))})"}
    delays = [d["sequence_ms"]["mean"] for c in conditions.values() for d in c["delay"].values() if d["sequence_ms"]]
    whole = [c["whole_us"]["median"] for c in conditions.values()]
    if delays:
        ours["delay_ms"] = (
            f"{_range(delays)} ms, end to end"
            if plan.get("backend") == "fci"
            else f"{_range(delays)} ms by the plant, as configured; computing adds {_range(whole)} µs on an arm"
        )
    first = next(iter(conditions))
    parts = [
        f"{name} {_us(conditions[name]['stages_us']['features'])} µs ({added[name]:+.1f} µs against {first})"
        for name in added
    ]
    if parts:
        ours["manipulability_us"] = "stage of the features, median (the whole control function): " + ", ".join(parts)
    switching = results["switching"]
    if switching and switching["controllet"]["received_to_first_torque_ms"]:
        f = switching["controllet"]["received_to_first_torque_ms"]
        ours["switch_ms"] = (
            f"{f['mean']:.3f} ± {f['deviation']:.3f} ms; in the next cycle "
            f"{switching['controllet']['in_the_next_cycle']} of "
            f"{switching['controllet']['trials']}"
        )
    memory = [c["usage"] for c in conditions.values() if c["usage"].get("memory_mb")]
    if memory:
        ours["memory_percent"] = (
            f"{_range([u['memory_percent']['median'] for u in memory], 2)} % of "
            f"{float(plan['machine']['memory_mb']) / 1024:.0f} GB "
            f"({_range([u['memory_mb']['median'] for u in memory])} MB)"
        )
    cpu = [c["usage"]["process_percent"]["median"] for c in conditions.values() if c["usage"].get("process_percent")]
    rows = [[line["text"], ours.get(line["metric"])] for line in plan["published"]]
    if cpu:
        simulation = "" if plan.get("backend") == "fci" else ", simulation included"
        rows.append(["CPU of one core: small in the paper, which gives no number.", f"{_range(cpu, 2)} %{simulation}"])
    return page.Raw(
        "<h3>Comparison with the paper</h3>"
        + page.table(["the paper: two real arms, a 16-core mini PC", "this run"], rows)
        + page.paragraph("The paper used another computer, so times are comparable only in their order of magnitude.")
    )


def _limit_table(results, variants):
    labels = {v["name"]: v["label"] for v in variants}
    rows, bad = [], []
    for i, row in enumerate(results["limits"]):
        what, unit = LABELS.get(row["metric"], (row["metric"], ""))
        rows.append(
            [
                what,
                labels[row["variant"]],
                f"{'≤' if row['bound'] == 'at_most' else '≥'} {page.figures(row['limit'])} {unit}",
                None if row["worst"] is None else f"{page.figures(row['worst'])} {unit}",
                "held" if row["passed"] else "missed",
            ]
        )
        if not row["passed"]:
            bad.append(i)
    return (
        [
            page.details(
                f"All {len(rows)} limits", page.table(["figure", "of", "limit", "worst repeat", ""], rows, (2, 3), bad)
            )
        ]
        if rows
        else []
    )


def _cycle_table(conditions):
    rows = []
    for name, c in conditions.items():
        for what, f in (
            ("control function", c["control_us"]),
            ("whole step", c["whole_us"]),
            ("start deviation", c["jitter_us"]),
        ):
            ratio = f["median"] / c["bare_us"] if what == "control function" and f and c["bare_us"] else None
            rows.append(
                [
                    name if what == "control function" else "",
                    what,
                    *(_us(f, key) for key in ("median", "mean", "p99", "p999", "worst")),
                    page.figures(ratio) if ratio else "",
                    str(f["count"]) if f else None,
                    str(c["cycles_lost"]) if what == "start deviation" else "",
                ]
            )
    return page.table(
        ["condition", "[µs]", "median", "mean", "99 %", "99.9 %", "worst", "over bare", "cycles", "lost"],
        rows,
        range(2, 10),
    )


def _acting(conditions):
    rows = []
    for name, c in conditions.items():
        f = c["features"]
        near = f.get("control_three_pairs_us")
        rows.append(
            [
                name,
                f"{100 * f['acting_share']:.0f} %",
                f"{f['largest_torque_nm']:.2f} N m",
                str(f["pairs_largest"]) if "pairs_largest" in f else "–",
                f"{100 * f['three_pairs_share']:.0f} %" if "three_pairs_share" in f else "–",
                f"{_us(near)} µs ({near['count']} cycles)" if near else "–",
                f"{f['manipulability_least']:.3f}" if "manipulability_least" in f else "–",
            ]
        )
    return page.Raw(
        "<h3>Features at work</h3>"
        + page.table(
            [
                "condition",
                "cycles with a torque of a feature",
                "largest",
                "most pairs in range",
                "three or more pairs",
                "control function in these cycles, median",
                "least manipulability m",
            ],
            rows,
            range(1, 7),
        )
    )


def _input(plan):
    return "ROS adapter and live input" if plan.get("generator") == "ros" else "live input"


def _way(plan):
    if plan.get("backend") == "fci":
        return frame.arms_sentence(plan) + " End to end, per arm: client, network, arm, and back. "
    if plan.get("backend") != "virtual":
        return ""
    return (
        "End to end, per arm: client, sockets, virtual arm, and back; every torque and every state went over the wire. "
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
            "and of "
            "injected network faults, not of the computer."
        )
    if plan.get("backend") == "virtual":
        return (
            "The conditions run in real time: a torque that arrives too late for its period is used in a later one, "
            "or never ('not found'). The plants with known "
            "delays run in lock-step."
        )
    return (
        "In lock-step the world is paused while the controller computes, so the measured delay is that of the plant "
        "alone; on an arm the time of the whole step is added."
    )


def _delay_table(conditions):
    rows = []
    for name, c in conditions.items():
        for i, (arm, d) in enumerate(c["delay"].items()):
            a, b = d["correlation_ms"], d["sequence_ms"]
            rows.append(
                [
                    name if i == 0 else "",
                    arm,
                    f"{c['configured_delay_ms']:g}",
                    f"{a['median']:.4f}" if a else None,
                    f"{a['least']:.4f} … {a['worst']:.4f}" if a else None,
                    f"{a['median'] - c['configured_delay_ms']:.4f}" if a else None,
                    f"{b['mean']:.4f}" if b else None,
                    f"{b['least']:.4f} … {b['worst']:.4f}" if b else None,
                    str(b["count"]) if b else "0",
                    str(d["unmatched"]),
                ]
            )
    return page.table(
        [
            "condition",
            "arm",
            "configured [ms]",
            "correlation, median [ms]",
            "its windows [ms]",
            "median beyond the plant [ms]",
            "sequence number, mean [ms]",
            "its cycles [ms]",
            "torques found",
            "not found",
        ],
        rows,
        range(2, 10),
    )


def _load_table(conditions):
    rows = []
    for name, c in conditions.items():
        u = c["usage"]
        if u.get("process_percent") is None:
            continue
        rows.append(
            [
                name,
                f"{u['process_percent']['median']:.1f} ({u['process_percent']['p1']:.1f} … "
                f"{u['process_percent']['p99']:.1f})",
                f"{u['loop_percent']['median']:.1f}",
                f"{c['control_percent']:.1f}",
                f"{max(u['process_percent']['mean'] - c['control_percent'], 0):.1f}",
                f"{u['generator_percent']['median']:.1f}",
                f"{u['others_percent']['mean']:.0f}",
                f"{u['loop_waited_percent']['mean']:.2f}",
                f"{u['memory_mb']['median']:.0f} ({u['memory_percent']['median']:.2f} %)",
                str(u["process_percent"]["count"]),
            ]
        )
    return page.table(
        [
            "condition",
            "control process [%]",
            "its loop [%]",
            "control [%]",
            "simulation and the rest [%]",
            "generator [%]",
            "everybody else [%]",
            "loop waited for a core [%]",
            "memory [MB]",
            "readings",
        ],
        rows,
        range(1, 10),
    )


def _switch_text(s):
    different = s["bystander_different"]
    if not s["bystander_cycles"]:
        return [
            page.paragraph(
                "A request that arrives during a cycle is taken at the next boundary; the new law gives its first "
                "torque in that same cycle. Arms cannot repeat a run to the bit, so the third arm of the scene was "
                "not compared."
            )
        ]
    same = (
        f"identical to the bit in all {s['bystander_cycles']} cycles to a run in which nothing was switched"
        if different == 0
        else f"different in {different} of {s['bystander_cycles']} cycles from a run in which nothing was switched"
    )
    return [
        page.paragraph(
            "A request that arrives during a cycle is taken at the next boundary; the new law gives its first "
            "torque in "
            "that same cycle. The third arm of the scene "
            f"({s['bystander']}), which no request concerns, is {same}: positions, measured torques, torques sent and "
            "in use."
        )
    ]


def _switch_table(s):
    rows = []
    for kind in ("controllet", "feature"):
        k = s[kind]
        row = [kind, str(k["trials"]), f"{k['in_the_next_cycle']} of {k['trials']}"]
        for name, unit in (
            ("received_to_taken_ms", 1),
            ("taken_to_first_torque_ms", 1),
            ("received_to_first_torque_ms", 1),
        ):
            f = k[name]
            row.append(f"{f['mean']:.3f} ± {f['deviation']:.3f} ({f['worst']:.3f})" if f else None)
        row.append(f"{k['torque_step_nm']['worst']:.2f}" if k["torque_step_nm"] and kind == "controllet" else "–")
        rows.append(row)
    return page.table(
        [
            "switch of a",
            "trials",
            "in the next cycle",
            "request to taken [ms]",
            "taken to first torque [ms]",
            "request to first torque [ms]",
            "largest step [N m]",
        ],
        rows,
        range(1, 7),
    ) + page.paragraph("Mean ± standard deviation (worst).")


def _generator_table(plan, conditions):
    rows = []
    for name, c in conditions.items():
        for g in c["generator"]:
            channels = g.get("channels") or [{}]
            late = g.get("late_us", {})
            rows.append(
                [
                    name,
                    f"{g.get('rate_hz', 0):.2f}",
                    str(g.get("samples")),
                    str(g.get("missed")),
                    str(g.get("unsent")),
                    str(sum(x.get("received", 0) for x in channels)),
                    str(sum(x.get("lost", 0) for x in channels)),
                    page.figures(late.get("median")),
                    page.figures(late.get("p99")),
                    page.figures(late.get("worst")),
                ]
            )
    way = (
        "Its set-points come by ROS topics (DDS, shared memory of this machine). A run reads the newest message "
        "of each "
        "topic, so an older unread one counts as lost."
        if plan.get("generator") == "ros"
        else "Its set-points come by packets over the run's live-input socket."
    )
    return page.Raw(
        "<h3>Motion generator</h3>"
        + page.paragraph(way)
        + page.table(
            [
                "condition",
                "rate [Hz]",
                "periods",
                "missed",
                "no room",
                "received",
                "lost on the way",
                "late, median [µs]",
                "99 %",
                "worst",
            ],
            rows,
            range(1, 10),
        )
    )
