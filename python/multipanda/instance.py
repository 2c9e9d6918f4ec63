"""A controllet of a run, for its goals and streams."""

from __future__ import annotations

from typing import Any

import numpy as np

from .base_client import BaseClient
from .errors import Refused
from .pose import Pose


class Instance:
    """One configured control law of the scene, without its parameters. Errors are those of Controllet.

    Attributes:
        name: Name of the instance.
        type: Type of the law, such as `cartesian_impedance`.
        arms: Names of the arms that it owns while it is active.
        client: The run.
    """

    name: str
    type: str
    arms: tuple[str, ...]
    client: BaseClient

    def __init__(self, client: BaseClient, entry: dict[str, Any]) -> None:
        own = {"client": client, "name": entry["name"], "type": entry["type"], "arms": tuple(entry["arms"])}
        for name, value in own.items():
            object.__setattr__(self, name, value)  # a controllet's other attributes are parameters

    def __repr__(self) -> str:
        return f"<controllet {self.name}: {self.type} of {', '.join(self.arms)}>"

    def describe(self) -> dict[str, Any]:
        """Its present description: inputs, parameters, features, whether it is active."""
        for entry in self.client.listing()["controllets"]:
            if entry["name"] == self.name:
                return dict(entry)
        raise Refused("unknown_instance", f"the run has no controllet '{self.name}'")

    @property
    def active(self) -> bool:
        """Whether it owns its arms now."""
        return bool(self.describe()["active"])

    @property
    def inputs(self) -> dict[str, dict[str, Any]]:
        """Its inputs: quantity, frame, arm, timeout_s, doc."""
        return {entry["name"]: dict(entry) for entry in self.describe()["inputs"]}

    def input(self, name: str) -> dict[str, Any]:
        """One of its inputs. Raises Refused with the names that exist."""
        inputs = self.inputs
        if name not in inputs:
            raise Refused("unknown_input", f"{self.name} has no input '{name}'; it has: {', '.join(inputs) or 'none'}")
        return inputs[name]

    def set_point(self, name: str) -> Any:
        """The loop's present set-point of an input: a Pose in the world, or an array in SI units.

        Goals relative to it do not accumulate the deflection of a soft arm:
        `law.goal("pose", law.set_point("pose").moved(z=0.1))`.

        Raises:
            Refused: The controllet is not active, or the run shares no records.
        """
        quantity = self.input(name)["quantity"]
        self.client.state()  # waits for the cycle that executed this client's last request
        values = self.client.record()[f"{self.name}/{name}"]
        if not np.all(np.isfinite(values)):
            raise Refused("not_active", f"{self.name} is not active: '{name}' has no set-point")
        return Pose.of(values) if quantity == "pose" else values
