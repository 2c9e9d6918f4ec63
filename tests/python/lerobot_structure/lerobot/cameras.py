"""A camera whose picture is one number, the same in each pixel."""

from dataclasses import dataclass

import numpy as np


@dataclass(kw_only=True)
class CameraConfig:
    height: int
    width: int
    fps: int = 30
    fails: bool = False


class Camera:
    def __init__(self, config):
        self.config, self.is_connected = config, False

    def connect(self):
        if self.config.fails:
            raise ConnectionError("no camera there")
        self.is_connected = True

    def read_latest(self):
        if not self.is_connected:
            raise ConnectionError("not connected")
        return np.full((self.config.height, self.config.width, 3), 7, dtype=np.uint8)

    def disconnect(self):
        self.is_connected = False


def make_cameras_from_configs(configs):
    return {name: Camera(config) for name, config in configs.items()}
