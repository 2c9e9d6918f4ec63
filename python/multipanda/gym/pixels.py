"""What cameras see of the worlds of an environment."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np

from ..scene_camera import SceneCamera, SceneView
from .worlds import Worlds

VIEW = SceneCamera([1.5, -1.1, 1.1], look_at_m=[0.4, 0, 0.3], width=480, height=360)  # of render()
STATE = "state"
_RENDERED = "render()"


def spaces_of(cameras: Mapping[str, SceneCamera]) -> dict[str, gymnasium.spaces.Space[Any]]:
    """The spaces of one world's pictures by name."""
    spaces: dict[str, gymnasium.spaces.Space[Any]] = {}
    for name, camera in cameras.items():
        if name == STATE:
            raise ValueError(f"cameras: the name '{STATE}' is that of the other observations; choose another one")
        size = camera.height, camera.width
        spaces[name] = gymnasium.spaces.Box(0, 255, (*size, 3), np.uint8)
        if camera.depth:
            spaces[f"{name}_depth"] = gymnasium.spaces.Box(0, np.inf, (*size, 1), np.float32)
    return spaces


class Pixels:
    """The pictures of worlds, drawn one after the other; nothing is loaded before the first one."""

    def __init__(self, worlds: Worlds, cameras: Mapping[str, SceneCamera]) -> None:
        self._worlds, self._cameras = worlds, dict(cameras)
        self._view: SceneView | None = None

    def _placed(self, world: int) -> SceneView:
        if self._view is None:
            first = next(iter(self._cameras.values()), VIEW)
            self._view = SceneView(self._worlds.task.scene, {**self._cameras, _RENDERED: first})
        batch = self._worlds.batch
        self._view.place(
            {name: arm.q_rad[world] for name, arm in batch.arms.items()},
            {name: poses[world] for name, poses in batch.objects.items()},
            {name: float(arm.gripper[world, 0]) for name, arm in batch.arms.items()},
        )
        return self._view

    def observed(self) -> dict[str, Any]:
        """The cameras' pictures of all worlds, by name."""
        found: dict[str, list[Any]] = {name: [] for name in spaces_of(self._cameras)}
        for world in range(self._worlds.count):
            view = self._placed(world)
            for name in self._cameras:
                rgb, depth = view.shoot(name)
                found[name].append(rgb)
                if depth is not None:
                    found[f"{name}_depth"].append(depth[..., None])
        return {name: np.stack(pictures) for name, pictures in found.items()}

    def rendered(self) -> tuple[Any, ...]:
        """A picture of each world, by the first camera, or from in front of the arms."""
        return tuple(self._placed(world).shoot(_RENDERED)[0] for world in range(self._worlds.count))

    def close(self) -> None:
        """Frees what OpenGL has allocated."""
        if self._view is not None:
            self._view.close()
