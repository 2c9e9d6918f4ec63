"""Teleoperators for the arms of lerobot_robot_multipanda: arms guided by hand, SpaceMice, or arms of servos."""

from .config_multipanda import (
    MultipandaLeaderConfig as MultipandaLeaderConfig,
    MultipandaServoLeaderConfig as MultipandaServoLeaderConfig,
    MultipandaSpaceMouseConfig as MultipandaSpaceMouseConfig,
)
from .multipanda import (
    MultipandaLeader as MultipandaLeader,
    MultipandaServoLeader as MultipandaServoLeader,
    MultipandaSpaceMouse as MultipandaSpaceMouse,
)
