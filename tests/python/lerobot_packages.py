"""The two LeRobot packages of this tree, on LeRobot if it is installed, otherwise on the structure of its classes."""

import importlib.util
import sys

from harness import ROOT

INSTALLED = importlib.util.find_spec("lerobot") is not None
if not INSTALLED:
    sys.path.insert(0, str(ROOT / "tests/python/lerobot_structure"))
for name in ("lerobot_robot_multipanda", "lerobot_teleoperator_multipanda"):
    sys.path.insert(0, str(ROOT / "python/for_lerobot" / name))

import lerobot_robot_multipanda as robot_package
import lerobot_teleoperator_multipanda as teleoperator_package

__all__ = ["INSTALLED", "robot_package", "teleoperator_package"]
