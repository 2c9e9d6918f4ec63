"""LeRobot's configuration of the robot. Fields and units: multipanda.lerobot.RobotSettings."""

from dataclasses import dataclass, field
from typing import Any

from lerobot.cameras import CameraConfig
from lerobot.robots import RobotConfig

try:
    from multipanda.lerobot import RobotSettings
except ImportError as missing:
    raise ImportError("lerobot_robot_multipanda needs multipanda: install its wheel into this environment") from missing


@RobotConfig.register_subclass("multipanda")
@dataclass(kw_only=True)
class MultipandaConfig(RobotConfig, RobotSettings):
    """One, two or more arms of one run, and LeRobot's own cameras.

    Attributes:
        cameras: Real cameras.
        scene_cameras: Cameras of a simulated scene that the robot starts: the fields of multipanda.SceneCamera.
    """

    cameras: dict[str, CameraConfig] = field(default_factory=dict)
    scene_cameras: dict[str, dict[str, Any]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        super().__post_init__()
        self.check()
        if self.scene_cameras and self.scene is None:
            raise ValueError("scene_cameras: expected `scene`, which the robot starts; found none")
