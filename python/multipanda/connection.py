"""JSON lines over the socket of a run (docs/live_input.md)."""

from __future__ import annotations

import errno
import itertools
import json
import os
import pathlib
import socket
import threading
import time
import weakref
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, TimeoutError as FutureTimeout
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .ssh import Link

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
    """The folder, closed to others, as the program requires: who can write into it can move the arms."""
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
    """The sockets of the active runs."""
    found = []
    for path in sorted(socket_folder().glob("*.sock")):
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
            probe.setblocking(False)  # a frozen run, which accepts no connection, is active as well
            if probe.connect_ex(str(path)) in (0, errno.EAGAIN):
                found.append(path)
    return found


def all_running_sockets() -> list[pathlib.Path]:
    """Those of all runs on this computer: also of sockets elsewhere, of other environments and of other users."""
    listening: dict[str, set[str]] = {"0001": set(), "0005": set()}  # stream, sequence of packets
    try:
        lines = pathlib.Path("/proc/net/unix").read_text().splitlines()
    except OSError:
        lines = []
    for line in lines:
        words = line.split(None, 7)
        if len(words) == 8 and words[3] == "00010000" and words[4] in listening:
            listening[words[4]].add(words[7])
    found = {pathlib.Path(path) for path in listening["0001"] if path + ".stream" in listening["0005"]}
    return sorted(found | set(running_sockets()))


def _connected(path: str | os.PathLike[str], link: Link | None, timeout_s: float | None) -> socket.socket:
    own = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) if link is None else link.open("lines")
    try:
        own.settimeout(timeout_s)
        if link is None:
            own.connect(os.fspath(path))
    except BaseException:
        own.close()
        raise
    return own


def stop_run(
    path: str | os.PathLike[str], arms: Sequence[str] = ("all",), timeout_s: float = 5, link: Link | None = None
) -> Json:
    """Stops arms over a connection of its own, so that nothing else in this process can delay it.

    Raises:
        Disconnected: No run listens there.
        Timeout: No answer within timeout_s [s]: a stalled run stops when it continues.
    """
    line = json.dumps({"id": 1, "do": "stop", "arms": list(arms)}).encode() + b"\n"
    deadline = time.monotonic() + timeout_s
    while (left := deadline - time.monotonic()) > 0:
        try:
            with _connected(path, link, left) as own:
                own.sendall(line)
                with own.makefile("rb") as answers:
                    for answer in map(json.loads, answers):
                        if answer.get("id") == 1:
                            return accepted(answer)
        except (FileNotFoundError, ConnectionRefusedError, PermissionError) as wrong:
            raise Disconnected(f"no run listens at {path} ({wrong.strerror})", "see running_sockets()") from None
        except Disconnected:
            raise
        except (OSError, ValueError):
            pass  # it accepts no connection at the moment, or a full run has ended this connection for another one
        time.sleep(0.001)
    raise Timeout(
        f"the run at {path} did not answer 'stop' within {timeout_s:g} s", "a paused run stops as soon as it continues"
    )


