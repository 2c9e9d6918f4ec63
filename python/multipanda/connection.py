"""JSON lines over the socket of a run (docs/live_input.md)."""

from __future__ import annotations

import itertools
import json
import os
import pathlib
import socket
import threading
import weakref
from collections.abc import Callable
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeout
from typing import Any

from .errors import Disconnected, Error, Refused, Timeout

Json = dict[str, Any]

_ALL: weakref.WeakSet[Connection] = weakref.WeakSet()


def socket_folder() -> pathlib.Path:
    """Where runs make their sockets."""
    runtime = os.environ.get("XDG_RUNTIME_DIR", "")
    if runtime.startswith("/"):
        return pathlib.Path(runtime, "multipanda")
    return pathlib.Path("/tmp") / f"multipanda-{os.getuid()}"


def make_socket_folder() -> pathlib.Path:
    """The folder, closed to others, as the program requires: whoever can write into it can move the arms."""
    folder = socket_folder()
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        info = os.lstat(folder)
    except OSError as wrong:
        raise Error(f"the folder {folder} for sockets cannot be made: {wrong}", "set XDG_RUNTIME_DIR") from None
    if info.st_uid != os.getuid() or info.st_mode & 0o077:
        raise Error(f"the folder {folder} is open to other users", f"chmod 700 {folder}, or remove it")
    return folder


def running_sockets() -> list[pathlib.Path]:
    """The sockets of the runs that listen now."""
    found = []
    for path in sorted(socket_folder().glob("*.sock")):
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
            if probe.connect_ex(str(path)) == 0:
                found.append(path)
    return found


def only_running_socket() -> pathlib.Path:
    """The socket of the only run."""
    found = running_sockets()
    if len(found) == 1:
        return found[0]
    if not found:
        raise Disconnected(
            f"no scene is running (no socket in {socket_folder()})",
            "start one with mp.run(SCENE) or `multipanda run SCENE`, or name its socket",
        )
    raise Refused(
        "several_runs",
        "several scenes are running: " + ", ".join(map(str, found)),
        "name one of these sockets: mp.connect(PATH)",
    )


class Connection:
    """One client of a run. Any number of threads may ask at once; a thread of its own takes the answers."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = pathlib.Path(path)
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            self._socket.connect(str(self.path))
        except OSError as wrong:
            self._socket.close()
            raise Disconnected(
                f"no run listens at {self.path} ({wrong.strerror or wrong})",
                "start one with mp.run(SCENE) or `multipanda run SCENE`",
            ) from None
        self._ids = itertools.count(1)
        self._waiting: dict[int, Future[Json]] = {}
        self._listeners: dict[tuple[str, int], Callable[[Json], None]] = {}
        self._lock = threading.Lock()  # of the two tables
        self._sending = threading.Lock()
        self._ended: str | None = None
        self._on_end: Callable[[], None] | None = None
        self.process = os.getpid()
        self._thread = threading.Thread(target=self._receive, name="multipanda answers", daemon=True)
        self._thread.start()
        _ALL.add(self)

    def _end(self, why: str) -> None:
        with self._lock:
            self._ended = self._ended or why
            waiting, self._waiting = self._waiting, {}
            on_end, self._on_end = self._on_end, None
        for future in waiting.values():
            future.set_exception(self._gone())
        if on_end is not None:
            on_end()

    def _gone(self) -> Disconnected:
        why = self._ended or "the connection is closed"
        return Disconnected(f"{why} ({self.path})", "start the scene again, or mp.connect() to another run")

    def _receive(self) -> None:
        try:
            with self._socket.makefile("rb") as lines:
                for line in lines:
                    self._take(json.loads(line))
        except (OSError, ValueError):
            pass
        self._end("the run has ended")

    def _take(self, answer: Json) -> None:
        for kind in ("subscription", "channel"):
            if kind in answer and "ok" not in answer:
                with self._lock:
                    listener = self._listeners.get((kind, answer[kind]))
                if listener is not None:
                    listener(answer)
                return
        with self._lock:
            future = self._waiting.pop(answer.get("id") or 0, None)
        if future is not None:
            future.set_result(answer)

    def check(self) -> None:
        """Raises Disconnected if this connection has ended, or belongs to another process."""
        if os.getpid() != self.process:
            raise Disconnected("this process was forked from the one that has the connection", "mp.connect() here")
        if self._ended is not None:
            raise self._gone()

    def listen(self, kind: str, number: int, listener: Callable[[Json], None]) -> None:
        """Calls `listener` with each line of a subscription or a channel, on the thread of the answers."""
        with self._lock:
            self._listeners[kind, number] = listener

    def on_end(self, listener: Callable[[], None]) -> None:
        """Calls `listener` once when the connection ends, at once if it has."""
        with self._lock:
            if self._ended is None:
                self._on_end = listener
                return
        listener()

    def ask_subscription(self, rate_hz: float, listener: Callable[[Json], None]) -> None:
        """Subscribes to the state: calls `listener` with each line, on the thread of the answers."""
        future = self.post(
            {"do": "subscribe", "rate_hz": rate_hz}, lambda number: self.listen("subscription", number, listener)
        )
        accepted(future.result(30))

    def forget(self, kind: str, number: int) -> None:
        """Ends listen()."""
        with self._lock:
            self._listeners.pop((kind, number), None)

    def post(self, request: Json, on_id: Callable[[int], None] | None = None) -> Future[Json]:
        """Sends a request. The future has the answer, refused or not."""
        self.check()
        future: Future[Json] = Future()
        number = next(self._ids)
        if on_id is not None:
            on_id(number)
        with self._lock:
            if self._ended is not None:
                raise self._gone()
            self._waiting[number] = future
        line = json.dumps({**request, "id": number}, allow_nan=False).encode() + b"\n"
        try:
            with self._sending:
                self._socket.sendall(line)
        except OSError:
            self._end("the run has ended")
        except BaseException:  # Ctrl-C: perhaps in the middle of a line, so nothing more can follow it
            self._end("a request was interrupted while it was sent")
            raise
        return future

    def ask(self, request: Json, timeout_s: float = 30) -> Json:
        """The answer to a request. Raises Refused, Timeout or Disconnected."""
        future = self.post(request)
        try:
            answer = future.result(timeout_s)
        except FutureTimeout:
            if future.done():  # the answer was an error of its own
                raise
            raise Timeout(
                f"the run did not answer '{request.get('do')}' within {timeout_s:g} s",
                "see whether it still runs: multipanda ctl state",
            ) from None
        return accepted(answer)

    def close(self) -> None:
        """Closes the connection. Requests that were sent are still executed."""
        self._end("the connection was closed")
        try:
            self._socket.shutdown(socket.SHUT_RDWR)
        except OSError:
            pass
        if threading.current_thread() is not self._thread:
            self._thread.join(5)
        self._socket.close()

    def abandon(self) -> None:
        """In a forked child: drops the copy of the socket, which remains the parent's."""
        self._ended = "this process was forked from the one that has the connection"
        self._socket.close()


def accepted(answer: Json) -> Json:
    """The answer, or Refused."""
    if answer.get("ok"):
        return answer
    verdict = str(answer.get("verdict", "refused"))
    reason = str(answer.get("reason", "refused"))
    if verdict in ("timeout", "pending"):
        raise Timeout(reason, "read run.state() before sending the request again")
    raise Refused(verdict, reason)


def _after_fork() -> None:
    for connection in list(_ALL):
        connection.abandon()


os.register_at_fork(after_in_child=_after_fork)
