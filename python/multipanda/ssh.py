"""A run on another computer: its sockets over one ssh connection to `multipanda bridge` there (bridge.py)."""

from __future__ import annotations

import collections
import contextlib
import itertools
import json
import os
import select
import shlex
import socket
import struct
import subprocess
import tempfile
import threading
import time
import urllib.parse
from collections.abc import Sequence
from dataclasses import dataclass

from .bridge import MAGIC, Frames, frame
from .connection import accepted
from .errors import Disconnected, Refused, Timeout
from .program import last_lines
from .record import Record
from .shared import SharedRecords

_PING_S = 0.1
_PINGS = 600  # round trips of the last minute, which give the clocks' offset
_FIRST_PINGS = 5
_RECORDS_HZ = 50
_UNSENT = 1 << 16  # bytes from which on samples wait: the newest ones are dropped where they are sent
_MOST_UNREAD = 1 << 24
_PATIENCE_S = 30


@dataclass(frozen=True)
class Clock:
    """The clock of the run's computer, by the quickest of the last minute's round trips.

    Attributes:
        ahead_ns: By how much it is ahead of time.monotonic_ns() here [ns].
        uncertainty_ns: Half of that round trip [ns]: the offset is right within it.
    """

    ahead_ns: int = 0
    uncertainty_ns: int = 0

    @property
    def least_ns(self) -> int:
        """Lower bound of its lead [ns], so that no request seems newer than it is."""
        return self.ahead_ns - self.uncertainty_ns


