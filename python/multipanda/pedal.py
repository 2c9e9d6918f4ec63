"""A foot pedal, which is a keyboard to Linux, marks the beginnings and outcomes of episodes."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import struct
from collections.abc import Callable, Mapping

from .client import Client
from .closing import Closing
from .episode import Episode
from .errors import Disconnected, Error, Refused

_EVENT = struct.Struct("@llHHi")  # input_event: its time [s, us], type, code, value
_KEY, _PRESSED = 1, 1
_GRAB = 0x40044590  # EVIOCGRAB: its letters reach no other program
_BOUNCE_S = 0.3
MARKS = ("start", "success", "failure", "discard")
KEYS = {30: "start", 48: "failure", 46: "discard"}  # A, B, C: what pedals send as they are sold
_KEYBOARD = (1, 29, 97)  # Esc, Ctrl: a keyboard that was taken for a pedal cannot interrupt its program any more


class Pedal(Closing):
    """A pedal with one switch or several: `with Pedal("/dev/input/by-id/usb-...-event-kbd") as pedal: pedal.read()`.

    Attributes:
        path: Its device.
    """

    def __init__(self, device: str | os.PathLike[str], keys: Mapping[int, str] | None = None) -> None:
        """Opens it, for this program alone.

        Args:
            device: Its input device.
            keys: What each key marks, by Linux's number of it: start, success, failure, discard. By default those of
                A, B and C: start, failure, discard.

        Raises:
            Disconnected: It cannot be read, or another program has it.
            ValueError: There is no such mark.
        """
        self.path, self._keys = os.fspath(device), dict(keys or KEYS)
        for mark in self._keys.values():
            if mark not in MARKS:
                raise ValueError(f"keys: expected {', '.join(MARKS)}, found {mark!r}")
        self._last: dict[int, float] = {}
        try:
            self._file = os.open(self.path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
            try:
                fcntl.ioctl(self._file, _GRAB, 1)
            except OSError as wrong:
                if wrong.errno not in (errno.ENOTTY, errno.EINVAL):  # these: not an input device, but a pipe
                    os.close(self._file)
                    raise
        except OSError as wrong:
            step = 'let users read it: KERNEL=="event*", SUBSYSTEM=="input", TAG+="uaccess" in /etc/udev/rules.d'
            raise Disconnected(f"the pedal cannot be read ({wrong})", step) from None

    def read(self) -> list[str]:
        """The marks of the keys that were pressed since the last call.

        Raises:
            Disconnected: It is unplugged, or a keyboard whose Esc or Ctrl was pressed, which reaches no other program.
        """
        found: list[str] = []
        while True:
            try:
                data = os.read(self._file, 64 * _EVENT.size)
            except BlockingIOError:
                return found
            except OSError:
                data = b""
            if not data:
                raise Disconnected(f"the pedal {self.path} is gone", "plug it in and start again")
            for s, us, kind, code, value in _EVENT.iter_unpack(data[: len(data) // _EVENT.size * _EVENT.size]):
                if kind != _KEY or value != _PRESSED:
                    continue
                if code not in self._keys:
                    if code in _KEYBOARD:
                        raise Disconnected(f"{self.path} is a keyboard, not a pedal: Esc or Ctrl", "name the pedal's")
                    continue
                at_s = s + 1e-6 * us
                if abs(at_s - self._last.get(code, -1.0)) > _BOUNCE_S:
                    found.append(self._keys[code])
                self._last[code] = at_s

    def close(self) -> None:
        """Closes the device."""
        with contextlib.suppress(OSError):
            os.close(self._file)


class Marks:
    """The episodes of a run, as a pedal marks them. `start` while one is under way is its success: one switch will do.

    Attributes:
        episode: The newest one.
    """

    def __init__(self, client: Client, say: Callable[[str], object] = print) -> None:
        self._client, self._say = client, say
        self.episode: Episode | None = None

    def take(self, mark: str) -> None:
        """Marks, and says so. What has no episode to mark does nothing. Raises Timeout, Disconnected."""
        under_way = self.episode is not None and not self.episode.outcome
        try:
            if mark == "start" and not under_way:
                self.episode = self._client.episode()
                self._say(f"episode {self.episode.number} begins")
            elif self.episode is not None and (under_way or mark == "discard"):
                getattr(self.episode, "success" if mark == "start" else mark)()
                self._say(f"episode {self.episode.number}: {self.episode.outcome}")
            else:
                self._say(f"no episode is under way: {mark} is ignored")
        except Refused as refused:
            self._say(f"{mark}: {refused.reason}")

    def end(self) -> None:
        """Discards an episode that is under way. Never raises."""
        if self.episode is not None and not self.episode.outcome:
            with contextlib.suppress(Error, OSError):
                self.episode.discard()
                self._say(f"episode {self.episode.number}: discard")
