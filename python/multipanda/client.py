"""A client of a run: arms, controllets, switches, state, events."""

from __future__ import annotations

import os
import pathlib
from collections.abc import Sequence
from typing import Any, TypeVar

from .arm import Arm
from .base_client import BaseClient, Named
from .connection import Connection, Json, only_running_socket, socket_folder
from .controllet import Controllet, make_controllet
from .episode import Episode
from .notebook import as_html
from .pose import Pose
from .ssh import Clock, Link

T = TypeVar("T", bound="Client")


class Client(BaseClient):
    """A connection to a running scene. `mp.connect()` makes one; `mp.run()` makes a Run, which also owns the program.

    `run["left_cartesian"]` is a controllet, `run.arms["left"]` an arm. Leaving `with` closes the connection: its
    streams fall silent, and their arms are held. Leaving it by an exception also takes the arms from the controllets
    that this client has activated or commanded; they are held.

    Every request raises `Refused` with the reason if the run does not accept it, `Timeout` without an answer in time,
    and `Disconnected` once the run has ended. `client["name"]` raises KeyError if the scene has no such controllet.

    Attributes:
        scene: Name of the scene.
        arms: The arms by name.
        controllets: The controllets by name.
    """

    def __init__(self, connection: Connection) -> None:
        super().__init__(connection)
        self.arms: Named[Arm] = Named("arm", {e["name"]: Arm(self, e) for e in self._listing["arms"]})
        joints = {name: arm.joints for name, arm in self.arms.items()}
        found = {entry["name"]: make_controllet(self, entry, joints) for entry in self._listing["controllets"]}
        self.controllets: Named[Controllet] = Named("controllet", found)

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {self.scene}: {', '.join(self.arms)}>"

    def __getitem__(self, name: str) -> Controllet:
        return self.controllets[name]

    def _repr_html_(self) -> str:
        return as_html(self.state())

    def _ipython_key_completions_(self) -> list[str]:
        return list(self.controllets)

    def episode(self) -> Episode:
        """Begins an attempt at a task, which the log marks with its outcome.

        with run.episode() as episode: ...    success at the end, failure by an exception; or episode.discard()

        Raises:
            Refused: The episode before it is not judged yet.
            Timeout: The run did not answer.
            Disconnected: The run has ended.
        """
        return Episode(self)

    def keep(self) -> pathlib.Path:
        """Writes the last 30 s as a log and returns its path, on the run's computer; of a recorded run its own.

        Raises:
            Refused: The run keeps none, or the log is not whole.
            Timeout: The run did not answer.
            Disconnected: The run has ended.
        """
        return pathlib.Path(self.ask({"do": "keep"}, 60)["log"])

    @property
    def clock(self) -> Clock:
        """The clock of the run's computer."""
        return Clock() if self.connection.link is None else self.connection.link.clock

    def place(self, name: str, position_m: Any, quaternion_wxyz: Any = None) -> None:
        """Simulation: places a free object.

        Args:
            name: Name of the object.
            position_m: x, y, z in the world [m], or a Pose.
            quaternion_wxyz: Orientation; that of the scene by default.
        """
        if isinstance(position_m, Pose):
            position_m, quaternion_wxyz = position_m.position_m, position_m.quaternion_wxyz
        request: Json = {"do": "place_object", "object": name, "position_m": [float(x) for x in position_m]}
        if quaternion_wxyz is not None:
            request["quaternion_wxyz"] = [float(x) for x in quaternion_wxyz]
        self.ask(request)

    def push(self, name: str, force_n: Any, duration_s: float = 0.2) -> None:
        """Simulation: pushes a free object at its center of mass.

        Args:
            name: Name of the object.
            force_n: x, y, z in world axes [N], at most 100 N together.
            duration_s: How long the force acts, at most 2 s.
        """
        force = [float(x) for x in force_n]
        self.ask({"do": "push_object", "object": name, "force_n": force, "duration_s": duration_s})

    def pause(self, paused: bool = True) -> None:
        """Simulation: pauses the world, or continues it."""
        self.ask({"do": "pause", "paused": paused})

    def step(self, periods: int = 1) -> None:
        """Simulation: advances a paused world by periods of 1 ms."""
        self.ask({"do": "step", "periods": periods}, 30 + 0.02 * periods)

    def reset(self) -> None:
        """Simulation: resets the world to its start."""
        self.ask({"do": "reset"})

    def __enter__(self: T) -> T:
        return self

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        if kind is not None and os.getpid() == self.connection.process:
            self.take_arms_from(self._commanded)
        self.close()


def connect(
    socket: str | os.PathLike[str] | None = None,
    *,
    program: str = "multipanda",
    ssh: Sequence[str] = ("ssh",),
    silence_s: float = 1,
    timeout_s: float = 60,
) -> Client:
    """Attaches to a running scene, of this computer or over ssh.

    Args:
        socket: Name of the scene, or path of its socket; by default the only one that runs. On another computer
            `ssh://USER@HOST:PORT/NAME`, or `ssh://USER@HOST` for the only one.
        program: Over ssh: the program there, by path if ssh does not find it.
        ssh: The ssh command, with options.
        silence_s: After this silence between the computers the connection ends, and the arms that this client has
            commanded are held [s].
        timeout_s: How long ssh may take to connect, with a password if need be [s].

    Raises:
        Disconnected: No scene runs there, or ssh does not connect.
        Refused: Several scenes run, and none is named; or the network is too slow.
        VersionMismatch: The run is of another version.
        Timeout: The other computer does not answer.
        ValueError: An address that is none.
    """
    if socket is None:
        return Client(Connection(only_running_socket()))
    text = os.fspath(socket)
    if text.startswith("ssh:"):
        link = Link(text, program, ssh, silence_s, timeout_s)
        try:
            return Client(Connection(link.where, link))
        except BaseException:
            link.close()
            raise
    if "/" not in text and not text.endswith(".sock"):
        return Client(Connection(socket_folder() / f"{text}.sock"))
    return Client(Connection(text))
