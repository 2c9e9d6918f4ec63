"""Where the CMake package is: cmake -Dmultipanda_DIR=$(python -m multipanda.cmake) ... for find_package(multipanda)."""

from __future__ import annotations

import pathlib

from .errors import ProgramMissing


def folder() -> pathlib.Path:
    """The folder with multipandaConfig.cmake: of this installation, or of the source tree's build."""
    here = pathlib.Path(__file__).resolve().parent
    for candidate in (here / "lib" / "cmake" / "multipanda", here.parent.parent / "build"):
        if (candidate / "multipandaConfig.cmake").exists():
            return candidate
    raise ProgramMissing(f"there is no CMake package in {here}", "install multipanda again, or run ./multipanda setup")


if __name__ == "__main__":
    print(folder())
