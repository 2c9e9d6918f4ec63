"""Figures of a performance experiment: of each condition, of the delay checks, of switching. Units are in the names."""

import pathlib

import numpy as np

from experiments.pages import torque_delay
from report.page import known
from report.series import spread

# The client of real arms stays slightly below the arm's torque-rate limit. If the loop has cut a step at that limit,
# the client sends up to CUT_NM less; this accumulates over consecutive steps.
RATE_LIMIT_NM_PER_S, CUT_NM = 1000.0, 1e-4

STAGES = ("read", "controllets", "features", "safety", "write")
TIMES = {"control function": "control_us", "whole step": "whole_us", "start deviation": "jitter_us"}
TAILS = {"median": "median", "mean": "mean", "99 %": "p99", "99.9 %": "p999", "worst": "worst"}


class Trace:
    """The recorded cycles of one run."""

    def __init__(self, entry, folder):
        self.entry = entry
        with np.load(pathlib.Path(folder) / entry["npz"]) as archive:
            self.arrays = {name: archive[name] for name in archive.files}

    arms = property(lambda self: self.entry["arms"])

    def __getitem__(self, name):
        return self.arrays[name]

    @property
    def control_us(self):
        """The control function: until the torques of all arms are computed, models included."""
        return self["stages_us"][:, 5] - self["stages_us"][:, 4]

    @property
    def period_us(self):
        """Time between the starts of consecutive cycles."""
        follows = np.diff(self["cycle"]) == 1
        return (np.diff(self["start_ns"]) * 1e-3)[follows]

    @property
    def lost(self):
        return int(self["overruns"][-1] - self["overruns"][0]) if len(self["overruns"]) else 0

    def delays(self, arm):
        """([s] per window of 1 s by correlation, [s] per cycle by sequence number).

        The clock is the arm's: in lock-step the world is paused while the controller computes. A torque was sent at
        the time of its cycle; what a packet reports as in use has been so since one period before it.
        """
        t, period = self["t_ns"] * 1e-9, self.entry["period_s"]
        sent, used = self[f"{arm}/tau_cmd"], self[f"{arm}/tau_J_d"]
        tolerance = 0.0
        if np.array_equal(used, used.astype(np.float32)):  # states of the control interface have single precision
            step = np.max(np.abs(np.diff(sent, axis=0, prepend=sent[:1])), axis=1)
            tolerance = np.where(step >= 0.999 * RATE_LIMIT_NM_PER_S * period, CUT_NM, 0.0)
            sent = sent.astype(np.float32).astype(float)
        return (
            torque_delay.by_correlation_in_windows(t, sent, t - period, used),
            torque_delay.by_sequence(self[f"{arm}/sequence"], sent, used, period, tolerance=tolerance),
        )

    def column(self, ending):
        for name, values in self.arrays.items():
            if name.endswith(ending):
                return values
        return None


def delay_figures(trace):
    """Per arm, and the run's own metrics."""
    configured = trace.entry["command_delay_s"]
    arms, metrics = {}, {"delay_error_us": 0.0, "delay_by_sequence_error_us": 0.0, "torques_unmatched": 0}
    for arm in trace.arms:
        windows, cycles = trace.delays(arm)
        matched = cycles[np.isfinite(cycles)]
        arms[arm] = {
            "correlation_ms": spread(windows * 1e3),
            "sequence_ms": spread(matched * 1e3),
            "windows_ms": [float(w * 1e3) for w in windows],
            "unmatched": int(len(cycles) - len(matched)),
        }
        metrics["torques_unmatched"] += arms[arm]["unmatched"]
        for name, values in (("delay_error_us", windows), ("delay_by_sequence_error_us", matched)):
            if metrics[name] is None or not len(values):
                metrics[name] = None  # nothing moved: not measured
            else:
                metrics[name] = max(metrics[name], float(np.max(np.abs(values - configured)) * 1e6))
    return arms, metrics


def _feature_figures(traces):
    out = {}
    torque = np.concatenate(
        [np.max([np.max(np.abs(t[f"{arm}/tau_feature"]), axis=1) for arm in t.arms], axis=0) for t in traces]
    )
    out["acting_share"] = float(np.mean(torque > 0))
    out["largest_torque_nm"] = float(torque.max())
    # A feature that is off outputs zeros; one that is on outputs at least the distance of the nearest pair.
    near = [t.column("collision_avoidance.smallest_distance_m") for t in traces]
    if all(x is not None and np.all(x > 0) for x in near):
        pairs = [t.column("collision_avoidance.active_pairs") for t in traces]
        out["smallest_distance_m"] = float(min(x.min() for x in near))
        count = np.concatenate(pairs)
        control = np.concatenate([t.control_us for t in traces])
        out["pairs_largest"] = int(count.max())
        out["near_share"] = float(np.mean(count >= 1))
        out["three_pairs_share"] = float(np.mean(count >= 3))
        out["control_three_pairs_us"] = spread(control[count >= 3])
    m = [t.column("manipulability.manipulability") for t in traces]
    if all(x is not None and np.all(x > 0) for x in m):
        out["manipulability_least"] = float(min(x.min() for x in m))
    return out


