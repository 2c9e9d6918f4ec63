"""Checked declarations of a law."""

from __future__ import annotations

import dataclasses
import keyword
import math
import re
from typing import Any

from . import law_layout as layout
from .law_layout import LawInput, LawParameter

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,63}")


def _named(kind: str, name: str) -> str:
    if not _NAME.fullmatch(name) or keyword.iskeyword(name):
        raise ValueError(f"{kind} '{name}': expected a letter, then letters, digits or _, and no Python keyword")
    return name


def _sized(what: str, size: int | str, most: int, joints: bool) -> int | str:
    if size == "joints" and joints:
        return size
    if isinstance(size, bool) or not isinstance(size, int) or not 1 <= size <= most:
        raise ValueError(f"{what}: expected 1 to {most} numbers{' or joints' if joints else ''}, found {size!r}")
    return size


def declared_of(given: dict[str, Any]) -> dict[str, Any]:
    """The declarations, checked. Raises ValueError."""
    arms = given["arms"]
    if isinstance(arms, bool) or not isinstance(arms, int) or not 1 <= arms <= 16:
        raise ValueError(f"arms: expected 1 to 16, found {arms!r}")
    inputs = {}
    for name, value in given["inputs"].items():
        spec = LawInput(value) if isinstance(value, str) else value
        if not isinstance(spec, LawInput) or spec.quantity not in layout.QUANTITIES:
            raise ValueError(f"input '{name}': expected one of {', '.join(layout.QUANTITIES)}, found {value!r}")
        if not 0 <= spec.arm < arms:
            raise ValueError(f"input '{name}': arm {spec.arm} of {arms}")
        doc = spec.doc or f"Set-point of {name}."
        inputs[_named("input", name)] = dataclasses.replace(spec, doc=doc)
    parameters = {}
    for name, spec in given["parameters"].items():
        if not isinstance(spec, LawParameter):
            raise ValueError(f"parameter '{name}': expected mp.LawParameter(initial, low, high), found {spec!r}")
        size = _sized(f"parameter '{name}'", spec.size, 16, True)
        values = [spec.initial] if isinstance(spec.initial, (int, float)) else list(spec.initial)
        numbers = [float(v) for v in (*values, spec.low, spec.high)]
        if not all(map(math.isfinite, numbers)) or not all(numbers[-2] <= v <= numbers[-1] for v in numbers[:-2]):
            raise ValueError(f"parameter '{name}': expected low <= initial <= high, finite, found {spec}")
        if len(values) != 1 and isinstance(size, int) and len(values) != size:
            raise ValueError(f"parameter '{name}': {len(values)} initial values for {size} numbers")
        if not 1 <= len(values) <= layout.MOST_JOINTS:
            raise ValueError(f"parameter '{name}': {len(values)} initial values")
        initial = float(values[0]) if len(values) == 1 else tuple(float(v) for v in values)
        doc = spec.doc or f"Parameter {name}."
        parameters[_named("parameter", name)] = dataclasses.replace(spec, initial=initial, doc=doc)
    outputs = {_named("output", n): _sized(f"output '{n}'", s, 64, False) for n, s in given["outputs"].items()}
    memory = {_named("memory", n): _sized(f"memory '{n}'", s, 4096, True) for n, s in given["memory"].items()}
    return {"arms": arms, "inputs": inputs, "parameters": parameters, "outputs": outputs, "memory": memory}
