"""Shared by multipanda's LeRobot packages and the export of logs: names of features, arms as a robot, leaders, data
sets. It needs neither LeRobot nor PyTorch (docs/lerobot.md).
"""

from .leader import ArmsLeader as ArmsLeader, ServoLeader as ServoLeader, SpaceMouseLeader as SpaceMouseLeader
from .names import ACTIONS as ACTIONS, OBSERVED as OBSERVED, action_names as action_names, state_names as state_names
from .robot import ArmsRobot as ArmsRobot
from .settings import (
    LeaderSettings as LeaderSettings,
    RobotSettings as RobotSettings,
    RunSettings as RunSettings,
    ServoLeaderSettings as ServoLeaderSettings,
    SpaceMouseSettings as SpaceMouseSettings,
)
