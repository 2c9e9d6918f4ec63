import abc
from dataclasses import dataclass

from .choices import Device, DeviceConfig


@dataclass(kw_only=True)
class RobotConfig(DeviceConfig):
    choices = {}


class Robot(Device, abc.ABC):
    """Abstract in the same names as LeRobot's."""


for name in ("observation_features", "action_features", "is_connected", "is_calibrated"):
    setattr(Robot, name, property(abc.abstractmethod(lambda self: None)))
for name in ("connect", "calibrate", "configure", "get_observation", "send_action", "disconnect"):
    setattr(Robot, name, abc.abstractmethod(lambda self: None))
abc.update_abstractmethods(Robot)
