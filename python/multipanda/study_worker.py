"""A worker of a study runs a batch in a process of the program, which stays alive for the next batch.

Everything here may happen on another computer: a worker gets plain data and the name of this module's `work`.
"""

from __future__ import annotations

import contextlib
import json
import os
import pathlib
import shutil
import signal
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
            start_new_session=True,  # Ctrl-C must reach the study only
        )
        assert self.process.stdout is not None
        if not self.process.stdout.readline():  # it prints its version once all libraries are mapped
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
        """Why it has ended, as text."""
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
        raise Error("the study was stopped", "start it again: it continues")
    program = getattr(_local, "program", None)
    if program is None or program.owner != os.getpid() or program.process.poll() is not None:
        program = _local.program = _Program()
        _all.append(program)
    return program


_all: list[_Program] = []
_commands: set[subprocess.Popen[str]] = set()
_ending = threading.Event()


def begin_programs() -> None:
    """Allows batches again after end_programs()."""
    _ending.clear()


def end_programs() -> None:
    """Ends the processes that this Python process has started for batches; runs in them are lost."""
    _ending.set()
    for program in list(_all):
        program.process.kill()
    for command in list(_commands):
        with contextlib.suppress(ProcessLookupError):
            os.killpg(command.pid, signal.SIGTERM)  # ends its children, too


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


def _ended(words: list[str], folder: str) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of a command that writes into the folder.

    It ends if this thread's process does, and is tried again if a signal has ended it.
    """
    guard = ["setpriv", "--pdeathsig", "TERM"] if shutil.which("setpriv") else []
    code, out, err = 0, "", ""
    for _ in range(_ATTEMPTS):
        if _ending.is_set():
            break
        for path in pathlib.Path(folder).iterdir():  # remains of an earlier attempt
            shutil.rmtree(path) if path.is_dir() else path.unlink()
        with subprocess.Popen(
            [*guard, *words],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
            start_new_session=True,  # Ctrl-C must reach the study only
        ) as process:
            _commands.add(process)
            try:
                out, err = process.communicate()
            finally:
                _commands.discard(process)
            code = process.returncode
        if code >= 0:
            break
    if _ending.is_set():
        raise Error("the study was stopped", "start it again: it continues")
    return code, out, err


def _why(code: int, err: str) -> str:
    said = last_lines(err, 3)
    return (f"died twice, by signal {-code}" if code < 0 else f"ended with code {code}") + (f": {said}" if said else "")


def _result(figures: Json, code: int, faults: list[str], begin: float, details: Json) -> Json:
    whole_s = time.monotonic() - begin
    cost = {"loop_s": whole_s, "whole_s": whole_s}
    return {"figures": figures, "success": code == 0, "faults": faults, "cost": cost, "details": details}


def _run_program(words: list[str]) -> Json:
    """A command of the study's own, which writes result.json into a folder that is removed."""
    begin = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="multipanda-study-") as folder:
        words = [word.replace("{out}", folder) for word in words]
        try:
            code, out, err = _ended(words, folder)
        except OSError as wrong:
            return {"error": f"{words[0]} does not start on {os.uname().nodename}: {wrong.strerror}"}
        if code < 0:
            return {"error": f"{words[0]} {_why(code, err)}"}
        path = pathlib.Path(folder) / "result.json"
        if not path.exists():
            return {"error": f"{words[0]} wrote no result.json into {{out}}; it {_why(code, err or out)}"}
        try:
            result = json.loads(path.read_text(encoding="utf-8"))
        except ValueError as wrong:
            return {"error": f"{words[0]} wrote no JSON into result.json: {wrong}"}
    if not isinstance(result, dict):
        return {"error": f"{words[0]} wrote no object into result.json"}
    if "testsuites" in result:
        figures, faults, whole = test_figures(result)
    else:
        figures = {name: value for name, value in result.items() if isinstance(value, (int, float, list))}
        faults, whole = [str(fault) for fault in figures.pop("faults", [])], True
    if not whole:
        return {"error": f"{words[0]}: no test has run; expected one that its filter names and that is not skipped"}
    if code != 0 and not faults:
        faults = [f"exit code {code}: {last_lines(err or out, 3)}"]
    return _result(figures, code, faults, begin, result)


_OF_GOOGLETEST = {"name", "file", "line", "status", "result", "timestamp", "time", "classname", "failures", "skipped"}
_OF_GOOGLETEST |= {"value_param", "type_param"}


def test_figures(report: Json) -> tuple[Json, list[str], bool]:
    """Properties that the tests of a GoogleTest report have recorded, their failures, and whether a test has run."""
    figures: Json = {}
    faults: list[str] = []
    tests = [test for suite in report["testsuites"] for test in suite.get("testsuite", [])]
    for test in tests:
        figures |= {name: float(value) for name, value in test.items() if name not in _OF_GOOGLETEST}
        faults += [str(failure["failure"]) for failure in test.get("failures", [])]
    ran = [test for test in tests if test.get("result") == "COMPLETED"]
    return figures, faults, bool(ran) and not any(test.get("result") == "SKIPPED" for test in tests)


def _run_command(words: list[str]) -> Json:
    """A long run: a command of the program, in a folder that is removed."""
    begin = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="multipanda-study-") as folder:
        code, out, err = _ended([checked_program(), *words, "--json", "--out", folder], folder)
    try:
        result = json.loads(out)
    except ValueError:
        return {"error": f"multipanda {' '.join(words)} {_why(code, err)}"}
    result.pop("machine", None)
    faults = [str(fault) for fault in result.get("problems") or result.get("faults") or []]
    figures = experiment_figures(result) if words[0] == "experiment" else refine_figures(result)
    return _result(figures, code, faults, begin, result)


def experiment_figures(result: Json) -> Json:
    """The figures of an experiment's runs; the mean if a variant was repeated."""
    found: dict[str, list[float]] = {}
    for run in result.get("runs", []):
        for name, value in run["metrics"].items():
            if isinstance(value, (int, float)):
                found.setdefault(f"{run['variant']}/{run['plant']}/{name}", []).append(float(value))
    return {name: sum(values) / len(values) for name, values in found.items()}


def refine_figures(result: Json) -> Json:
    """Values before and after, and their ratio, of every quantity of every arm in the last round."""
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
    if "program" in job:
        return _run_program(job["program"])
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
