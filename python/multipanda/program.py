"""Finds the program `multipanda` and calls its commands."""

from __future__ import annotations

import json
import os
import pathlib
import shutil
import subprocess
from collections.abc import Sequence
from typing import Any

from ._version import __version__
from .errors import Error, ProgramMissing, Refused, VersionMismatch

_HERE = pathlib.Path(__file__).resolve().parent
_versions: dict[str, str] = {}  # versions of programs, by path


def program_path() -> str:
    """The program's path: MULTIPANDA_PROGRAM, this package's folder bin, the build of this source tree, or PATH.

    Raises:
        ProgramMissing: It is in none of them.
    """
    named = os.environ.get("MULTIPANDA_PROGRAM")
    if named:
        if os.access(named, os.X_OK) and os.path.isfile(named):
            return named
        raise ProgramMissing(f"MULTIPANDA_PROGRAM names '{named}', which is not a program", "correct or unset it")
    tree = _HERE.parent.parent
    candidates = [_HERE / "bin" / "multipanda"]
    if (tree / "CMakeLists.txt").exists():
        candidates.append(tree / "build" / "multipanda")
    for path in candidates:
        if path.is_file() and os.access(path, os.X_OK):
            return str(path)
    found = shutil.which("multipanda")
    if found:
        return found
    raise ProgramMissing(
        f"the program multipanda is neither in {_HERE / 'bin'} nor on PATH",
        "build it with ./multipanda setup, or set MULTIPANDA_PROGRAM to its path",
    )


def _same_version(theirs: str) -> bool:
    return theirs.split(".")[:2] == __version__.split(".")[:2]


def check_version(theirs: str | None, whose: str) -> None:
    """Raises VersionMismatch unless major and minor version are ours."""
    if theirs is None or not _same_version(theirs):
        raise VersionMismatch(
            f"{whose} is of version {theirs or 'unknown (an older one)'}, this package of version {__version__}",
            "install package and program of the same version; they come together in one file",
        )


def checked_program() -> str:
    """The program's path, once its version is known to be ours."""
    path = program_path()
    if path not in _versions:
        answer = subprocess.run(
            [path, "--version"], capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=60, check=False
        )
        if answer.returncode != 0:
            raise Error(f"{path} does not start: {answer.stderr.strip()}", "build or install it again")
        _versions[path] = answer.stdout.strip()
    check_version(_versions[path], path)
    return path


def last_lines(text: str, count: int = 8) -> str:
    """The last lines of a program's messages."""
    return "\n".join([line for line in text.strip().splitlines() if line.strip()][-count:])


def call(arguments: Sequence[str | os.PathLike[str]], timeout_s: float | None = None) -> tuple[int, str, str]:
    """Calls a command of the program to its end: exit code, standard output, standard error.

    Ctrl-C and every other exception end the command as well. Raises Refused if it was not understood.
    """
    words = [checked_program(), *(os.fspath(word) for word in arguments)]
    # A session of its own: Ctrl-C reaches this process only, which then ends the command properly.
    with subprocess.Popen(
        words,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as child:
        try:
            out, err = child.communicate(timeout=timeout_s)
        except BaseException:
            child.terminate()  # the command ends in hold
            try:
                child.communicate(timeout=30)
            except subprocess.TimeoutExpired:
                child.kill()
            raise
    if child.returncode == 2:
        raise Refused("not_understood", last_lines(err), f"multipanda {words[1]} --help")
    return child.returncode, out, err


def call_json(
    arguments: Sequence[str | os.PathLike[str]], timeout_s: float | None = None, add_json: bool = True
) -> dict[str, Any]:
    """As call(), with --json unless the command prints an object anyway: the object that it printed."""
    code, out, err = call([*arguments, *(["--json"] if add_json else [])], timeout_s)
    lines = out.strip().splitlines()
    try:
        result = json.loads(out if len(lines) != 1 else lines[0])
    except ValueError:
        raise Error(
            f"multipanda {os.fspath(arguments[0])} ended with code {code} and without a result:\n{last_lines(err)}",
            "see the messages above",
        ) from None
    if not isinstance(result, dict):
        raise Error(f"multipanda {os.fspath(arguments[0])} printed no object", "report this as a defect")
    return result