def stop_all(arms: str | Sequence[str] = "all") -> dict[pathlib.Path, Json]:
    """Stops arms of all runs on this computer, at once. Returns the answers by socket.

    A run without an arm of that name stops all of its arms.

    Raises:
        Disconnected: No scene runs, or one of the runs ended meanwhile.
        Timeout: A run does not answer: a paused run stops as soon as it continues.
    """
    names = [arms] if isinstance(arms, str) else list(arms)
    paths = all_running_sockets()
    if not paths:
        raise Disconnected("no scene is running on this computer: nothing was stopped", "start one with mp.run(SCENE)")
    with ThreadPoolExecutor(len(paths)) as threads:
        asked = {path: threads.submit(stop_run, path, names) for path in paths}
    return {path: future.result() for path, future in asked.items()}


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
    """One client of a run. Any number of threads may send requests; a separate thread receives the answers."""

    def __init__(self, path: str | os.PathLike[str], link: Link | None = None) -> None:
        self.link = link  # to another computer; None: the run is on this one
        self.path: pathlib.Path | str = os.fspath(path)
        if link is None:
            self.path = pathlib.Path(path).absolute()  # for a stop after os.chdir(), too
        try:
            self._socket = _connected(self.path, link, None)
        except OSError as wrong:
            if isinstance(wrong, Disconnected):
                raise
            raise Disconnected(
                f"no run listens at {self.path} ({wrong.strerror or wrong})",
                "start one with mp.run(SCENE) or `multipanda run SCENE`",
            ) from None
        self._ids = itertools.count(1)
        self._waiting: dict[int, tuple[Future[Json], int]] = {}  # and when it was sent
        # The run's clock minus ours, from its answers: 0 on one computer. None: not known.
        self._ahead_ns: int | None = None
        self._listeners: dict[int, Callable[[Json], None]] = {}  # of channels
        self._lock = threading.Lock()  # protects both tables
        self._sending = threading.Lock()
        self._ended: str | None = None
        self.process = os.getpid()
        self._thread = threading.Thread(target=self._receive, name="multipanda answers", daemon=True)
        self._thread.start()
        _ALL.add(self)

    def _end(self, why: str) -> None:
        with self._lock:
            self._ended = self._ended or why
            waiting, self._waiting = self._waiting, {}
        for future, _ in waiting.values():
            future.set_exception(self._gone())

    def _why(self) -> str:
        return (self.link.lost if self.link is not None else "") or "the run has ended"

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
        self._end(self._why())

    def _take(self, answer: Json) -> None:
        if "channel" in answer and "ok" not in answer:
            with self._lock:
                listener = self._listeners.get(answer["channel"])
            if listener is not None:
                listener(answer)
            return
        if answer.get("verdict") == "too_many_clients":
            self._end(str(answer["reason"]))
        with self._lock:
            waiting = self._waiting.pop(answer.get("id") or 0, None)
        if waiting is None:
            return
        future, sent = waiting
        there, here = int(answer.get("now_ns", 0)), time.monotonic_ns()
        if (
            there and self.link is None
        ):  # answered meanwhile by this clock, it is the same one; otherwise requests seem older than they are
            self._ahead_ns = 0 if sent <= there <= here else there - here
        future.set_result(answer)

    def check(self) -> None:
        """Raises Disconnected if this connection has ended, or belongs to another process."""
        if os.getpid() != self.process:
            raise Disconnected("this process was forked from the one that has the connection", "mp.connect() here")
        if self._ended is not None:
            raise self._gone()

    def listen(self, channel: int, listener: Callable[[Json], None]) -> None:
        """Calls `listener` with each line of a channel, on the thread of the answers."""
        with self._lock:
            self._listeners[channel] = listener

    def forget(self, channel: int) -> None:
        """Ends listen()."""
        with self._lock:
            self._listeners.pop(channel, None)

    def post(self, request: Json, patience_s: float | None = None) -> Future[Json]:
        """Sends a request. The future has the answer, refused or not.

        Args:
            request: The request, without an `id`.
            patience_s: How long the sender waits for the answer [s]; the run does not begin the request later.
        """
        self.check()
        sent = time.monotonic_ns()
        ahead_ns = self._ahead_ns if self.link is None else self.link.clock.least_ns
        if patience_s is not None and ahead_ns is not None:
            request = {"asked_ns": sent + ahead_ns, "patience_s": patience_s, **request}
        future: Future[Json] = Future()
        number = next(self._ids)
        with self._lock:
            if self._ended is not None:
                raise self._gone()
            self._waiting[number] = future, sent
        line = json.dumps({**request, "id": number}, allow_nan=False).encode() + b"\n"
        try:
            with self._sending:
                self._socket.sendall(line)
        except OSError:
            self._end(self._why())
        except BaseException:  # Ctrl-C may cut a line, so nothing can be sent after it
            self._end("a request was interrupted while it was sent")
            raise
        return future

    def ask(self, request: Json, timeout_s: float = 30) -> Json:
        """The answer to a request. Raises Refused, Timeout or Disconnected."""
        future = self.post(request, patience_s=timeout_s)
        try:
            answer = future.result(timeout_s)
        except FutureTimeout:
            if future.done():  # the answer was an error itself
                raise
            raise Timeout(
                f"the run did not answer '{request.get('do')}' within {timeout_s:g} s",
                "see whether it still runs: multipanda ctl state",
            ) from None
        return accepted(answer)

    def samples(self, timeout_s: float) -> socket.socket:
        """A socket for packets of streams. Raises OSError if there is none.

        Args:
            timeout_s: By how much a packet may be later than the quickest [s].
        """
        if self.link is not None:
            return self.link.open("samples", timeout_s)
        own = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:  # not answer["path"]: behind a forwarded socket that could be another run of this computer
            own.connect(f"{self.path}.stream")
        except BaseException:
            own.close()
            raise
        return own

    def answered_ns(self, answer: Json) -> int:
        """When the run answered, by the clock of this computer [ns]."""
        there = int(answer.get("now_ns", 0))
        return time.monotonic_ns() if self.link is None or not there else there - self.link.clock.ahead_ns

    @property
    def delay_s(self) -> float:
        """How much longer than on one computer an answer takes."""
        return 0 if self.link is None else 2e-9 * self.link.clock.uncertainty_ns

    def close(self) -> None:
        """Closes the connection. Pending requests no longer begin."""
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
