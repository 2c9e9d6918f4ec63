"""The program's longer commands as functions."""

from __future__ import annotations

import html
import os
import pathlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from .errors import Error
from .program import call, call_json, last_lines

Path = str | os.PathLike[str]


def _options(options: Mapping[str, Any]) -> list[str]:
    """repeats=2, fast=True, only=["a", "b"] as --repeats 2 --fast --only a b."""
    words: list[str] = []
    for name, value in options.items():
        if value is None or value is False:
            continue
        words.append("--" + name.replace("_", "-"))
        if value is True:
            continue
        many = value if isinstance(value, (list, tuple)) else [value]
        words += [os.fspath(one) if isinstance(one, os.PathLike) else str(one) for one in many]
    return words


def experiment(name: Path, **options: Any) -> dict[str, Any]:
    """Runs an experiment on simulated arms: `multipanda experiment`, with its options by name.

    mp.experiment("task-1", fast=True, repeats=1, out="runs")["success"]: False if a figure exceeds its limit.

    Raises:
        Refused: An option or a file is not accepted.
        Error: The command ended without a result; its messages say why.
        ProgramMissing: The program was not found.
        VersionMismatch: The program is of another version.
    """
    return call_json(["experiment", os.fspath(name), *_options(options)])


def compare(real: Path, sim: Path, **options: Any) -> dict[str, Any]:
    """Compares a measured and a simulated task in every quantity: `multipanda compare`.

    Returns what its `--json` prints; units are in the names (docs/identification.md).

    Errors are those of experiment().
    """
    return call_json(["compare", real, sim, *_options(options)])


def identify(*logs: Path, **options: Any) -> dict[str, Any]:
    """Identifies the parameters of an arm from logs of its motion: `multipanda identify`.

    Errors are those of experiment().
    """
    return call_json(["identify", *logs, *_options(options)])


def refine(name: Path, **options: Any) -> dict[str, Any]:
    """Adapts the simulation of a task to its arms: `multipanda refine`. Real arms need cleared=True.

    Errors are those of experiment().
    """
    return call_json(["refine", os.fspath(name), *_options(options)])


@dataclass(frozen=True)
class Report:
    """The report of a run; a notebook shows it.

    Attributes:
        path: The HTML page.
    """

    path: pathlib.Path

    def _repr_html_(self) -> str:
        text = self.path.read_text(encoding="utf-8")
        return f'<iframe style="width:100%;height:640px;border:0" srcdoc="{html.escape(text, quote=True)}"></iframe>'


def report(log: Path) -> Report:
    """Makes the HTML report of a recorded run: `multipanda report`.

    Errors are those of experiment().
    """
    code, out, err = call(["report", log])
    path = pathlib.Path(log)
    folder = path if path.is_dir() else path.parent
    found = sorted(folder.rglob("report.html"), key=lambda page: page.stat().st_mtime)
    if code != 0 or not found:
        raise Error(f"no report of {log}: {last_lines(err or out)}", "see the message above")
    return Report(found[-1])
