#!/usr/bin/env python3
"""Strict types of the Python package, by mypy where it is installed; exit code 77 where it is not."""

import importlib.util
import pathlib
import shutil
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
PACKAGES = [ROOT / "python" / name for name in ("multipanda", "multipanda_native")]


def main():
    for package in PACKAGES:
        if not (package / "py.typed").exists():
            sys.exit(f"{package} lacks py.typed: its types would not be used")
    if importlib.util.find_spec("mypy") is not None:
        command = [sys.executable, "-m", "mypy"]
    elif shutil.which("mypy"):
        command = ["mypy"]
    else:
        print("skipped: mypy is not installed (pip install mypy)")
        return 77
    command += ["--config-file", str(ROOT / "python" / "mypy.ini"), "--cache-dir", "/dev/null", *map(str, PACKAGES)]
    return subprocess.run(command, cwd=ROOT, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
