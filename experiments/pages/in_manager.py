"""The controller inside a controller_manager: its measurement beside that of the program's own process."""

import json
import pathlib

import numpy as np

from experiments.pages import performance_metrics, performance_plots
from experiments.pages.performance_metrics import Trace
from report import page
from report.series import spread

OWN, INSIDE = "own process", "manager"
NOT_MEASURED = "not measured inside a controller_manager"
FORMAT = 1
NOT_INSIDE = {
    "simulation": ": the hardware's read() advances it, before update()",
    "CPU and memory of the control process": ": hardware and other controllers share the process",
    "the law alone, and the ratio to it": "",
    "plants with known delays": "",
    "switching of controllets and features": "",
    "motion generator": "; it prints its own report",
}


class InsideTrace(Trace):
    """Cycles that the multimode controller has recorded of itself, and their metadata `about`."""

    def __init__(self, entry, folder):
        super().__init__(entry, folder)
        file = pathlib.Path(folder) / entry["npz"]
        if "about" not in self.arrays:
            raise ValueError(f"{file}: expected a measurement by the multimode controller, found no array 'about'")
        self.about = json.loads(str(self["about"][0]))
        if self.about.get("format") != FORMAT:
            raise ValueError(
                f"{file}: expected format {FORMAT}, found {self.about.get('format')}; use the same version"
            )
        self.file = file
        self.entry = {**entry, "arms": self.about["arms"], "period_s": self.about["period_s"]}

    @property
    def missing(self):
        """Cycles between the first and the last one that are not in the file."""
        return int(self["cycle"][-1] - self["cycle"][0]) + 1 - len(self["cycle"])


def load(plan, folder):
    """The measurements of the plan by condition, in the order of its conditions."""
    traces = {}
    for condition in plan["conditions"]:
        of_it = [
            InsideTrace(entry, folder) for entry in plan.get("beside") or [] if entry["condition"] == condition["name"]
        ]
        if of_it:
            traces[condition["name"]] = of_it
    return traces


def _outputs(trace):
    """(controllet, feature, values) of each recorded output of a feature."""
    for name, values in trace.arrays.items():
        controllet, _, output = name.partition("/")
        if "." in output:
            yield controllet, output.partition(".")[0], values


def _running_features(trace):
    """Names of the features whose outputs were not all zero."""
    return {feature for _, feature, values in _outputs(trace) if np.any(np.nan_to_num(values))}


def unlike(name, trace, own, machine):
    """Differences between a measurement shown as condition `name` and that condition or its computer."""
    about, out = trace.about, []
    if about["condition"] != name:
        out.append(f"it was measured as the condition {about['condition']}")
    if trace.arms != own.arms:
        out.append(f"its arms are {', '.join(trace.arms)} instead of {', '.join(own.arms)}")
    if about["period_s"] != own.entry["period_s"]:
        out.append(f"its period is {1e3 * about['period_s']:g} ms instead of {1e3 * own.entry['period_s']:g} ms")
    if not about["controllet"]:
        out.append("it names no controllet, so its features are not known")
    else:
        expected = {controllet for controllet, _, _ in _outputs(own)}
        if expected and about["controllet"] not in expected:
            out.append(f"its controllet is {about['controllet']} instead of {', '.join(sorted(expected))}")
    if about["controllet"] and _running_features(trace) != _running_features(own):
        features = [", ".join(sorted(_running_features(t))) or "none" for t in (trace, own)]
        out.append(f"its features are {features[0]} instead of {features[1]}")
    there = about["machine"]
    out += [
        f"{key} {there.get(key)} instead of {machine.get(key)}"
        for key in ("processor", "cores", "kernel", "multipanda")
        if machine.get(key) != there.get(key)
    ]
    return out


def _delays(traces):
    """Per arm, repeats together; None: its hardware does not report the torque in use."""
    out = {}
    for arm in traces[0].arms:
        out[arm] = None
        if not all(arm in t.about["reports_command"] for t in traces):
            continue
        both = [t.delays(arm) for t in traces]
        cycles = np.concatenate([cycles for _, cycles in both])
        out[arm] = {
            "correlation_ms": spread(np.concatenate([w for w, _ in both]) * 1e3),
            "sequence_ms": spread(cycles * 1e3),
            "unmatched": int(np.sum(~np.isfinite(cycles))),
        }
    return out


def figures(traces):
    """Figures of one condition over all its measurements, under the names of performance_metrics.condition_figures."""
    return {
        **performance_metrics.cycle_figures(traces),
        "measurements": len(traces),
        "cycles_missing": sum(t.missing for t in traces),
        "full": sum(bool(t.about["full"]) for t in traces),
        "delay": _delays(traces),
        "scheduling": [t.about["scheduling"] for t in traces],
    }


