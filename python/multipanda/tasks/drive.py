"""A policy drives the arms of a run, simulated, virtual or real, by the same mapping as in training."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..errors import Refused
from .actions import LEAD_STEPS, Command
from .arms import ArmStates
from .rotations import Array
from .task import Start, Task

if TYPE_CHECKING:
    from ..client import Client
    from ..state import RunState
    from ..stream import Stream

Policy = Callable[[Array], Array]


@dataclass(frozen=True)
class Drive:
    """What an episode on arms was.

    Attributes:
        t_s: Times since its beginning [s].
        observations: What the policy saw, a row per action.
        actions: What it answered.
        states: The states of the run at these times.
        latest_s: The largest delay of an action behind its time [s].
    """

    t_s: Array
    observations: Array
    actions: Array
    states: list[RunState]
    latest_s: float


def _arms(task: Task, state: RunState) -> dict[str, ArmStates]:
    return {arm.name: ArmStates.of(state.arms[arm.name]) for arm in task.arms}


class _Grippers:
    """Sends what grippers are to do when it changes, on threads: their answers come when the fingers rest."""

    def __init__(self, run: Client) -> None:
        self._run = run
        self._sent: dict[str, tuple[float, float]] = {}
        self._threads: list[threading.Thread] = []

    def send(self, command: Command) -> None:
        for arm, rows in command.grippers.items():
            requested = (float(rows[0, 0]), float(rows[0, 1]))
            if self._sent.get(arm) != requested:
                self._sent[arm] = requested
                self._threads.append(threading.Thread(target=self._move, args=(arm, *requested)))
                self._threads[-1].start()

    def _move(self, arm: str, width_m: float, force_n: float) -> None:
        with contextlib.suppress(Refused):  # it missed, or the next motion has ended it: the policy sees the width
            if force_n > 0:
                self._run.arms[arm].gripper.grasp(width_m, force_n=force_n)
            else:
                self._run.arms[arm].gripper.move(width_m)

    def close(self) -> None:
        for thread in self._threads:
            thread.join()


def drive(
    run: Client,
    task: Task,
    policy: Policy,
    start: Start,
    *,
    action: str = "pose",
    seconds: float | None = None,
    rate_hz: float = 20,
) -> Drive:
    """One episode with a policy on the arms of a run, which is a scene with the task's arms and controllets.

    The arms begin where they are; bring them near the task's start before. Leaving, by an exception too, holds them. A
    sample that the run refuses, because an arm has stopped or was held, raises Refused.

    Args:
        run: The run.
        task: The task.
        policy: From an observation, as `task.observe` makes it, to an action, both of one world.
        start: What the episode is about: `numbers` is used.
        action: Kind of the actions.
        seconds: Length [s]; by default the task's.
        rate_hz: Actions per second: those of the training.

    Raises:
        Refused: A set-point or a parameter was refused.
        Disconnected: The run has ended.
        Timeout: The run does not answer.
    """
    mapping = task.mapping(action)
    numbers = {name: np.asarray(value, dtype=np.float64)[None] for name, value in start.numbers.items()}
    count = round((task.seconds if seconds is None else seconds) * rate_hz)
    times, observations, actions, seen = [], [], [], []
    sent: dict[tuple[str, str], Array] = {}
    latest = 0.0
    with contextlib.ExitStack() as opened:
        run.switch(list(mapping.controllets))
        mapping.reset(_arms(task, run.state()))
        streams: dict[tuple[str, str], Stream] = {}
        grippers = opened.enter_context(contextlib.closing(_Grippers(run)))
        begin = time.monotonic()
        for k in range(count):
            state = run.state()
            arms = _arms(task, state)
            now = np.array([k / rate_hz])
            observation = task.observe(arms, numbers, now)
            chosen = np.asarray(policy(observation[0]), dtype=np.float64)
            command = mapping.command(chosen[None], arms, task.around(numbers, now + LEAD_STEPS / rate_hz))
            for key, target in command.targets.items():
                if key not in streams:
                    streams[key] = opened.enter_context(run[key[0]].stream(key[1]))
                streams[key].send(target[0])
            grippers.send(command)
            for key, value in command.parameters.items():
                if key not in sent or not np.array_equal(sent[key], value):
                    run[key[0]].set(key[1], value[0])
                    sent[key] = value
            times.append(float(now[0]))
            observations.append(observation[0])
            actions.append(chosen)
            seen.append(state)
            due = begin + (k + 1) / rate_hz
            latest = max(latest, time.monotonic() - due)
            time.sleep(max(0.0, due - time.monotonic()))
    return Drive(np.array(times), np.array(observations), np.array(actions), seen, latest)
