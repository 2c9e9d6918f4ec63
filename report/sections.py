"""The sections of the report, made from figures (metrics) and plots."""

from report import metrics, page, series
from report.page import Raw, known

LISTED = 200  # interventions, and events
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
PLANT_FACTS = {
    "joint_friction": "Joint friction",
    "torque_bandwidth_hz": "Torque tracking bandwidth [Hz]",
    "command_delay_s": "Command delay [s]",
    "noise_q_rad": "Noise of q [rad]",
    "noise_dq_rad_per_s": "Noise of q̇ [rad/s]",
    "noise_tau_nm": "Noise of τ [N m]",
    "substeps": "Physics steps per cycle",
}
DEGREES = 57.29577951308232


def _or_unknown(value, shown="{}"):
    return "not available" if value is None else shown.format(value)


def glance(run):
    counts, times, factor = metrics.cycle_counts(run), metrics.cycle_times(run), metrics.realtime_factor(run)
    end = run.meta.get("missing")
    dropped = int(end.get("cycles_lost") or 0) if end is not None else counts["missing"]
    accepted, interventions = sum(bool(s.get("accepted")) for s in run.switches), len(run.interventions)
    pace = (
        "Paced to the wall clock."
        if metrics.is_paced(run)
        else f"Not paced to the wall clock: {known(factor)} × real time."
    )
    absent = metrics.missing(run)
    return [
        page.tiles(
            (_or_unknown(metrics.duration(run), "{:.3f} s"), "duration"),
            (_or_unknown(metrics.loop_rate(run), "{:.1f} Hz"), "control rate, computer's clock"),
            (_or_unknown(counts["recorded"], "{:,}").replace(",", " "), "cycles recorded"),
            (_or_unknown(counts["overruns"]), "overruns", counts["overruns"]),
            (_or_unknown(dropped), "cycle records dropped", dropped),
            (f"{accepted} / {len(run.switches)}", "switches accepted / requested"),
            (interventions, "episodes of safety interventions", interventions),
            *((f"{1e6 * value:.1f} µs", f"cycle, {name}") for name, value in (times or {}).items()),
        ),
        pace if factor is not None else None,
        page.heading("What is missing"),
        page.box(absent or ["Nothing is known to be missing from the log."], fine=not absent),
    ]


def largest_errors(run):
    worst = {arm: metrics.largest_errors(run, arm) for arm in run.arms}
    cells = {
        "arm": lambda arm: arm,
        "position of E [mm]": lambda arm: known(worst[arm]["position"], 1e3),
        "orientation of E [deg]": lambda arm: known(worst[arm]["rotation"], DEGREES),
        "joint [mrad]": lambda arm: known(worst[arm]["joint"], 1e3),
    }
    return [
        page.heading("Largest tracking errors"),
        page.columns(run.arms, cells),
        "n/a, not available: no controllet of that arm had such a target, or it was not logged.",
    ]


def _answer(switch):
    if not switch["accepted"]:
        return switch["text"]
    _, because, reason = switch["text"].partition("because of ")
    return "accepted" if switch["request"] else ("by the loop: " + reason if because else "by the loop")


def _torque_steps(switch):
    steps = []
    for arm, requested, sent in zip(switch["arms"], switch["torque_step_computed"], switch["torque_step"]):
        known = requested is not None and sent is not None
        steps.append(f"{arm}: {requested:.2f} / {sent:.2f}" if known else f"{arm}: not measured")
    return Raw("<br>".join(f'<span class="one">{page.escape(step)}</span>' for step in steps) or "–")


def _times(switch):
    return "–" if switch["total"] is None else f"0 → {1e3 * switch['waiting']:.3f} → {1e3 * switch['total']:.3f}"


def switches(run, colors):
    if not run.switches:
        return page.absent("The log has no switches.")
    cells = {
        "t [s]": lambda s: f"{s['stamp']:.3f}",
        "started": lambda s: page.chips(s["started"], colors),
        "stopped": lambda s: page.chips(s["stopped"], colors),
        "kept": lambda s: page.chips(s["kept"], colors),
        "received → taken → first torque [ms]": _times,
        "torque step computed / sent [N m]": _torque_steps,
        "answer": _answer,
    }
    return [
        page.columns(metrics.switch_rows(run), cells, bad=lambda s: not s["accepted"]),
        "Received: zero. Taken: start of the cycle that took the request. First torque: of the new controllet, as "
        "written to the arm. Torque step: the largest step of one joint's torque at the hand-over, as the new "
        "controllet computed it, and as sent after the torque-rate limit. “–” in place of times: the switch was not "
        "requested but caused by the loop or the timeline.",
    ]


