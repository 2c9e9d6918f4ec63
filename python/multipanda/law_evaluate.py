"""One tick of a law outside of the loop: its arrays, and the call of its native code."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import law_layout as layout
from .errors import Error

Array = NDArray[np.float64]


def state_of(
    law: layout.Declaration,
    arm: Mapping[str, Any] | Sequence[Mapping[str, Any]],
    inputs: Mapping[str, Any],
    parameters: Mapping[str, Any],
    memory: Any,
    contact: tuple[float, float, float],
    dt: float,
    time_s: float,
) -> layout.State:
    """The arrays of one tick from what `Law.evaluate` takes.

    Raises:
        ValueError: A number is missing, or an array has another shape.
    """
    given = [arm] if isinstance(arm, Mapping) else list(arm)
    if len(given) != law.arms:
        raise ValueError(f"{law.type} owns {law.arms} arm(s), found {len(given)}")
    arms, counts = [], []
    for number, values in enumerate(given):
        if "q" not in values:
            raise ValueError(f"arm {number}: q is missing")
        n = len(values["q"])
        counts.append(n)
        members = {}
        for name in law.arm_fields:
            if name not in values and name not in ("dq", "c"):
                raise ValueError(f"arm {number}: {name} is missing, which the law uses")
            shape = layout.shape_of(layout.ARM_FIELDS[name].shape, n)
            members[name] = layout.fixed(values.get(name, 0.0), shape, f"arm {number}: {name}")
        arms.append(members)
    for kind, names, known in (("input", inputs, law.inputs), ("parameter", parameters, law.parameters)):
        for name in names:
            if name not in known:
                raise ValueError(f"{law.type} has no {kind} '{name}'; it has: {', '.join(known) or 'none'}")
    made: dict[str, Any] = {}
    for name, spec in law.inputs.items():
        if name not in inputs:
            raise ValueError(f"the input {name} is missing")
        made[name] = _set_point(spec.quantity, inputs[name], counts[spec.arm], name)
    values_of = {}
    for name, parameter in law.parameters.items():
        shape = layout.shape_of([parameter.size], counts[0])
        default = layout.initial_of(parameter)
        values_of[name] = layout.fixed(parameters.get(name, default[: shape[0]]), shape, name)
    own = np.zeros(law.memory_size) if memory is None else np.array(memory, dtype=np.float64)
    if own.shape != (law.memory_size,):
        raise ValueError(f"memory: expected {law.memory_size} numbers, found {own.shape}")
    return layout.State(
        arms,
        made,
        values_of,
        {name: np.zeros(size) for name, size in law.outputs.items()},
        own,
        [np.zeros(n) for n in counts],
        dt,
        time_s,
        contact,
    )


def _set_point(quantity: str, value: Any, n: int, name: str) -> Any:
    members = layout.SET_POINTS.get(quantity)
    if members is None:
        return float(value) if quantity == "scalar" else layout.fixed(value, (6,), name)
    first = next(iter(members))
    if not isinstance(value, Mapping):
        if quantity == "pose":
            raise ValueError(f"{name}: expected a dictionary with p and R, and perhaps V and A")
        value = {first: value}
    made = {}
    for member, (_, shape) in members.items():
        if member not in value and member in ("p", "R", "q"):
            raise ValueError(f"{name}: {member} is missing")
        made[member] = layout.fixed(value.get(member, 0.0), layout.shape_of(shape, n), f"{name}.{member}")
    return made


def call_native(law: layout.Declaration, function: Callable[..., int], state: layout.State) -> None:
    """Calls the compiled law, which writes into the arrays of the state.

    Raises:
        Error: It reports a fault.
    """

    def pointer(array: Array) -> Any:
        return array.ctypes.data_as(ctypes.POINTER(ctypes.c_double))

    arms = (layout.CArm * law.arms)()
    for plain, values, tau in zip(arms, state.arms, state.tau, strict=True):
        plain.n, plain.tau = len(tau), pointer(tau)
        for name, array in values.items():
            setattr(plain, name, pointer(array))
    inputs = (layout.CSetPoint * max(1, len(law.inputs)))()
    scalars = []
    for set_point, (name, spec) in zip(inputs, law.inputs.items(), strict=False):
        value = state.inputs[name]
        if spec.quantity == "scalar":
            scalars.append(np.array([value]))
            set_point.value = pointer(scalars[-1])
        elif spec.quantity in layout.SET_POINTS:
            for member, (member_of_c, _) in layout.SET_POINTS[spec.quantity].items():
                setattr(set_point, member_of_c, pointer(value[member]))
        else:
            set_point.value = pointer(value)
    parameters = (ctypes.POINTER(ctypes.c_double) * max(1, len(law.parameters)))()
    for place, array in enumerate(state.parameters.values()):
        parameters[place] = pointer(array)
    outputs = np.zeros(sum(law.outputs.values()))
    tick = layout.CTick(state.dt, state.time_s, *state.contact, arms, inputs, parameters)
    tick.outputs, tick.memory = pointer(outputs), pointer(state.memory)
    if function(ctypes.byref(tick)) != 0:
        raise Error(
            f"{law.type} reports a fault in this state: an exception, or an index out of bounds",
            "evaluate(..., compiled=False) raises it, with its line",
        )
    place = 0
    for array in state.outputs.values():
        array[:] = outputs[place : place + len(array)]
        place += len(array)
