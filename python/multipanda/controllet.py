"""A controllet of a run: its parameters as attributes, its features, goals and streams."""

from __future__ import annotations

import difflib
import inspect
import math
from collections.abc import Iterable, Mapping
from typing import Any

from .base_client import BaseClient
from .goal import Goal
from .instance import Instance
from .parameters import Parameter, Value, parameter_of
from .state import ArmState
from .stream import Stream, target_values


def _no_parameter(owner: Any, name: str) -> AttributeError:
    known = [key for key, member in vars(type(owner)).items() if isinstance(member, (Parameter, property))]
    near = [key for key in known if name in key] or difflib.get_close_matches(name, known, 1)
    hint = f"; did you mean {' or '.join(near)}?" if near else f"; it has: {', '.join(known) or 'none'}"
    return AttributeError(f"{vars(owner).get('name', 'it')} has no parameter '{name}'{hint}")


class _Parameters:
    """Only parameters can be written: a typing error must not make a new attribute.

    Reading an unknown one suggests the nearest.
    """

    def __setattr__(self, name: str, value: Any) -> None:
        if not isinstance(inspect.getattr_static(type(self), name, None), (Parameter, property)):
            raise _no_parameter(self, name)
        object.__setattr__(self, name, value)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):  # of Python and notebooks, which look up optional attributes
            raise AttributeError(name)
        raise _no_parameter(self, name)


class Feature(_Parameters):
    """A feature of a controllet: its parameters are attributes. Errors are those of Controllet.

    Attributes:
        name: Name of the feature.
        controllet: The controllet that has it.
    """

    name: str
    controllet: Controllet

    def __init__(self, controllet: Controllet, name: str) -> None:
        object.__setattr__(self, "controllet", controllet)
        object.__setattr__(self, "name", name)

    def __repr__(self) -> str:
        return f"<feature {self.name} of {self.controllet.name}>"

    def describe(self) -> dict[str, Any]:
        """As Controllet.describe()."""
        return self.controllet.describe()

    def set(self, parameter: str, value: Any) -> None:
        """As Controllet.set()."""
        self.controllet.set(parameter, value)

    def switch(self, on: bool = True) -> None:
        """Switches it on or off."""
        self.controllet.feature(self.name, on)

    @property
    def on(self) -> bool:
        """Whether it is on."""
        return self.controllet.features[self.name]


