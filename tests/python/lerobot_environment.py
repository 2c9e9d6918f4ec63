"""`multipanda export --lerobot` with the build's Python environment and pyarrow, which is no part of it."""

import functools
import os
import pathlib
import subprocess
import sys

from harness import PATIENCE, ROOT

ENVIRONMENT = pathlib.Path(sys.argv.pop(2)).absolute() if len(sys.argv) > 2 else ROOT / "build" / "lerobot-env"
sys.path.insert(0, str(ROOT / "tools"))

import build_site


@functools.cache
def python_with_arrow():
    """The build's Python environment and pyarrow, which is no part of it."""
    python = build_site.environment(ENVIRONMENT, ROOT / "requirements-lerobot.txt")
    (own,) = ENVIRONMENT.glob("lib/python3*/site-packages")
    (of_build,) = pathlib.Path(sys.prefix).glob("lib/python3*/site-packages")
    (own / "build_environment.pth").write_text(f"{of_build}\n", encoding="utf-8")
    sys.path.append(str(own))
    return python


def export(*words, python=None, code=0):
    """The command's messages and output."""
    environment = {**os.environ, "MULTIPANDA_PYTHON": str(python or python_with_arrow())}
    done = subprocess.run(
        [os.environ["MULTIPANDA_PROGRAM"], "export", *map(str, words)],
        capture_output=True,
        text=True,
        timeout=3 * PATIENCE,
        env=environment,
    )
    if done.returncode != code:
        raise AssertionError(f"{words}: code {done.returncode}\n{done.stdout}{done.stderr}")
    return done.stderr + done.stdout
