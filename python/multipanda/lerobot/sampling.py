"""Frames of an episode from a log: all numbers of a frame are of one cycle.

Frame k of an episode is the newest cycle at or before its start + k / fps of which the log has every number that the
data set needs. Frames before all arms are commanded and after it are dropped. The action is the set-point that the
arm's controllet followed in that very cycle. Beside a log with pictures a frame has the newest one of each camera, and
the state of the instant of the first camera's, interpolated between two cycles.
"""

from __future__ import annotations

import pathlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..episode import LoggedEpisode
from ..picture_log import LoggedPicture, read_pictures
from ..rotations import Array
from ..tasks.arms import in_base, wrench_in_base
from .dataset import Frames
from .names import SteadySigns

Values = NDArray[Any]
_OLDEST_S = 0.5  # age from which on a camera has stalled, as in Cameras


class LeftOut(Exception):
    """An episode cannot be used; the text says why."""


@dataclass(frozen=True)
class Choice:
    """The selection for a data set.

    Attributes:
        arms: Names of the arms, in the order of the features.
        action: `joints` or `pose`.
        observe: Quantities of observation.state.
        grippers: Arms whose fingers are part of it.
        leaders: By arm: the arm whose measured joints or pose are the action, instead of the set-point.
        fps: Frames per second.
        task: What was to be done.
    """

    arms: list[str]
    action: str
    observe: list[str]
    grippers: list[str]
    leaders: dict[str, str]
    fps: int
    task: str


@dataclass(frozen=True)
class Series:
    """Rows of one quantity by cycle."""

    what: str
    cycle: Values
    values: Array
    pose: bool = False


class RecordedRun:
    """One log: its arrays by name, and the program's description of its scene."""

    def __init__(self, log: Mapping[str, Values], about: dict[str, Any]) -> None:
        """
        Args:
            log: The arrays, as read_log() gives them.
            about: `name`, `bases` (by arm: x y z [m], qw qx qy qz), `instances` (name, arms, inputs), `log` (its file;
                pictures are beside it).
        """
        self.log, self.name = log, str(about["name"])
        self.bases: dict[str, Array] = {arm: np.array(base) for arm, base in about["bases"].items()}
        self.instances: list[dict[str, Any]] = about["instances"]
        beside = pathlib.Path(about["log"]).with_name("pictures.mcap")
        found = read_pictures(beside) if beside.exists() else {}
        self.pictures = {name: shots for name, shots in found.items() if not name.endswith("/depth")}

    def _has(self, name: str) -> bool:
        return name in self.log

    def _base(self, arm: str) -> Array:
        if arm not in self.bases:
            raise LeftOut(f"its scene cannot be rebuilt, so the base of '{arm}' is not known: use joints only")
        return self.bases[arm]

    def _topic(self, arm: str, topic: str, quantity: str) -> Values:
        if not self._has(f"{arm}/{topic}/cycle"):
            raise LeftOut(f"has no {quantity} of '{arm}' (/{arm}/{topic}): record it, see --log-every")
        cycles: Values = self.log[f"{arm}/{topic}/cycle"]
        return cycles

    def clock(self, arm: str) -> tuple[Values, Values]:
        """The cycles of which the log has the arm's state, and their times [s]."""
        return np.asarray(self._topic(arm, "state", "state")), np.asarray(self.log[f"{arm}/state/t"])

    def joints(self, arm: str) -> int:
        """How many joints it has."""
        self._topic(arm, "state", "state")
        return int(self.log[f"{arm}/state/q"].shape[1])

    def observed(self, arm: str, quantity: str) -> Series:
        """A measured quantity of an arm, in the frame of its base."""
        what = f"{quantity} of '{arm}'"
        if quantity == "pose":
            return Series(what, self._topic(arm, "model", quantity), in_base(self._base(arm), self._pose(arm)), True)
        if quantity == "wrench":
            cycles = self._topic(arm, "wrench", quantity)
            return Series(what, cycles, wrench_in_base(self._base(arm), self._wrench(arm)))
        field = {"joints": "q", "velocities": "dq", "torques": "tau_j"}[quantity]
        cycles = self._topic(arm, "state", quantity)
        return Series(what, cycles, np.asarray(self.log[f"{arm}/state/{field}"]))

    def _pose(self, arm: str) -> Array:
        turned = np.asarray(self.log[f"{arm}/model/pose_orientation"], dtype=np.float64)  # x y z w
        return np.concatenate([self.log[f"{arm}/model/pose_position"], turned[:, [3, 0, 1, 2]]], axis=1)

    def _wrench(self, arm: str) -> Array:
        if not bool(np.all(self.log[f"{arm}/wrench/has_estimate"])):
            raise LeftOut(f"has no wrench estimate of '{arm}' in some cycles: leave it out of --observe")
        parts = [self.log[f"{arm}/wrench/estimated_{part}"] for part in ("force", "torque")]
        return np.concatenate(parts, axis=1)

    def gripper(self, arm: str) -> tuple[Series, Series]:
        """Width of the fingers [m], and its target: the equivalent request of a policy.

        Requests to grippers are not in the log. While the fingers move, the target is the end of this motion; a motion
        that ends with a grasp has the target 0.
        """
        cycles = self._topic(arm, "state", "gripper")
        if not bool(np.all(self.log[f"{arm}/state/has_gripper"])):
            raise LeftOut(f"'{arm}' has no gripper: leave it out of --grippers")
        width = np.asarray(self.log[f"{arm}/state/gripper_width"], dtype=np.float64).reshape(-1)
        moving = np.asarray(self.log[f"{arm}/state/gripper_moving"]).reshape(-1).astype(bool)
        grasped = np.asarray(self.log[f"{arm}/state/gripper_grasped"]).reshape(-1).astype(bool)
        rest = np.where(moving, len(width), np.arange(len(width)))
        ends = np.minimum(np.minimum.accumulate(rest[::-1])[::-1], len(width) - 1)  # the next row at rest
        aims = np.where(grasped[ends], 0.0, width[ends])
        return (
            Series(f"gripper of '{arm}'", cycles, width[:, None]),
            Series(f"gripper of '{arm}'", cycles, aims[:, None]),
        )

    def set_points(self, arm: str, action: str) -> Series:
        """The set-points that controllets of this arm alone followed, cycle by cycle."""
        cycles, rows = [], []
        for instance in self.instances:
            if instance["arms"] != [arm]:
                continue
            for spec in instance["inputs"]:
                topic = f"{instance['name']}/{spec['name']}"
                if spec["quantity"] != action or not self._has(f"{topic}/cycle"):
                    continue
                values = np.asarray(self.log[f"{topic}/value"], dtype=np.float64)
                if action == "pose":
                    values = in_base(self._base(arm), values)
                cycles.append(np.asarray(self.log[f"{topic}/cycle"]))
                rows.append(values)
        if not cycles:
            raise LeftOut(
                f"has no set-point of {action} for '{arm}' alone: choose another --action or --arms, or name "
                "the arm that led it by --leader"
            )
        order = np.argsort(np.concatenate(cycles), kind="stable")
        found = np.concatenate(cycles)[order], np.concatenate(rows)[order]
        return Series(f"set-point ({action}) of '{arm}'", *found, action == "pose")


