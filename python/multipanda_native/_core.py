"""Finds and loads the compiled part: beside the program, of this source tree or of an installation."""

from __future__ import annotations

import importlib.util
import pathlib
import sys
from types import ModuleType

from multipanda.errors import ProgramMissing
from multipanda.program import program_path

_NAME = "multipanda_native_core"


def _load() -> ModuleType:
    folder = pathlib.Path(program_path()).resolve().parent
    for place in (folder, folder.parent / "lib"):
        file = place / f"{_NAME}.abi3.so"
        if file.exists():
            break
    else:
        raise ProgramMissing(f"{_NAME}.abi3.so is not beside {folder}", "build it, or install the wheel again")
    if importlib.util.find_spec("nanobind_backend") is None:
        raise ProgramMissing(
            "the package nanobind-backend is not installed, which multipanda_native needs for this version of Python",
            "pip install nanobind-backend",
        )
    spec = importlib.util.spec_from_file_location(_NAME, file)
    assert spec is not None and spec.loader is not None  # such a file has both
    module = importlib.util.module_from_spec(spec)
    sys.modules[_NAME] = module
    spec.loader.exec_module(module)
    return module


core = _load()
