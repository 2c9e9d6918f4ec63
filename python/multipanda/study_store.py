"""The results of a study: a file per run, named by the hash of everything that determines the run."""

from __future__ import annotations

import fcntl
import json
import os
import pathlib
import secrets
from typing import Any

from .errors import Refused
from .study_identity import difference, same_machine
from .study_plan import StudyRun, canonical, sha256

Json = dict[str, Any]

_own_folders: set[str] = set()  # folders of the studies that this process runs


def sealed(result: Json) -> Json:
    """The result with the digest of its content, by which later changes are detected."""
    return {**result, "seal": sha256(canonical(result))}


def write_result(folder: pathlib.Path, result: Json) -> None:
    """Writes a sealed result as a whole or not at all. Several processes may do so at once."""
    target = result_path(folder, result["key"])
    target.parent.mkdir(parents=True, exist_ok=True)
    part = target.with_suffix(f".{os.getpid()}-{secrets.token_hex(4)}.part")
    part.write_bytes(canonical(result))
    part.replace(target)


def result_path(folder: pathlib.Path, key: str) -> pathlib.Path:
    return folder / "results" / key[:2] / f"{key}.json"


def check_result(result: Json, run: StudyRun, program: Json, where: str) -> None:
    """Raises Refused if a result is not this run's, or was changed since it was written."""
    help_ = "delete it, and the run is made again"
    content = {name: value for name, value in result.items() if name != "seal"}
    if result.get("seal") != sha256(canonical(content)):
        raise Refused("tampered", f"{where} was changed after it was written: its digest differs", help_)
    if result.get("key") != run.key or result.get("inputs") != run.inputs:
        raise Refused("foreign", f"{where} is the result of another run", help_)
    if result.get("program") != program:
        raise Refused("foreign", f"{where} was computed by another program", help_)


class Store:
    """A study's folder. One study at a time owns it."""

    def __init__(self, folder: pathlib.Path, any_machine: bool) -> None:
        self.folder = folder
        self.any_machine = any_machine
        folder.mkdir(parents=True, exist_ok=True)
        self._take_lock()
        # Workers that share this folder find the token in it; the others send their results back.
        token = folder / "token"
        if not token.exists():
            token.write_text(secrets.token_hex(16))
        self.token = token.read_text()
        self.machine: Json | None = None
        self._machine_file = folder / "machine.json"
        if self._machine_file.exists():
            self.machine = json.loads(self._machine_file.read_text())

    def _take_lock(self) -> None:
        # A POSIX lock belongs to this process alone: forked pool workers do not keep it when this process is killed.
        # It does not exclude other studies of the same process, and closing any copy of the file releases it.
        taken = Refused("in_use", f"a study is running in {self.folder}", "wait for it, or name another folder")
        self._place = os.path.realpath(self.folder)
        if self._place in _own_folders:
            raise taken
        self._lock = open(self.folder / "lock", "a")  # noqa: SIM115  held until close()
        try:
            fcntl.lockf(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            self._lock.close()
            raise taken from None
        _own_folders.add(self._place)

    def close(self) -> None:
        _own_folders.discard(self._place)
        self._lock.close()

    def take_machine(self, machine: Json, where: str) -> None:
        """The first result sets the reference machine; raises Refused for a result of another one."""
        if self.machine is None:
            self.machine = machine
            part = self._machine_file.with_suffix(".part")
            part.write_text(json.dumps(machine, indent=1))
            part.replace(self._machine_file)
        elif not self.any_machine and not same_machine(self.machine, machine):
            raise Refused(
                "other_machine",
                f"{where} comes from another machine than the study's first one, so that it may differ in the last "
                f"bits: {difference(self.machine, machine)}",
                "run on equal computers, accept it with --any-machine, or name another folder",
            )

    def load(self, run: StudyRun, program: Json) -> Json | None:
        """The checked result of a run; None if it is not done.

        Raises:
            Refused: It was changed, belongs to something else, or comes from another machine.
        """
        path = result_path(self.folder, run.key)
        try:
            text = path.read_bytes()
        except FileNotFoundError:
            return None
        try:
            result = json.loads(text)
            assert isinstance(result, dict)
        except (ValueError, AssertionError):
            raise Refused("tampered", f"{path} is no result", "delete it, and the run is made again") from None
        check_result(result, run, program, str(path))
        self.take_machine(result["machine"], str(path))
        return result
