"""Starts a scene in a process of its own, and ends it in hold."""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import pathlib
import signal
import subprocess
import tempfile
import time
import weakref
from collections.abc import Mapping, Sequence
from typing import IO, Any

from .client import Client
from .connection import Connection, make_socket_folder
from .errors import Disconnected, Error, Refused, Timeout, VersionMismatch
from .law import PlacedLaw, run_words
from .model import ArmModel, model, settings_words
from .program import checked_program, last_lines

_NUMBERS = itertools.count(1)
_EVERY_CYCLE: Mapping[str, int] = {}
_AS_IN_THE_SCENE: Mapping[str, Any] = {}
_CHILDREN: weakref.WeakSet[Process] = weakref.WeakSet()


class Process:
    """The program in a process of its own.

    It holds the other end of a pipe: when this process ends, however it does, the pipe closes and the program ends in
    hold. Its output goes to files without names, so nothing is left behind and no reader can slow it down.
    """

    def __init__(self, words: Sequence[str | os.PathLike[str]]) -> None:
        self.words = [checked_program(), *(os.fspath(word) for word in words)]
        self._kept: tuple[str, str] | None = None  # output and messages, once the program has ended
        self._out: IO[bytes] = tempfile.TemporaryFile(prefix="multipanda-")
        self._err: IO[bytes] = tempfile.TemporaryFile(prefix="multipanda-")
        # A session of its own: Ctrl-C reaches this process only, which then ends the program properly.
        self.child = subprocess.Popen(
            self.words, stdin=subprocess.PIPE, stdout=self._out, stderr=self._err, start_new_session=True
        )
        _CHILDREN.add(self)

    @property
    def output(self) -> str:
        """What it has written to standard output so far."""
        return self._kept[0] if self._kept else self._text(self._out)

    @property
    def messages(self) -> str:
        """What it has written to standard error so far."""
        return self._kept[1] if self._kept else self._text(self._err)

    @staticmethod
    def _text(file: IO[bytes]) -> str:
        size = os.fstat(file.fileno()).st_size
        return os.pread(file.fileno(), size, 0).decode(errors="replace")

    def let_go(self) -> None:
        """Closes the pipe: the program holds its arms, finishes their motion, and ends."""
        if self.child.stdin is not None:
            with contextlib.suppress(OSError):
                self.child.stdin.close()

    def tell(self, line: str) -> None:
        """Writes a line to the program's standard input."""
        if self.child.stdin is None or self.child.stdin.closed:
            raise Disconnected("the program has ended", "start it again")
        self.child.stdin.write(line.encode() + b"\n")
        self.child.stdin.flush()

    def end(self, patience_s: float) -> int:
        """Closes the pipe and waits for the end; Ctrl-C meanwhile does not shorten the hold. Returns the exit code."""
        self.let_go()
        deadline = time.monotonic() + patience_s
        interrupted: KeyboardInterrupt | None = None
        while True:
            try:
                code = self.child.wait(max(0.0, deadline - time.monotonic()))
                break
            except KeyboardInterrupt as again:
                interrupted = again
            except subprocess.TimeoutExpired:
                self.child.send_signal(signal.SIGKILL)
                self.child.wait()
                raise Timeout(
                    f"the program did not end within {patience_s:g} s and was killed:\n{last_lines(self.messages)}",
                    "look at the arms before you start again; real arms stop by themselves without commands",
                ) from None
        if self._kept is None:
            self._kept = (self._text(self._out), self._text(self._err))
            self._out.close()
            self._err.close()
        if interrupted is not None:
            raise interrupted
        return code

    def forget(self) -> None:
        """In a forked child: drops the copies of the pipe and of the process, which remain the parent's."""
        self.let_go()
        self.child.returncode = self.child.returncode if self.child.returncode is not None else 0


def _after_fork() -> None:
    for process in list(_CHILDREN):
        process.forget()


os.register_at_fork(after_in_child=_after_fork)


