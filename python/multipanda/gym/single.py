"""A task in one world, as Gymnasium's environment."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode

from ..tasks.task import Task
from .vector import TaskVectorEnv


class TaskEnv(gymnasium.Env[Any, Any]):
    """A task in one world: a vector environment of one, without its axis.

    Attributes:
        vector: The vector environment.
    """

    def __init__(self, task: Task, *, render_mode: str | None = None, **options: Any) -> None:
        """
        Args:
            task: The task.
            render_mode: `rgb_array`: render() draws the world as the first camera sees it, or from in front.
            options: As for TaskVectorEnv, but `num_envs` and `autoreset_mode`.

        Raises:
            ValueError, ModuleNotFoundError: As for TaskVectorEnv.
        """
        self.vector = TaskVectorEnv(
            task, 1, autoreset_mode=AutoresetMode.DISABLED, render_mode=render_mode, threads=1, **options
        )
        self.metadata = {name: self.vector.metadata[name] for name in ("render_modes", "render_fps")}
        self.render_mode = render_mode
        self.observation_space = self.vector.single_observation_space
        self.action_space = self.vector.single_action_space

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begins an episode; without a seed the next one of the same series."""
        super().reset(seed=seed)
        observation, _ = self.vector.reset(seed=seed)
        return self._first(observation), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Executes one action. After the end of an episode call reset() first."""
        observation, reward, terminated, truncated, infos = self.vector.step(np.asarray(action)[None])
        info = {name: value[0] for name, value in infos.items() if not name.startswith("_")}
        return self._first(observation), float(reward[0]), bool(terminated[0]), bool(truncated[0]), info

    @staticmethod
    def _first(observation: Any) -> Any:
        if isinstance(observation, dict):
            return {name: rows[0] for name, rows in observation.items()}
        return observation[0]

    def render(self) -> Any:
        """A picture of the world, rows x columns x 3; None without render_mode."""
        pictures = self.vector.render()
        return None if pictures is None else pictures[0]

    def close(self) -> None:
        """Releases the world."""
        self.vector.close()
