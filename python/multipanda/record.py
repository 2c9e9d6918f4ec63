"""One cycle of a run: every number that its program recorded."""

from __future__ import annotations

import difflib
import time
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .pose import Pose
from .rotations import Array
from .state import ArmState, GripperState, RunState

# What an ArmState has by name.
_INTEGERS = (
    *("mode", "errors", "owner", "stopped", "interventions", "last_intervention", "removed_by"),
    *("has_gripper", "gripper_grasped", "gripper_moving"),
)
_FLOATS = ("age_s", "gripper_width_m", "gripper_max_width_m")
_LISTS = ("q_rad", "dq_rad_per_s", "tau_J_nm", "tau_cmd_nm", "position_m", "quaternion_wxyz", "wrench_n_nm")


class Layout:
    """Names and places of the numbers of a run's records, from the table in its memory."""

    def __init__(self, table: dict[str, Any]) -> None:
        self.scene: str = table["scene"]
        self.fields: dict[str, tuple[str, slice]] = {}  # dtype and 64-bit words of a row
        for name, kind, offset, count in table["fields"]:
            self.fields[name] = ("<" + kind, slice(offset // 8, offset // 8 + count))
        self.controllets: list[str] = table["controllets"]
        self.modes: list[str] = table["modes"]
        self.errors: list[str] = table["errors"]
        self.interventions: list[str] = table["interventions"]
        self.known_by: dict[str, str] = table["known_by"]  # quantities of arms, and the flags that they are reported
        # Words of the quantities of each arm, and of those in an ArmState.
        self.arms: dict[str, dict[str, slice]] = {}
        self.in_state: dict[str, tuple[list[int], list[int], list[slice]]] = {}
        for arm in (arm["name"] for arm in table["arms"]):
            names = (name.removeprefix(f"{arm}/") for name in self.fields if name.startswith(f"{arm}/"))
            at = self.arms[arm] = {name: self.fields[f"{arm}/{name}"][1] for name in names}
            starts = [[at[name].start for name in names] for names in (_INTEGERS, _FLOATS)]
            self.in_state[arm] = starts[0], starts[1], [at[name] for name in _LISTS]
        self.floats = np.zeros(max(words.stop for _, words in self.fields.values()), dtype=np.bool_)
        self.quaternions: list[slice] = []
        for name, (kind, place) in self.fields.items():
            self.floats[place] = kind == "<f8"
            is_pose = name.rpartition("/")[2].startswith("X_") and place.stop - place.start == 7
            if is_pose or name.endswith("quaternion_wxyz"):
                self.quaternions.append(slice(place.stop - 4, place.stop))
        words = ("cycle", "t_ns", "start_ns", "overruns", "total_ns")
        self.cycle, self.t_ns, self.start_ns, self.overruns, self.total_ns = (
            int(self.fields[word][1].start) for word in words
        )

    def place(self, name: str) -> tuple[str, slice]:
        """dtype and 64-bit words of a field."""
        if name not in self.fields:
            near = difflib.get_close_matches(name, self.fields, 3)
            raise KeyError(f"there is no field '{name}'; near: {', '.join(near)}" if near else f"no field '{name}'")
        return self.fields[name]

    def error_names(self, bits: int) -> tuple[str, ...]:
        """The flags that are set."""
        return tuple(name for bit, name in enumerate(self.errors) if bits >> bit & 1)


class _Quantities(Mapping[str, Array]):
    """The quantities that an arm reports in a record."""

    __slots__ = ("_arm", "_layout", "_row")

    def __init__(self, layout: Layout, row: NDArray[np.int64], arm: str) -> None:
        self._layout, self._row, self._arm = layout, row, arm

    def _values(self, name: str) -> Array | None:
        kind, words = self._layout.place(f"{self._arm}/{name}")
        values = self._row[words].view(kind).astype(np.float64)
        flag = self._layout.known_by.get(name)
        if flag is None:
            return values
        at = self._layout.arms[self._arm].get(flag)
        known = not np.isnan(values).all() if at is None else self._row.item(at.start) != 0
        return values if known else None

    def __getitem__(self, name: str) -> Array:
        values = self._values(name)
        if values is None:
            raise KeyError(f"the arm does not report {name}")
        return values

    def __iter__(self) -> Iterator[str]:
        return (name for name in self._layout.arms[self._arm] if self._values(name) is not None)

    def __len__(self) -> int:
        return sum(1 for _ in self)


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
        """Whether `arm` has stopped itself; without it, whether any arm has."""
        arms = self._layout.arms
        names = arms if arm is None else (arm,)
        return any(self._row.item(arms[name]["errors"].start) != 0 for name in names)

    def arm(self, name: str) -> ArmState:
        """One arm. Its `reason` has only the names of its errors; the whole sentence is in run.state() and events."""
        row, floats, layout = self._row, self._floats, self._layout
        integers, numbers, lists = layout.in_state[name]
        mode, bits, owner, stopped, interventions, last_intervention, removed_by, has_gripper, grasped, moving = map(
            row.item, integers
        )
        age_s, width, max_width = map(floats.item, numbers)
        q, dq, tau_j, tau_cmd, position, quaternion, wrench = map(floats.__getitem__, lists)
        errors = layout.error_names(bits) if bits else ()
        return ArmState(
            name,
            1e-9 * row.item(layout.t_ns),
            layout.controllets[owner] if owner < len(layout.controllets) else "",
            layout.modes[mode],
            bool(stopped),
            q,
            dq,
            tau_j,
            tau_cmd,
            Pose.measured(position, quaternion),
            None if wrench.item(0) != wrench.item(0) else wrench,
            age_s,
            errors,
            ", ".join(errors),
            interventions,
            layout.interventions[last_intervention],
            layout.interventions[removed_by],
            GripperState(width, max_width, bool(grasped), bool(moving)) if has_gripper else None,
            _Quantities(layout, row, name),
        )

    def state(self, rate_hz: float = float("nan")) -> RunState:
        """All arms. rate_hz: of the run, since a single record does not contain it."""
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


def between(before: Record, after: Record, start_ns: int) -> Record:
    """The record of an instant between two: numbers are interpolated, everything else is the earlier one's."""
    layout = before._layout
    gap_ns = after.start_ns - before.start_ns
    share = min(max((start_ns - before.start_ns) / gap_ns, 0.0), 1.0) if gap_ns > 0 else 0.0
    row = before._row.copy()
    floats = row.view(np.float64)[: len(layout.floats)]
    target = after._floats[: len(layout.floats)].copy()
    for words in layout.quaternions:  # q and -q are one orientation
        if floats[words] @ target[words] < 0:
            target[words] *= -1
    if share > 0:  # a flag of one record that has no numbers in the other would make them not a number
        floats[layout.floats] += share * (target - floats)[layout.floats]
    for words in layout.quaternions:
        floats[words] /= max(float(np.linalg.norm(floats[words])), 1e-12)
    for word in (layout.t_ns, layout.start_ns):
        row[word] += round(share * (after._row.item(word) - before._row.item(word)))
    return Record(layout, row)


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
