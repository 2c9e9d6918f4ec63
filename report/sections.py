"""The sections of the report: turn figures (metrics) and plots into parts of the page."""

import math

from report import metrics, page, series
from report.page import Raw, figures

LISTED_INTERVENTIONS, LISTED_EVENTS = 200, 200
RUN_FACTS = {
    "scene": "Scene",
    "scene_path": "Scene file",
    "start": "Started",
    "seed": "Seed",
    "plant": "Plant fidelity",
    "paced": "Paced to the wall clock",
    "threads": "Thread set-up",
    "multipanda": "multipanda",
    "version": "multipanda",
    "mujoco": "MuJoCo",
    "eigen": "Eigen",
    "compiler": "Compiler",
    "processor": "Processor",
    "cpu": "Processor",
    "cores": "Processor cores",
    "kernel": "Kernel",
    "machine": "Architecture",
}


def _milli(seconds, digits=3):
    return figures(1e3 * seconds, digits) if seconds is not None and math.isfinite(seconds) else None


def _micro(seconds):
    return f"{1e6 * seconds:.1f}" if seconds is not None else None


def _degrees(radians):
    return figures(math.degrees(radians)) if radians is not None else None


def _with_unit(text, unit):
    return f"{text} {unit}" if text is not None else "not available"


def glance(run):
    counts, times, rate = metrics.cycle_counts(run), metrics.cycle_times(run), metrics.loop_rate(run)
    end = run.meta.get("missing")
    interventions = len(run.interventions)
    accepted = sum(bool(s.get("accepted")) for s in run.switches)
    dropped = int(end.get("cycles_lost") or 0) if end is not None else counts["missing"]
    span = metrics.duration(run)
    entries = [
        (_with_unit(f"{span:.3f}" if span is not None else None, "s"), "duration", False),
        (_with_unit(f"{rate:.1f}" if rate is not None else None, "Hz"), "control rate, computer's clock", False),
        (
            f"{counts['recorded']:,}".replace(",", " ") if counts["recorded"] is not None else "not available",
            "cycles recorded",
            False,
        ),
        ("not available" if counts["overruns"] is None else counts["overruns"], "overruns", bool(counts["overruns"])),
        ("not available" if dropped is None else dropped, "cycle records dropped", bool(dropped)),
        (f"{accepted} / {len(run.switches)}", "switches accepted / requested", False),
        (interventions, "episodes of safety interventions", interventions > 0),
    ]
    if times is not None:
        entries += [
            (f"{1e6 * times[key]:.1f} µs", f"cycle, {name}", False)
            for key, name in (("p50", "median"), ("p99", "p99"), ("p99.9", "p99.9"), ("max", "worst"))
        ]
    parts = [page.tiles(entries)]
    factor = metrics.realtime_factor(run)
    if factor is not None:
        parts.append(
            page.paragraph(
                "Paced to the wall clock."
                if metrics.is_paced(run)
                else f"Not paced to the wall clock: {figures(factor)} × real time."
            )
        )
    absent = metrics.missing(run)
    parts.append(Raw("<h3>What is missing</h3>"))
    parts.append(page.box(absent or ["Nothing is known to be missing from the log."], fine=not absent))
    return parts


def largest_errors(run):
    rows = []
    for arm in run.arms:
        worst = metrics.largest_errors(run, arm)
        rows.append([arm, _milli(worst["position"]), _degrees(worst["rotation"]), _milli(worst["joint"])])
    return [
        Raw("<h3>Largest tracking errors</h3>"),
        page.table(["arm", "position of E [mm]", "orientation of E [deg]", "joint [mrad]"], rows, numeric=(1, 2, 3)),
        page.paragraph("n/a, not available: no controllet of that arm had such a target, or it was not logged."),
    ]


def _answer(switch):
    if not switch["accepted"]:
        return switch["text"]
    _, because, reason = switch["text"].partition("because of ")
    return "accepted" if switch["request"] else ("by the loop: " + reason if because else "by the loop")


