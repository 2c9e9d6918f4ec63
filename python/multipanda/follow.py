"""Iterators over what a run records: without loss for a reader that keeps up, with a count for one that does not."""

from __future__ import annotations

import threading
import time
from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Generic, TypeVar

from .closing import Closing
from .record import Record
from .shared import SharedRecords

T = TypeVar("T")

_PERIOD_S = 2.5e-4  # polling period


@dataclass(frozen=True)
class Event:
    """An event of the run. docs/live_input.md lists the kinds.

    Attributes:
        t_s: Loop time of the cycle [s].
        arm: Name of the arm; empty if it concerns no single arm.
        kind: What happened, such as `contact`, `switch`, `error`.
        text: The same in words.
        cycle: Number of the cycle.
    """

    t_s: float
    arm: str
    kind: str
    text: str
    cycle: int = 0


class _Follower(Closing, Iterator[T], Generic[T]):
    """Reads slot by slot. `lost` counts the slots overwritten before they were read."""

    def __init__(self, shared: SharedRecords, capacity: int) -> None:
        self._shared, self._capacity = shared, capacity
        self._number = self._written()
        self._closed = threading.Event()
        self.lost = 0

    @abstractmethod
    def _written(self) -> int: ...

    @abstractmethod
    def _read(self, number: int) -> T | None: ...

    def _skipped(self, count: int) -> None:
        self.lost += count

    def waiting(self) -> int:
        """Number of unread entries."""
        return self._written() - self._number

    def __next__(self) -> T:
        while not self._closed.is_set():
            ended = self._shared.ended  # read first, so that everything written before the end is still delivered
            behind = self._written() - self._number
            if behind > self._capacity:
                # Continues in the middle of the ring: the oldest entries would be overwritten before they are read.
                skipped = behind - self._capacity // 2
                self._number += skipped
                self._skipped(skipped)
                continue
            if behind > 0:
                value = self._read(self._number)
                self._number += 1
                if value is not None:
                    return value
                self._skipped(1)
                continue
            if ended:
                break
            time.sleep(_PERIOD_S)
        raise StopIteration

    def close(self) -> None:
        """Ends the iteration, from any thread."""
        self._closed.set()


class Records(_Follower[Record]):
    """Every record from now on, until the run ends; `lost` counts the cycles that are missing between them."""

    def __init__(self, shared: SharedRecords) -> None:
        super().__init__(shared, shared.capacity)
        self._cycle: int | None = None

    def _written(self) -> int:
        return self._shared.written

    def _skipped(self, count: int) -> None:
        pass  # cycle numbers show missing records, including those dropped by the loop

    def _read(self, number: int) -> Record | None:
        record = self._shared.read(number)
        if record is not None:
            if self._cycle is not None:
                self.lost += record.cycle - self._cycle - 1
            self._cycle = record.cycle
        return record


class Events(_Follower[Event]):
    """Every event from now on, until the run ends; `lost` counts those that were overwritten before they were read."""

    def __init__(self, shared: SharedRecords) -> None:
        super().__init__(shared, shared.event_capacity)
        self._lost_by_loop = shared.lost_by_loop[1]

    def _written(self) -> int:
        return self._shared.events_written

    def _read(self, number: int) -> Event | None:
        found = self._shared.read_event(number)
        if found is None:
            return None
        by_loop = self._shared.lost_by_loop[1]
        self.lost += by_loop - self._lost_by_loop
        self._lost_by_loop = by_loop
        cycle, t_ns, contents = found
        return Event(1e-9 * t_ns, contents["arm"], contents["kind"], contents["text"], cycle)
