"""Cameras in a scene: MuJoCo draws what they see, in the caller's process and without a screen (docs/cameras.md)."""

from __future__ import annotations

import atexit
import glob
import os
import weakref
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .model import settings_words
from .pose import Pose
from .rotations import Array

_LARGEST = 1920, 1440  # of MuJoCo's buffer in multipanda's scenes [pixel]
_NOTHING = 0.99  # of the farthest depth: the sky
_VIEWS: weakref.WeakSet[SceneView] = weakref.WeakSet()


@dataclass(frozen=True)
class SceneCamera:
    """A camera of a simulated scene: a pinhole without distortion. Its axes are x right, y down, z forward.

    Attributes:
        position_m: x, y, z in the world, or in the flange of `on` [m].
        look_at_m: A point in the middle of the picture [m]; the picture's upper side is towards +z, or +x if it looks
            along z.
        rpy_rad: In place of look_at_m: roll, pitch, yaw of its axes [rad].
        on: Arm on whose flange it is mounted; empty: it stands in the world.
        width: Columns of its picture.
        height: Rows of its picture.
        fov_deg: Vertical field of view [degree].
        depth: Whether it also measures depth.
        shadows: Whether shadows are drawn, which takes three times as long without a GPU.
    """

    position_m: Sequence[float]
    look_at_m: Sequence[float] | None = None
    rpy_rad: Sequence[float] | None = None
    on: str = ""
    width: int = 320
    height: int = 240
    fov_deg: float = 45
    depth: bool = False
    shadows: bool = False

    def __post_init__(self) -> None:
        if (self.look_at_m is None) == (self.rpy_rad is None):
            raise ValueError("expected look_at_m or rpy_rad, found both or neither")
        for what, value, most in zip(("width", "height"), (self.width, self.height), _LARGEST):
            if not 16 <= value <= most:
                raise ValueError(f"{what}: expected 16 to {most} pixels, found {value}")
        if not 1 <= self.fov_deg <= 170:
            raise ValueError(f"fov_deg: expected 1 to 170 degrees, found {self.fov_deg}")
        _ = self.pose

    @property
    def pose(self) -> Pose:
        """Its optical frame in the world, or in the flange [m]. Raises ValueError if look_at_m is position_m."""
        if self.rpy_rad is not None:
            return Pose.at(self.position_m, rpy_rad=self.rpy_rad)
        way = np.asarray(self.look_at_m, dtype=np.float64) - np.asarray(self.position_m, dtype=np.float64)
        if way.shape != (3,) or not np.linalg.norm(way) > 1e-6:
            raise ValueError(f"look_at_m: expected a point away from position_m, found {self.look_at_m}")
        forward = way / np.linalg.norm(way)
        up = np.array([1.0, 0, 0] if abs(forward[2]) > 0.999 else [0, 0, 1.0])
        right = np.cross(forward, up) / np.linalg.norm(np.cross(forward, up))
        return Pose.at(self.position_m, rotation=np.column_stack([right, np.cross(forward, right), forward]))

    @property
    def matrix(self) -> Array:
        """K: a point x, y, z in its axes is at (K @ [x, y, z]) / z, in pixels from the upper left corner."""
        focal = 0.5 * self.height / np.tan(np.radians(0.5 * self.fov_deg))
        return np.array([[focal, 0, 0.5 * self.width], [0, focal, 0.5 * self.height], [0, 0, 1]])


def _mujoco() -> Any:
    """MuJoCo with an OpenGL context that needs no screen: a GPU's by EGL, otherwise computed by OSMesa."""
    gpu = glob.glob("/dev/dri/renderD*") or os.path.exists("/dev/nvidiactl")
    os.environ.setdefault("MUJOCO_GL", "egl" if gpu else "osmesa")
    try:
        import mujoco
        import mujoco.rendering.classic.renderer
        import OpenGL  # noqa: F401
    except ModuleNotFoundError as missing:
        raise ModuleNotFoundError(
            f"cameras of scenes need MuJoCo for Python and PyOpenGL ({missing}): pip install 'multipanda[cameras]'"
        ) from missing
    return mujoco