def switches(run, colors):
    rows = metrics.switch_rows(run)
    if not rows:
        return [page.absent("No switch is in the log.")]
    out, bad = [], []
    for n, s in enumerate(rows):
        steps = []
        for arm, requested, sent in zip(s["arms"], s["torque_step_wanted"], s["torque_step"]):
            known = requested is not None and sent is not None
            steps.append(f"{arm}: " + (f"{requested:.2f} / {sent:.2f}" if known else "not measured"))
        asked = s["total"] is not None
        if not s["accepted"]:
            bad.append(n)
        out.append(
            [
                f"{s['stamp']:.3f}",
                page.chips(s["started"], colors),
                page.chips(s["stopped"], colors),
                page.chips(s["kept"], colors),
                f"0 → {1e3 * s['waiting']:.3f} → {1e3 * s['total']:.3f}" if asked else "–",
                Raw("<br>".join(f'<span class="one">{page.escape(step)}</span>' for step in steps) or "–"),
                _answer(s),
            ]
        )
    return [
        page.table(
            [
                "t [s]",
                "started",
                "stopped",
                "kept",
                "received → taken → first torque [ms]",
                "torque step computed / sent [N m]",
                "answer",
            ],
            out,
            numeric=(0, 4),
            bad=bad,
        ),
        page.paragraph(
            "Received: zero. Taken: start of the cycle that took the request. First torque: of the new controllet, as "
            "written to the "
            "arm. Torque step: the largest step of one joint's torque at the hand-over, as the new controllet "
            "computed it, "
            "and as sent after the torque-rate limit. “–” in place of the times: there was no request for this switch; "
            "the loop itself or the scene's timeline caused it."
        ),
    ]


def _value(value, unit):
    return "–" if value is None else (f"{figures(value)} {unit}".strip())


def interventions(run):
    groups = metrics.intervention_groups(run)
    if not groups:
        return [page.absent("The safety stage did not intervene.")]
    units = run.meta.get("intervention_units") or {}
    rows = []
    for g in groups:
        unit = units.get(g["code"], "")
        joints = ", ".join(str(j + 1) for j in sorted(g["joints"])) or "–"
        rows.append(
            [
                g["code"],
                g["arm"] or "–",
                g["instance"] or "–",
                g["count"],
                f"{g['first']:.3f}",
                f"{g['last']:.3f}",
                joints,
                _value(g["value"], unit),
                _value(g["limit"], unit),
            ]
        )
    parts = [
        page.table(
            ["rule", "arm", "controllet", "episodes", "first t [s]", "last t [s]", "joints", "largest value", "limit"],
            rows,
            numeric=(3, 4, 5),
        )
    ]
    listed = run.interventions[:LISTED_INTERVENTIONS]
    rows = [
        [
            f"{m['stamp']:.3f}",
            m["code"],
            m["arm"] or "–",
            m["instance"] or "–",
            m["joint"] + 1 if m["joint"] >= 0 else "–",
            _value(m["value"], units.get(m["code"], "")),
            _value(m["limit"], units.get(m["code"], "")),
        ]
        for m in listed
    ]
    title = f"Individual interventions ({len(listed)} of {len(run.interventions)})"
    parts.append(
        page.details(
            title, page.table(["t [s]", "rule", "arm", "controllet", "joint", "value", "limit"], rows, numeric=(0,))
        )
    )
    return parts


def tracking(run, colors):
    rows = []
    for arm in run.arms:
        for row in metrics.tracking(run, arm):
            rows.append(
                [
                    arm,
                    page.chips([row["instance"]], colors),
                    f"{row['active']:.2f}",
                    _milli(row["position_max"]),
                    _milli(row["position_rms"]),
                    _degrees(row["rotation_max"]),
                    _degrees(row["rotation_rms"]),
                    _milli(row["joint_max"]),
                ]
            )
    if not rows:
        return [page.absent("Tracking is not available: no command is in the log.")]
    return [
        page.table(
            [
                "arm",
                "controllet",
                "active [s]",
                "position max [mm]",
                "position RMS [mm]",
                "orientation max [deg]",
                "orientation RMS [deg]",
                "joint max [mrad]",
            ],
            rows,
            numeric=(2, 3, 4, 5, 6, 7),
        ),
        page.paragraph(
            "Target after interpolation minus actual, while that controllet owned the arm; norms over x, y, z. "
            "n/a, not available: it has no such target, or the target belongs to several arms together."
        ),
    ]


