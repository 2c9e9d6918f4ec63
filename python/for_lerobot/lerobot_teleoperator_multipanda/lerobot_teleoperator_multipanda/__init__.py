"""Teleoperators for the arms of lerobot_robot_multipanda: arms guided by hand, or SpaceMice (docs/lerobot.md)."""

from .config_multipanda import MultipandaLeaderConfig, MultipandaSpaceMouseConfig
from .multipanda import MultipandaLeader, MultipandaSpaceMouse

__all__ = ["MultipandaLeader", "MultipandaLeaderConfig", "MultipandaSpaceMouse", "MultipandaSpaceMouseConfig"]
