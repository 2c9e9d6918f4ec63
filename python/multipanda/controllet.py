"""A controllet of a run: its parameters as attributes, its features, goals and streams."""

from __future__ import annotations

import difflib
import inspect
from typing import TYPE_CHECKING, Any

from .errors import Refused
from .goal import Goal
from .parameters import Parameter, Value, parameter_of
from .stream import Stream, target_values

if TYPE_CHECKING:
    from .client import Client


def _set_parameter(owner: Any, name: str, value: Any) -> None:
    """Only parameters can be written: a typing error must not make a new attribute."""
    kind = type(owner)
    if isinstance(inspect.getattr_static(kind, name, None), (Parameter, property)):
        object.__setattr__(owner, name, value)
        return
    known = [key for key, member in vars(kind).items() if isinstance(member, (Parameter, property))]
    near = difflib.get_close_matches(name, known, 1)
    hint = f"; did you mean {near[0]}?" if near else f"; it has: {', '.join(known) or 'none'}"
    raise AttributeError(f"{owner.name} has no parameter '{name}'{hint}")


class Feature:
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

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any: ...

    def __setattr__(self, name: str, value: Any) -> None:
        _set_parameter(self, name, value)

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


class Controllet:
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

    name: str
    type: str
    arms: tuple[str, ...]
    client: Client
    _parameters: dict[str, Parameter]

    def __init__(self, client: Client, entry: dict[str, Any]) -> None:
        object.__setattr__(self, "client", client)
        object.__setattr__(self, "name", entry["name"])
        object.__setattr__(self, "type", entry["type"])
        object.__setattr__(self, "arms", tuple(entry["arms"]))

    def __repr__(self) -> str:
        return f"<controllet {self.name}: {self.type} of {', '.join(self.arms)}>"

    if TYPE_CHECKING:  # parameters are known when the run is: type checkers take any other name as one

        def __getattr__(self, name: str) -> Any: ...

    def __setattr__(self, name: str, value: Any) -> None:
        _set_parameter(self, name, value)

    def describe(self) -> dict[str, Any]:
        """Everything that the run says about it now: inputs, parameters, features, whether it is active."""
        for entry in self.client.listing()["controllets"]:
            if entry["name"] == self.name:
                return dict(entry)
        raise Refused("unknown_instance", f"the run has no controllet '{self.name}'")

    @property
    def active(self) -> bool:
        """Whether it owns its arms now."""
        return bool(self.describe()["active"])

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
        sent = known.sent(value) if known is not None else value  # an unknown name is refused with the nearest
        self.client.ask({"do": "parameter", "controllet": self.name, "name": parameter, "value": sent})

    @property
    def features(self) -> dict[str, bool]:
        """Its features, and whether they are on."""
        return {entry["name"]: bool(entry["on"]) for entry in self.describe()["features"]}

    def feature(self, name: str, on: bool = True) -> None:
        """Switches a feature on or off."""
        self.client.ask({"do": "feature", "controllet": self.name, "name": name, "on": on})

    def activate(self) -> None:
        """Gives it its arms: run.switch(name)."""
        self.client.switch(self.name)

    def deactivate(self) -> None:
        """Takes its arms, which are held then."""
        self.client.switch(deactivate=self.name)

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

    def goal(self, name: str, values: Any, *, frame: str | None = None, duration_s: float | None = None) -> Goal:
        """Sets a goal for an input; returns once the loop has accepted it.

        Args:
            name: Name of the input.
            values: For a pose a Pose, 7 numbers x y z qw qx qy qz [m], or a 4 x 4 matrix; for a twist [m/s, rad/s] or a
                wrench [N, N m] 6 numbers, linear first; for joints one angle each [rad].
            frame: `world` (default) or `<arm>_base`.
            duration_s: Duration of the motion [s]; longer if the limits require it. Without it, as fast as they allow.

        Returns:
            The goal; `wait()` waits for the arrival.

        Raises:
            Refused: The controllet is not active, or the goal is out of reach.
            ValueError: Another number of values, or one that is not finite.
        """
        spec = self.input(name)
        quantity: str = spec["quantity"]
        numbers = target_values(quantity, values, spec["values"])
        request: dict[str, Any] = {"do": "reference", "controllet": self.name, "input": name}
        if quantity == "pose":
            request |= {"position_m": numbers[:3], "quaternion_wxyz": numbers[3:]}
        elif quantity == "twist":
            request |= {"linear_m_per_s": numbers[:3], "angular_rad_per_s": numbers[3:]}
        elif quantity == "wrench":
            request |= {"force_n": numbers[:3], "torque_nm": numbers[3:]}
        elif quantity == "joints":
            request["q_rad"] = numbers
        else:
            request["value"] = numbers[0]
        if frame is not None:
            request["frame"] = frame
        if duration_s is not None:
            request["duration_s"] = duration_s
        answer = self.client.ask(request)
        self.client.commanded(self.name)
        self.client.streaming.pop(self.name, None)
        return Goal(self, spec, numbers, frame or "world", float(answer["t_s"]))

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


def make_controllet(client: Client, entry: dict[str, Any], joints: dict[str, int]) -> Controllet:
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
        parameter.name = name  # of the request; a feature's is not the attribute's
    return made