def effort(run):
    def share(found):
        return f"{100 * found[0]:.1f} % (joint {found[1] + 1})" if found is not None else None

    rows = []
    for arm in run.arms:
        e = metrics.effort(run, arm)
        margin = (
            f"{figures(e['joint_margin'][0])} rad (joint {e['joint_margin'][1] + 1})" if e["joint_margin"] else None
        )
        rows.append(
            [
                arm,
                share(e["torque"]),
                share(e["speed"]),
                margin,
                figures(e["manipulability_min"]) if e["manipulability_min"] is not None else None,
                figures(e["force_estimated"]) if e["force_estimated"] is not None else None,
                figures(e["force_contact"]) if e["force_contact"] is not None else None,
            ]
        )
    return [
        Raw("<h3>How close to the limits</h3>"),
        page.table(
            [
                "arm",
                "largest torque / limit",
                "largest speed / limit",
                "nearest to a joint limit",
                "least manipulability",
                "largest force, estimated [N]",
                "largest force, simulator [N]",
            ],
            rows,
            numeric=(1, 2, 3, 4, 5, 6),
        ),
    ]


def events(run):
    if not run.events:
        return [page.absent("No other event is in the log.")]
    listed = run.events[:LISTED_EVENTS]
    rows = [[f"{e['stamp']:.3f}", e["kind"].replace("_", " "), e["text"] or "–", e["verdict"]] for e in listed]
    return [
        page.details(
            f"Targets, parameters, features, stops ({len(listed)} of {len(run.events)})",
            page.table(["t [s]", "event", "what", "answer"], rows, numeric=(0,)),
        )
    ]


def plant(run):
    fidelity = run.meta.get("plant")
    if not fidelity:
        return [page.absent("Which plant fidelity set was used is not in the log.")]
    known = {
        "joint_friction": "Joint friction",
        "torque_bandwidth_hz": "Torque tracking bandwidth [Hz]",
        "command_delay_s": "Command delay [s]",
        "noise_q_rad": "Noise of q [rad]",
        "noise_dq_rad_per_s": "Noise of q̇ [rad/s]",
        "noise_tau_nm": "Noise of τ [N m]",
        "substeps": "Physics steps per cycle",
    }
    name = fidelity.get("name", "not named")
    rows = [("Set", name)]
    for key, label in known.items():
        if key not in fidelity:
            continue
        value = fidelity[key]
        if isinstance(value, bool):
            value = "of the robot model's table" if value else "none"
        elif key == "torque_bandwidth_hz" and value == 0:
            value = "perfect"
        elif key != "substeps" and value == 0:
            value = "none"
        rows.append((label, f"{value:g}" if isinstance(value, (int, float)) else value))
    return [page.paragraph(f"Plant fidelity set: {name}."), page.facts(rows)]


def machine(run):
    info = run.meta.get("run") or {}
    if not info:
        parts = [page.absent("Machine, versions and thread set-up are not in the log.")]
    else:
        order = {key: i for i, key in enumerate(RUN_FACTS)}
        rows = [
            (
                RUN_FACTS.get(key, key.replace("_", " ").capitalize()),
                page.preformatted(value) if "\n" in str(value) else value,
            )
            for key, value in sorted(info.items(), key=lambda item: (order.get(item[0], 99), item[0]))
        ]
        parts = [page.facts(rows)]
        if not any("thread" in key for key in info):
            parts.append(page.absent("The thread set-up (memory lock, priority, affinity) is not in the log."))
    if run.meta.get("scene_text"):
        parts.append(page.details("Scene file", page.preformatted(run.meta["scene_text"])))
    tool = run.meta.get("report") or {}
    if tool:
        parts.append(
            page.paragraph("This page was made " + ", ".join(f"{key} {value}" for key, value in tool.items()) + ".")
        )
    return parts


def decimation_note():
    return page.paragraph(
        f"Long series are drawn as the smallest and largest value of each of {series.COLUMNS} equal pieces: no peak is "
        "lost. Dashed gray lines: the arm changed its owner. Orange: the safety stage intervened. The bands at the top "
        "name the active "
        "controllet."
    )
