"""Gymnasium environments on the program's own controllets, safety stage and simulated arms.

    import gymnasium
    import multipanda.gym

    env = gymnasium.make("multipanda/Reach-v0", action="impedance")
    envs = gymnasium.make_vec("multipanda/PressCircle-v0", num_envs=64, vectorization_mode="vector_entry_point")

Importing it registers the environments; docs/learning.md describes them.
"""

from __future__ import annotations

from typing import Any

try:
    import gymnasium
except ModuleNotFoundError as missing:
    raise ModuleNotFoundError("multipanda.gym needs Gymnasium: pip install 'multipanda[gym]'") from missing

from ..tasks import TASKS
from .single import TaskEnv
from .vector import TaskVectorEnv

__all__ = ["TaskEnv", "TaskVectorEnv"]


def _make(name: str, **options: Any) -> TaskEnv:
    return TaskEnv(TASKS[name](), **options)


def _make_vector(name: str, num_envs: int = 1, **options: Any) -> TaskVectorEnv:
    return TaskVectorEnv(TASKS[name](), num_envs, **options)


def _register() -> None:
    for name in TASKS:
        gymnasium.register(
            id=f"multipanda/{name}-v0",
            entry_point=f"{__name__}:_make",
            vector_entry_point=f"{__name__}:_make_vector",
            kwargs={"name": name},
        )


_register()
