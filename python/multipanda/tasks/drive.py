"""A policy drives the arms of a run, simulated, virtual or real, by the same mapping as in training."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import Error, Refused, Timeout
from ..pose import Pose
from ..rotations import Array
from .actions import LEAD_STEPS, ActionMapping, Command
from .arms import ArmStates
from .task import Start, Task

if TYPE_CHECKING:
    from ..client import Client
    from ..state import RunState
    from ..stream import Stream

Policy = Callable[[Array], Array]

_NEAR_RAD = 0.3  # largest angle of the first set-point from the hand
_BASE_M, _BASE_RAD = 0.005, 0.01  # largest deviation of the run's bases from the task's
_PATIENCE_S = 5  # longest wait for fingers whose motion was stopped


@dataclass(frozen=True)
class Drive:
    """The record of an episode on arms.

    Attributes:
        t_s: Times since its beginning [s], by the count of actions.
        observations: The policy's observations, a row per action.
        actions: Its answers.
        states: The states of the run at these times.
        latest_s: The largest delay of an action beyond one period after the one before [s].
    """

    t_s: Array
    observations: Array
    actions: Array
    states: list[RunState]
    latest_s: float


def _arms(task: Task, state: RunState) -> dict[str, ArmStates]:
    """The policy's observation.

    A missing gripper would shift all later numbers, a missing wrench would look like no contact.

    Raises:
        Refused: An arm does not report all that the task observes.
    """
    for arm in task.arms:
        seen = state.arms[arm.name]
        if seen.wrench_n_nm is None:
            raise Refused("arm_not_ready", f"{task.name} observes the force of '{arm.name}', which nothing estimates")
        if arm.name in task.grippers and seen.gripper is None:
            raise Refused(
                "arm_not_ready", f"{task.name} needs the gripper of '{arm.name}', which has none or has lost it"
            )
    return {arm.name: ArmStates.of(state.arms[arm.name]) for arm in task.arms}


def _check_bases(run: Client, task: Task) -> None:
    """Set-points and observations are made with the task's bases: another one moves the hand elsewhere."""
    for arm in task.arms:
        found, expected = run.arms[arm.name].base, Pose.of(arm.base)
        away = float(np.linalg.norm(found.position_m - expected.position_m))
        if away > _BASE_M or found.angle_to(expected) > _BASE_RAD:
            raise Refused(
                "out_of_bounds",
                f"the base of '{arm.name}' is {away:.3f} m and {found.angle_to(expected):.3f} rad away from where "
                f"{task.name} expects it ({arm.base.tolist()})",
                "give the arms of the scene the bases of the task",
            )


def _check_owned(mapping: ActionMapping, task: Task, state: RunState) -> None:
    """Nothing is sent, to no arm and no gripper, once one of the arms was stopped or held."""
    for arm in task.arms:
        seen = state.arms[arm.name]
        if seen.stopped:
            raise Refused("arm_stopped", f"'{arm.name}' has been stopped")
        if seen.controllet not in mapping.controllets:
            ended = seen.reason or seen.removed_by.replace("_", " ")
            why = f": {ended}" if ended else ""
            raise Refused("not_active", f"'{arm.name}' is owned by '{seen.controllet}' now{why}")


class _Grippers:
    """Sends gripper commands when they change, on threads: their answers arrive when the fingers rest.

    Leaving it waits for motions; by an exception it stops those that are under way. Held objects stay held.
    """

    def __init__(self, run: Client) -> None:
        self._run = run
        self._sent: dict[str, tuple[float, float]] = {}
        self._threads: dict[str, threading.Thread] = {}
        self._failed: Error | None = None

    def send(self, command: Command) -> None:
        if self._failed is not None:
            raise self._failed
        for arm, rows in command.grippers.items():
            requested = (float(rows[0, 0]), float(rows[0, 1]))
            if self._sent.get(arm) != requested:
                self._sent[arm] = requested
                self._threads[arm] = threading.Thread(target=self._move, args=(arm, *requested), daemon=True)
                self._threads[arm].start()

    def _move(self, arm: str, width_m: float, force_n: float) -> None:
        try:
            if force_n > 0:
                self._run.arms[arm].gripper.grasp(width_m, force_n=force_n)
            else:
                self._run.arms[arm].gripper.move(width_m)
        except Refused:
            pass  # the grasp missed, or the next motion ended it; the policy sees the width
        except Error as failed:
            self._failed = failed

    def _stop(self) -> None:
        for arm, thread in self._threads.items():
            if thread.is_alive():
                with contextlib.suppress(Error):
                    self._run.ask({"do": "gripper", "arm": arm, "action": "stop"}, _PATIENCE_S)
        for thread in self._threads.values():
            thread.join(_PATIENCE_S)

    def __enter__(self) -> _Grippers:
        return self

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        if kind is not None:
            self._stop()
            return
        try:
            for thread in self._threads.values():
                thread.join()
        except BaseException:
            self._stop()
            raise


class _Parameters:
    """Sends parameters when they change. Leaving it restores the previous values: a person may drive next."""

    def __init__(self, run: Client) -> None:
        self._run = run
        self._before: dict[tuple[str, str], Any] = {}
        self._sent: dict[tuple[str, str], Array] = {}

    def send(self, command: Command) -> None:
        for key, value in command.parameters.items():
            if key not in self._sent or not np.array_equal(self._sent[key], value):
                if key not in self._before:
                    self._before[key] = self._run[key[0]].parameters[key[1]]
                self._run[key[0]].set(key[1], value[0])
                self._sent[key] = value

    def close(self) -> None:
        for (controllet, name), value in self._before.items():
            with contextlib.suppress(Error):  # the run has ended
                self._run[controllet].set(name, value)


