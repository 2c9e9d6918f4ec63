"""A run from an exported log: arrays by topic and field, switches, interventions, events, and owners of the arms."""

import json
import os
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np


@dataclass(frozen=True)
class Span:
    """One controllet instance owning one arm without a break: [start, end) in loop time [s]."""

    instance: str
    start: float
    end: float


@dataclass
class Run:
    """Arrays are read from the archive at first use. Data that the log lacks are None, never zeros."""

    path: str
    meta: dict = field(default_factory=dict)
    _cache: dict = field(default_factory=dict, repr=False)

    @property
    def _archive(self):
        """Opened once per process: a forked process would share its parent's file position."""
        key = f"archive of process {os.getpid()}"
        if key not in self._cache:
            self._cache[key] = np.load(self.path, allow_pickle=False)
        return self._cache[key]

    @cached_property
    def names(self):
        return set(self._archive.files)

    def get(self, name):
        """The array, or None when the log has no such topic or field, or no message of it."""
        if name not in self._cache:
            value = self._archive[name] if name in self.names else None
            self._cache[name] = value if value is not None and value.shape[0] > 0 and value.size > 0 else None
        return self._cache[name]

    def messages(self, topic):
        """Whole messages of a topic with occasional messages, in the order of the log."""
        texts = self.get(f"{topic}/json")
        return [json.loads(text) for text in texts] if texts is not None else []

    @cached_property
    def switches(self):
        return self.messages("switches")

    @cached_property
    def interventions(self):
        return self.messages("interventions")

    @cached_property
    def events(self):
        return self.messages("events")

    @cached_property
    def arms(self):
        """Arm names in the scene's order if known, otherwise alphabetically."""
        logged = {name.removesuffix("/state/t") for name in self.names if name.endswith("/state/t")}
        known = [arm["name"] for arm in self.layout.get("arms") or []]
        return known + sorted(logged - set(known))

    @property
    def layout(self):
        return self.meta.get("layout") or {}

    @cached_property
    def joint_counts(self):
        counts = {arm["name"]: int(arm["joints"]) for arm in self.layout.get("arms") or []}
        for arm in self.arms:
            q = self.get(f"{arm}/state/q")
            if q is not None:
                counts[arm] = q.shape[1]
        return counts

    @cached_property
    def instances(self):
        """Controllet instances: name -> {"type", "arms" (in the order in which the controllet counts them)}."""
        found = {}
        for entry in self.layout.get("instances") or []:
            found[entry["name"]] = {"type": entry.get("type", ""), "arms": list(entry.get("arms") or [])}
        for name, arms in (self.meta.get("instance_arms") or {}).items():
            found.setdefault(name, {"type": "", "arms": []})["arms"] = list(arms)
        for arm in self.arms:  # without a layout: the arms that it owned in the log
            for span in self.spans(arm):
                entry = found.setdefault(span.instance, {"type": "", "arms": []})
                if not self.layout and arm not in entry["arms"]:
                    entry["arms"].append(arm)
        return found

    def spans(self, arm):
        """The owners of the arm in chronological order."""
        key = f"{arm}/spans"
        if key not in self._cache:
            t, owner = self.get(f"{arm}/command/t"), self.get(f"{arm}/command/owner")
            spans = []
            if t is not None and owner is not None:
                changes = np.flatnonzero(owner[1:] != owner[:-1]) + 1
                starts = np.concatenate([[0], changes])
                last = t[-1] + (np.median(np.diff(t)) if len(t) > 1 else 0.001)
                ends = np.concatenate([t[changes], [last]])
                spans = [Span(str(owner[i]), float(t[i]), float(end)) for i, end in zip(starts, ends)]
            self._cache[key] = spans
        return self._cache[key]

    @cached_property
    def time_range(self):
        """First and last loop time of any cycle [s]; None without any."""
        ends = [
            t for name in ["timing"] + [f"{arm}/state" for arm in self.arms] if (t := self.get(f"{name}/t")) is not None
        ]
        return (min(float(t[0]) for t in ends), max(float(t[-1]) for t in ends)) if ends else None

    def limits(self, arm, name):
        """One of q_min, q_max [rad], dq_max [rad/s], tau_max [N m], tau_rate_max [N m/s]; None when not known."""
        values = ((self.meta.get("limits") or {}).get(arm) or {}).get(name)
        if not values or len(values) != self.joint_counts.get(arm):
            return None
        return np.array(values, dtype=float)


def load(npz, meta=None):
    """The run in the archive `npz`; `meta`: the file of metadata next to it, or None."""
    data = {}
    if meta is not None:
        with open(meta, encoding="utf-8") as stream:
            data = json.load(stream)
    return Run(str(npz), data)