class SceneView:
    """What cameras of one scene see of a world whose positions are given. Only the thread that made it may use it.

    Attributes:
        cameras: The cameras by name.
    """

    def __init__(
        self,
        scene: str | os.PathLike[str],
        cameras: Mapping[str, SceneCamera],
        settings: Mapping[str, Any] | None = None,
    ) -> None:
        """
        Args:
            scene: The scene, by name or file.
            cameras: The cameras by name.
            settings: Other values of the scene, as for run().

        Raises:
            ValueError: There is no such scene, or a camera is on an arm that it does not have.
            ModuleNotFoundError: MuJoCo for Python or PyOpenGL is not installed.
            ProgramMissing: The compiled part is not installed.
        """
        self._renderers: dict[tuple[int, int], Any] = {}
        mujoco = self._mujoco = _mujoco()
        from multipanda_native._core import core

        data = core.world_model(os.fspath(scene), settings_words(settings or {}))
        try:
            self._model = mujoco.MjModel.from_binary_path("scene.mjb", {"scene.mjb": data})
        except (ValueError, RuntimeError) as wrong:
            raise ValueError(f"MuJoCo {mujoco.__version__} cannot read the scene's model: {wrong}") from wrong
        self._model.vis.quality.offsamples = 0
        self._model.vis.quality.shadowsize = 1024
        self._data = mujoco.MjData(self._model)
        self._at = {self._model.joint(k).name: int(self._model.jnt_qposadr[k]) for k in range(self._model.njnt)}
        self.cameras = dict(cameras)
        arms = {name.partition("/")[0] for name in self._at if name.endswith("/joint1")}
        for name, camera in self.cameras.items():
            if camera.on and camera.on not in arms:
                raise ValueError(f"camera '{name}' is on '{camera.on}'; the scene's arms: {', '.join(sorted(arms))}")
        self.place({}, {})
        _VIEWS.add(self)

    def place(
        self, joints: Mapping[str, Array], objects: Mapping[str, Array], widths_m: Mapping[str, float] | None = None
    ) -> None:
        """Sets the world.

        Args:
            joints: Joint angles by arm [rad].
            objects: Poses of free objects by name: x y z [m], qw qx qy qz.
            widths_m: Openings of fingers by arm [m]; ignored where they do not move.
        """
        qpos = self._data.qpos
        for arm, angles in joints.items():
            for k, angle in enumerate(angles):
                qpos[self._at[f"{arm}/joint{k + 1}"]] = angle
        for name, pose in objects.items():
            qpos[self._at[name] : self._at[name] + 7] = pose
        for arm, width in (widths_m or {}).items():
            for finger in ("finger_joint1", "finger_joint2"):
                at = self._at.get(f"{arm}/{finger}")
                if at is not None and np.isfinite(width):
                    qpos[at] = 0.5 * width
        self._mujoco.mj_kinematics(self._model, self._data)
        self._mujoco.mj_comPos(self._model, self._data)
        self._mujoco.mj_camlight(self._model, self._data)

    def _renderer(self, camera: SceneCamera) -> Any:
        size = camera.height, camera.width
        if size not in self._renderers:
            try:
                self._renderers[size] = self._mujoco.rendering.classic.renderer.Renderer(self._model, *size)
            except (ImportError, RuntimeError) as wrong:
                raise RuntimeError(
                    f"no picture without OpenGL ({wrong}): install Debian's libosmesa6, or libegl1 with a GPU, and set"
                    " MUJOCO_GL=osmesa or egl before the first import of mujoco"
                ) from wrong
        return self._renderers[size]

    def _aim(self, camera: SceneCamera, scene: Any) -> None:
        pose = camera.pose
        if camera.on:
            flange = self._data.site(f"{camera.on}/flange")
            pose = Pose.at(flange.xpos, rotation=flange.xmat.reshape(3, 3)) @ pose
        near, far = (x * self._model.stat.extent for x in (self._model.vis.map.znear, self._model.vis.map.zfar))
        top = near * np.tan(np.radians(0.5 * camera.fov_deg))
        for eye in scene.camera:
            eye.pos[:], eye.forward[:], eye.up[:] = pose.position_m, pose.rotation[:, 2], -pose.rotation[:, 1]
            eye.frustum_near, eye.frustum_far, eye.frustum_top, eye.frustum_bottom = near, far, top, -top
            eye.frustum_center = eye.frustum_width = 0  # the width follows from the picture's sides
            eye.orthographic = 0

    def shoot(self, name: str) -> tuple[NDArray[np.uint8], NDArray[np.float32] | None]:
        """The picture of a camera: height x width x 3, and its depth [m] along the view, 0 where there is nothing.

        Raises:
            RuntimeError: There is no OpenGL.
        """
        camera = self.cameras[name]
        renderer = self._renderer(camera)
        flags, flag = renderer.scene.flags, self._mujoco.mjtRndFlag
        flags[flag.mjRND_SHADOW], flags[flag.mjRND_REFLECTION] = camera.shadows, False
        self._aim(camera, renderer.scene)  # places the headlight, which update_scene() puts where the last camera was
        renderer.update_scene(self._data)
        self._aim(camera, renderer.scene)
        rgb = renderer.render()
        if not camera.depth:
            return rgb, None
        renderer.enable_depth_rendering()
        depth = renderer.render()
        renderer.disable_depth_rendering()
        depth[depth > _NOTHING * self._model.vis.map.zfar * self._model.stat.extent] = 0
        return rgb, depth

    def close(self) -> None:
        """Frees what OpenGL has allocated."""
        while self._renderers:
            self._renderers.popitem()[1].close()


@atexit.register
def _close_all() -> None:
    """MuJoCo's own end of a renderer fails once Python is being torn down."""
    for view in list(_VIEWS):
        view.close()
