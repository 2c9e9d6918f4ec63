"""Configurations by name, as draccus.ChoiceRegistry has them."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any


class Registry:
    choices: dict[str, type] = {}

    @classmethod
    def register_subclass(cls, name):
        def register(kind):
            cls.choices[name] = kind
            return kind

        return register

    @property
    def type(self):
        return next(name for name, kind in type(self).choices.items() if kind is type(self))


@dataclass(kw_only=True)
class DeviceConfig(Registry):
    id: str | None = None
    calibration_dir: Path | None = None

    def __post_init__(self):
        pass


class Device:
    config_class: type
    name: str

    def __init__(self, config: Any):
        self.id = config.id

    def __str__(self):
        return f"{self.id} {type(self).__name__}"

    def __enter__(self):
        self.connect()
        return self

    def __exit__(self, *ended):
        self.disconnect()