@dataclass(frozen=True)
class _Choice:
    """An action, and the state that it was chosen from."""

    state: RunState
    arms: dict[str, ArmStates]
    observation: Array
    action: Array
    command: Command
    read_s: float  # host time of the state

    def age_s(self) -> float:
        return time.monotonic() - self.read_s


def drive(
    run: Client,
    task: Task,
    policy: Policy,
    start: Start,
    *,
    action: str = "pose",
    seconds: float | None = None,
    rate_hz: float = 20,
    near_m: float = 0.05,
    leash_m: float = 0.15,
) -> Drive:
    """One episode with a policy on the arms of a run, which is a scene with the task's arms and controllets.

    The arms begin where they are; bring them near the task's start before. The policy's first action is checked before
    an arm is switched. Leaving, by an exception too, holds the arms, stops fingers that move if it was an exception,
    and restores the parameters.

    Nothing is sent, to no arm and no gripper, after one of the arms was stopped or held, nor from a state that is older
    than the shortest `timeout_s` of the inputs. An action that takes longer than its period delays those after it.
    Only the policy's first call may be slow: then it is called again.

    Args:
        run: The run.
        task: The task.
        policy: From an observation, as `task.observe` makes it, to an action, both of one world.
        start: What the episode is about: `numbers` is used.
        action: Kind of the actions.
        seconds: Length [s]; by default the task's.
        rate_hz: Actions per second: those of the training.
        near_m: Largest distance of the first set-point from the hand [m].
        leash_m: That of all set-points [m]; a policy or a path that runs further away from the hand is ended.

    Raises:
        Refused: The run's bases are not the task's, a set-point is too far away, an arm was stopped or held, or a
            sample or parameter was refused.
        Timeout: The run does not answer, or the policy took too long.
        Disconnected: The run has ended.
        ValueError: The policy's action has another size or a number that is not finite, what it would see is not
            finite, or actions of another rate than those of the training.
    """
    mapping = task.mapping(action)
    if rate_hz != mapping.rate_hz:
        raise ValueError(f"expected {mapping.rate_hz:g} actions per second, as in the training; found {rate_hz:g}")
    numbers = {name: np.asarray(value, dtype=np.float64)[None] for name, value in start.numbers.items()}
    count = round((task.seconds if seconds is None else seconds) * rate_hz)
    _check_bases(run, task)

    def choose(k: int) -> _Choice:
        state = run.state()
        read_s, arms = time.monotonic() - state.since_cycle_s, _arms(task, state)
        now = np.array([k / rate_hz])
        if k == 0:
            mapping.reset(arms)
        observation = task.observe(arms, numbers, now)
        if not np.all(np.isfinite(observation)):
            raise ValueError("expected finite numbers to observe: see the state of the arms, and start.numbers")
        chosen = np.asarray(policy(observation[0]), dtype=np.float64)
        command = mapping.command(chosen[None], arms, task.around(numbers, now + LEAD_STEPS / rate_hz))
        away_m, away_rad = mapping.away(arms)
        if away_m > (near_m if k == 0 else leash_m) or (k == 0 and away_rad > _NEAR_RAD):
            raise Refused(
                "out_of_bounds",
                f"the set-point of action {k} is {away_m:.3f} m and {away_rad:.2f} rad away from the hand",
                "bring the arm near the task's start before" if k == 0 else "see what blocks the hand, and the policy",
            )
        return _Choice(state, arms, observation[0], chosen, command, read_s)

    done: list[_Choice] = []
    latest = 0.0
    with contextlib.ExitStack() as opened:
        choice = choose(0)
        inputs = [run[controllet].input(name) for controllet, name in choice.command.targets]
        silence_s = min((float(found["timeout_s"]) for found in inputs), default=1 / rate_hz)
        grippers = opened.enter_context(_Grippers(run))
        parameters = opened.enter_context(contextlib.closing(_Parameters(run)))
        opened.callback(run.take_arms_from, mapping.controllets)  # also before there is a stream
        run.switch(list(mapping.controllets))
        streams: dict[tuple[str, str], Stream] = {}
        for key in choice.command.targets:
            streams[key] = opened.enter_context(run[key[0]].stream(key[1]))
        due = time.monotonic()
        for k in range(count):
            if k > 0 or choice.age_s() > 1 / rate_hz:
                choice = choose(k)
            command = choice.command
            _check_owned(mapping, task, run.state())
            if choice.age_s() > silence_s:
                raise Timeout(
                    f"action {k} came {choice.age_s():.2f} s after the state that it was chosen from; the arms may be "
                    "elsewhere",
                    f"the policy must answer within {1 / rate_hz:g} s",
                )
            for key, target in command.targets.items():
                streams[key].send(target[0])
            grippers.send(command)
            parameters.send(command)
            done.append(choice)
            now_s = time.monotonic()
            due += 1 / rate_hz
            latest = max(latest, now_s - due)
            if now_s > due:
                due = now_s + 1 / rate_hz  # a late action is not compensated: two in one period would be twice as fast
            time.sleep(max(0.0, due - time.monotonic()))
    return Drive(
        np.arange(len(done)) / rate_hz,
        np.array([one.observation for one in done]),
        np.array([one.action for one in done]),
        [one.state for one in done],
        latest,
    )
