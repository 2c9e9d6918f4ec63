"""One cycle of a run: every number that its program recorded."""

from __future__ import annotations

import difflib
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .state import ArmState, Array, GripperState, Pose, RunState


class _ArmPlaces:
    """Where the numbers of one arm are in a row."""

    def __init__(self, name: str, places: dict[str, tuple[str, slice]]) -> None:
        def at(field: str) -> int:
            return int(places[f"{name}/{field}"][1].start)

        def part(field: str) -> slice:
            return places[f"{name}/{field}"][1]

        self.name = name
        self.mode, self.errors, self.owner, self.stopped = at("mode"), at("errors"), at("owner"), at("stopped")
        self.interventions, self.last_intervention = at("interventions"), at("last_intervention")
        self.age, self.has_gripper, self.width = at("age_s"), at("has_gripper"), at("gripper_width_m")
        self.max_width = at("gripper_max_width_m")
        self.grasped, self.moving = at("gripper_grasped"), at("gripper_moving")
        self.position, self.quaternion, self.wrench = part("position_m"), part("quaternion_wxyz"), part("wrench_n_nm")
        self.q, self.dq = part("q_rad"), part("dq_rad_per_s")
        self.tau_j, self.tau_cmd = part("tau_J_nm"), part("tau_cmd_nm")


class Layout:
    """Names and places of the numbers of a run's records, from the table in its memory."""

    def __init__(self, table: dict[str, Any]) -> None:
        self.scene: str = table["scene"]
        self.fields: dict[str, tuple[str, slice]] = {}  # dtype and words of a row
        for name, kind, offset, count in table["fields"]:
            self.fields[name] = ("<" + kind, slice(offset // 8, offset // 8 + count))
        self.controllets: list[str] = table["controllets"]
        self.modes: list[str] = table["modes"]
        self.errors: list[str] = table["errors"]
        self.interventions: list[str] = table["interventions"]
        self.arms = {arm["name"]: _ArmPlaces(arm["name"], self.fields) for arm in table["arms"]}
        words = ("cycle", "t_ns", "start_ns", "overruns", "total_ns")
        self.cycle, self.t_ns, self.start_ns, self.overruns, self.total_ns = (
            int(self.fields[word][1].start) for word in words
        )

    def place(self, name: str) -> tuple[str, slice]:
        """dtype and words of a field."""
        if name not in self.fields:
            near = difflib.get_close_matches(name, self.fields, 3)
            raise KeyError(f"there is no field '{name}'; near: {', '.join(near)}" if near else f"no field '{name}'")
        return self.fields[name]

    def error_names(self, bits: int) -> tuple[str, ...]:
        """The flags that are set."""
        return tuple(name for bit, name in enumerate(self.errors) if bits >> bit & 1)


class Record:
    """One cycle, copied. record["left/q_rad"] is an array; `fields` names all. `state` and arm() are plain data."""

    __slots__ = ("_floats", "_layout", "_row")

    def __init__(self, layout: Layout, row: NDArray[np.int64]) -> None:
        self._layout, self._row = layout, row
        self._floats: Array = row.view(np.float64)

    def __repr__(self) -> str:
        return f"<record of cycle {self.cycle} at {self.t_s:.3f} s>"

    def __getitem__(self, name: str) -> NDArray[Any]:
        kind, words = self._layout.place(name)
        return self._row[words].view(kind)

    @property
    def fields(self) -> list[str]:
        """The names of all numbers."""
        return list(self._layout.fields)

    @property
    def cycle(self) -> int:
        """Number of the cycle, from 1."""
        return int(self._row.item(self._layout.cycle))

    @property
    def t_s(self) -> float:
        """Loop time."""
        return 1e-9 * float(self._row.item(self._layout.t_ns))

    @property
    def start_ns(self) -> int:
        """When the cycle began, by time.monotonic_ns()."""
        return int(self._row.item(self._layout.start_ns))

    @property
    def age_s(self) -> float:
        """Time since the cycle began."""
        return 1e-9 * (time.monotonic_ns() - self.start_ns)

    def errors(self, arm: str | None = None) -> bool:
        """Whether an arm, or any, has stopped itself."""
        arms = self._layout.arms
        if arm is not None:
            return self._row.item(arms[arm].errors) != 0
        return any(self._row.item(places.errors) != 0 for places in arms.values())

    def arm(self, name: str) -> ArmState:
        """One arm. Its `reason` has only the names of its errors; the whole sentence is in run.state() and events."""
        row, floats, layout = self._row, self._floats, self._layout
        at = layout.arms[name]
        errors = layout.error_names(row.item(at.errors)) if row.item(at.errors) else ()
        gripper = None
        if row.item(at.has_gripper):
            gripper = GripperState(
                floats.item(at.width), floats.item(at.max_width), bool(row.item(at.grasped)), bool(row.item(at.moving))
            )
        owner = row.item(at.owner)
        wrench = floats[at.wrench]
        return ArmState(
            name,
            1e-9 * row.item(layout.t_ns),
            layout.controllets[owner] if owner < len(layout.controllets) else "",
            layout.modes[row.item(at.mode)],
            bool(row.item(at.stopped)),
            floats[at.q],
            floats[at.dq],
            floats[at.tau_j],
            floats[at.tau_cmd],
            Pose(floats[at.position], floats[at.quaternion]),
            None if wrench.item(0) != wrench.item(0) else wrench,
            floats.item(at.age),
            errors,
            ", ".join(errors),
            row.item(at.interventions),
            layout.interventions[row.item(at.last_intervention)],
            gripper,
        )

    def state(self, rate_hz: float = float("nan")) -> RunState:
        """All arms. rate_hz: of the run, which a single record does not know."""
        row, layout = self._row, self._layout
        return RunState(
            layout.scene,
            self.cycle,
            self.t_s,
            self.age_s,
            rate_hz,
            1e-3 * row.item(layout.total_ns),
            row.item(layout.overruns),
            {name: self.arm(name) for name in layout.arms},
        )


class History:
    """The newest records as arrays, oldest first: history["left/q_rad"] has one row per cycle."""

    def __init__(self, layout: Layout, rows: NDArray[np.int64]) -> None:
        self._layout, self._rows = layout, rows

    def __len__(self) -> int:
        return len(self._rows)

    def __repr__(self) -> str:
        return f"<{len(self)} records>"

    def __getitem__(self, name: str) -> NDArray[Any]:
        kind, words = self._layout.place(name)
        columns = self._rows[:, words].view(kind)
        return columns[:, 0] if columns.shape[1] == 1 else columns

    @property
    def t_s(self) -> Array:
        """Loop times."""
        times: Array = np.multiply(self._rows[:, self._layout.t_ns], 1e-9)
        return times

    @property
    def cycles(self) -> NDArray[np.int64]:
        """Numbers of the cycles."""
        return self._rows[:, self._layout.cycle]
