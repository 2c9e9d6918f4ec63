"""LeRobot's configuration of leaders. Fields and units: their settings in multipanda.lerobot."""

from dataclasses import dataclass

from lerobot.teleoperators import TeleoperatorConfig

try:
    from multipanda.lerobot import LeaderSettings, ServoLeaderSettings, SpaceMouseSettings
except ImportError as missing:
    raise ImportError(
        "lerobot_teleoperator_multipanda needs multipanda: install its wheel into this environment"
    ) from missing


@TeleoperatorConfig.register_subclass("multipanda_leader")
@dataclass(kw_only=True)
class MultipandaLeaderConfig(TeleoperatorConfig, LeaderSettings):
    """Arms that a person leads by hand."""

    def __post_init__(self) -> None:
        self.check()


@TeleoperatorConfig.register_subclass("multipanda_space_mouse")
@dataclass(kw_only=True)
class MultipandaSpaceMouseConfig(TeleoperatorConfig, SpaceMouseSettings):
    """SpaceMice that lead hands."""

    def __post_init__(self) -> None:
        self.check()


@TeleoperatorConfig.register_subclass("multipanda_servo_leader")
@dataclass(kw_only=True)
class MultipandaServoLeaderConfig(TeleoperatorConfig, ServoLeaderSettings):
    """Small arms of servos that lead joints."""

    def __post_init__(self) -> None:
        self.check()