class Summary(dict[str, Any]):
    """The summary of a run, as `multipanda run --json` prints it; printed as text it is short. Times [s], [us]."""

    @property
    def success(self) -> bool:
        """Whether no controllet was deactivated by the safety stage, no switch refused and no record lost."""
        return bool(self.get("success"))

    @property
    def faults(self) -> list[str]:
        """Why it failed."""
        return list(self.get("faults", []))

    @property
    def log(self) -> pathlib.Path:
        """The log, in a folder of its own.

        Raises:
            Refused: The run was not recorded.
        """
        if not self.get("log"):
            raise Refused("no_log", "this run was not recorded", 'record it: mp.run(..., record="runs")')
        return pathlib.Path(self["log"])

    def __str__(self) -> str:
        cycle = self["cycle_us"]
        faults = f"; failed: {'; '.join(self.faults)}" if self.faults else ""
        return (
            f"{self['scene']}: {self['cycles']} cycles, {self['time_s']:.3f} s, {self['overruns']} overruns, "
            f"cycle median {cycle['median']:.1f} us, worst {cycle['worst']:.1f} us{faults}"
        )


def _raise_start(process: Process, code: int) -> None:
    said = last_lines(process.messages) or f"exit code {code}"
    if "--until-input-ends" in said:
        raise VersionMismatch(f"{process.words[0]} is older than this package: {said}", "build it again")
    if code == 2:
        raise Refused("not_understood", said, "multipanda list scenes, multipanda run --help")
    raise Error(f"the program ended at its start with code {code}:\n{said}", "see the messages above")


def _summary(process: Process, code: int) -> Summary:
    lines = process.output.strip().splitlines()
    if not lines:
        raise Error(
            f"the program ended with code {code} and without a summary:\n{last_lines(process.messages)}",
            "see the messages above",
        )
    return Summary(json.loads(lines[-1]))


