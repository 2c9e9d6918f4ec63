"""Shared by multipanda's LeRobot packages and the export of logs: names of features, arms as a robot, leaders, data
sets. It needs neither LeRobot nor PyTorch (docs/lerobot.md).
"""

from .leader import ArmsLeader, ServoLeader, SpaceMouseLeader
from .names import ACTIONS, OBSERVED, action_names, state_names
from .robot import ArmsRobot
from .settings import LeaderSettings, RobotSettings, RunSettings, ServoLeaderSettings, SpaceMouseSettings

__all__ = [
    "ACTIONS",
    "OBSERVED",
    "ArmsLeader",
    "ArmsRobot",
    "LeaderSettings",
    "RobotSettings",
    "RunSettings",
    "ServoLeader",
    "ServoLeaderSettings",
    "SpaceMouseLeader",
    "SpaceMouseSettings",
    "action_names",
    "state_names",
]