class Sampler:
    """The frames of a log's episodes."""

    def __init__(self, run: RecordedRun, choice: Choice) -> None:
        """Raises LeftOut if the log lacks a quantity altogether."""
        self.run, self.choice = run, choice
        self.states: list[Series] = []
        self.actions: list[Series] = []
        for arm in choice.arms:
            for quantity in choice.observe:
                self.states.append(run.observed(arm, quantity))
            leader = choice.leaders.get(arm)
            if leader is None:
                self.actions.append(run.set_points(arm, choice.action))
            else:
                self.actions.append(run.observed(leader, choice.action))
            if arm in choice.grippers:
                width, aim = run.gripper(arm)
                self.states.append(width)
                self.actions.append(run.gripper(leader)[0] if leader is not None and self._led(leader) else aim)
        self.cycle, self.t = run.clock(choice.arms[0])
        whole = self.cycle
        for series in self.states + self.actions:
            whole = np.intersect1d(whole, series.cycle)
        self.whole = whole  # cycles with every number
        self.at = self.t[np.searchsorted(self.cycle, self.whole)]

    def _led(self, leader: str) -> bool:
        name = f"{leader}/state/has_gripper"
        return name in self.run.log and bool(np.all(self.run.log[name]))

    def frames(self, episode: LoggedEpisode) -> Frames:
        """Drops frames before the first and after the last complete one: arms are held there.

        Raises LeftOut if a frame between these has no numbers.
        """
        choice = self.choice
        count = int(np.floor((episode.end_s - episode.start_s) * choice.fps - 1e-9)) + 1
        if not np.isfinite(episode.end_s) or count < 2:
            raise LeftOut("is shorter than two frames")
        due = episode.start_s + np.arange(count) / choice.fps
        shown, about = self._shown(due)
        if shown:  # the state is that of the first camera's instant
            due = np.array([picture.t_s for picture in next(iter(shown.values()))])
        found = np.searchsorted(self.at, due + 1e-9, side="right") - 1
        # A mark follows the record of its cycle, so that cycle may be the first frame.
        age = np.where(found >= 0, due - self.at[np.maximum(found, 0)], np.inf)
        whole = np.flatnonzero(age < 1 / choice.fps)
        if not len(whole):
            raise LeftOut(self._what_is_missing(float(due[0])))
        first, last = int(whole[0]), int(whole[-1])
        if last + 1 - first > len(whole):
            gap = first + int(np.argmax(np.diff(whole) > 1)) + 1
            raise LeftOut(self._what_is_missing(float(due[gap])))
        if last == first:
            raise LeftOut("is shorter than two frames")
        cycles = self.whole[found[whole]]
        rows = [self._rows(series, cycles) for series in (self.states, self.actions)]
        if shown:
            after = np.minimum(found[whole] + 1, len(self.whole) - 1)
            gap = np.maximum(self.at[after] - self.at[found[whole]], 1e-9)
            share = np.clip((due[whole] - self.at[found[whole]]) / gap, 0, 1)
            rows[0] = self._rows(self.states, cycles, self.whole[after], share)
        if not all(bool(np.all(np.isfinite(values))) for values in rows):
            raise LeftOut("has numbers that are not finite")
        origin = {
            "log": self.run.name,
            "episode": episode.number,
            "outcome": episode.outcome,
            "start_s": episode.start_s,
            "end_s": episode.end_s,
            "cycles": [int(cycles[0]), int(cycles[-1])],
            "frames_dropped": [first, count - 1 - last],
            **about,
        }
        files = {name: [pictures[k].data for k in whole] for name, pictures in shown.items()}
        return Frames(rows[0], rows[1], choice.task, origin, files)

    def _shown(self, due: Array) -> tuple[dict[str, list[LoggedPicture]], dict[str, Any]]:
        """The newest picture of each camera at each time, and for the origin how old and how far apart they are."""
        shown: dict[str, list[LoggedPicture]] = {}
        about: dict[str, dict[str, float]] = {"picture_age_s": {}, "pairing_error_s": {}}
        instants: Array | None = None
        for name, pictures in self.run.pictures.items():
            times = np.array([picture.t_s for picture in pictures])
            newest = np.searchsorted(times, due + 1e-9, side="right") - 1
            ages = np.where(newest >= 0, due - times[np.maximum(newest, 0)], np.inf)
            if ages.max() > _OLDEST_S:
                late = float(due[int(np.argmax(ages > _OLDEST_S))])
                raise LeftOut(f"has no picture of camera '{name}' in the {_OLDEST_S:g} s before {late:.3f} s")
            shown[name] = [pictures[k] for k in newest]
            instants = times[newest] if instants is None else instants
            own = np.array([picture.error_s for picture in shown[name]])
            about["picture_age_s"][name] = float(ages.max())
            about["pairing_error_s"][name] = float((np.abs(times[newest] - instants) + own).max())
        return shown, about if shown else {}

    def _rows(
        self, group: list[Series], cycles: Values, after: Values | None = None, share: Array | None = None
    ) -> Array:
        """The numbers of cycles, or those a share of the way to later cycles."""
        parts = []
        for series in group:
            values = series.values[np.searchsorted(series.cycle, cycles)]
            if after is not None and share is not None:
                target = series.values[np.searchsorted(series.cycle, after)]
                if series.pose:  # q and -q are one orientation
                    opposite = np.sum(values[:, 3:] * target[:, 3:], axis=1) < 0
                    target = np.where(opposite[:, None] & (np.arange(7) > 2), -target, target)
                values = values + share[:, None] * (target - values)
                if series.pose:
                    values[:, 3:] /= np.linalg.norm(values[:, 3:], axis=1, keepdims=True)
            if series.pose:
                signs = SteadySigns()
                values = np.array([signs.of("", row) for row in values])
            parts.append(values)
        return np.concatenate(parts, axis=1)

    def _what_is_missing(self, t_s: float) -> str:
        """Which quantity has no row in the frame before a time [s]."""
        for series in self.states + self.actions:
            at = self.t[np.isin(self.cycle, series.cycle)]
            near = at[(at <= t_s + 1e-9) & (at > t_s - 1 / self.choice.fps)]
            if not len(near):
                return f"has no {series.what} at {t_s:.3f} s"
        return f"has no cycle with every number between {t_s - 1 / self.choice.fps:.3f} and {t_s:.3f} s"
