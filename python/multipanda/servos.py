"""A leader arm: a chain of Dynamixel X servos, read by their manufacturer's SDK, whose calibration makes joints."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import math
import os
import pathlib
import termios
import time
from collections.abc import Iterator
from typing import Any, NoReturn

import numpy as np

from .closing import Closing
from .errors import Disconnected, Error, Refused
from .rotations import Array

COUNT_RAD = 2 * math.pi / 4096
_BAUDS = (57600, 1_000_000, 115200, 2_000_000, 3_000_000, 4_000_000)  # as they are sold, then as GELLOs are set
_X_MODELS = range(1000, 1300)  # numbers of the series, whose control tables agree in what is read here
_TORQUE_ENABLE, _HARDWARE_ERROR, _POSITION = 64, 70, 132  # addresses
_ALERT = 0x80  # in the error of each answer: the servo has switched itself off
_ALERTS = {0x01: "input voltage", 0x04: "overheating", 0x08: "encoder", 0x10: "electrical shock", 0x20: "overload"}
SILENCE_S = 0.1
_TRIES_S = 1.0
_SCAN_S = 5.0
_GRACE_S = 0.1  # longer than the SDK waits for an answer
_PAUSE_S = 0.2  # the angles of an older reading do not tell how often a joint has turned
_FASTEST_RAD_PER_S, _SLACK_RAD = 15.0, 0.1  # of a joint that a hand moves
_MARGIN_RAD = 0.05  # to the ends of the arm's ranges, as joint_follower has it


class _NoAnswer(Exception):
    """No valid answer."""


class ServoChain(Closing):
    """Servos on one serial port, without torque.

    Attributes:
        path: The port.
        ids: Numbers of the servos.
    """

    def __init__(self, port: str | os.PathLike[str], baud: int, ids: list[int], silence_s: float = SILENCE_S) -> None:
        """Opens the port and switches the torque of the servos off.

        Args:
            port: Such as /dev/serial/by-id/usb-FTDI_...
            baud: Bits per second that the servos are set to.
            ids: Numbers of the servos.
            silence_s: How long they may give no valid answer [s].

        Raises:
            Disconnected: It cannot be opened, another program reads it, or a servo is missing or in error.
            Error: The SDK is not installed.
        """
        try:
            import dynamixel_sdk as sdk
        except ImportError:
            raise Error("a leader needs its servos' SDK, dynamixel-sdk", 'pip install "multipanda[leader]"') from None
        self.path, self.ids = os.fspath(port), list(ids)
        self._sdk, self._handler, self._silence_s = sdk, sdk.Protocol2PacketHandler(), silence_s
        self._deadline_s = self._asked_s = 0.0
        self._port: Any = sdk.PortHandler(self.path)
        read = self._port.readPort

        def waits_at_most(length: int) -> bytes:
            # The SDK's own timeout never comes while bytes arrive faster than it sorts them.
            if time.monotonic() > self._deadline_s + _GRACE_S:
                raise _NoAnswer("answers garbage")
            found: bytes = read(length)
            return found

        self._port.readPort = waits_at_most
        try:
            self.set_baud(baud)
            for number in self.ids:
                (model,) = self._tell(number, "ping")
                if model not in _X_MODELS:
                    raise Disconnected(
                        f"servo {number} at {self.path} is of model {model}", "a leader has servos of the X series"
                    )
                self._tell(number, "write1ByteTxRx", _TORQUE_ENABLE, 0)
        except BaseException:
            self.close()
            raise

    def set_baud(self, baud: int) -> None:
        """Opens the port again [bit/s]. Raises Disconnected as __init__()."""
        step = "name its port (ls /dev/serial/by-id), end other programs that read it, join its group (dialout)"
        try:
            self._port.is_using = False
            if not self._port.setBaudRate(baud):
                raise Disconnected(f"the leader's port has no {baud} baud", "calibrate it again")
            self._port.ser.exclusive = True
            self._port.ser.timeout = 1e-3  # the SDK would poll without pause
            with contextlib.suppress(ValueError, OSError):  # a port without USB: otherwise answers wait for 16 ms there
                self._port.ser.set_low_latency_mode(True)
        except (OSError, termios.error) as wrong:
            raise Disconnected(f"the leader at {self.path} cannot be read ({wrong})", step) from None

    @contextlib.contextmanager
    def _present(self) -> Iterator[None]:
        try:
            yield
        except (OSError, termios.error, TypeError) as wrong:  # TypeError: pyserial's, of a port that was closed
            raise Disconnected(f"the leader at {self.path} is gone ({wrong})", "plug it in and start again") from None

    def _lost(self, number: int, why: object) -> Disconnected:
        return Disconnected(
            f"servo {number} of the leader at {self.path} {why}",
            "check its cable, the supply, the number and the baud rate of each servo",
        )

    def _tell(self, number: int, what: str, *values: int) -> list[int]:
        """One instruction of the SDK to one servo, repeated if it was not understood."""
        self._deadline_s = time.monotonic() + _TRIES_S
        why = ""
        for _ in range(3):
            self._port.is_using = False
            try:
                with self._present():
                    answer: list[int] = list(getattr(self._handler, what)(self._port, number, *values))
                *found, result, error = answer
                self._check(result, error & ~_ALERT)
            except _NoAnswer as wrong:
                why = str(wrong)
                continue
            if error & _ALERT and values[:1] != (_HARDWARE_ERROR,):
                self._alert(number)
            return found
        raise self._lost(number, why)

    def _check(self, result: int, error: int) -> None:
        if result != self._sdk.COMM_SUCCESS:
            raise _NoAnswer("does not answer" if result == self._sdk.COMM_RX_TIMEOUT else "answers garbage")
        if error:
            raise _NoAnswer(f"answers with error {error}")

    def _alert(self, number: int) -> NoReturn:
        (bits,) = self._tell(number, "read1ByteTxRx", _HARDWARE_ERROR)
        names = [name for bit, name in _ALERTS.items() if bits & bit] or [f"bits {bits:#04x}"]
        raise Disconnected(
            f"servo {number} of the leader at {self.path} reports a hardware error: {', '.join(names)}",
            "remove the cause, then switch its supply off and on",
        )

    def scan(self, baud: int) -> list[int]:
        """The numbers of all servos that answer at a baud rate [bit/s]. Raises Disconnected."""
        self.set_baud(baud)
        self._deadline_s = time.monotonic() + _SCAN_S
        try:
            with self._present():
                found, _ = self._handler.broadcastPing(self._port)
        except _NoAnswer:
            return []
        return sorted(found)

    def request(self) -> None:
        """Asks all servos at once for their positions; answer() waits for them."""
        self._asked_s = time.monotonic()
        self._deadline_s = self._asked_s + self._silence_s
        self._send()

    def _send(self) -> None:
        self._port.is_using = False
        with self._present():
            self._handler.syncReadTx(self._port, _POSITION, 4, self.ids, len(self.ids), False)

    def answer(self) -> list[int]:
        """The positions in counts, 4096 to a turn; lost or damaged answers are asked for again.

        Raises:
            Disconnected: No valid answer came in time, a servo reports a hardware error, or the port is gone.
        """
        while True:
            number = self.ids[0]
            alerts, found = [], []
            try:
                for number in self.ids:
                    with self._present():
                        data, result, error = self._handler.readRx(self._port, number, 4)
                    self._check(result, 0 if error & _ALERT else error)
                    if error & _ALERT:
                        alerts.append(number)  # the other answers must be read first: they share the wire
                    elif len(data) != 4:
                        raise _NoAnswer("answers garbage")
                    found.append(int.from_bytes(bytes(data), "little", signed=True))
            except _NoAnswer as wrong:
                if time.monotonic() >= self._deadline_s:
                    raise self._lost(number, wrong) from None
                self._send()
                continue
            if alerts:
                self._alert(alerts[0])
            return found

    def read(self) -> list[int]:
        """request() and answer(), whose errors it raises."""
        self.request()
        return self.answer()

    def close(self) -> None:
        """Closes the port."""
        if self._port.ser is not None:
            with contextlib.suppress(OSError, termios.error):
                self._port.closePort()


def find_servos(port: str | os.PathLike[str]) -> tuple[int, list[int]]:
    """The baud rate [bit/s] and the numbers of the servos on a port. Raises Disconnected if there are none."""
    with ServoChain(port, _BAUDS[0], []) as chain:
        for baud in _BAUDS:
            if found := chain.scan(baud):
                return baud, found
    rates = ", ".join(map(str, _BAUDS))
    raise Disconnected(f"no servo answers at {port} ({rates} baud)", "check supply and cable of the first servo")


@dataclasses.dataclass(frozen=True)
class Calibration:
    """What `python -m multipanda.leader calibrate` finds, as its file has it.

    Attributes:
        port: Where the servos are.
        baud: Bits per second.
        arm: Model of the arm that is led.
        ids: Servo of each joint.
        signs: 1, or -1 where the servo turns against the joint.
        offsets_rad: Angle of each servo where its joint is at 0 [rad].
        q_min_rad: Lower ends of the arm's joint ranges [rad].
        q_max_rad: Upper ends [rad].
        trigger: Servo of the trigger, its counts when let go and when squeezed; None without one.
    """

    port: str
    baud: int
    arm: str
    ids: list[int]
    signs: list[int]
    offsets_rad: list[float]
    q_min_rad: list[float]
    q_max_rad: list[float]
    trigger: list[int] | None = None

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Calibration:
        """Reads a file. Raises Refused if it is not one of a leader."""
        try:
            found = cls(**json.loads(pathlib.Path(path).read_text(encoding="utf-8")))
            fault = found._fault()
        except (OSError, ValueError, TypeError) as wrong:
            fault = str(wrong)
        if fault:
            step = "python -m multipanda.leader calibrate PORT FILE makes one"
            raise Refused("malformed", f"{os.fspath(path)} is not a calibration of a leader: {fault}", step)
        return found

    def _fault(self) -> str:
        """What is wrong; empty: nothing. Raises as numpy does for words in place of numbers."""
        numbers = np.array([self.signs, self.offsets_rad, self.q_min_rad, self.q_max_rad], dtype=np.float64)
        if numbers.shape != (4, len(self.ids)) or not self.ids:
            return "ids, signs, offsets_rad, q_min_rad, q_max_rad need one number per joint"
        if not np.all(np.isfinite(numbers)) or not np.all(np.abs(numbers[0]) == 1):
            return "expected finite numbers, and signs of 1 or -1"
        if not np.all(numbers[2] < numbers[3]):
            return "expected q_min_rad below q_max_rad"
        if self.trigger is not None and (len(self.trigger) != 3 or self.trigger[1] == self.trigger[2]):
            return "trigger: expected its servo and two different counts"
        if not all(isinstance(k, int) for k in [self.baud, *self.servos, *(self.trigger or [])]):
            return "expected whole numbers of baud, ids and trigger"
        if len(set(self.servos)) != len(self.servos):
            return "a servo is named twice"
        return ""

    @property
    def servos(self) -> list[int]:
        """All servos, that of the trigger last."""
        return self.ids if self.trigger is None else [*self.ids, self.trigger[0]]

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the file."""
        lines = (f"  {json.dumps(name)}: {json.dumps(value)}" for name, value in dataclasses.asdict(self).items())
        pathlib.Path(path).write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")