def cycle_figures(traces):
    """Figures of the cycles of several runs together."""
    stages, whole = (np.concatenate([t[name] for t in traces]) for name in ("stages_us", "whole_us"))
    return {
        "cycles": int(sum(len(t["cycle"]) for t in traces)),
        "cycles_lost": sum(t.lost for t in traces),
        "control_us": spread(np.concatenate([t.control_us for t in traces])),
        "whole_us": spread(whole),
        "stages_us": {name: spread(stages[:, i]) for i, name in enumerate(STAGES)},
        "period_us": spread(np.concatenate([t.period_us for t in traces])),
        "jitter_us": spread(np.concatenate([np.abs(t.period_us - 1e6 * t.entry["period_s"]) for t in traces])),
    }


def control_ratio(trace):
    """The control function's median over that of the bare law of the same minute; None: there is no such law."""
    bare = trace.entry.get("bare_us")
    return float(np.median(trace.control_us) / bare) if bare else None


def condition_figures(traces, machine_memory_mb):
    """Figures of one condition over all its repeats."""
    usage = np.concatenate(
        [np.array(t.entry["usage"], dtype=float).reshape(-1, len(t.entry["usage_columns"])) for t in traces]
    )
    columns = {name: usage[:, i] for i, name in enumerate(traces[0].entry["usage_columns"])}
    first, whole_us = traces[0].entry, float(np.mean(np.concatenate([t["whole_us"] for t in traces])))
    out = {
        **cycle_figures(traces),
        "control_percent": 1e-4 * whole_us / first["period_s"],
        "bare_us": float(np.mean([t.entry["bare_us"] for t in traces])) if "bare_us" in first else None,
        "features": _feature_figures(traces),
        "configured_delay_ms": first["command_delay_s"] * 1e3,
    }
    out["usage"] = {name: spread(columns[name]) for name in columns if name != "t_s"}
    if out["usage"]["memory_mb"] is not None:
        out["usage"]["memory_percent"] = spread(columns["memory_mb"] / machine_memory_mb * 100)
    out["generator"] = [t.entry["generator"] for t in traces]
    return out


def switching_figures(switching):
    kept = ("bystander", "bystander_cycles", "bystander_different", "overruns", "faults")
    out, kinds = {key: switching[key] for key in kept}, ("controllet", "feature")
    for kind in kinds:
        trials = [x for x in switching["list"] if x["kind"] == kind]
        good = [x for x in trials if x["accepted"]]
        waiting, computing = ([x[k] * 1e-3 for x in good] for k in ("received_to_taken_us", "taken_to_first_torque_us"))
        out[kind] = {
            "trials": len(trials),
            "accepted": len(good),
            "in_the_next_cycle": sum(x["cycles_late"] == 0 for x in good),
            "received_to_taken_ms": spread(waiting),
            "taken_to_first_torque_ms": spread(computing),
            "received_to_first_torque_ms": spread(np.add(waiting, computing)),
            "torque_step_nm": spread([x["torque_step_nm"] for x in good]),
        }
    out["metrics"] = {
        "switches_refused": sum(out[k]["trials"] - out[k]["accepted"] for k in kinds),
        "switches_late": sum(out[k]["accepted"] - out[k]["in_the_next_cycle"] for k in kinds),
        "switches_missing": 2 * switching["trials"] - len(switching["list"]),
        "bystander_different": switching["bystander_different"] if switching["bystander_cycles"] else None,
    }
    return out


def time_cells(more=()):
    """Table columns for rows of TIMES (row["what"]) of a condition; `more` columns follow the tails."""

    def of(key):
        return lambda row: known((row[TIMES[row["what"]]] or {}).get(key))

    counts = {"cycles": lambda row: (row[TIMES[row["what"]]] or {}).get("count")}
    counts["lost"] = lambda row: row["cycles_lost"] if row["what"] == "start deviation" else ""
    return {**{head: of(key) for head, key in TAILS.items()}, **dict(more), **counts}
