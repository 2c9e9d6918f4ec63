"""Compile commands of single files, without batches and precompiled headers, for the checks in this folder."""

import json
import pathlib
import re
import subprocess

from project_files import ROOT


def cached(build, name):
    """The value of a variable in a build folder's cache, empty without one."""
    match = re.search(rf"^{name}:\w+=(.*)$", (build / "CMakeCache.txt").read_text(), re.M)
    return match.group(1) if match else ""


def single_files(build):
    """Configures build/lint next to the build in `build` (nothing is compiled); returns its compile commands.

    Generated headers are those of `build`: its paths replace those of build/lint.
    """
    build = pathlib.Path(build).resolve()
    lint = build / "lint"
    options = [f"-D{name}={cached(build, name)}" for name in ("CMAKE_BUILD_TYPE", "MULTIPANDA_ROS")]
    configured = subprocess.run(
        ["cmake", "-S", ROOT, "-B", lint, "-G", "Ninja", "-DMULTIPANDA_BATCHES=OFF", "-DMULTIPANDA_PCH=OFF", *options],
        capture_output=True,
        text=True,
        check=False,
    )
    if configured.returncode:
        raise SystemExit(f"{lint} could not be configured:\n{configured.stderr}")
    text = (lint / "compile_commands.json").read_text().replace(str(lint), str(build))
    entries = json.loads(text)
    return [entry for entry in entries if not pathlib.Path(entry["file"]).is_relative_to(build)]  # generated files
