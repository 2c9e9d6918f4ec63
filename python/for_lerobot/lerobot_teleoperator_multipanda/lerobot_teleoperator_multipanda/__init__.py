"""Teleoperators for the arms of lerobot_robot_multipanda: arms guided by hand, SpaceMice, or arms of servos."""

from .config_multipanda import MultipandaLeaderConfig, MultipandaServoLeaderConfig, MultipandaSpaceMouseConfig
from .multipanda import MultipandaLeader, MultipandaServoLeader, MultipandaSpaceMouse

__all__ = [
    "MultipandaLeader",
    "MultipandaLeaderConfig",
    "MultipandaServoLeader",
    "MultipandaServoLeaderConfig",
    "MultipandaSpaceMouse",
    "MultipandaSpaceMouseConfig",
]
