"""Franka arms as a robot of LeRobot, by multipanda: --robot.type=multipanda (docs/lerobot.md)."""

from .config_multipanda import MultipandaConfig
from .multipanda import Multipanda

__all__ = ["Multipanda", "MultipandaConfig"]
