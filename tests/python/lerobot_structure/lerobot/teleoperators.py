import abc
from dataclasses import dataclass

from .choices import Device, DeviceConfig


@dataclass(kw_only=True)
class TeleoperatorConfig(DeviceConfig):
    choices = {}


class Teleoperator(Device, abc.ABC):
    """Abstract in the same names as LeRobot's."""


for name in ("action_features", "feedback_features", "is_connected", "is_calibrated"):
    setattr(Teleoperator, name, property(abc.abstractmethod(lambda self: None)))
for name in ("connect", "calibrate", "configure", "get_action", "send_feedback", "disconnect"):
    setattr(Teleoperator, name, abc.abstractmethod(lambda self: None))
abc.update_abstractmethods(Teleoperator)