class Controllet(_Parameters, Instance):
    """One configured control law of the scene: `run["left_cartesian"]`.

    Its parameters are attributes, and so are its features; `help()` of it shows them with units and bounds. Everything
    here asks the run, and raises `Refused` with the reason if the loop does not accept it, `Timeout` without an answer,
    `Disconnected` once the run has ended. Writing an attribute that does not exist raises AttributeError.

    Attributes:
        name: Name of the instance.
        type: Type of the law, such as `cartesian_impedance`.
        arms: Names of the arms that it owns while it is active.
        client: The run.
    """

    _parameters: dict[str, Parameter]

    @property
    def descriptors(self) -> dict[str, Parameter]:
        """All parameters, with units and bounds; those of a feature as feature.parameter."""
        return dict(self._parameters)

    @property
    def parameters(self) -> dict[str, Value]:
        """All parameters and their values."""
        entries = self.describe()["parameters"]
        return {entry["name"]: self._parameters[entry["name"]].read(entry) for entry in entries}

    def set(self, parameter: str, value: Any) -> None:
        """Sets a parameter by its name: one number for all, a list, or the name of a choice.

        Raises:
            Refused: The name is unknown, or the value is out of bounds.
            TypeError: It is neither a number nor a choice.
            ValueError: A number is not finite.
        """
        known = self._parameters.get(parameter)
        # An unknown name is refused by the run, which suggests the nearest.
        sent = known.sent(value) if known is not None else value
        self.client.ask({"do": "parameter", "controllet": self.name, "name": parameter, "value": sent})

    @property
    def features(self) -> dict[str, bool]:
        """Its features, and whether they are on."""
        return {entry["name"]: bool(entry["on"]) for entry in self.describe()["features"]}

    def feature(self, name: str, on: bool = True) -> None:
        """Switches a feature on or off."""
        self.client.ask({"do": "feature", "controllet": self.name, "name": name, "on": on})

    def activate(self) -> None:
        """Activates it: run.switch(name)."""
        self.client.switch(self.name)

    def deactivate(self) -> None:
        """Deactivates it; its arms are held."""
        self.client.switch(deactivate=self.name)

    def goal(
        self,
        name: str,
        values: Any,
        *,
        frame: str | None = None,
        duration_s: float | None = None,
        until: Mapping[str, float] | None = None,
    ) -> Goal:
        """Sets a goal for an input; returns once the loop has accepted it.

        Args:
            name: Name of the input.
            values: For a pose a Pose, 7 numbers x y z qw qx qy qz [m], or a 4 x 4 matrix; for a twist [m/s, rad/s] or a
                wrench [N, N m] 6 numbers, linear first; for joints one angle each [rad].
            frame: `world` (default) or `<arm>_base`.
            duration_s: Duration of the motion [s]; longer if the limits require it. Without it, as fast as they allow.
            until: Conditions that end it early, in the loop: the estimated force or moment of an arm changes by
                `force_n` [N] or `torque_nm` [N m], or its hand moves by `distance_m` [m]. The set-point then brakes and
                rests there.

        Returns:
            The goal: `shortest_s` is what its limits allow, `wait()` waits for the arrival.

        Raises:
            Refused: The controllet is not active, the goal is out of reach, or `until` cannot be known here.
            ValueError: Another number of values, or one that is not finite.
        """
        spec = self.input(name)
        quantity: str = spec["quantity"]
        numbers = target_values(quantity, values, spec["values"])
        request: dict[str, Any] = {"do": "reference", "controllet": self.name, "input": name, "values": numbers}
        if frame is not None:
            request["frame"] = frame
        if duration_s is not None:
            request["duration_s"] = duration_s
        if until is not None:
            self.client.shared()  # which reports how it ended
            request["until"] = {key: float(value) for key, value in until.items()}
        answer = self.client.ask(request)
        self.client.commanded(self.name)
        self.client.streaming.pop(self.name, None)
        return Goal(self, spec, numbers, frame or "world", float(answer["t_s"]), duration_s, until is not None)

    def through(
        self,
        name: str,
        places: Iterable[Any],
        *,
        frame: str | None = None,
        timeout_s: float = 30,
        position_m: float = 0.03,
        angle_rad: float = 0.1,
    ) -> ArmState:
        """Goes through poses or joint angles and stops at the last one only.

        The next goal is set where the arm is within the tolerances of the one before it: it turns there without
        stopping.
        Errors are those of goal() and Goal.wait().

        Args:
            name: Name of the input.
            places: Values as for goal(), at least one.
            frame: `world` (default) or `<arm>_base`.
            timeout_s: How long each may take [s].
            position_m: How near it passes [m].
            angle_rad: How near it passes [rad], of the hand or of a joint.

        Returns:
            The state at the last place.
        """
        *passed, last = places
        for place in passed:
            self.goal(name, place, frame=frame).wait(
                timeout_s, position_m=position_m, angle_rad=angle_rad, speed_rad_per_s=math.inf
            )
        return self.goal(name, last, frame=frame).wait(timeout_s)

    def stream(self, name: str, *, frame: str | None = None) -> Stream:
        """Opens a stream to an input, for use with `with`. Silence for the input's `timeout_s` [s] means hold.

        Args:
            name: Name of the input.
            frame: `world` (default) or `<arm>_base`.
        """
        stream = Stream(self, name, frame)
        self.client.commanded(self.name)
        return stream


def _feature_of(name: str, members: dict[str, Any]) -> property:
    kind = type(name, (Feature,), {**members, "__doc__": f"The feature {name}: switch(True or False), on, parameters."})

    def get(owner: Controllet) -> Any:
        return kind(owner, name)

    return property(get, doc=f"The feature {name}: {', '.join(members) or 'no parameters'}.")


def make_controllet(client: BaseClient, entry: dict[str, Any], joints: dict[str, int]) -> Controllet:
    """A controllet whose class has the parameters of this instance, for help() and completion."""
    of_arms = {joints[arm] for arm in entry["arms"]}
    count = of_arms.pop() if len(of_arms) == 1 else 0
    parameters = {p["name"]: parameter_of(p, count) for p in entry["parameters"]}
    own: dict[str, Any] = {name: p for name, p in parameters.items() if "." not in name}
    for feature in entry["features"]:
        prefix = feature["name"] + "."
        members = {name[len(prefix) :]: p for name, p in parameters.items() if name.startswith(prefix)}
        own[feature["name"]] = _feature_of(feature["name"], members)
    lines = [f"{entry['name']}: {entry['type']} of {', '.join(entry['arms'])}.", ""]
    lines += [
        f"input {i['name']}: {i['quantity']} of {i['values']} numbers in {i['frame']}. {i['doc']}"
        for i in entry["inputs"]
    ]
    lines += [f"feature {f['name']}: an attribute with its parameters and on" for f in entry["features"]]
    own |= {"_parameters": parameters, "__doc__": "\n".join(lines)}
    made: Controllet = type(entry["type"], (Controllet,), own)(client, entry)
    for name, parameter in parameters.items():
        parameter.name = name  # the name in requests; that of a feature's parameter differs from its attribute
    return made
