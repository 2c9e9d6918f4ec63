"""Control laws in Python: compiled to a library that the 1 kHz loop loads, so that it never waits for Python."""

from __future__ import annotations

import ast
import contextlib
import ctypes
import dataclasses
import functools
import hashlib
import json
import math
import os
import pathlib
import shutil
import subprocess
import traceback
import types
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import law_layout as layout
from ._version import __version__
from .errors import Error, VersionMismatch
from .law_compile import numba_version, object_file
from .law_declared import declared_of
from .law_evaluate import call_native, state_of
from .law_layout import LawInput, LawParameter
from .law_link import cache_folder, link, temporary_beside
from .law_rules import read, refuse
from .program import call

Array = NDArray[np.float64]

MOST_US = 100  # processor time of one tick [us]
STATES = 10_000
_PATIENCE_S = 120
_ARGUMENTS = ("arm", "arms", "tau", "inputs", "parameters", "outputs", "memory", "contact", "dt", "time_s")
_UNBOUNDED = (math.inf, math.inf, math.inf)


class Evaluation(NamedTuple):
    """A law's result for a state.

    Attributes:
        tau: Torque of the arm [N m], one number per joint; of a law of several arms a list of these.
        outputs: Its outputs by name, in their own units.
        memory: Its memory after the tick, as `evaluate` takes it, in the law's own units.
    """

    tau: Any
    outputs: dict[str, Array]
    memory: Array


@dataclass(frozen=True)
class PlacedLaw:
    """A law on arms of a scene, for `mp.run(..., laws=[law.on("left")])`.

    Attributes:
        law: The law.
        arms: Names of the arms that it owns, in its order.
        name: Name of the controllet in the run.
        parameters: Values at the start that differ from the initial ones, in the parameters' own units.
        features: Features that are on from the start.
    """

    law: Law
    arms: tuple[str, ...]
    name: str
    parameters: Mapping[str, Any]
    features: tuple[str, ...]

    def entry(self) -> dict[str, Any]:
        """The controllet as an entry of a scene file."""
        made: dict[str, Any] = {"name": self.name, "type": self.law.type, "arms": list(self.arms)}
        if self.features:
            made["features"] = list(self.features)
        if self.parameters:
            values = {name: np.asarray(value, dtype=float) for name, value in self.parameters.items()}
            made["parameters"] = {name: value.tolist() for name, value in values.items()}
        return made


def run_words(laws: Sequence[PlacedLaw]) -> list[str]:
    """The options of `multipanda run` for these laws, compiled and tried. Errors are those of Law.library."""
    words = []
    for path in dict.fromkeys(str(placed.law.library) for placed in laws):
        words += ["--plugin", path]
    for placed in laws:
        words += ["--controllet", json.dumps(placed.entry())]
    return words


