"""What changed between two states."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from .state import ArmState, RunState


@dataclass(frozen=True)
class Event:
    """A change of one arm.

    Attributes:
        t_s: Loop time of the state that shows it [s].
        arm: Name of the arm.
        kind: `controllet`, `stopped`, `resumed`, `error`, `recovered`, `intervention`, `grasped` or `released`.
        text: The same in words.
    """

    t_s: float
    arm: str
    kind: str
    text: str


def _of_arm(a: ArmState, b: ArmState) -> Iterator[tuple[str, str]]:
    if a.controllet != b.controllet:
        yield "controllet", f"{b.controllet} after {a.controllet}"
    if a.stopped != b.stopped:
        yield ("stopped", "held until resume()") if b.stopped else ("resumed", "switches are allowed again")
    if a.errors != b.errors:
        if b.errors:
            yield "error", b.reason or ", ".join(b.errors)
        else:
            yield "recovered", "no error is left"
    if b.interventions > a.interventions:
        yield "intervention", b.last_intervention
    if a.gripper is not None and b.gripper is not None and a.gripper.grasped != b.gripper.grasped:
        yield ("grasped" if b.gripper.grasped else "released"), f"{1e3 * b.gripper.width_m:.1f} mm"


def changes(before: RunState, after: RunState) -> Iterator[Event]:
    """The events between two states of one run."""
    for name, state in after.arms.items():
        for kind, text in _of_arm(before.arms[name], state):
            yield Event(state.t_s, name, kind, text)
