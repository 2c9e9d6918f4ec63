"""Streams of set-points: the newest sample counts at the next cycle, or each at its time; silence means hold."""

from __future__ import annotations

import contextlib
import os
import socket
import struct
import time
from typing import Any

import numpy as np

from .closing import Closing
from .errors import Disconnected, Error, Refused
from .instance import Instance
from .pose import Pose

_HEADER = struct.Struct("<4sHHIIQq")


def target_values(quantity: str, values: Any, count: int) -> list[float]:
    """The numbers of a set-point, in the order of the binary stream."""
    if quantity == "pose":
        array = Pose.of(values).values
    else:
        array = np.atleast_1d(np.asarray(values, dtype=np.float64)).ravel()
    if array.shape != (count,):
        raise ValueError(f"expected {count} numbers for a {quantity}, found {array.size}")
    if not np.all(np.isfinite(array)):
        raise ValueError(f"expected finite numbers, found {array}")
    return [float(x) for x in array]


class Stream(Closing):
    """A stream to one input of an active controllet, as a context manager.

    Leaving it, by an exception too, holds the arms at once, unless a goal followed the last sample. If this process
    falls silent or dies, they are held after the input's `timeout_s`.

    Attributes:
        controllet: The controllet.
        name: Name of the input.
        channel: Number of its channel in the run.
        quantity: What it carries: `pose`, `twist`, `wrench`, `joints`, `scalar`.
        count: How many numbers a sample has.
        timeout_s: Silence after which the arms are held [s].
        unsent: Samples that were dropped because there was no room.
        longest_chunk: How many samples may be sent with their times at once.
    """

    def __init__(self, controllet: Instance, name: str, frame: str | None) -> None:
        spec = controllet.input(name)
        self.controllet, self.name = controllet, name
        self.quantity: str = spec["quantity"]
        self.count: int = spec["values"]
        self.timeout_s: float = spec["timeout_s"]
        self._connection = controllet.client.connection
        request = {"do": "stream", "controllet": controllet.name, "input": name}
        if frame is not None:
            request["frame"] = frame
        answer = self._connection.ask(request)
        self.channel: int = answer["channel"]
        self.longest_chunk: int = answer["longest_chunk"]
        self._verdict = "accepted"
        self._connection.listen(self.channel, self._hear)
        self._socket: socket.socket | None = None
        self._process = os.getpid()
        try:
            self._socket = self._connection.samples(self.timeout_s)
        except OSError as wrong:
            self._connection.forget(self.channel)
            self._connection.ask({"do": "stream_end", "channel": self.channel}, 5)  # raises if the run has ended
            raise Refused(
                "not_local",
                f"there is no stream socket beside {self._connection.path} ({wrong.strerror})",
                'a forwarded socket takes goals only; mp.connect("ssh://USER@HOST/RUN") takes streams, too',
            ) from None
        self._socket.setblocking(False)
        self._sequence = 0
        self.unsent = 0  # samples dropped because the socket was full; the next one is newer anyway

    def _hear(self, line: dict[str, Any]) -> None:
        self._verdict = str(line["stream"]["verdict"])

    def send(self, values: Any, at: Any = None) -> bool:
        """Sends the newest sample, or with `at` a chunk of samples that are not due yet; never waits.

        A chunk is a policy's next actions. The run keeps it, and the set-point is at each sample at its time, so
        pauses of this process do not matter. It replaces all samples that are not due yet; so does a single sample,
        and a goal ends it. So do a stop, a refused sample, `close()` and the end of this process, at once. Samples
        whose time has passed are not used (`counts()["late_samples"]`). After the last one, silence counts as usual.

        Args:
            values: As for `Controllet.goal`, in SI units: [m] and quaternion, [m/s], [N], [rad]. With `at` one sample
                per row, or a list of poses; at most `longest_chunk`.
            at: Their times [s], increasing, on the run's clock: that of `state.t_s` and `record.t_s`. Successive times
                are at most `timeout_s` apart, and the last one at most 10 s ahead.

        Returns:
            False if there was no room, and what was sent is dropped.

        Raises:
            Refused: The loop has refused a sample, for instance because the arm is held after a silence. This asks the
                run why.
            Disconnected: The run has ended, the stream is closed, or this process was forked.
            ValueError: A sample has another size, or a number that is not finite; times do not increase or are too far
                apart; too many samples.
        """
        if self._socket is None or os.getpid() != self._process:
            raise Disconnected("this stream is closed", "open it again: controllet.stream(...)")
        if self._verdict != "accepted":
            verdict, self._verdict = self._verdict, "accepted"
            raise Refused(verdict, f"{self.controllet.name}.{self.name}: a sample was refused: {self._why(verdict)}")
        if at is None:
            version, samples = 1, 0
            numbers = target_values(self.quantity, values, self.count)
        else:
            version = 2
            times = self._times(at, len(values))
            samples = len(times)
            numbers = times + [x for sample in values for x in target_values(self.quantity, sample, self.count)]
        self.controllet.client.streaming[self.controllet.name] = self
        self._sequence += 1
        now = time.monotonic_ns()
        header = _HEADER.pack(b"MPRS", version, self.count, self.channel, samples, self._sequence, now)
        try:
            self._socket.send(header + struct.pack(f"<{len(numbers)}d", *numbers))
        except BlockingIOError:
            self.unsent += 1
            return False
        except OSError as wrong:
            self._connection.check()
            raise Disconnected(f"the run has ended ({wrong})", "start the scene again") from None
        return True

    def follow(self, actions: Any, dt_s: float, since_s: float | None = None) -> bool:
        """Sends a policy's next actions as a chunk: send() with `at`, whose errors it raises.

        Args:
            actions: Samples as for send(), one per row.
            dt_s: Time between them [s].
            since_s: `t_s` of the state from which they were computed: the first one is due dt_s later, and those whose
                time has passed meanwhile are not used. By default now.

        Returns:
            False if there was no room, and what was sent is dropped.
        """
        if since_s is None:
            record = self.controllet.client.record()
            since_s = record.t_s + record.age_s
        return self.send(actions, at=since_s + dt_s * np.arange(1, len(actions) + 1))

    def _why(self, verdict: str) -> str:
        law, client = self.controllet, self.controllet.client
        if verdict == "not_active":
            with contextlib.suppress(Error):  # the loop has stalled or ended
                return client.loss(law.name, law.arms, client.state()) or verdict
        return verdict

    def _times(self, at: Any, count: int) -> list[float]:
        times = np.atleast_1d(np.asarray(at, dtype=np.float64))
        if times.shape != (count,):
            raise ValueError(f"expected a time for each of {count} samples, found an array of {times.shape}")
        if not 1 <= count <= self.longest_chunk:
            raise ValueError(f"expected 1 to {self.longest_chunk} samples at once, found {count}: send fewer of them")
        if not np.all(np.isfinite(times)):
            raise ValueError(f"expected finite times [s], found {times}")
        gaps = np.diff(times)
        if np.any(gaps <= 0):
            raise ValueError(f"expected increasing times [s], found {times}")
        if np.any(gaps > self.timeout_s):
            raise ValueError(
                f"expected times at most {self.timeout_s} s apart, found {gaps.max():.3g} s: the arms would be held in "
                "between; send samples between them, or give the input a longer timeout_s in the scene"
            )
        return [float(t) for t in times]

    def counts(self) -> dict[str, Any]:
        """The run's counts of received, lost and refused samples: the channel's entry in the answer to `channels`.

        Raises:
            Disconnected: The stream is closed, or the run has ended.
            Refused: The run does not accept the request.
            Timeout: The run does not answer.
        """
        for entry in self._connection.ask({"do": "channels"})["channels"]:
            if entry["channel"] == self.channel:
                return dict(entry)
        raise Disconnected("this stream is closed", "open it again: controllet.stream(...)")

    def close(self) -> None:
        """Ends the stream: the arms are held."""
        if self._socket is None or os.getpid() != self._process:
            return
        client = self.controllet.client
        if client.streaming.get(self.controllet.name) is self:
            del client.streaming[self.controllet.name]
            client.take_arms_from([self.controllet.name])
        self._socket.close()
        self._socket = None
        self._connection.forget(self.channel)
        try:
            self._connection.ask({"do": "stream_end", "channel": self.channel}, 5)
        except (Disconnected, Refused, TimeoutError):
            pass  # the run has ended, and with it the channel