class Angles:
    """Angles of servos that count within a turn, followed across its ends: a joint's range gives the first turn."""

    def __init__(self, calibration: Calibration) -> None:
        c = calibration
        middle = (np.array(c.q_min_rad) + np.array(c.q_max_rad)) / 2
        self._signs, self._offsets = np.array(c.signs, dtype=np.float64), np.array(c.offsets_rad)
        if c.trigger is not None:
            self._signs, self._offsets = np.append(self._signs, 1), np.append(self._offsets, 0)
            middle = np.append(middle, COUNT_RAD * (c.trigger[1] + c.trigger[2]) / 2)
        self._middle, self._ids, self._last, self._then_s = middle, c.servos, middle, -math.inf

    def take(self, counts: list[int], now_s: float) -> Array:
        """The angles [rad] of a reading at a time [s]. Raises Disconnected for a jump; the next one begins again."""
        elapsed = now_s - self._then_s
        begins = elapsed > _PAUSE_S
        near = self._middle if begins else self._last
        angles: Array = self._signs * (COUNT_RAD * np.array(counts, dtype=np.float64) - self._offsets)
        angles += 2 * math.pi * np.round((near - angles) / (2 * math.pi))
        jumps = np.abs(angles - near)
        k = int(np.argmax(jumps))
        if not begins and jumps[k] > _FASTEST_RAD_PER_S * elapsed + _SLACK_RAD:
            self._then_s = -math.inf
            raise Disconnected(
                f"servo {self._ids[k]} of the leader jumped by {jumps[k]:.2f} rad within {1e3 * elapsed:.0f} ms",
                "check that its horn and cable are tight",
            )
        self._last, self._then_s = angles, now_s
        return angles


