"""LeRobot's Teleoperator, made of multipanda's leaders."""

from functools import cached_property
from typing import Any

from lerobot.teleoperators import Teleoperator
from lerobot.utils.errors import DeviceAlreadyConnectedError, DeviceNotConnectedError
from multipanda.lerobot import ArmsLeader, ServoLeader, SpaceMouseLeader

from .config_multipanda import MultipandaLeaderConfig, MultipandaServoLeaderConfig, MultipandaSpaceMouseConfig


class _Leader(Teleoperator):
    """Shared by all. No feedback: the bilateral controllet `teleoperation` has that, at 1 kHz."""

    leader: ArmsLeader | SpaceMouseLeader | ServoLeader

    @cached_property
    def action_features(self) -> dict[str, type]:
        return {name: float for name in self.leader.action_names}

    @property
    def feedback_features(self) -> dict[str, type]:
        return {}

    @property
    def is_connected(self) -> bool:
        return self.leader.connected

    def connect(self, calibrate: bool = True) -> None:
        if self.is_connected:
            raise DeviceAlreadyConnectedError(f"{self} is connected already")
        self.leader.connect()

    @property
    def is_calibrated(self) -> bool:
        return True

    def calibrate(self) -> None:
        pass

    def configure(self) -> None:
        pass

    def get_action(self) -> dict[str, Any]:
        self._need_connection()
        return dict(self.leader.read())

    def send_feedback(self, feedback: dict[str, Any]) -> None:
        raise NotImplementedError("multipanda's leaders take no feedback from LeRobot")

    def disconnect(self) -> None:
        self._need_connection()
        self.leader.disconnect()

    def _need_connection(self) -> None:
        if not self.is_connected:
            raise DeviceNotConnectedError(f"{self} is not connected: call connect() first")


class MultipandaLeader(_Leader):
    """Arms in gravity compensation. connect() makes them soft; disconnect() holds them."""

    config_class = MultipandaLeaderConfig
    name = "multipanda_leader"

    def __init__(self, config: MultipandaLeaderConfig) -> None:
        super().__init__(config)
        self.config = config
        self.leader = ArmsLeader(config)


class MultipandaSpaceMouse(_Leader):
    """SpaceMice: the hand moves while the left button is held, the right button stops all arms."""

    config_class = MultipandaSpaceMouseConfig
    name = "multipanda_space_mouse"

    def __init__(self, config: MultipandaSpaceMouseConfig) -> None:
        super().__init__(config)
        self.config = config
        self.leader = SpaceMouseLeader(config)


class MultipandaServoLeader(_Leader):
    """Small arms of servos (docs/leader.md), calibrated before."""

    config_class = MultipandaServoLeaderConfig
    name = "multipanda_servo_leader"

    def __init__(self, config: MultipandaServoLeaderConfig) -> None:
        super().__init__(config)
        self.config = config
        self.leader = ServoLeader(config)
