"""Inputs and outputs of a law: the C interface of laws (core/plugin/c_law.h), and the same as named tuples."""

from __future__ import annotations

import collections
import ctypes
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

VERSION = 1
MOST_JOINTS = 16
QUANTITIES = ("pose", "twist", "wrench", "joints", "scalar")

_U32, _POINTER, _NUMBERS, _TEXT = ctypes.c_uint32, ctypes.c_void_p, ctypes.POINTER(ctypes.c_double), ctypes.c_char_p


class CParameter(ctypes.Structure):
    """multipanda_c_parameter."""

    _fields_ = [("name", _TEXT), ("unit", _TEXT), ("doc", _TEXT), ("size", _U32), ("initial_count", _U32)]
    _fields_ += [("initial", _NUMBERS), ("min", ctypes.c_double), ("max", ctypes.c_double)]


class CInput(ctypes.Structure):
    """multipanda_c_input."""

    _fields_ = [("name", _TEXT), ("doc", _TEXT), ("quantity", _U32), ("arm", _U32)]


class COutput(ctypes.Structure):
    """multipanda_c_output."""

    _fields_ = [("name", _TEXT), ("doc", _TEXT), ("size", _U32)]


class ArmField(NamedTuple):
    """One member of `arm`, in the order of multipanda_c_arm: its shape, where "n" is the number of joints, and its flag
    MULTIPANDA_USES_..."""

    shape: tuple[int | str, ...]
    flag: int = 0


ARM_FIELDS = {
    "q": ArmField(("n",)),
    "dq": ArmField(("n",)),
    "tau_J": ArmField(("n",), 256),
    "p_WE": ArmField((3,), 1),
    "R_WE": ArmField((3, 3), 1),
    "V_WE": ArmField((6,), 2),
    "J_V_WE": ArmField((6, "n"), 4),
    "M": ArmField(("n", "n"), 8),
    "c": ArmField(("n",), 16),
    "g": ArmField(("n",), 32),
    "tau_ext_hat": ArmField(("n",), 64),
    "F_K_W_est": ArmField((6,), 128),
}


class CArm(ctypes.Structure):
    """multipanda_c_arm."""

    _fields_ = [("n", ctypes.c_uint64), *((name, _NUMBERS) for name in (*ARM_FIELDS, "tau"))]


class CSetPoint(ctypes.Structure):
    """multipanda_c_set_point."""

    _fields_ = [(name, _NUMBERS) for name in ("value", "rotation", "velocity", "acceleration")]


class CTick(ctypes.Structure):
    """multipanda_c_tick."""

    _fields_ = [(name, ctypes.c_double) for name in ("dt", "time_s", "hand_speed", "spring_force", "spring_moment")]
    _fields_ += [("arms", ctypes.POINTER(CArm)), ("inputs", ctypes.POINTER(CSetPoint))]
    _fields_ += [("parameters", ctypes.POINTER(_NUMBERS)), ("outputs", _NUMBERS), ("memory", _NUMBERS)]


C_FUNCTION = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.POINTER(CTick))


class CLaw(ctypes.Structure):
    """multipanda_c_law."""

    _fields_ = [("type", _TEXT), ("doc", _TEXT)]
    _fields_ += [(n, _U32) for n in ("arms", "uses", "input_count", "parameter_count", "output_count", "memory_size")]
    _fields_ += [(name, _POINTER) for name in ("inputs", "parameters", "outputs", "start", "update")]


class CLaws(ctypes.Structure):
    """multipanda_c_laws."""

    _fields_ = [("version", _U32)]
    _fields_ += [(f"size_of_{n}", _U32) for n in ("law", "parameter", "input", "output", "arm", "set_point", "tick")]
    _fields_ += [("law_count", _U32), ("reserved", _U32), ("laws", ctypes.POINTER(CLaw))]


# Members of a set-point, each with its place in multipanda_c_set_point; twists, wrenches and scalars have none.
SET_POINTS: dict[str, dict[str, tuple[str, tuple[int | str, ...]]]] = {
    "pose": {
        "p": ("value", (3,)),
        "R": ("rotation", (3, 3)),
        "V": ("velocity", (6,)),
        "A": ("acceleration", (6,)),
    },
    "joints": {"q": ("value", ("n",)), "dq": ("velocity", ("n",)), "ddq": ("acceleration", ("n",))},
}
CONTACT = ("hand_speed", "spring_force", "spring_moment")


@dataclass(frozen=True)
class LawParameter:
    """A parameter of a law: `mp.LawParameter(50, 0, 200, unit="N m/rad", size="joints")`.

    Attributes:
        initial: Its value at the start, in `unit`; a list for different ones.
        low: Least value, in `unit`.
        high: Largest value, in `unit`.
        unit: Its unit, such as `N/m`; empty for a ratio.
        size: How many numbers, or "joints" for one per joint of the first arm. The law gets a float if it is 1.
        doc: What it means.
    """

    initial: float | Sequence[float]
    low: float
    high: float
    unit: str = ""
    size: int | str = 1
    doc: str = ""


