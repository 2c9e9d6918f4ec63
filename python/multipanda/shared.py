"""The newest records and events of a run, in memory that its program writes and this process only reads.

The layout is in docs/live_input.md. A record has a number that is odd while it is written and changes when it is
overwritten, so a copy between two equal, even numbers is whole.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import mmap
import os
import pathlib
import socket
import threading
import weakref
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .connection import Json, accepted
from .errors import Disconnected, Refused, VersionMismatch
from .record import Layout, Record, between

_HEADER_BYTES = 96
_TABLE_BYTES, _TABLE_HASH, _BYTES, _RECORDS, _RECORDS_LOST, _EVENTS, _EVENTS_LOST = 1, 2, 3, 8, 9, 10, 11  # words
_MAGIC = b"mp-rec-1"
_GET_SEALS, _SEAL_SHRINK = 1034, 2  # fcntl.h
_PATIENCE_S = 30

_ALL: weakref.WeakSet[SharedRecords] = weakref.WeakSet()


def _fnv1a(text: bytes) -> int:
    value = 0xCBF29CE484222325
    for byte in text:
        value = ((value ^ byte) * 0x100000001B3) & 0xFFFFFFFFFFFFFFFF
    return value


def _ask(connection: socket.socket) -> tuple[Json, list[int]]:
    """The answer to the request `records`, and the descriptor that comes with it."""
    connection.settimeout(_PATIENCE_S)
    connection.sendall(b'{"id": 1, "do": "records"}\n')
    line, files = b"", list[int]()
    try:
        while not line.endswith(b"\n"):
            part, passed, _, _ = socket.recv_fds(connection, 65536, 1)
            files += passed
            if not part:
                raise Disconnected("the run has ended", "start the scene again")
            line += part
        return json.loads(line), files
    except BaseException:
        for file in files:
            os.close(file)
        raise


class SharedRecords:
    """A mapping of a run's records and events. Any thread may read; no reading waits for the run."""

    def __init__(self, path: pathlib.Path) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        files: list[int] = []
        try:
            self._socket.connect(str(path))
            answer, files = _ask(self._socket)
            accepted(answer)
            if not files:
                raise Refused(
                    "not_local", "the run's memory is not on this computer", "state() asks the run; record() cannot"
                )
            self._map(files[0], int(answer["bytes"]), str(answer["hash"]))
        except BaseException as wrong:
            self._socket.close()
            if isinstance(wrong, OSError) and not isinstance(wrong, Disconnected):
                raise Disconnected(f"the run has ended ({wrong})", "start the scene again") from None
            raise
        finally:
            for file in files:
                os.close(file)
        self._socket.setblocking(False)
        self._process = os.getpid()
        self._ending = threading.Lock()
        self._ended = False
        _ALL.add(self)

    def _map(self, file: int, count: int, expected: str) -> None:
        # Memory that could shrink would end this process by SIGBUS.
        if not fcntl.fcntl(file, _GET_SEALS) & _SEAL_SHRINK or os.fstat(file).st_size != count:
            raise VersionMismatch("the run's records are not sealed memory", "build program and package together")
        self._read_table(mmap.mmap(file, count, mmap.MAP_SHARED, mmap.PROT_READ), expected)

    def _read_table(self, memory: mmap.mmap | bytearray, expected: str) -> None:
        self._head: NDArray[np.uint64] = np.ndarray(_HEADER_BYTES // 8, "<u8", memory)
        text = bytes(memory[_HEADER_BYTES : _HEADER_BYTES + int(self._head[_TABLE_BYTES])])
        found = _fnv1a(text)
        if memory[:8] != _MAGIC or found != int(self._head[_TABLE_HASH]) or f"{found:016x}" != expected:
            raise VersionMismatch("the run's records have another layout", "build program and package together")
        self._table: dict[str, Any] = json.loads(text)
        table = self._table
        self.layout = Layout(table)
        self.capacity: int = table["records"]
        self.event_capacity: int = table["events"]
        shape = (self.capacity, table["record_bytes"] // 8)
        self._rows: NDArray[np.int64] = np.ndarray(shape, "<i8", memory, table["first_record"])
        shape = (self.event_capacity, table["event_bytes"] // 8)
        self._event_rows: NDArray[np.int64] = np.ndarray(shape, "<i8", memory, table["first_event"])

    @property
    def written(self) -> int:
        """Records so far; the newest has this number minus one."""
        return int(self._head.item(_RECORDS))

    @property
    def events_written(self) -> int:
        """Events so far."""
        return int(self._head.item(_EVENTS))

    @property
    def lost_by_loop(self) -> tuple[int, int]:
        """Records and events that the loop had to drop, because nothing took them in time."""
        return int(self._head.item(_RECORDS_LOST)), int(self._head.item(_EVENTS_LOST))

    @property
    def ended(self) -> bool:
        """Whether the run has ended; what it wrote stays readable."""
        if self._ended or os.getpid() != self._process:
            return True
        try:
            gone = self._socket.recv(4096) == b""
        except BlockingIOError:
            return False
        except OSError:
            gone = True
        self._ended = self._ended or gone
        return gone

    def read(self, number: int) -> Record | None:
        """A copy of a record; None if it is not there yet, or not any more."""
        at, whole = number % self.capacity, 2 * number + 2
        if self._rows.item(at, 0) != whole:
            return None
        row = self._rows[at].copy()
        if self._rows.item(at, 0) != whole:
            return None
        return Record(self.layout, row)

    def newest(self) -> Record | None:
        """A copy of the newest record; None before the first cycle."""
        while (written := self.written) > 0:
            record = self.read(written - 1)
            if record is not None:  # None: the ring wrapped while this thread was suspended
                return record
        return None

    def rate_hz(self) -> float:
        """Cycles per second of wall time, over the last half second at 1 kHz."""
        newest = self.written - 1
        before = max(0, newest - 500)
        a, b = self._rows[before % self.capacity, 1:4], self._rows[newest % self.capacity, 1:4]
        elapsed_ns = b.item(2) - a.item(2)
        return 1e9 * (b.item(0) - a.item(0)) / elapsed_ns if elapsed_ns > 0 else 0.0

    def block(self, count: int) -> NDArray[np.int64]:
        """Copies of the newest records, oldest first, one per row; at most as many as are there."""
        written = self.written
        numbers = np.arange(max(0, written - min(count, self.capacity)), written)
        rows: NDArray[np.int64] = self._rows[numbers % self.capacity]
        after = self._rows[numbers % self.capacity, 0]
        whole: NDArray[np.int64] = rows[(rows[:, 0] == 2 * numbers + 2) & (after == 2 * numbers + 2)]
        return whole

    def at(self, start_ns: int) -> tuple[Record, int] | None:
        """The state at an instant by time.monotonic_ns(), interpolated between the records around it.

        Returns:
            The record, and the time to the nearest one that was recorded [ns]; None before the first cycle.
        """
        while (written := self.written) > 0:
            numbers = np.arange(max(0, written - self.capacity), written)
            places = numbers % self.capacity
            whole = self._rows[places, 0] == 2 * numbers + 2
            numbers, starts = numbers[whole], self._rows[places, self.layout.start_ns][whole]
            if not len(numbers):
                continue
            after = int(np.searchsorted(starts, start_ns))
            pair = (numbers[max(after - 1, 0)], numbers[min(after, len(numbers) - 1)])
            first, second = (self.read(int(number)) for number in pair)
            if first is not None and second is not None:  # None: the ring wrapped meanwhile
                apart = min(abs(start_ns - first.start_ns), abs(start_ns - second.start_ns))
                return between(first, second, start_ns), apart
        return None

    def start_of(self, cycle: int) -> int | None:
        """When a recorded cycle began, by time.monotonic_ns() [ns]; None: it is not among the records."""
        for place in np.flatnonzero(self._rows[:, self.layout.cycle] == cycle):
            record = self.read((self._rows.item(place, 0) - 2) // 2)
            if record is not None and record.cycle == cycle:
                return record.start_ns
        return None

    def read_event(self, number: int) -> tuple[int, int, Json] | None:
        """Cycle, loop time [ns] and contents of an event; None if it is not there yet, or not any more."""
        at, whole = number % self.event_capacity, 2 * number + 2
        if self._event_rows.item(at, 0) != whole:
            return None
        row = self._event_rows[at].copy()
        if self._event_rows.item(at, 0) != whole:
            return None
        text = row[4:].tobytes()[: row.item(3)]
        return row.item(1), row.item(2), json.loads(text)

    def close(self) -> None:
        """Ends all waits for the run. The mapping is removed with its last reader."""
        with self._ending:
            self._ended = True
            if os.getpid() == self._process:
                with contextlib.suppress(OSError):
                    self._socket.shutdown(socket.SHUT_RDWR)
            self._socket.close()


def _after_fork() -> None:
    for shared in list(_ALL):
        shared.close()


os.register_at_fork(after_in_child=_after_fork)
