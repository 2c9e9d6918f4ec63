"""LeRobot's configuration of the robot. Fields and units: multipanda.lerobot.RobotSettings."""

from dataclasses import dataclass, field

from lerobot.cameras import CameraConfig
from lerobot.robots import RobotConfig

try:
    from multipanda.lerobot import RobotSettings
except ImportError as missing:
    raise ImportError("lerobot_robot_multipanda needs multipanda: install its wheel into this environment") from missing


@RobotConfig.register_subclass("multipanda")
@dataclass(kw_only=True)
class MultipandaConfig(RobotConfig, RobotSettings):
    """One, two or more arms of one run, and LeRobot's own cameras."""

    cameras: dict[str, CameraConfig] = field(default_factory=dict)

    def __post_init__(self) -> None:
        super().__post_init__()
        self.check()