class Run(Client):
    """A running scene that belongs to this process.

    Leaving `with`, by an exception too: the arms are held, their motion is finished, the program ends, `summary` and
    `log` are there. The program does the same when this process dies. Nothing here recovers an arm or loosens a limit.

    Attributes:
        summary: The run's summary once it is over; None before.
        process: The program.
        scene_file: Name or file of its scene.
        settings: Other values of the scene, as for run().
    """

    def __init__(
        self,
        process: Process,
        socket: pathlib.Path,
        start_timeout_s: float,
        end_timeout_s: float,
        scene_file: str,
        settings: Mapping[str, Any],
    ) -> None:
        self.process = process
        self.scene_file, self.settings = scene_file, settings
        self._socket = socket
        self._end_timeout_s = end_timeout_s
        self.summary: Summary | None = None
        self._owner = os.getpid()
        try:
            super().__init__(self._connect(socket, start_timeout_s))
            self.state()  # waits for the first cycle
        except Disconnected:  # the program reports why, for example which arm it could not reach
            self._end_quietly()
            code = self.process.child.poll()
            if code:
                _raise_start(self.process, code)
            raise
        except BaseException:
            self._end_quietly()
            raise

    def _connect(self, socket: pathlib.Path, timeout_s: float) -> Connection:
        deadline = time.monotonic() + timeout_s
        while True:
            code = self.process.child.poll()
            if code is not None:
                _raise_start(self.process, code)
            try:
                return Connection(socket)
            except Disconnected:
                pass
            if time.monotonic() > deadline:
                raise Timeout(
                    f"the program did not listen within {timeout_s:g} s:\n{last_lines(self.process.messages)}",
                    "see its messages; real arms must be unlocked and reachable (multipanda doctor)",
                )
            time.sleep(0.005)

    def arm_model(self, arm: str) -> ArmModel:
        """As Arm.model, but of the scene's file alone."""
        return model(self.scene_file, arm=arm, settings=self.settings)

    def _end_process(self) -> int:
        try:
            return self.process.end(self._end_timeout_s)
        finally:
            if self.process.child.poll() is not None:
                for suffix in ("", ".stream", ".lock"):  # a killed program leaves them behind
                    with contextlib.suppress(FileNotFoundError):
                        os.unlink(f"{self._socket}{suffix}")

    def _end_quietly(self) -> None:
        with contextlib.suppress(Error):
            self._end_process()

    @property
    def messages(self) -> str:
        """The program's messages so far."""
        return self.process.messages

    @property
    def running(self) -> bool:
        """Whether the program still runs."""
        return self.process.child.poll() is None

    @property
    def log(self) -> pathlib.Path:
        """The log, in a folder of its own.

        Raises:
            Refused: The run is not over, or was not recorded.
        """
        if self.summary is None:
            raise Refused("running", "the log is complete when the run is over", "leave `with` or call close() first")
        return self.summary.log

    @property
    def folder(self) -> pathlib.Path:
        """The folder of the log while it is written.

        Raises:
            Refused: The run is not recorded.
        """
        for file in pathlib.Path(f"/proc/{self.process.child.pid}/fd").glob("*"):
            with contextlib.suppress(OSError):
                if (log := pathlib.Path(os.readlink(file))).name == "log.mcap":
                    return log.parent
        raise Refused("no_log", "this run is not recorded", 'record it: mp.run(..., record="runs")')

    def wait(self, timeout_s: float | None = None) -> Summary:
        """Waits until the scene is over by itself (seconds=... or timeline=True), then closes.

        Raises:
            Timeout: It still runs after timeout_s [s].
        """
        try:
            self.process.child.wait(timeout_s)
        except subprocess.TimeoutExpired:
            raise Timeout(f"the run has not ended after {timeout_s:g} s", "close() ends it in hold") from None
        self.close()
        assert self.summary is not None
        return self.summary

    def close(self) -> None:
        """Ends the run in hold and reads its summary. May be called again.

        Raises:
            Timeout: The program did not end in time and was killed.
            Error: It ended without a summary.
        """
        if os.getpid() != self._owner or self.summary is not None:
            return
        try:
            code = self._end_process()
        finally:
            super().close()
        self.summary = _summary(self.process, code)

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        if kind is None:
            self.close()
            return
        try:  # the user should see the exception that ended the block
            self.close()
        except (Error, ValueError) as also:
            if error is not None and hasattr(error, "add_note"):
                error.add_note(f"also at the end of the run: {also}")


def _words(
    scene: str | os.PathLike[str],
    address: Mapping[str, str] | None,
    backend: str | None,
    record: str | os.PathLike[str] | None,
    log_every: int | Mapping[str, int],
    seconds: float | None,
    fast: bool,
    laws: Sequence[PlacedLaw],
    settings: Mapping[str, Any],
) -> list[str]:
    words: list[str] = ["run", os.fspath(scene), "--json", "--until-input-ends"]
    if backend is not None or address:
        words += ["--backend", backend or "fci"]
    if isinstance(address, str):
        raise TypeError(f"address: expected addresses by the names of arms, {{'arm': '{address}'}}; found '{address}'")
    for arm, where in (address or {}).items():
        words += ["--address", f"{arm}={where}"]
    if record is not None:
        words += ["--record", os.fspath(record)]
    choices = {"all": log_every} if isinstance(log_every, int) else log_every
    for group, every in choices.items():
        words += ["--log-every", f"{group}={every}"]
    if seconds is not None:
        words += ["--seconds", f"{seconds:g}"]
    for setting in settings_words(settings):
        words += ["--set", setting]
    if fast:
        words.append("--fast")
    return words + run_words(laws)


