"""A task in N worlds at once, as Gymnasium's vector environment; the worlds run on threads of the native module."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from ..rotations import Array
from ..scene_camera import SceneCamera
from ..tasks.actions import LEAD_STEPS
from ..tasks.task import Numbers, Start, Task
from .pixels import STATE, Pixels, spaces_of as picture_spaces
from .worlds import Worlds

Mask = NDArray[np.bool_]
Info = dict[str, Any]


def spaces_of(
    task: Task, action: str, privileged: bool, cameras: Mapping[str, SceneCamera] = MappingProxyType({})
) -> tuple[gymnasium.spaces.Space[Any], gymnasium.spaces.Box]:
    """The spaces of one world: observation and action."""
    names = task.observation_names + (task.privileged_names if privileged else [])
    observation: gymnasium.spaces.Space[Any] = gymnasium.spaces.Box(-np.inf, np.inf, (len(names),), np.float32)
    if cameras:
        observation = gymnasium.spaces.Dict({STATE: observation, **picture_spaces(cameras)})
    return observation, gymnasium.spaces.Box(-1, 1, (task.mapping(action).size,), np.float32)


class TaskVectorEnv(VectorEnv[Any, Any, Any]):
    """A task in N worlds.

    World k of an environment that was reset with seed s equals, bit for bit, the single environment that was reset with
    seed s + k; with a list of seeds each world has its own.

    Attributes:
        task: The task.
        mapping: From actions to set-points.
        worlds: The worlds of the native module.
        action_kind: `pose`, `impedance`, `wrench` or `joints`.
    """

    def __init__(
        self,
        task: Task,
        num_envs: int = 1,
        *,
        action: str = "pose",
        privileged: bool = False,
        plants: bool = False,
        rate_hz: float = 20,
        max_episode_steps: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int = 0,
        cameras: Mapping[str, SceneCamera] = MappingProxyType({}),
        render_mode: str | None = None,
    ) -> None:
        """
        Args:
            task: The task.
            num_envs: How many worlds.
            action: Kind of actions: one of `task.actions`.
            privileged: Whether observations end with true contact forces and the poses of objects, which no arm can
                measure.
            plants: Whether each episode draws other arms: masses, friction, delay (docs/simulation.md, hidden plants).
            rate_hz: Actions per second: a divisor of 1000, from 5 to 200.
            max_episode_steps: Length of an episode; by default the task's.
            autoreset_mode: NEXT_STEP, or DISABLED: reset with the option `reset_mask`.
            threads: How many threads step the worlds; 0: as many as there are processors.
            cameras: Cameras by name, whose pictures are observed: observations are then a dict of `state` and these.
            render_mode: `rgb_array`: render() draws each world as the first camera sees it, or from in front.

        Raises:
            ValueError: A kind of action, rate or mode that there is not.
            ModuleNotFoundError: Cameras, or at the first render(), without MuJoCo for Python or PyOpenGL.
        """
        mode = AutoresetMode(autoreset_mode)
        if mode is AutoresetMode.SAME_STEP:
            raise ValueError("expected autoreset_mode NEXT_STEP or DISABLED, found SAME_STEP")
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"expected render_mode rgb_array or None, found '{render_mode}'")
        if not 5 <= rate_hz <= 200 or abs(1000 / rate_hz - round(1000 / rate_hz)) > 1e-9:
            raise ValueError(f"expected a rate_hz from 5 to 200 that divides 1000, found {rate_hz}")
        self.task, self.num_envs, self.action_kind, self.mode = task, num_envs, action, mode
        self.privileged_observation = privileged
        self.render_mode = render_mode
        self.metadata = {"render_modes": ["rgb_array"], "render_fps": rate_hz, "autoreset_mode": mode}
        self.mapping = task.mapping(action)
        self.mapping.rate_hz = rate_hz
        self.limit = max_episode_steps or round(task.seconds * rate_hz)
        self.single_observation_space, self.single_action_space = spaces_of(task, action, privileged, cameras)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.worlds = Worlds(task, num_envs, self.mapping.controllets, plants=plants, threads=threads)
        self._sees = bool(cameras)
        self._pixels = Pixels(self.worlds, cameras)
        self._randoms: list[np.random.Generator] = []
        self._seeds: list[int] = []
        self._numbers: Numbers = {}
        self._steps = np.zeros(num_envs, dtype=np.int64)
        self._over = np.zeros(num_envs, dtype=np.bool_)  # these worlds are reset at the next step

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, Info]:
        """Begins episodes: in all worlds, or in those of `options["reset_mask"]`."""
        mask = np.ones(self.num_envs, dtype=np.bool_)
        if options is not None and options.get("reset_mask") is not None:
            mask = np.asarray(options["reset_mask"])
            if mask.shape != (self.num_envs,) or mask.dtype != np.bool_ or not mask.any():
                raise ValueError(f"expected a reset_mask of {self.num_envs} booleans, one of them at least True")
            if not self._randoms and not mask.all():
                raise ValueError("expected a first reset of all worlds, found a reset_mask")
        self._seed(seed, mask)
        self._begin(mask)
        return self._observation(), {}

    @property
    def np_random_seed(self) -> Any:
        """The seed of each world; empty before the first reset."""
        return tuple(self._seeds)

    def _seed(self, seed: int | list[int | None] | None, mask: Mask) -> None:
        if isinstance(seed, (int, np.integer)):
            seeds: list[int | None] = [int(seed) + k for k in range(self.num_envs)]
        else:
            seeds = [None] * self.num_envs if seed is None else list(seed)
        if len(seeds) != self.num_envs:
            raise ValueError(f"expected {self.num_envs} seeds, found {len(seeds)}")
        if not self._randoms:
            drawn = [gymnasium.utils.seeding.np_random(one) for one in seeds]
            self._randoms, self._seeds = [random for random, _ in drawn], [own for _, own in drawn]
            return
        for k, one in enumerate(seeds):
            if mask[k] and one is not None:
                self._randoms[k], self._seeds[k] = gymnasium.utils.seeding.np_random(one)

    def _begin(self, mask: Mask) -> None:
        """Draws and starts an episode in each world of the mask; the others do not change."""
        starts: dict[int, Start] = {}
        seeds = np.zeros(self.num_envs, dtype=np.uint64)
        for k in map(int, np.flatnonzero(mask)):
            starts[k] = self.task.draw(self._randoms[k])
            seeds[k] = np.uint64(self._randoms[k].integers(1, 2**53))
        for k, start in starts.items():
            for name, value in start.numbers.items():
                if name not in self._numbers:
                    self._numbers[name] = np.zeros((self.num_envs, len(value)))
                self._numbers[name][k] = value
        self.worlds.reset(mask, seeds, starts)
        self.mapping.reset(self.worlds.states(), mask)
        self._steps[mask] = 0
        self._over[mask] = False

    def _time(self) -> Array:
        time: Array = self._steps / self.mapping.rate_hz
        return time

    def _observation(self) -> Any:
        values = self.task.observe(self.worlds.states(), self._numbers, self._time())
        if self.privileged_observation:
            values = np.concatenate([values, self.task.privileged(self.worlds.truth())], axis=1)
        state = values.astype(np.float32)
        return {STATE: state, **self._pixels.observed()} if self._sees else state

    def render(self) -> tuple[Any, ...] | None:
        """A picture of each world, rows x columns x 3; None without render_mode."""
        return self._pixels.rendered() if self.render_mode else None

    def close_extras(self, **options: Any) -> None:
        """Frees the pictures' memory."""
        self._pixels.close()

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, Info]:
        """One action in each world. A world whose episode has ended is reset instead (NEXT_STEP)."""
        if not self._randoms:
            raise gymnasium.error.ResetNeeded("expected reset() before the first step()")
        begins = self._over.copy()
        if self.mode is AutoresetMode.DISABLED and begins.any():
            raise gymnasium.error.ResetNeeded(f"worlds {np.flatnonzero(begins)} have ended: reset them by reset_mask")
        if begins.any():
            self._begin(begins)
        runs = ~begins
        states = self.worlds.states()
        due = (self._steps + LEAD_STEPS) / self.mapping.rate_hz
        command = self.mapping.command(actions, states, self.task.around(self._numbers, due))
        if begins.any():
            self.mapping.reset(states, begins)  # a world that is reset ignores its action
        self.worlds.send(command, runs)
        self.worlds.step(self.mapping.cycles, runs)
        self._steps[runs] += 1
        return self._judged(runs)

    def _judged(self, runs: Mask) -> tuple[Any, Any, Any, Any, Info]:
        judgment = self.task.judge(self.worlds.states(), self.worlds.truth(), self._numbers, self._time())
        stopped = self.worlds.stopped() & runs
        terminated = (judgment.failed & runs) | stopped
        truncated = (self._steps >= self.limit) & runs & ~terminated
        reward = np.where(runs & ~stopped, judgment.reward, 0.0)
        self._over = terminated | truncated
        info: Info = {"is_success": judgment.success & runs & ~stopped, "_is_success": runs.copy()}
        for name, value in judgment.measures.items():
            info[name], info["_" + name] = value, runs.copy()
        info["stopped"], info["_stopped"] = stopped, runs.copy()
        if stopped.any():
            reasons = np.full(self.num_envs, None, dtype=object)
            for k in np.flatnonzero(stopped):
                reasons[k] = self.worlds.reason(int(k))
            info["reason"], info["_reason"] = reasons, stopped.copy()
        return self._observation(), reward, terminated, truncated, info
