"""Parameters of controllets as attributes with units and bounds, from the controllets' descriptors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Value = float | bool | str | NDArray[np.float64]


class Owner(Protocol):
    """A controllet, or one of its features."""

    name: str

    def describe(self) -> dict[str, Any]:
        """As Controllet.describe()."""

    def set(self, parameter: str, value: Any) -> None:
        """As Controllet.set()."""


class Parameter:
    """One parameter of a controllet or a feature.

    Reading the attribute asks the run; writing it returns once the loop has taken the value, which is reached within
    0.2 s.

    Attributes:
        name: Its name in the run; that of a feature is `feature.parameter`.
        doc: What it means.
        unit: Its unit, such as `N/m`; empty for a ratio.
        low: Least value, in `unit`; None for a choice.
        high: Largest value, in `unit`; None for a choice.
        count: How many numbers; None for one per joint.
        choices: The values of a choice; empty for numbers.
    """

    def __init__(
        self,
        doc: str,
        unit: str = "",
        low: float | None = None,
        high: float | None = None,
        count: int | None = 1,
        choices: Sequence[str] = (),
    ) -> None:
        self.doc, self.unit, self.low, self.high, self.count = doc, unit, low, high, count
        self.choices = tuple(choices)
        self.name = ""
        self.__doc__ = self.describe()

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    @property
    def is_switch(self) -> bool:
        """Whether it is on or off."""
        return self.choices == ("false", "true")

    def describe(self) -> str:
        """Text with unit and bounds."""
        if self.is_switch:
            return f"{self.doc} True or False."
        if self.choices:
            return f"{self.doc} One of {', '.join(map(repr, self.choices))}."
        numbers = "one number per joint" if self.count is None else "" if self.count == 1 else f"{self.count} numbers"
        bounds = f"{self.low:g} to {self.high:g} {self.unit}".strip()
        each = f", {numbers}, or one for all" if numbers else ""
        return f"{self.doc} {bounds}{each}."

    def __get__(self, owner: Owner | None, kind: type | None = None) -> Any:
        if owner is None:
            return self
        for entry in owner.describe()["parameters"]:
            if entry["name"] == self.name:
                return self.read(entry)
        raise AttributeError(f"{owner.name} has no parameter {self.name}")

    def read(self, entry: dict[str, Any]) -> Value:
        """The value of a parameter in the answer to `list`."""
        value = entry["value"]
        if self.is_switch:
            return bool(value == "true")
        if self.choices:
            return str(value)
        numbers = np.array(value, dtype=np.float64)
        return float(numbers[0]) if self.count == 1 else numbers

    def __set__(self, owner: Owner, value: Any) -> None:
        owner.set(self.name, value)

    def sent(self, value: Any) -> Any:
        """The value as a request carries it.

        Raises:
            TypeError: It is neither a number nor a choice.
            ValueError: A number is not finite.
        """
        if self.is_switch and isinstance(value, (bool, np.bool_)):
            return bool(value)
        if self.choices:
            if isinstance(value, str):
                return value
            raise TypeError(f"{self.name}: expected one of {', '.join(self.choices)}, found {value!r}")
        try:
            numbers = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError):
            raise TypeError(f"{self.name}: expected numbers, found {value!r}; {self.describe()}") from None
        if not np.all(np.isfinite(numbers)):
            raise ValueError(f"{self.name}: expected finite numbers, found {value!r}")
        return float(numbers) if numbers.ndim == 0 else [float(x) for x in numbers.ravel()]


def parameter_of(entry: dict[str, Any], joints: int) -> Parameter:
    """From an entry of `parameters` in the answer to `list`."""
    if "choices" in entry:
        return Parameter(entry["doc"], choices=entry["choices"])
    count = len(entry["value"])
    return Parameter(
        entry["doc"], entry["unit"], entry["min"], entry["max"], None if count == joints and joints > 1 else count
    )