@dataclass(frozen=True)
class LawInput:
    """An input of a law of several arms: `mp.LawInput("pose", arm=1)`.

    Attributes:
        quantity: "pose", "joints", "twist", "wrench" or "scalar".
        arm: Which of the law's arms, from 0.
        doc: What it means.
    """

    quantity: str
    arm: int = 0
    doc: str = ""


@dataclass(frozen=True)
class Declaration:
    """Checked declarations of a law."""

    type: str
    doc: str
    arms: int
    inputs: Mapping[str, LawInput]
    parameters: Mapping[str, LawParameter]
    outputs: Mapping[str, int]
    memory: Mapping[str, int | str]
    uses: frozenset[str] = frozenset()

    @property
    def arm_fields(self) -> list[str]:
        """The members of `arm`: always q and dq, and what the law uses."""
        return [name for name, field in ARM_FIELDS.items() if not field.flag or name in self.uses]

    @property
    def flags(self) -> int:
        """The sum of MULTIPANDA_USES_..."""
        flags = 0
        for name in self.arm_fields:
            flags |= ARM_FIELDS[name].flag
        return flags

    @property
    def memory_size(self) -> int:
        """Numbers in memory; that of a joint is laid out for the largest arm."""
        return sum(reserved(size) for size in self.memory.values())


def initial_of(spec: LawParameter) -> list[float]:
    """One initial value for all numbers, or one for each; the last counts for further joints."""
    values = [spec.initial] if isinstance(spec.initial, (int, float)) else list(spec.initial)
    if isinstance(spec.size, str) and len(values) > 1:
        values += [values[-1]] * (MOST_JOINTS - len(values))
    return [float(value) for value in values]


def reserved(size: int | str) -> int:
    """How many numbers of the memory a member takes."""
    return MOST_JOINTS if isinstance(size, str) else size


def shape_of(shape: Iterable[int | str], n: int) -> tuple[int, ...]:
    """A shape with the number of joints in place of "n" and "joints"."""
    return tuple(n if isinstance(part, str) else part for part in shape)


def tuple_class(name: str, members: Iterable[str]) -> Callable[..., Any]:
    """The class of a named tuple."""
    return collections.namedtuple(name, list(members))  # noqa: PYI024  (the members are known at run time only)


class State(NamedTuple):
    """All arrays of one tick. Those that the law reads cannot be written."""

    arms: list[dict[str, NDArray[np.float64]]]
    inputs: dict[str, Any]
    parameters: dict[str, NDArray[np.float64]]
    outputs: dict[str, NDArray[np.float64]]
    memory: NDArray[np.float64]
    tau: list[NDArray[np.float64]]
    dt: float
    time_s: float
    contact: tuple[float, float, float]


def fixed(value: Any, shape: tuple[int, ...], what: str) -> NDArray[np.float64]:
    """A read-only array of that shape; one number fills it.

    Raises:
        ValueError: It has another shape.
    """
    array = np.asarray(value, dtype=np.float64)
    if array.ndim == 0 or array.shape == (1,):
        array = np.full(shape, float(array.reshape(())))
    if array.shape != shape:
        raise ValueError(f"{what}: expected {shape} numbers, found {array.shape}")
    array = np.array(array, order="C")
    array.flags.writeable = False
    return array


def python_arguments(law: Declaration, names: Sequence[str], state: State) -> list[Any]:
    """The arguments with which the law's Python function gets the state."""
    n = len(state.arms[0]["q"])
    arm_class = tuple_class("Arm", law.arm_fields)
    arms = tuple(arm_class(*(arm[name] for name in law.arm_fields)) for arm in state.arms)
    inputs = []
    for name, spec in law.inputs.items():
        members = SET_POINTS.get(spec.quantity)
        value = state.inputs[name]
        inputs.append(tuple_class("SetPoint", members)(*(value[m] for m in members)) if members else value)
    parameters = [float(v[0]) if law.parameters[k].size == 1 else v for k, v in state.parameters.items()]
    memory, place = [], 0
    for size in law.memory.values():
        memory.append(state.memory[place : place + shape_of([size], n)[0]])
        place += reserved(size)
    made: dict[str, Any] = {
        "arm": arms[0],
        "arms": arms,
        "tau": state.tau[0] if law.arms == 1 else tuple(state.tau),
        "inputs": tuple_class("Inputs", law.inputs)(*inputs),
        "parameters": tuple_class("Parameters", law.parameters)(*parameters),
        "outputs": tuple_class("Outputs", law.outputs)(*state.outputs.values()),
        "memory": tuple_class("Memory", law.memory)(*memory),
        "contact": tuple_class("Contact", CONTACT)(*state.contact),
        "dt": state.dt,
        "time_s": state.time_s,
    }
    return [made[name] for name in names]
