"""A SpaceMouse moves a hand while its button is held. Linux delivers its reports by a hidraw device."""

from __future__ import annotations

import contextlib
import os
import pathlib
import select
import struct
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from .closing import Closing
from .controllet import Controllet
from .errors import Disconnected, Refused
from .jog import JogLimits, axes_rotation, jogged, shaped
from .pose import Pose
from .rotations import Array
from .state import ArmState
from .stream import Stream

_FULL_SCALE = 350
_HOLD_BUTTON, STOP_BUTTON = 1, 2
_SILENCE_S = 0.15  # a deflected cap reports all the time: longer silence means that the device is gone
_BLIND_S = 0.4  # longest gap between two reads: Linux keeps half a second of reports, then drops the newest
_REST_S = 10.0  # a cap at rest sends nothing, so a hold ends after this time
_OWN_VENDOR, _FORMER_VENDOR = 0x256F, 0x046D
_MULTI_AXIS = bytes([0x05, 0x01, 0x09, 0x08])  # how its report descriptor begins
_RULE = 'KERNEL=="hidraw*", ATTRS{idVendor}=="256f", TAG+="uaccess"'


def find_space_mouse(hidraw: pathlib.Path = pathlib.Path("/sys/class/hidraw")) -> pathlib.Path:
    """The hidraw device of the SpaceMouse that is plugged in. Raises Disconnected if there is none."""
    for entry in sorted(hidraw.glob("hidraw*")):
        try:
            lines = (entry / "device/uevent").read_text(encoding="utf-8").splitlines()
            about = dict(line.partition("=")[::2] for line in lines)
            descriptor = (entry / "device/report_descriptor").read_bytes()
            vendor = int(about["HID_ID"].split(":")[1], 16)
        except (OSError, KeyError, IndexError, ValueError):
            continue
        named = about.get("HID_NAME", "").startswith("3Dconnexion")
        if vendor == _OWN_VENDOR or (vendor == _FORMER_VENDOR and named):
            if _MULTI_AXIS in descriptor:
                return pathlib.Path("/dev") / entry.name
    raise Disconnected("no SpaceMouse is plugged in", "plug it in, or name its device, such as /dev/hidraw3")


class Grip:
    """Whether a device is held, by its reports and by their absence. After a hold has ended, a new press is needed."""

    def __init__(self, cap_holds: bool, buttons: int = 0) -> None:
        """`buttons`: those pressed already, which are ignored until they are released."""
        self.cap_holds, self.held = cap_holds, False
        self._gripped, self._deflected, self._heard_s = bool(buttons & _HOLD_BUTTON), False, 0.0
        self._looked_s = time.monotonic()

    def lose(self) -> None:
        """The device was not read for a while: buttons that are down now must be released first."""
        self.held, self._gripped = False, True

    def take(self, deflection: Array, buttons: int, now_s: float) -> None:
        self._deflected, self._heard_s = bool(np.any(deflection)), now_s
        gripped = bool(buttons & _HOLD_BUTTON) or (self.cap_holds and self._deflected)
        self.held = gripped and (self.held or not self._gripped)
        self._gripped = gripped

    def look(self, now_s: float) -> None:
        if now_s - self._heard_s > (_SILENCE_S if self._deflected else _REST_S):
            self.held = False

    def read(self, mouse: SpaceMouse, timeout_s: float = 0) -> int:
        """Takes all reports that wait, waiting for the first one: a release may be the last of many.

        Returns the bits of the buttons that were pressed; the one that stops ends the hold.
        """
        blind = time.monotonic() - self._looked_s > _BLIND_S
        pressed, before = 0, mouse.buttons
        while mouse.read(timeout_s):
            timeout_s = 0
            if mouse._spoke:
                self.take(shaped(mouse.deflection), mouse.buttons, time.monotonic())
                pressed |= mouse.buttons & ~before
                before = mouse.buttons
        if pressed & STOP_BUTTON:
            self.held = False
        if blind:  # the report of a release may be among those that Linux dropped
            self.lose()
        self._looked_s = time.monotonic()
        self.look(self._looked_s)
        return pressed

    def settle(self, mouse: SpaceMouse) -> int:
        """Drops unread reports: they are old, and move nothing. Returns the bits of pressed buttons."""
        pressed = self.read(mouse)
        mouse.deflection = np.zeros(6)
        until = time.monotonic() + _SILENCE_S
        while (rest := until - time.monotonic()) > 0:  # a deflected cap reports all the time
            pressed |= self.read(mouse, rest)
        self.lose()
        if not mouse.buttons & _HOLD_BUTTON and not np.any(shaped(mouse.deflection)):
            self.take(np.zeros(6), mouse.buttons, time.monotonic())
        return pressed