class Law:
    """A control law in Python, made by `@mp.law(...)`.

    Its function is checked at once; it is compiled when it is first used. The library is kept in the user's cache
    ($XDG_CACHE_HOME/multipanda/laws) until the law, or the compiler, changes.

    Attributes:
        type: Type of the controllet in scene files: the function's name.
        declaration: What it declares: inputs, parameters, outputs, memory, and what it uses of an arm.
        function: The Python function.
        model: The robot model on which it is tried.
    """

    def __init__(self, function: Callable[..., None], declared: dict[str, Any], model: str) -> None:
        self.function = function
        self.model = model
        self._start: Callable[..., None] | None = None
        self._functions = {"update": read(function)}
        self.type = function.__name__
        doc = (function.__doc__ or "").strip().splitlines()
        self.declaration = layout.Declaration(
            self.type, doc[0].strip() if doc else f"The law {self.type}, in Python.", **declared_of(declared)
        )
        self._check_arguments("update", "tau")
        self.__doc__ = function.__doc__

    def __repr__(self) -> str:
        return f"<law {self.type} of {self._functions['update'].file}>"

    def start(self, function: Callable[..., None]) -> Callable[..., None]:
        """Decorates a function that runs once before the first tick, to set the memory; it takes the law's arguments,
        without tau. An exception refuses the start. Without it the memory begins with zeros.

        Raises:
            Refused: It contains something that the loop must not do.
        """
        self._functions["start"] = read(function)
        self._start = function
        self._check_arguments("start", None)
        return function

    def _check_arguments(self, kind: str, needed: str | None) -> None:
        function, law = self._functions[kind], self.declaration
        arguments = function.tree.args
        names = [a.arg for a in arguments.args]
        place = function.place(function.tree)
        known = [n for n in _ARGUMENTS if n != ("arm" if law.arms > 1 else "arms") and (needed or n != "tau")]
        for name in names:
            if name not in known:
                refuse(place, f"the argument '{name}' of {function.name}; expected some of: {', '.join(known)}")
            if name in ("inputs", "parameters", "outputs", "memory") and not getattr(law, name):
                refuse(place, f"the argument '{name}', but the law declares no {name}", f"add {name}= to @mp.law(...)")
        if arguments.kwonlyargs or arguments.posonlyargs or arguments.defaults:
            refuse(place, "arguments with defaults, or after * or /; expected plain names")
        if needed and needed not in names:
            refuse(place, f"{function.name} has no argument '{needed}', into which it writes its torque")
        for node in ast.walk(function.tree):
            if isinstance(node, ast.Return) and node.value is not None:
                refuse(function.place(node), "a law must not return a value; it writes into tau")
        used = set().union(*(f.attributes for f in self._functions.values())) & set(layout.ARM_FIELDS)
        self.declaration = dataclasses.replace(law, uses=frozenset(used))
        self.__dict__.pop("library", None)
        self.__dict__.pop("_key", None)

    @functools.cached_property
    def _key(self) -> str:
        # Everything that the library depends on, in a form that is identical in every process.
        declared = dataclasses.replace(self.declaration, uses=frozenset())
        parts = [__version__, numba_version(), str(layout.VERSION), repr(declared), self.model]
        parts += self.declaration.arm_fields
        for kind, top in self._functions.items():
            for function in top.all():
                values = [f"{name} {_text(value)}" for name, value in sorted(function.constants.items())]
                parts += [kind, function.file, str(function.tree.lineno), ast.dump(function.tree), *values]
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:24]

    @functools.cached_property
    def _linked(self) -> pathlib.Path:
        path = cache_folder() / f"{self.type}-{self._key}.so"
        if not path.exists():
            link(object_file(self.declaration, self._functions), path)
        return path

    @functools.cached_property
    def trial(self) -> dict[str, Any]:
        """Results on 10 000 random states: `median_us`, `p999_us`, `worst_us` of processor time of a tick [us].

        Raises:
            Refused: A torque is not finite, or a tick takes more than 100 us at 99.9 %.
            Error: Numba, a linker or the program is missing, or the program did not answer.
        """
        kept = self._linked.with_suffix(".json")
        with contextlib.suppress(OSError, ValueError):
            return dict(json.loads(kept.read_text()))
        figures = self._try()
        with temporary_beside(kept) as made:
            made.write_text(json.dumps(figures))
            os.replace(made, kept)
        return figures

    @functools.cached_property
    def library(self) -> pathlib.Path:
        """The library, compiled and tried. Scene files name it in `plugins`. Errors are those of `trial`."""
        assert self.trial
        return self._linked

    def build(self, folder: str | os.PathLike[str]) -> pathlib.Path:
        """Puts the library into a folder, as `<type>.so`, for scene files and computers without Python. Returns its
        path. Errors are those of `trial`.
        """
        path = pathlib.Path(folder) / f"{self.type}.so"
        with temporary_beside(path) as made:
            shutil.copyfile(self.library, made)
            made.chmod(0o755)
            os.replace(made, path)
        return path

    def on(
        self,
        *arms: str,
        name: str | None = None,
        parameters: Mapping[str, Any] | None = None,
        features: Sequence[str] = (),
    ) -> PlacedLaw:
        """This law on arms of a scene: `mp.run("two_arms", laws=[law.on("left"), law.on("right")])`.

        Args:
            arms: Names of its arms, in its order.
            name: Name of the controllet in the run; by default type and arms: `soft_left`.
            parameters: Values at the start, in the parameters' own units.
            features: Features that are on from the start.

        Raises:
            ValueError: Another number of arms.
        """
        if len(arms) != self.declaration.arms:
            raise ValueError(f"{self.type} owns {self.declaration.arms} arm(s), found {len(arms)}: {', '.join(arms)}")
        named = name or "_".join((self.type, *arms))
        return PlacedLaw(self, arms, named, dict(parameters or {}), tuple(features))

    def samples(self, count: int, *, states: int | None = None, seed: int = 1) -> list[dict[str, Any]]:
        """The first random states of a trial, with the model terms of the robot and the law's torques.

        Each has `arms` (with `tau`), `inputs`, `parameters`, `outputs`, `dt`, `time_s`, as `evaluate` takes them.
        `started` marks states before which the memory began with zeros.

        Args:
            count: How many.
            states: States of the trial, of which these are the first; by default as many.
            seed: Seed of the states.

        Raises:
            Refused: A torque is not finite.
            Error: As for `trial`.
        """
        words = ["--samples", str(count), "--seed", str(seed), "--repeats", "1", "--most-us", "1e6"]
        figures = self._ask_program(states or count, words)
        return list(figures["samples"])

    def _ask_program(self, states: int, more: Sequence[str] = ()) -> dict[str, Any]:
        words = ["law", str(self._linked), "--json", "--model", self.model, "--states", str(states)]
        place = self._functions["update"].place(self._functions["update"].tree)
        try:
            code, out, err = call([*words, *(more or ("--most-us", str(MOST_US)))], _PATIENCE_S)
        except subprocess.TimeoutExpired:
            refuse(place, f"{states} ticks took more than {_PATIENCE_S} s", "make its loops shorter")
        try:
            (figures,) = json.loads(out)["laws"]
        except ValueError:
            if "C interface" in err:
                raise VersionMismatch(err.strip(), "install package and program of the same version") from None
            raise Error(f"multipanda law ended with code {code}: {err.strip()}", "see the message above") from None
        if figures["faults"]:
            refuse(*self._explained(place, figures["first_fault"]))
        return dict(figures)

    def _try(self) -> dict[str, Any]:
        figures = self._ask_program(STATES)
        function = self._functions["update"]
        if figures["p999_us"] > MOST_US:
            refuse(
                function.place(function.tree),
                f"a tick takes {figures['p999_us']:.0f} us of processor time at 99.9 % of {figures['states']} random "
                f"states; at most {MOST_US} us are possible",
                "make its loops shorter; the loop of all arms has 1000 us",
            )
        figures.pop("first_fault", None)
        return figures

    def _explained(self, place: str, sample: dict[str, Any] | None) -> tuple[str, str, str]:
        """Location, cause and remedy of a fault on a random state, found by the Python function."""
        step = "a law gives a finite torque on every state within the limits; law.evaluate(...) repeats one"
        if sample is None:
            return place, "it faults on random states", step
        state = {key: sample[key] for key in ("inputs", "parameters", "dt", "time_s")}
        arms = [{name: arm[name] for name in self.declaration.arm_fields} for arm in sample["arms"]]
        text = ", ".join(f"{name} = {arms[0][name]}" for name in ("q", "dq"))
        text += f", parameters = {sample['parameters']}"
        try:
            if sample["started"] and "start" in self._functions:
                self.evaluate(arms, **state, compiled=False, start=True)
            with np.errstate(all="ignore"):
                made = self.evaluate(arms, **state, compiled=False)
        except Exception as error:  # raised by the user's function
            frames = [
                f for f in traceback.extract_tb(error.__traceback__) if f.filename == self._functions["update"].file
            ]
            if frames:
                place = f"{frames[-1].filename}:{frames[-1].lineno}"
            return place, f"{type(error).__name__}: {error}, on the state {text}", step
        if not np.all(np.isfinite(np.asarray(made.tau))):
            return place, f"its torque is not finite: {made.tau} on the state {text}", step
        return place, f"it faults on the state {text}", step

    def evaluate(
        self,
        arm: Mapping[str, Any] | Sequence[Mapping[str, Any]],
        *,
        inputs: Mapping[str, Any] | None = None,
        parameters: Mapping[str, Any] | None = None,
        memory: Any = None,
        contact: tuple[float, float, float] = _UNBOUNDED,
        dt: float = 0.001,
        time_s: float = 0,
        compiled: bool = True,
        start: bool = False,
    ) -> Evaluation:
        """The law's torque in one state, for tests such as that of a gradient; no program is needed.

        Args:
            arm: What the law uses of its arm, by name: {"q": ..., "dq": ...} [rad, rad/s, N m, m, ...]; a list for
                several arms. dq and c are zero if they are missing.
            inputs: Set-points by name: numbers, or for joints and poses a dictionary of their members [SI units].
            parameters: Values that differ from the initial ones, in the parameters' own units.
            memory: Memory of the last tick [the law's own units]; by default zeros.
            contact: Bounds for contact: hand speed [m/s], spring force [N], spring moment [N m].
            dt: Time since the last tick [s].
            time_s: The loop's time [s].
            compiled: Calls the native code; False the Python function, for comparison.
            start: Calls the function of `start` instead.

        Raises:
            ValueError: A number is missing, or an array has another shape.
            Error: The native code reports a fault; or it cannot be made, as for `trial`.
        """
        state = state_of(self.declaration, arm, inputs or {}, parameters or {}, memory, contact, dt, time_s)
        kind = "start" if start else "update"
        if kind not in self._functions:
            raise ValueError(f"{self.type} has no function start")
        if compiled:
            call_native(self.declaration, self._native[kind], state)
        else:
            names = [argument.arg for argument in self._functions[kind].tree.args.args]
            function = self.function if kind == "update" else self._start
            assert function is not None
            function(*layout.python_arguments(self.declaration, names, state))
        return Evaluation(state.tau[0] if self.declaration.arms == 1 else state.tau, state.outputs, state.memory)

    @functools.cached_property
    def _native(self) -> dict[str, Callable[..., int]]:
        ctypes.CDLL("libm.so.6", mode=ctypes.RTLD_GLOBAL)  # already loaded by the program
        exported = ctypes.CDLL(str(self._linked)).multipanda_laws
        exported.restype = ctypes.POINTER(layout.CLaws)
        law = exported().contents.laws[0]
        return {kind: layout.C_FUNCTION(getattr(law, kind)) for kind in self._functions}