class MirroredRecords(SharedRecords):
    """A copy of the run's newest records and all of its events. Their times are those of this computer."""

    def __init__(self, link: Link, answer: bytes, memory: bytes) -> None:
        described = accepted(json.loads(answer))
        if not memory:
            raise Refused("not_local", "the run shares no records", "see its messages at the start")
        self._link, self._run_ended = link, False
        self._memory = bytearray(int(described["bytes"]))
        self._memory[: len(memory)] = memory
        self._read_table(self._memory, str(described["hash"]))
        self._first, self._size = self._table["first_record"], self._table["record_bytes"]
        self._seen: collections.deque[tuple[int, int]] = collections.deque(maxlen=_RECORDS_HZ // 2)

    def take(self, at: int, contents: bytes) -> None:
        """Takes bytes of the run's memory."""
        if self._first <= at < self._first + self._size * self.capacity:
            row = bytearray(contents)
            place = 8 * self.layout.start_ns
            (start_ns,) = struct.unpack_from("<q", row, place)
            struct.pack_into("<q", row, place, start_ns - self._link.clock.ahead_ns)
            (cycle,) = struct.unpack_from("<q", row, 8 * self.layout.cycle)
            if not self._seen or cycle > self._seen[-1][0]:
                self._seen.append((cycle, start_ns))
            contents = bytes(row)
        self._memory[at : at + len(contents)] = contents

    def at(self, start_ns: int) -> tuple[Record, int] | None:
        """As SharedRecords.at(), of all records there: those around the instant are asked for."""
        found = super().at(start_ns)
        if found is None or found[1] == 0 or not self._link.ask_around(start_ns):
            return found
        return super().at(start_ns)

    def end(self) -> None:
        """The run has ended."""
        self._run_ended = True

    @property
    def ended(self) -> bool:
        """Whether the run has ended, or the connection to it."""
        return self._run_ended or bool(self._link.lost)

    def rate_hz(self) -> float:
        """Cycles per second of wall time, over the last half second."""
        if len(self._seen) < 2:
            return float("nan")
        (a, before_ns), (b, after_ns) = self._seen[0], self._seen[-1]
        return 1e9 * (b - a) / (after_ns - before_ns) if after_ns > before_ns else 0.0

    def close(self) -> None:
        """Ends all waits for the run."""
        self.end()


class _Channel:
    """This computer's end of a socket of the run."""

    def __init__(self, kind: str, late_s: float) -> None:
        self.packets, self.late_ns = kind == "samples", int(1e9 * late_s)
        self.outer, self.inner = socket.socketpair(
            socket.AF_UNIX, socket.SOCK_SEQPACKET if self.packets else socket.SOCK_STREAM
        )
        self.inner.setblocking(False)
        self.unread = bytearray()  # for a client that reads late


class Link:
    """An ssh connection to `multipanda bridge`.

    Attributes:
        where: Its address, with the run's socket there.
        lost: Why it has ended; empty while it lasts.
        clock: The clock there.
    """

    def __init__(self, url: str, program: str, ssh: Sequence[str], silence_s: float, timeout_s: float) -> None:
        words = urllib.parse.urlsplit(url)
        run = words.path[1:]
        if words.password is not None:
            raise ValueError("an address has no password: ssh asks for it, or uses a key")
        to = f"{words.username}@{words.hostname}" if words.username else words.hostname or "-"
        if words.scheme != "ssh" or not words.hostname or to.startswith("-") or words.query:  # "-": an option of ssh
            raise ValueError(f"expected ssh://USER@HOST:PORT/RUN, found '{url}'")
        if not 0.2 <= silence_s <= 60:
            raise ValueError(f"silence_s: expected 0.2 to 60 s, found {silence_s:g}")
        self.host = to + (f":{words.port}" if words.port else "")
        self.where, self.lost, self.clock = f"ssh://{self.host}", "", Clock()
        self._silence_s = silence_s
        port = ["-p", str(words.port)] if words.port else []
        far = " ".join(shlex.quote(word) for word in (program, "bridge", *([run] if run else [])))
        # Ctrl-C is for this program, which may have to stop arms over this connection.
        command = ["sh", "-c", 'trap "" INT; exec "$@"', "sh", *ssh, "-T", *port, to, far]
        self._messages = tempfile.TemporaryFile(prefix="multipanda-")
        self._child = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._messages, bufsize=0
        )
        assert self._child.stdin is not None and self._child.stdout is not None
        self._in, self._out = self._child.stdout.fileno(), self._child.stdin.fileno()
        os.set_blocking(self._in, False)
        os.set_blocking(self._out, False)
        self._wake, self._waker = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        self._numbers = itertools.count(1)
        self._channels: dict[int, _Channel] = {}
        self._unsent = bytearray()
        self._lock = threading.Lock()  # protects the two above
        self._pings: collections.deque[tuple[int, int]] = collections.deque(maxlen=_PINGS)  # round trip, offset
        self._records: MirroredRecords | None = None
        self._table: bytes | None = None
        self._asked_around, self._got_around = 0, 0
        self._changed = threading.Condition()
        self._process = os.getpid()
        self._thread = threading.Thread(target=self._serve, args=(timeout_s,), name="multipanda ssh", daemon=True)
        self._thread.start()
        try:
            self._wait(lambda: len(self._pings) >= _FIRST_PINGS, timeout_s + _PATIENCE_S)
            if 2e-9 * self.clock.uncertainty_ns > silence_s / 2:
                raise Refused(
                    "too_slow",
                    f"{self.host} answers after {2e-9 * self.clock.uncertainty_ns:.2f} s",
                    f"use a nearer computer, or more than silence_s={silence_s:g}",
                )
        except BaseException:
            self.close()
            raise

    # --- any thread ---

    def open(self, kind: str, late_s: float = 0) -> socket.socket:
        """A new connection to the run's socket: "lines", or "samples", which may be late by late_s [s].

        Raises:
            Disconnected: The connection is lost.
        """
        channel = _Channel(kind, late_s)
        with self._lock:
            if self.lost or os.getpid() != self._process:
                channel.inner.close()
                channel.outer.close()
                raise Disconnected(f"{self.lost or 'this process was forked'} ({self.where})", "mp.connect() again")
            number = next(self._numbers)
            self._channels[number] = channel
            self._unsent += frame(b"s" if channel.packets else b"l", number)
        self._stir()
        return channel.outer

    def records(self) -> MirroredRecords:
        """The copy of the run's records and events.

        Raises:
            Refused: The run shares none.
            Disconnected: The connection is lost.
            Timeout: No answer.
        """
        self._send(frame(b"m", 0, struct.pack("<d", _RECORDS_HZ)))
        self._wait(lambda: self._table is not None, _PATIENCE_S)
        assert self._table is not None
        if self._records is None:
            raise Refused("not_local", "the run shares no records", "see its messages at the start")
        return self._records

    def ask_around(self, start_ns: int) -> bool:
        """Brings the records around an instant of this computer's clock [ns]. False: they did not come."""
        with self._lock:
            self._asked_around += 1
            number = self._asked_around
            self._unsent += frame(b"r", number, struct.pack("<q", start_ns + self.clock.ahead_ns))
        self._stir()
        with contextlib.suppress(Disconnected, Timeout):
            self._wait(lambda: self._got_around >= number, self._silence_s)
        return self._got_around >= number

    def close(self) -> None:
        """Ends it properly: the run continues."""
        if os.getpid() == self._process and not self.lost:
            self._send(frame(b"e"))
            self._thread.join(self._silence_s)
        self._lose("the connection was closed")
        if threading.current_thread() is not self._thread:
            self._thread.join(5)

    def _wait(self, condition: collections.abc.Callable[[], bool], patience_s: float) -> None:
        with self._changed:
            done = self._changed.wait_for(lambda: condition() or self.lost, patience_s)
        if not condition() and self.lost:
            raise Disconnected(f"{self.lost} ({self.where})", "check that the same ssh command works in a terminal")
        if not done:
            raise Timeout(f"{self.where} did not answer within {patience_s:g} s", "check the computer and the network")

    def _send(self, one: bytes) -> None:
        with self._lock:
            self._unsent += one
        self._stir()

    def _stir(self) -> None:
        with contextlib.suppress(OSError):
            os.write(self._waker, b".")

    def _lose(self, why: str) -> None:
        with self._lock:
            self.lost = self.lost or why
        self._stir()
        with self._changed:
            self._changed.notify_all()

    # --- its own thread ---

    def _serve(self, timeout_s: float) -> None:
        try:
            self._handshake(time.monotonic() + timeout_s)
            self._send(frame(b"b", 0, struct.pack("<d", self._silence_s)))
            frames, self._heard_s, next_ping_s = Frames(), time.monotonic(), 0.0
            while not self.lost:
                if time.monotonic() >= next_ping_s:
                    next_ping_s = time.monotonic() + (_PING_S if len(self._pings) >= _FIRST_PINGS else 0.01)
                    self._send(frame(b"p", 0, struct.pack("<q", time.monotonic_ns())))
                self._turn(frames, max(0.0, next_ping_s - time.monotonic()))
                if time.monotonic() - self._heard_s > self._silence_s:
                    self._lose(f"nothing came from {self.host} for {self._silence_s:g} s; it holds the arms then")
        except (OSError, EOFError, ValueError) as wrong:
            self._lose(self._why(wrong))
        finally:
            self._lose("the connection was closed")
            for file in (self._child.stdin, self._child.stdout):
                with contextlib.suppress(OSError):
                    file.close()  # type: ignore[union-attr]
            try:
                self._child.wait(2)
            except subprocess.TimeoutExpired:
                self._child.kill()
                self._child.wait()
            with self._lock:
                channels, self._channels = self._channels, {}
            for channel in channels.values():
                channel.inner.close()
            self._messages.close()
            os.close(self._wake)
            self._waker, waker = -1, self._waker
            os.close(waker)

    def _handshake(self, deadline_s: float) -> None:
        """Waits for the bridge; skips the output of a login shell."""
        heard = b""
        while MAGIC not in heard:
            left = deadline_s - time.monotonic()
            ready = select.select([self._in, self._wake], [], [], max(0.0, left))[0]
            if self.lost or not ready:
                raise OSError(self.lost or "no answer in time")
            part = os.read(self._in, 1) if self._in in ready else b"."
            if self._in in ready:
                heard += part
            if not part:
                raise EOFError
        self._heard_s = time.monotonic()

    def _why(self, wrong: Exception) -> str:
        """The messages of ssh if it has ended."""
        try:
            code = self._child.wait(2 if isinstance(wrong, (EOFError, BrokenPipeError)) else 0)
        except subprocess.TimeoutExpired:
            return f"the connection to {self.host} broke ({wrong})"
        size = os.fstat(self._messages.fileno()).st_size
        said = last_lines(os.pread(self._messages.fileno(), size, 0).decode(errors="replace"), 4)
        if code == 127:
            said += '; name the program there: mp.connect(..., program="/path/to/multipanda")'
        return f"the connection to {self.host} has ended, code {code}: {said or 'no message'}"

    def _turn(self, frames: Frames, patience_s: float) -> None:
        poll = select.poll()
        poll.register(self._in, select.POLLIN)
        poll.register(self._wake, select.POLLIN)
        with self._lock:
            if self._unsent:
                poll.register(self._out, select.POLLOUT)
            channels = {channel.inner.fileno(): number for number, channel in self._channels.items()}
            takes = select.POLLIN if len(self._unsent) < _UNSENT else 0
            for channel in self._channels.values():
                poll.register(channel.inner, takes | (select.POLLOUT if channel.unread else 0))
        for file, events in poll.poll(1e3 * patience_s):
            if file == self._wake:
                os.read(self._wake, 4096)
            elif file == self._in:
                part = os.read(self._in, 1 << 16)
                if not part:
                    raise EOFError
                self._heard_s = time.monotonic()
                for one in frames.add(part):
                    self._take(*one)
            elif file in channels:
                if events & select.POLLOUT:
                    self._bring(channels[file])
                if events & ~select.POLLOUT:
                    self._pass_on(channels[file])
        with self._lock, contextlib.suppress(BlockingIOError):
            if self._unsent:
                del self._unsent[: os.write(self._out, self._unsent[: 1 << 16])]

    def _pass_on(self, number: int) -> None:
        channel = self._channels.get(number)
        if channel is None:
            return
        try:
            data = channel.inner.recv(1 << 16)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self._drop(number)
        elif channel.packets:  # its own time of sending is at byte 24
            (sent_ns,) = struct.unpack_from("<q", data, 24)
            use_by_ns = sent_ns + self.clock.ahead_ns + self.clock.uncertainty_ns + channel.late_ns
            data = struct.pack("<q", use_by_ns) + data
        self._send(frame(b"d", number, data))

    def _bring(self, number: int) -> None:
        """Data of the run for the reader here."""
        channel = self._channels.get(number)
        if channel is None:
            return
        try:
            while channel.unread:
                del channel.unread[: channel.inner.send(channel.unread)]
        except BlockingIOError:
            if len(channel.unread) > _MOST_UNREAD:
                self._drop(number)
        except OSError:  # closed
            self._drop(number)

    def _drop(self, number: int) -> None:
        with self._lock:
            channel = self._channels.pop(number, None)
        if channel is not None:
            channel.inner.close()

    def _take(self, kind: bytes, number: int, contents: bytes) -> None:
        if kind == b"p":
            now = time.monotonic_ns()
            sent, there = struct.unpack("<qq", contents)
            self._pings.append((now - sent, there - (sent + now) // 2))
            trip, ahead = min(self._pings)
            self.clock = Clock(ahead, trip // 2)
        elif kind == b"h":
            self.where += contents.decode()
        elif kind == b"d" and not contents:
            self._drop(number)
        elif kind == b"d" and number in self._channels:
            self._channels[number].unread += contents
            self._bring(number)
        elif kind == b"m" and self._records is not None:
            self._records.take(int.from_bytes(contents[:8], "little"), contents[8:])
        elif kind == b"r":
            self._got_around = number
        elif kind == b"t" and contents:
            answer, _, memory = contents.partition(b"\n")
            with contextlib.suppress(Refused, ValueError):
                self._records = MirroredRecords(self, answer, memory)
            self._table = answer
        elif kind == b"t" and self._records is not None:
            self._records.end()
        with self._changed:
            self._changed.notify_all()
