"""What a worker of a study does: it runs a batch in a process of the program, which lives on for the next batch.

Everything here may happen on another computer: a worker gets plain data and the name of this module's `work`.
"""

from __future__ import annotations

import contextlib
import json
import os
import pathlib
import shutil
import subprocess
import tempfile
import threading
import time
from typing import Any

from .errors import Error, Refused
from .program import checked_program, last_lines
from .study_identity import difference, identity, same_machine
from .study_plan import file_digest
from .study_store import result_path, sealed, write_result

Json = dict[str, Any]
_ATTEMPTS = 2  # a run whose process is killed is tried again in a new one

_local = threading.local()  # a thread that runs batches has a process of its own


class _Program:
    """A process `multipanda study --worker`, which ends with this one, however this one ends."""

    def __init__(self) -> None:
        self._said = tempfile.TemporaryFile("w+")
        self.process = subprocess.Popen(
            [checked_program(), "study", "--worker"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._said,
            text=True,
            start_new_session=True,  # Ctrl-C is for the study
        )
        assert self.process.stdout is not None
        if not self.process.stdout.readline():  # it says its version once all libraries are mapped
            raise Error(f"the program does not start: {self.end()}", "build or install it again")
        self.identity = identity(self.process.pid)
        self.owner = os.getpid()

    def run(self, job: Json) -> Json | None:
        """The answer; None if the process has died."""
        assert self.process.stdin is not None and self.process.stdout is not None
        try:
            self.process.stdin.write(json.dumps(job) + "\n")
            self.process.stdin.flush()
            line = self.process.stdout.readline()
        except (BrokenPipeError, OSError):
            return None
        return dict(json.loads(line)) if line.endswith("\n") else None

    def end(self) -> str:
        """Why it has ended, in words."""
        assert self.process.stdin is not None and self.process.stdout is not None
        with contextlib.suppress(OSError):
            self.process.stdin.close()
        self.process.stdout.close()
        code = self.process.wait()
        self._said.seek(0)
        said = last_lines(self._said.read(), 3)
        self._said.close()
        return (f"signal {-code}" if code < 0 else f"exit code {code}") + (f": {said}" if said else "")


def _program() -> _Program:
    if _ending.is_set():
        raise Error("the study was stopped", "start it again: it goes on")
    program = getattr(_local, "program", None)
    if program is None or program.owner != os.getpid() or program.process.poll() is not None:
        program = _local.program = _Program()
        _all.append(program)
    return program


_all: list[_Program] = []
_ending = threading.Event()


def begin_programs() -> None:
    """Allows batches again after end_programs()."""
    _ending.clear()


def end_programs() -> None:
    """Kills the processes that this Python process has started for batches; runs in them are lost."""
    _ending.set()
    for program in list(_all):
        program.process.kill()


def close_programs() -> None:
    """After end_programs(), once no batch is being done any more."""
    while _all:
        _all.pop().end()


def _refuse_others(task: Json, program: Json, machine: Json) -> None:
    where = f"the worker on {os.uname().nodename}"
    if program != task["program"]:
        raise Refused(
            "other_program",
            f"{where} has another program than the study: {difference(task['program'], program)}",
            "install the same one everywhere, or set MULTIPANDA_PROGRAM there",
        )
    if task["machine"] is not None and not task["any_machine"] and not same_machine(task["machine"], machine):
        raise Refused(
            "other_machine",
            f"{where} is another machine than the study's first one: {difference(task['machine'], machine)}",
            "run on equal computers, or accept it with --any-machine",
        )
    for path, digest in task["files"].items():
        if file_digest(path) != digest:
            raise Refused("other_file", f"{where} has another {path} than the study", "copy the study's files there")


def _run_command(words: list[str]) -> Json:
    """A long run: a command of the program, in a folder that is removed. It is ended if this thread's process is."""
    begin = time.monotonic()
    guard = ["setpriv", "--pdeathsig", "TERM"] if shutil.which("setpriv") else []
    with tempfile.TemporaryDirectory(prefix="multipanda-study-") as folder:
        done = subprocess.run(
            [*guard, checked_program(), *words, "--json", "--out", folder],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            check=False,
            start_new_session=True,
        )
    whole_s = time.monotonic() - begin
    try:
        result = json.loads(done.stdout)
    except ValueError:
        return {
            "error": f"multipanda {' '.join(words)} ended with code {done.returncode}: {last_lines(done.stderr, 3)}"
        }
    result.pop("machine", None)
    faults = [str(fault) for fault in result.get("problems") or result.get("faults") or []]
    figures = experiment_figures(result) if words[0] == "experiment" else refine_figures(result)
    return {
        "figures": figures,
        "success": done.returncode == 0,
        "faults": faults,
        "cost": {"loop_s": whole_s, "whole_s": whole_s},
        "details": result,
    }


def experiment_figures(result: Json) -> Json:
    """The figures of an experiment's runs; the mean if a variant was repeated."""
    found: dict[str, list[float]] = {}
    for run in result.get("runs", []):
        for name, value in run["metrics"].items():
            if isinstance(value, (int, float)):
                found.setdefault(f"{run['variant']}/{run['plant']}/{name}", []).append(float(value))
    return {name: sum(values) / len(values) for name, values in found.items()}


def refine_figures(result: Json) -> Json:
    """What was before, after, and their ratio, of every quantity of every arm in the last round."""
    figures: Json = {}
    rounds = result.get("rounds") or [{"changes": {}}]
    for arm, changes in rounds[-1]["changes"].items():
        for name, change in changes.items():
            for part in ("before", "after", "ratio", "spread", "worse"):
                figures[f"{arm}/{name}/{part}"] = change[part]
    return figures


def _outcome(job: Json) -> Json:
    if "command" in job:
        return _run_command(job["command"])
    reason = ""
    for _ in range(_ATTEMPTS):
        program = _program()
        answer = program.run(job)
        if answer is not None:
            return answer
        reason = program.end()
        with contextlib.suppress(ValueError):
            _all.remove(program)
    return {"error": f"the program died twice in this run, by {reason}"}


def work(task: Json) -> Json:
    """Does the runs of a batch, and stores each when it is done if the study's folder is reachable from here.

    Returns:
        `done`: the keys of stored results; `results`: those that could not be stored here; `errors`: by key, the
        runs without a result; `busy_s`: time in runs [s]; `machine`, `host`.

    Raises:
        Refused: The program, the machine or a file differs from the study's.
    """
    folder = pathlib.Path(task["folder"])
    token = folder / "token"
    shared = token.exists() and token.read_text() == task["token"]
    program, machine = _program().identity
    answer: Json = {"done": [], "results": [], "errors": {}, "busy_s": 0.0}
    answer |= {"machine": machine, "host": os.uname().nodename}
    _refuse_others(task, program, machine)
    for run in task["runs"]:
        if shared and result_path(folder, run["key"]).exists():
            answer["done"].append(run["key"])  # done by an earlier worker that was killed afterwards
            continue
        job = dict(run["job"])
        if job.pop("logs", False):
            if not shared:
                raise Error(
                    f"logs can be kept only where {folder} is reachable", "share the folder, or leave out `logs`"
                )
            (folder / "logs").mkdir(exist_ok=True)
            job["log"] = str(folder / "logs" / f"{run['key']}.mcap")
        outcome = _outcome(job)
        if "error" in outcome:
            answer["errors"][run["key"]] = outcome["error"]
            continue
        answer["busy_s"] += outcome["cost"]["whole_s"]
        content = {"key": run["key"], "inputs": run["inputs"], "row": run["row"], "program": program}
        result = sealed({**content, "machine": machine, **outcome})
        if shared:
            write_result(folder, result)
            answer["done"].append(run["key"])
        else:
            answer["results"].append(result)
    return answer