class LeaderArm(Closing):
    """A leader arm whose joints are read: `with LeaderArm("left.json") as leader: q_rad, squeezed = leader.read()`.

    Attributes:
        calibration: Its file.
    """

    def __init__(self, path: str | os.PathLike[str], silence_s: float = SILENCE_S) -> None:
        """Opens it.

        Args:
            path: Its calibration.
            silence_s: How long the servos may give no valid answer [s].

        Raises:
            Refused: The file is not a calibration.
            Disconnected: As ServoChain.
            Error: The SDK is not installed.
        """
        self.calibration = c = Calibration.load(path)
        self._low, self._high = np.array(c.q_min_rad) + _MARGIN_RAD, np.array(c.q_max_rad) - _MARGIN_RAD
        self._angles = Angles(c)
        self._chain = ServoChain(c.port, c.baud, c.servos, silence_s)

    def request(self) -> None:
        """Asks for a reading; answer() waits for it. Raises Disconnected."""
        self._chain.request()

    def answer(self) -> tuple[Array, float | None]:
        """Joint angles within the arm's ranges [rad], and the trigger: 0 let go, 1 squeezed, None without one.

        Raises:
            Disconnected: The leader is gone, does not answer, reports a hardware error, or a joint has jumped.
        """
        angles = self._angles.take(self._chain.answer(), time.monotonic())
        trigger, joints = self.calibration.trigger, len(self._low)
        q = np.clip(angles[:joints], self._low, self._high)
        if trigger is None:
            return q, None
        free, squeezed = COUNT_RAD * trigger[1], COUNT_RAD * trigger[2]
        return q, float(np.clip((angles[joints] - free) / (squeezed - free), 0, 1))

    def read(self) -> tuple[Array, float | None]:
        """request() and answer(). Raises Disconnected."""
        self.request()
        return self.answer()

    def close(self) -> None:
        """Closes its port."""
        self._chain.close()
