"""Virtual arms: the arms of a scene at network addresses, as libfranka programs expect them."""

from __future__ import annotations

import itertools
import json
import os
import time
from collections.abc import Mapping
from typing import Any

from .errors import Disconnected, Error, Refused, Timeout
from .program import last_lines
from .started import Process

_NUMBERS = itertools.count()


def _address(arm: int) -> str:
    """An address of this computer: libfranka uses fixed ports, so each arm of each process has one of its own."""
    number = os.getpid() * 16 + next(_NUMBERS) + arm
    return f"127.{64 + number // 62500 % 64}.{number // 250 % 250}.{number % 250 + 2}"


class VirtualArms:
    """Virtual arms that listen; leaving `with` ends them.

    Attributes:
        addresses: Address by name of the arm.
        ports: Port by name of the arm.
        result: Counts of exchanged packets; filled by close().
        process: The program.
    """

    def __init__(self, process: Process, timeout_s: float) -> None:
        self.process = process
        self.result: dict[str, Any] = {}
        deadline = time.monotonic() + timeout_s
        try:
            while "\n" not in process.output:
                code = process.child.poll()
                if code is not None:
                    said = last_lines(process.messages)
                    if code == 2:
                        raise Refused("not_understood", said, "multipanda virtual-arm --help")
                    raise Error(f"the virtual arms ended with code {code}:\n{said}", "see the messages above")
                if time.monotonic() > deadline:
                    raise Timeout(f"the virtual arms did not listen within {timeout_s:g} s", "see their messages")
                time.sleep(0.005)
        except BaseException:
            process.end(10)
            raise
        listening = json.loads(process.output.splitlines()[0])["listening"]
        self.addresses: dict[str, str] = {name: place["address"] for name, place in listening.items()}
        self.ports: dict[str, int] = {name: place["port"] for name, place in listening.items()}

    def tell(self, command: str) -> None:
        """A command such as "push arm 0 0 -30 0.5" ([N], [s]) or "user-stop arm on"; `help` prints all to the messages.

        Raises:
            Disconnected: The virtual arms have ended.
        """
        self.process.tell(command)

    def close(self) -> None:
        """Ends them; `result` has their counts. May be called again.

        Raises:
            Disconnected: They have ended before, with the program's messages.
            Timeout: They did not end in time and were killed.
        """
        if self.result:
            return
        code = self.process.end(30)
        lines = self.process.output.splitlines()
        if len(lines) < 2:
            raise Disconnected(
                f"the virtual arms ended with code {code}:\n{last_lines(self.process.messages)}", "see the messages"
            )
        self.result = json.loads(lines[-1])["ended"]

    def __enter__(self) -> VirtualArms:
        return self

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        try:
            self.close()
        except Error:
            if kind is None:
                raise


def virtual_arms(
    scene: str | os.PathLike[str],
    *,
    lockstep: bool = True,
    strict: bool = False,
    bind: Mapping[str, str] | None = None,
    arm_names: tuple[str, ...] = (),
    arguments: tuple[str, ...] = (),
    timeout_s: float = 60,
) -> VirtualArms:
    """Offers the arms of a scene to libfranka programs, on this computer.

    Args:
        scene: Name of a scene, or path of a scene file.
        lockstep: The world waits for the programs' commands, so a busy computer loses no packet.
        strict: No tolerance for late answers, as on a real arm.
        bind: Addresses by arm.
        arm_names: Arms that get an address of their own, for several processes at once; others get 127.0.0.1, ...
        arguments: More options of `multipanda virtual-arm`.
        timeout_s: How long to wait until they listen [s].

    Raises:
        Refused: The scene or an option is not accepted.
        Timeout: They did not listen in time.
        ProgramMissing: The program was not found.
        VersionMismatch: The program is of another version.
        Error: The program ended; its messages say why.
    """
    words = ["virtual-arm", os.fspath(scene), "--json", "--until-input-ends"]
    words += ["--pace", "lockstep" if lockstep else "realtime"]
    if strict:
        words.append("--strict")
    places = {name: _address(k) for k, name in enumerate(arm_names)} | dict(bind or {})
    for name, address in places.items():
        words += ["--bind", f"{name}={address}"]
    return VirtualArms(Process([*words, *arguments]), timeout_s)