def _text(value: Any) -> str:
    """A constant of a law; for functions, which are compared by their source, and for modules the name."""
    if isinstance(value, np.ndarray):
        return f"{value.dtype} {value.shape} {value.tobytes()!r}"
    if callable(value) or isinstance(value, types.ModuleType):
        return str(getattr(value, "__name__", type(value).__name__))
    return repr(value)


def law(
    *,
    arms: int = 1,
    inputs: Mapping[str, str | LawInput] | None = None,
    parameters: Mapping[str, LawParameter] | None = None,
    outputs: Mapping[str, int] | None = None,
    memory: Mapping[str, int | str] | None = None,
    model: str = "fer",
) -> Callable[[Callable[..., None]], Law]:
    """Makes a function a control law of the 1 kHz loop (docs/python_laws.md).

        @mp.law(inputs={"joints": "joints"},
                parameters={"stiffness_nm_per_rad": mp.LawParameter(50, 0, 200, unit="N m/rad")})
        def soft(arm, inputs, parameters, tau):
            for i in range(len(tau)):
                tau[i] = arm.c[i] + parameters.stiffness_nm_per_rad * (inputs.joints.q[i] - arm.q[i])

        with mp.run("one_arm", laws=[soft.on("arm")]) as run:
            run.switch("soft_arm")

    Args:
        arms: How many arms it owns. With several, it gets `arms` instead of `arm`, and tau is a tuple of arrays.
        inputs: Quantity of each input: "pose", "joints", "twist", "wrench" or "scalar".
        parameters: Its parameters, in their own units.
        outputs: How many numbers each output has, which is shown and logged; names carry the unit.
        memory: How many numbers it keeps from tick to tick under each name, or "joints" for one per joint.
        model: Robot model on which it is tried.

    Raises:
        Refused: The function contains something that the loop must not do; with file and line.
        ValueError: A declaration is not possible.
    """
    declared = {
        "arms": arms,
        "inputs": dict(inputs or {}),
        "parameters": dict(parameters or {}),
        "outputs": dict(outputs or {}),
        "memory": dict(memory or {}),
    }
    return lambda function: Law(function, declared, model)