def remarks(traces, own, machine):
    """Sentences by condition: differences of its measurements."""
    return {
        name: [
            f"{name}: {trace.file.name} is not of the same kind: {'; '.join(what)}."
            for trace in of_it
            if (what := unlike(name, trace, own[name][0], machine))
        ]
        for name, of_it in traces.items()
    }


def draw(own, own_traces, inside, inside_traces):
    """Pictures by name: stages and tails of each measured condition, in our own process and inside the manager."""
    both, traces = {}, {}
    for name in inside:
        for place, f, t in ((OWN, own, own_traces), (INSIDE, inside, inside_traces)):
            both[f"{name}, {place}"], traces[f"{name}, {place}"] = f[name], t[name]
    return {"manager_stages": performance_plots.stages(both), "manager_tails": performance_plots.tails(traces)}


# Page ---------------------------------------------------------------------------------------------------------------


def section(own, inside, remarks, drawn):
    """The section of the page; remarks: of each condition; drawn: path of each picture by name. Nothing is judged."""
    return (
        "Inside a controller_manager",
        "The same controller in another program's loop, measured by itself (parameter performance_trace): each "
        "update() of the multimode controller. Control function and whole step are defined as above; copying between "
        "the manager's interfaces and the controller is not in them, and with real arms neither is sending the "
        "torques, which another thread does there. Start deviation and lost cycles are those of update(): the "
        "manager's earlier work in the cycle counts, simulation included, and a late cycle counts as lost even if "
        "the manager catches up. The scene's bounds for contact hold there, so the hands may move and press less "
        "than in the own process, and a feature may have more or less to compute. Nothing here is judged.",
        page.box([line for name, f in inside.items() for line in [_summary(name, f), *remarks[name]]]),
        _cycle_table(own, inside),
        page.image(drawn["manager_stages"], "Medians of the stages of a step."),
        page.image(drawn["manager_tails"], "Fraction of the cycles above a value, down to the worst one."),
        page.heading("Command delay"),
        "From the torque that the controller has written for its hardware to the state that reports it as in use; the "
        "plant's own delay is in it and is not known to the controller. In lock-step with simulated arms it is that of "
        f"the plant alone. Hardware that does not report the torque in use: {NOT_MEASURED}.",
        _delay_table(own, inside),
        page.heading("What else this page shows"),
        page.table(["figure", INSIDE], [[what, f"{NOT_MEASURED}{reason}"] for what, reason in NOT_INSIDE.items()]),
    )


def _summary(name, f):
    scheduling = sorted({s or "not known: it had ended" for s in f["scheduling"]})
    several = "measurement" if f["measurements"] == 1 else "measurements"
    missing = f"; {f['cycles_missing']} cycles between them were not recorded" if f["cycles_missing"] else ""
    return (
        f"{name}: {f['cycles']} cycles in {f['measurements']} {several}; {f['full']} of them filled the memory, which "
        f"ends a measurement{missing}. The loop's thread: {', '.join(scheduling)}."
    )


def _places(own, inside):
    """(condition, place, its figures)"""
    return [(name, place, f[name]) for name in inside for place, f in ((OWN, own), (INSIDE, inside))]


def _heads(first):
    """Condition and place, shown in their first row only; first(row): whether it is the first."""
    return {
        "condition": lambda row: row["name"] if first(row) and row["place"] == OWN else "",
        "in": lambda row: row["place"] if first(row) else "",
    }


def _cycle_table(own, inside):
    rows = [
        {"name": name, "place": place, "what": what, **f}
        for name, place, f in _places(own, inside)
        for what in performance_metrics.TIMES
    ]
    heads = _heads(lambda row: row["what"] == "control function")
    return page.columns(rows, {**heads, "[µs]": lambda row: row["what"], **performance_metrics.time_cells()})


def _delay_table(own, inside):
    rows = [
        {"name": name, "place": place, "arm": arm, "first": i == 0, "delay": d}
        for name, place, f in _places(own, inside)
        for i, (arm, d) in enumerate(f["delay"].items())
    ]

    def value(shown, absent=""):
        return lambda row: absent if row["delay"] is None else shown(row["delay"])

    range_of = "{mean:.4f} ({least:.4f} … {worst:.4f})".format
    cells = {
        **_heads(lambda row: row["first"]),
        "arm": lambda row: row["arm"],
        "correlation, median [ms]": value(
            lambda d: d["correlation_ms"] and f"{d['correlation_ms']['median']:.4f}", NOT_MEASURED
        ),
        "sequence number, mean (range) [ms]": value(lambda d: d["sequence_ms"] and range_of(**d["sequence_ms"])),
        "torques found": value(lambda d: d["sequence_ms"]["count"] if d["sequence_ms"] else 0),
        "not found": value(lambda d: d["unmatched"]),
    }
    return page.columns(rows, cells)