def play(
    scene: str | os.PathLike[str],
    *,
    address: Mapping[str, str] | None = None,
    backend: str | None = None,
    record: str | os.PathLike[str] | None = None,
    log_every: int | Mapping[str, int] = _EVERY_CYCLE,
    seconds: float | None = None,
    fast: bool = True,
    laws: Sequence[PlacedLaw] = (),
    settings: Mapping[str, Any] = _AS_IN_THE_SCENE,
    arguments: Sequence[str] = (),
    end_timeout_s: float = 60,
) -> Summary:
    """Plays a scene with its timeline to its end.

    Ctrl-C, every other exception and the death of this process end it in hold. The arguments are those of run(), but
    that it is as fast as possible unless fast=False, as real arms need it.

    Returns:
        The summary.

    Raises:
        Refused: The scene, an option or a law is not accepted.
        ProgramMissing: The program was not found.
        VersionMismatch: The program is of another version.
        Error: It ended without a summary.
        TypeError: `address` is not by arm.
    """
    process = Process([*_words(scene, address, backend, record, log_every, seconds, fast, laws, settings), *arguments])
    try:
        code = process.child.wait()
    finally:
        process.end(end_timeout_s)
    if code == 2:
        _raise_start(process, code)
    return _summary(process, code)


def run(
    scene: str | os.PathLike[str],
    *,
    address: Mapping[str, str] | None = None,
    backend: str | None = None,
    record: str | os.PathLike[str] | None = None,
    log_every: int | Mapping[str, int] = _EVERY_CYCLE,
    seconds: float | None = None,
    timeline: bool = False,
    fast: bool = False,
    cpu: int | None = None,
    ros: bool = False,
    laws: Sequence[PlacedLaw] = (),
    settings: Mapping[str, Any] = _AS_IN_THE_SCENE,
    arguments: Sequence[str] = (),
    start_timeout_s: float = 60,
    end_timeout_s: float = 60,
) -> Run:
    """Starts a scene and returns once its loop runs.

    Args:
        scene: Name of a scene, or path of a scene file.
        address: The real arms' addresses by name; arms without one are simulated unless the scene says otherwise.
        backend: Whose arms: `mujoco`, `virtual`, `fci`; by default as in the scene.
        record: Folder in which the log's folder is made.
        log_every: What the log has of every Nth cycle only, or never (0): {"state": 10, "timing": 0}, or one number
            for all. Events, switches, interventions and episodes are always whole.
        seconds: Loop time after which it ends by itself [s].
        timeline: Also plays the scene's timeline; by default the scene waits for commands.
        fast: As fast as possible instead of in real time, until it is closed.
        cpu: Core to which the loop is pinned.
        ros: Also serves the ROS 2 interfaces.
        laws: Laws in Python to add to the scene's controllets: `law.on("left")`.
        settings: Other values of the scene, by key path: {"controllets.cartesian.inputs.pose.timeout_s": 0.5}.
        arguments: More options of `multipanda run`.
        start_timeout_s: How long the program may take until it listens [s].
        end_timeout_s: How long it may take to end in hold [s].

    Raises:
        Refused: The scene, an option or a law is not accepted.
        Timeout: It did not listen in time: real arms must be unlocked and reachable.
        ProgramMissing: The program was not found.
        VersionMismatch: The program is of another version.
        Error: It ended at its start; its messages say why.
        ValueError: Options that exclude each other.
        TypeError: `address` is not by arm.
    """
    if fast and (timeline or seconds is not None):
        raise ValueError(
            "run: with fast=True it could end before it is commanded: use mp.play(), or leave out timeline and seconds"
        )
    words = _words(scene, address, backend, record, log_every, 1e6 if fast else seconds, fast, laws, settings)
    if not timeline:
        words.append("--no-timeline")
    if cpu is not None:
        words += ["--cpu", str(cpu)]
    if ros:
        words.append("--ros")
    socket = make_socket_folder() / f"python-{os.getpid()}-{next(_NUMBERS)}.sock"
    words += ["--socket", str(socket), *arguments]
    file = os.path.abspath(scene) if os.path.isfile(scene) else os.fspath(scene)
    return Run(Process(words), socket, start_timeout_s, end_timeout_s, file, settings)
