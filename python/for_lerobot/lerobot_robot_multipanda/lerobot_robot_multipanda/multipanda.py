"""LeRobot's Robot, made of multipanda's ArmsRobot."""

from functools import cached_property
from typing import Any

from lerobot.cameras import make_cameras_from_configs
from lerobot.robots import Robot
from lerobot.utils.errors import DeviceAlreadyConnectedError, DeviceNotConnectedError
from multipanda import Cameras, SceneCamera
from multipanda.lerobot import ArmsRobot

from .config_multipanda import MultipandaConfig


class Multipanda(Robot):
    """Any number of arms. connect() moves nothing; an exception, disconnect() and silence leave the arms held."""

    config_class = MultipandaConfig
    name = "multipanda"

    def __init__(self, config: MultipandaConfig) -> None:
        super().__init__(config)
        self.config = config
        self.arms = ArmsRobot(config)
        self.cameras = make_cameras_from_configs(config.cameras)
        self.scene_cameras = {name: SceneCamera(**fields) for name, fields in config.scene_cameras.items()}
        self._drawn: Cameras | None = None

    @cached_property
    def observation_features(self) -> dict[str, type | tuple[int, int, int]]:
        features: dict[str, type | tuple[int, int, int]] = {name: float for name in self.arms.state_names}
        for name, camera in self.config.cameras.items():
            if getattr(camera, "use_rgb", True):
                features[name] = (camera.height, camera.width, 3)
            if getattr(camera, "use_depth", False):
                features[f"{name}_depth"] = (camera.height, camera.width, 1)
        for name, seen in self.scene_cameras.items():
            features[name] = (seen.height, seen.width, 3)
        return features

    @cached_property
    def action_features(self) -> dict[str, type]:
        return {name: float for name in self.arms.action_names}

    @property
    def is_connected(self) -> bool:
        return self.arms.connected

    def connect(self, calibrate: bool = True) -> None:
        """Connects the cameras first: without them no arm is started."""
        if self.is_connected:
            raise DeviceAlreadyConnectedError(f"{self} is connected already")
        try:
            for camera in self.cameras.values():
                camera.connect()
            self.arms.connect()
            if self.scene_cameras:
                self._drawn = Cameras(self.arms.client, self.scene_cameras)
        except BaseException:
            self.arms.disconnect()
            self._close_cameras()
            raise
        self.configure()

    @property
    def is_calibrated(self) -> bool:
        """Franka's arms measure absolute joint angles."""
        return True

    def calibrate(self) -> None:
        pass

    def configure(self) -> None:
        pass

    def get_observation(self) -> dict[str, Any]:
        self._need_connection()
        try:
            found: dict[str, Any] = dict(self.arms.observe())
            for name, camera in self.cameras.items():
                if getattr(camera, "use_rgb", True):
                    found[name] = camera.read_latest()
                if getattr(camera, "use_depth", False):
                    found[f"{name}_depth"] = camera.read_latest_depth()
            if self._drawn is not None:
                found.update({name: self._drawn[name].rgb for name in self._drawn})
        except BaseException:
            self.arms.hold()
            raise
        return found

    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        self._need_connection()
        return dict(self.arms.act(action))

    def disconnect(self) -> None:
        self._need_connection()
        if self._drawn is not None:
            self._drawn.close()
            self._drawn = None
        self.arms.disconnect()
        self._close_cameras()

    def _need_connection(self) -> None:
        if not self.is_connected:
            raise DeviceNotConnectedError(f"{self} is not connected: call connect() first")

    def _close_cameras(self) -> None:
        for camera in self.cameras.values():
            if camera.is_connected:
                camera.disconnect()
