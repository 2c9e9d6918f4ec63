"""Drives torque-controlled Franka arms: the 1 kHz loop runs in a process of its own, this package commands it.

    import multipanda as mp

    with mp.run("two_arms", record="runs") as run:
        run["left_cartesian"].goal("pose", run.arms["left"].state.pose.moved(z=0.05)).wait()
    print(run.summary)

Leaving `with`, by an exception too, holds the arms, finishes their motion and ends the program.
"""

import sys
import types
from typing import TYPE_CHECKING, Any

from ._version import __version__ as __version__

if TYPE_CHECKING:
    from ._names import *  # noqa: F403


class _Package(types.ModuleType):
    """Loads the names with the first use: NumPy and the clients take fifty times as long as this file."""

    _FUNCTIONS = ("law", "model", "stubs", "study")  # in the modules of the same names

    def __getattr__(self, name: str) -> Any:
        from importlib import import_module, util

        if name.startswith("__") and name != "__all__":
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")
        if name not in self._FUNCTIONS and util.find_spec(f"{self.__name__}.{name}"):
            return import_module(f"{self.__name__}.{name}")
        names = vars(import_module(f"{self.__name__}._names"))
        vars(self).update({each: value for each, value in names.items() if not each.startswith("_")})
        vars(self)["__all__"] = ["__version__", *(each for each in names if not each.startswith("_"))]
        if name not in vars(self):
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")
        return vars(self)[name]

    def __setattr__(self, name: str, value: object) -> None:
        # The import system would store each module of the package here, in place of the function of the same name.
        if name not in self._FUNCTIONS or not isinstance(value, types.ModuleType):
            super().__setattr__(name, value)

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self.__getattr__("__all__")]


sys.modules[__name__].__class__ = _Package