class SpaceMouse(Closing):
    """A 3Dconnexion SpaceMouse: `with mp.SpaceMouse() as mouse: mouse.jog(run["cartesian"])`.

    Its left button is the one to hold while the hand moves, the other one stops the arms.

    Attributes:
        path: Its device.
        deflection: Its six axes, -1 to 1: right, away from the operator, up; rotations about these.
        buttons: One bit for each button that is down.
    """

    def __init__(self, device: str | os.PathLike[str] | None = None) -> None:
        """Opens it.

        Args:
            device: Its hidraw device, such as /dev/hidraw3; by default the one that is plugged in.

        Raises:
            Disconnected: There is none, or it cannot be read.
        """
        self.path = pathlib.Path(device) if device is not None else find_space_mouse()
        self.deflection: Array = np.zeros(6)
        self.buttons = 0
        self._spoke = False  # the newest report was about the cap or the buttons
        self._open = True
        try:
            self._file = os.open(self.path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError as wrong:
            step = f"let users of this computer read it: {_RULE} in /etc/udev/rules.d/70-space-mouse.rules"
            raise Disconnected(f"the SpaceMouse cannot be read ({wrong})", step) from None
        self._poll = select.poll()
        self._poll.register(self._file, select.POLLIN)

    def read(self, timeout_s: float = 0) -> bool:
        """Takes one report, waiting for it for at most timeout_s [s]; False: there was none.

        Raises:
            Disconnected: It was unplugged, or is closed.
        """
        gone = Disconnected(f"the SpaceMouse {self.path} is gone", "plug it in, and open it again")
        if not self._open:
            raise gone
        if not self._poll.poll(1e3 * max(0.0, timeout_s)):
            return False
        try:
            report = os.read(self._file, 64)
        except BlockingIOError:
            return False
        except OSError:
            raise gone from None
        if not report:
            raise gone
        self._spoke = self._take(report)
        return True

    def _take(self, report: bytes) -> bool:
        """Reports of an unknown number or a wrong length change nothing: False."""
        number, data = report[0], report[1:]
        if number == 1 and len(data) >= 12:
            self.deflection = np.concatenate([_axes(data), _axes(data[6:])])
        elif number == 1 and len(data) >= 6:
            self.deflection = np.concatenate([_axes(data), self.deflection[3:]])
        elif number == 2 and len(data) >= 6:
            self.deflection = np.concatenate([self.deflection[:3], _axes(data)])
        elif number == 3 and data:
            self.buttons = int.from_bytes(data[:4], "little")
        else:
            return False
        return True

    def jog(
        self,
        controllet: Controllet,
        name: str = "pose",
        *,
        axes: str = "base",
        cap_holds: bool = False,
        limits: JogLimits | None = None,
        rate_hz: float = 50,
        seconds: float | None = None,
        say: Callable[[str], object] = print,
    ) -> None:
        """Moves the hand of a controllet, and returns after `seconds`, or without them when it is interrupted.

        The hand moves while the left button is held, and is held as soon as it is released. The same happens when the
        device is unplugged, when it sends nothing for 150 ms while it is deflected (10 s at rest), and when the run
        refuses a set-point; then a new press is needed. A press activates the controllet if its arm is held, and does
        nothing if the arm is stopped or has another owner. So does a cap that is deflected at the beginning, until it
        was at rest. The right button stops all arms; only `resume()` lets them move again. It works while this
        function runs, and at its beginning if it was pressed since the last report was read. It is not a safety-rated
        stop.

        Args:
            controllet: A controllet of one arm.
            name: Its input, a pose.
            axes: `base`: pushing the cap away moves along the x axis of the arm's base, seen from above, and up is up.
                `hand`: the hand's own axes.
            cap_holds: A deflected cap is enough, without the button.
            limits: Speeds, force and lead; `JogLimits()` by default.
            rate_hz: Set-points per second [Hz], 20 to 200.
            seconds: How long; without end by default.
            say: Called with a line about each hold that could not begin or was ended by the run.

        Raises:
            Disconnected: The device was unplugged, or the run has ended. The arm is held.
            Refused: The controllet has no such input, or `axes` is `base` and the arm's base moves.
            Timeout: The run does not answer. The arm is held.
            ValueError: The controllet moves several arms, the input takes no poses, or an argument is out of bounds.
        """
        if axes not in ("base", "hand"):
            raise ValueError(f"axes: expected base or hand, found {axes!r}")
        if not 20 <= rate_hz <= 200:
            raise ValueError(f"rate_hz: expected 20 to 200 Hz, found {rate_hz}")
        led = _Jog(controllet, name, axes, limits or JogLimits(), say)
        grip = Grip(cap_holds, self.buttons)
        led.stop_if(grip.settle(self))
        led.run(self, grip, 1 / rate_hz, seconds)

    def close(self) -> None:
        """Closes the device."""
        if self._open:
            self._open = False
            os.close(self._file)


def _axes(data: bytes) -> Array:
    # The device's x is right, its y towards the operator and its z down. Both are right-handed, so rotations change
    # the same way.
    x, y, z = struct.unpack("<3h", data[:6])
    return np.clip(np.array([x, -y, -z]) / _FULL_SCALE, -1, 1)


def led_by(
    mouse: SpaceMouse, target: Pose, state: ArmState, base: Pose, axes: str, step_s: float, limits: JogLimits
) -> Pose:
    """The target of a hand after a step [s] of its motion; axes and base as in axes_rotation()."""
    rotation, deflection = axes_rotation(axes, base, state.pose), shaped(mouse.deflection)
    twist = np.concatenate([rotation @ deflection[:3], rotation @ deflection[3:]])
    force = np.zeros(3) if state.wrench_n_nm is None else state.wrench_n_nm[:3]
    return jogged(target, twist, step_s, state.pose, force, limits)


class _Jog:
    """The successive holds of one call of jog()."""

    def __init__(
        self, controllet: Controllet, name: str, axes: str, limits: JogLimits, say: Callable[[str], object]
    ) -> None:
        spec: dict[str, Any] = controllet.input(name)
        if spec["quantity"] != "pose":
            raise ValueError(f"{controllet.name}.{name} takes a {spec['quantity']}, but the device commands a pose")
        if len(controllet.arms) != 1:
            raise ValueError(f"{controllet.name} moves {', '.join(controllet.arms)}: the device moves one hand")
        self.law, self.name, self.axes, self.limits, self.say = controllet, name, axes, limits, say
        self.client, self.arm = controllet.client, controllet.arms[0]
        self.base = self.client.base(self.arm) if axes == "base" else Pose.at()
        self.stream: Stream | None = None
        self.target: Pose | None = None
        self.begun_s = self.stepped_s = 0.0

    def stop_if(self, pressed: int) -> None:
        if pressed & STOP_BUTTON:
            self.client.stop()

    def run(self, mouse: SpaceMouse, grip: Grip, period_s: float, seconds: float | None) -> None:
        now = due = time.monotonic()
        end = None if seconds is None else now + seconds
        try:
            while end is None or now < end:
                self.stop_if(grip.read(mouse, due - now))
                now = time.monotonic()
                if not grip.held:
                    self.release()
                if now < due:
                    continue
                due = max(due + period_s, now)
                if grip.held:
                    grip.held = self.step(mouse)
        finally:
            self.release()

    def step(self, mouse: SpaceMouse) -> bool:
        """Sends the next set-point; False: the hold is over."""
        try:
            state = self.client.arm_state(self.arm)
            if self.stream is None:
                state = self.begin(state)
                self.begun_s = self.stepped_s = state.t_s
            elif state.stopped or state.controllet != self.law.name:
                why = self.client.lost_by(self.law.name, state, self.begun_s)
                raise Refused("not_active", f"{self.arm} is owned by {state.controllet}: {why}")
            assert self.stream is not None and self.target is not None
            # By the run's clock: a simulation may be slower than this computer's time.
            step_s, self.stepped_s = state.t_s - self.stepped_s, state.t_s
            self.target = led_by(mouse, self.target, state, self.base, self.axes, step_s, self.limits)
            self.stream.send(self.target)
            return True
        except Refused as refused:
            self.release()
            self.say(f"{self.arm} is not led: {refused.reason}")
            return False

    def begin(self, state: ArmState) -> ArmState:
        if state.stopped:
            raise Refused("arm_stopped", f"{self.arm} is stopped: resume it first")
        if not state.held:
            return self.open(state)
        self.law.activate()
        try:
            return self.open(self.client.arm_state(self.arm))
        except BaseException:
            self.client.take_arms_from([self.law.name])
            raise

    def open(self, state: ArmState) -> ArmState:
        if state.controllet != self.law.name:
            raise Refused("not_active", f"{self.arm} is owned by {state.controllet}: deactivate it first")
        self.target = state.pose
        with contextlib.suppress(Refused, KeyError):  # a run without shared records
            # Begin at the law's present set-point, so that a loaded spring stays loaded.
            led = self.client.record()[f"{self.law.name}/{self.name}"]
            if np.all(np.isfinite(led)):
                self.target = Pose.of(led)
        self.stream = self.law.stream(self.name)
        return state

    def release(self) -> None:
        """Holds the arm, if it is being moved."""
        if self.stream is not None:
            self.stream.close()
        self.stream = self.target = None