def interventions(run):
    groups, units = metrics.intervention_groups(run), run.meta.get("intervention_units") or {}
    if not groups:
        return page.absent("The safety stage did not intervene.")

    def value(key):
        return lambda m: "–" if m[key] is None else f"{page.figures(m[key])} {units.get(m['code'], '')}".strip()

    where = {
        "rule": lambda m: m["code"],
        "arm": lambda m: m["arm"] or "–",
        "controllet": lambda m: m["instance"] or "–",
    }
    grouped = where | {
        "episodes": lambda g: g["count"],
        "first t [s]": lambda g: f"{g['first']:.3f}",
        "last t [s]": lambda g: f"{g['last']:.3f}",
        "joints": lambda g: ", ".join(str(j + 1) for j in sorted(g["joints"])) or "–",
        "largest value": value("value"),
        "limit": value("limit"),
    }
    single = {"t [s]": lambda m: f"{m['stamp']:.3f}"} | where
    single["joint"] = lambda m: m["joint"] + 1 if m["joint"] >= 0 else "–"
    single |= {"value": value("value"), "limit": value("limit")}
    listed = run.interventions[:LISTED]
    title = f"Individual interventions ({len(listed)} of {len(run.interventions)})"
    return [page.columns(groups, grouped), page.details(title, page.columns(listed, single))]


def tracking(run, colors):
    rows = [row for arm in run.arms for row in metrics.tracking(run, arm)]
    if not rows:
        return page.absent("Tracking is not available: the log has no commands.")
    cells = {
        "arm": lambda row: row["arm"],
        "controllet": lambda row: page.chips([row["instance"]], colors),
        "active [s]": lambda row: f"{row['active']:.2f}",
        "position max [mm]": lambda row: known(row["position_max"], 1e3),
        "position RMS [mm]": lambda row: known(row["position_rms"], 1e3),
        "orientation max [deg]": lambda row: known(row["rotation_max"], DEGREES),
        "orientation RMS [deg]": lambda row: known(row["rotation_rms"], DEGREES),
        "joint max [mrad]": lambda row: known(row["joint_max"], 1e3),
    }
    return [
        page.columns(rows, cells),
        "Target after interpolation minus actual, while that controllet owned the arm; norms over x, y, z. n/a, not "
        "available: it has no such target, or the target belongs to several arms together.",
    ]


def effort(run):
    def of_joint(key, text):
        return lambda e: e[key] and f"{text(e[key][0])} (joint {e[key][1] + 1})"

    cells = {
        "arm": lambda e: e["arm"],
        "largest torque / limit": of_joint("torque", lambda share: f"{100 * share:.1f} %"),
        "largest speed / limit": of_joint("speed", lambda share: f"{100 * share:.1f} %"),
        "nearest to a joint limit": of_joint("joint_margin", lambda margin: f"{known(margin)} rad"),
        "least manipulability": lambda e: known(e["manipulability_min"]),
        "largest force, estimated [N]": lambda e: known(e["force_estimated"]),
        "largest force, simulator [N]": lambda e: known(e["force_contact"]),
    }
    rows = [{"arm": arm, **metrics.effort(run, arm)} for arm in run.arms]
    return [page.heading("How close to the limits"), page.columns(rows, cells)]


def events(run):
    if not run.events:
        return page.absent("The log has no other events.")
    listed = run.events[:LISTED]
    cells = {
        "t [s]": lambda e: f"{e['stamp']:.3f}",
        "event": lambda e: e["kind"].replace("_", " "),
        "what": lambda e: e["text"] or "–",
        "answer": lambda e: e["verdict"],
    }
    title = f"Targets, parameters, features, stops ({len(listed)} of {len(run.events)})"
    return page.details(title, page.columns(listed, cells))


def plant(run):
    fidelity = run.meta.get("plant")
    if not fidelity:
        return page.absent("The log does not name the plant fidelity set.")

    def shown(key, value):
        if isinstance(value, bool):
            return "of the robot model's table" if value else "none"
        if value == 0 and key != "substeps":
            return "perfect" if key == "torque_bandwidth_hz" else "none"
        return f"{value:g}" if isinstance(value, (int, float)) else value

    name = fidelity.get("name", "not named")
    rows = [(label, shown(key, fidelity[key])) for key, label in PLANT_FACTS.items() if key in fidelity]
    return [f"Plant fidelity set: {name}.", page.facts([("Set", name), *rows])]


def machine(run):
    info, tool = run.meta.get("run") or {}, run.meta.get("report") or {}
    order = {key: i for i, key in enumerate(RUN_FACTS)}
    rows = [
        (
            RUN_FACTS.get(key, key.replace("_", " ").capitalize()),
            page.preformatted(value) if "\n" in str(value) else value,
        )
        for key, value in sorted(info.items(), key=lambda item: (order.get(item[0], 99), item[0]))
    ]
    parts = [page.facts(rows)] if info else [page.absent("Machine, versions and thread set-up are not in the log.")]
    if info and not any("thread" in key for key in info):
        parts.append(page.absent("The thread set-up (memory lock, priority, affinity) is not in the log."))
    if run.meta.get("scene_text"):
        parts.append(page.details("Scene file", page.preformatted(run.meta["scene_text"])))
    made = ", ".join(f"{key} {value}" for key, value in tool.items())
    return [*parts, f"This page was made {made}." if tool else None]


DECIMATION = (
    f"Long series are drawn as the smallest and largest value of each of {series.COLUMNS} equal pieces: no peak is "
    "lost. Dashed gray lines: the arm changed its owner. Orange: the safety stage intervened. The bands at the top "
    "name the active controllet."
)
