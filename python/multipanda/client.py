"""A client of a run: arms, controllets, switches, state, events."""

from __future__ import annotations

import os
import queue
import threading
import time
from collections.abc import Iterable, Iterator, Mapping
from types import TracebackType
from typing import Any

from .arm import Arm
from .connection import Connection, Json, only_running_socket, socket_folder
from .controllet import Controllet, make_controllet
from .episode import Episode
from .errors import Error, Refused, Timeout
from .follow import Events, Records
from .program import check_version
from .record import History, Record
from .shared import SharedRecords
from .state import ArmState, RunState, run_state
from .stream import Stream

Names = str | Iterable[str]

_FIRST_CYCLE_S = 60  # a real arm may take a while to begin
_CATCH_UP_S = 1  # the state is published beside the loop, a moment after the answer
_OLD_S = 0.1  # a state so old is one of a run that stands still


def _stands_still(since_s: float) -> Timeout:
    return Timeout(
        f"the run has made no cycle for {since_s:.1f} s",
        "a law that does not return, or a busy computer: see its messages; arms without commands stop themselves",
    )


def _names(names: Names) -> list[str]:
    return [names] if isinstance(names, str) else list(names)


class Client:
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
        connection: The socket's requests and answers.
        streaming: Streams whose sample was the last set-point, by controllet.
    """

    def __init__(self, connection: Connection) -> None:
        self.connection = connection
        self._commanded: set[str] = set()
        self._answered = 0  # newest cycle of an answer
        self._answered_ns = 0  # time of the newest answer
        self._shared: SharedRecords | None = None
        self._not_shared: Refused | None = None
        self._sharing = threading.Lock()
        self.streaming: dict[str, Stream] = {}  # by controllet: whose sample was the last set-point
        try:
            listing = connection.ask({"do": "list"})
            check_version(listing.get("version"), f"the run at {connection.path}")
        except BaseException:
            connection.close()
            raise
        self.scene: str = listing["scene"]
        self.arms: Mapping[str, Arm] = {entry["name"]: Arm(self, entry) for entry in listing["arms"]}
        joints = {name: arm.joints for name, arm in self.arms.items()}
        self.controllets: Mapping[str, Controllet] = {
            entry["name"]: make_controllet(self, entry, joints) for entry in listing["controllets"]
        }

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {self.scene}: {', '.join(self.arms)}>"

    def __getitem__(self, name: str) -> Controllet:
        if name not in self.controllets:
            raise KeyError(f"the scene has no controllet '{name}'; it has: {', '.join(self.controllets)}")
        return self.controllets[name]

    def _repr_html_(self) -> str:
        from .notebook import as_html

        return as_html(self.state())

    def _ipython_key_completions_(self) -> list[str]:
        return list(self.controllets)

    def ask(self, request: Json, timeout_s: float = 30) -> Json:
        """Sends any request of docs/live_input.md and returns its answer; waits for it for timeout_s [s]."""
        answer = self.connection.ask(request, timeout_s)
        self._answered = max(self._answered, int(answer.get("cycle", 0)))
        self._answered_ns = time.monotonic_ns()
        return answer

    def listing(self) -> Json:
        """The answer to `list`."""
        return self.ask({"do": "list"})

    def commanded(self, controllet: str) -> None:
        """Remembers that this client commands a controllet."""
        self._commanded.add(controllet)

    def take_arms_from(self, controllets: Iterable[str]) -> None:
        """Deactivates those that are active: their arms are held. Never raises."""
        try:
            active = set(self.active) & set(controllets)
            if active:
                self.switch(deactivate=sorted(active))
        except (Error, OSError):
            pass  # the run has ended, or its arms are held already

    @property
    def active(self) -> list[str]:
        """Names of the controllets that own arms now."""
        return [entry["name"] for entry in self.listing()["controllets"] if entry["active"]]

    def shared(self) -> SharedRecords:
        """The run's records in shared memory, mapped at the first call. Raises Refused if it shares none."""
        if os.getpid() != self.connection.process:
            self.connection.check()  # a forked child would read on without knowing when the run ends
        if self._shared is not None:
            return self._shared
        with self._sharing:
            if self._not_shared is not None:
                raise self._not_shared
            if self._shared is None:
                self.connection.check()
                try:
                    self._shared = SharedRecords(self.connection.path)
                except Refused as refused:
                    self._not_shared = refused
                    raise
            return self._shared

    def record(self) -> Record:
        """The newest record of the loop: every number of one cycle. Waits for the first cycle."""
        shared, deadline = self.shared(), time.monotonic() + _FIRST_CYCLE_S
        while (record := shared.newest()) is None:
            if shared.ended:
                self.connection.check()
            if time.monotonic() > deadline:
                raise Timeout(f"the run made no cycle within {_FIRST_CYCLE_S} s", "see its messages")
            time.sleep(0.001)
        return record

    def records(self) -> Records:
        """Every record from now on, until the run ends or the loop is left. `lost` counts what a slow reader missed.

        for record in run.records(): print(record.cycle, record["left/q_rad"])
        """
        return Records(self.shared())

    def episode(self) -> Episode:
        """Begins an attempt at a task, which the log marks with its outcome.

        with run.episode() as episode: ...    success at the end, failure by an exception; or episode.discard()

        Raises:
            Refused: The episode before it is not judged yet.
            Timeout: The run did not answer.
            Disconnected: The run has ended.
        """
        return Episode(self)

    def history(self, seconds: float = 1) -> History:
        """The newest records as arrays, one row per cycle: run.history(0.5)["left/q_rad"]. At least 2 s are kept."""
        shared, rows = self.shared(), self.shared().block(1)
        period_s = float(Record(shared.layout, rows[-1])["period_s"][0]) if len(rows) else 1e-3
        return History(shared.layout, shared.block(max(1, round(seconds / max(period_s, 1e-4)))))

    def _fresh(self, arm: str | None) -> Record | None:
        """The newest record if it says all that there is to know about an arm, or about all."""
        self.connection.check()
        if self._shared is None:
            if self._not_shared is not None:
                return None
            try:
                self.shared()
            except Refused:
                return None
        assert self._shared is not None
        record = self._shared.newest()
        if record is None or record.errors(arm):  # why is text, which comes by request
            return None
        start_ns = record.start_ns
        return record if self._answered_ns <= start_ns > time.monotonic_ns() - _OLD_S * 1e9 else None

    def arm_state(self, arm: str) -> ArmState:
        """The newest state of one arm, as state() has it, or Timeout."""
        record = self._fresh(arm)
        return self._asked_state().arms[arm] if record is None else record.arm(arm)

    def state(self) -> RunState:
        """The newest state of all arms, not older than what this client was answered. Waits for the first cycle.

        Never returns a state older than 0.1 s: it waits up to 1 s for the next cycle.

        Raises:
            Timeout: The run did not answer, or its loop stands still.
            Disconnected: The run has ended.
        """
        record = self._fresh(None)
        return self._asked_state() if record is None else record.state(self.shared().rate_hz())

    def _asked_state(self) -> RunState:
        now = time.monotonic()
        deadline, soon = now + _FIRST_CYCLE_S, now + _CATCH_UP_S
        while True:
            data = self.connection.ask({"do": "state"})["state"]
            current = data["since_cycle_s"] <= _OLD_S
            if data["arms"] and current and (data["cycle"] >= self._answered or time.monotonic() > soon):
                return run_state(data)
            if data["arms"] and not current and time.monotonic() > soon:
                raise _stands_still(data["since_cycle_s"])
            if not data["arms"] and time.monotonic() > deadline:
                raise Timeout(f"the run made no cycle within {_FIRST_CYCLE_S} s", "see its messages")
            time.sleep(0.001)

    def switch(self, activate: Names = (), *, deactivate: Names = (), only: bool = False) -> Json:
        """Changes the owners of arms between two cycles.

        Args:
            activate: Names of controllets that get their arms.
            deactivate: Names of controllets whose arms are held.
            only: Deactivates all that are not activated.

        Returns:
            The answer: `started`, `stopped`, `kept`, `times_ms` [ms], the largest torque step of each arm [N m].

        Raises:
            Refused: With the reason; nothing has changed.
        """
        on, off = _names(activate), _names(deactivate)
        answer = self.ask({"do": "switch", "activate": on, "deactivate": off, "only": only})
        self._commanded |= set(on)
        return answer

    def stop(self, arms: Names = "all") -> None:
        """Holds arms from the next cycle on until resume(). Not a safety-rated stop."""
        self.ask({"do": "stop", "arms": _names(arms)})

    def resume(self, arms: Names = "all") -> None:
        """Allows switches of stopped arms again; they are still held until then."""
        self.ask({"do": "resume", "arms": _names(arms)})

    def states(self, rate_hz: float = 10) -> Iterator[RunState]:
        """The state, `rate_hz` times a second of wall time [Hz], until the run ends or the loop is left.

        Raises:
            Timeout: The run's loop has stood still for 1 s.
        """
        lines: queue.SimpleQueue[Json | None] = queue.SimpleQueue()
        # A connection of its own: it has one subscription.
        own = Connection(self.connection.path)
        own.on_end(lambda: lines.put(None))
        try:
            own.ask_subscription(rate_hz, lines.put)
            while (line := lines.get()) is not None:
                if line["state"]["arms"]:
                    if line["state"]["since_cycle_s"] > _CATCH_UP_S:
                        raise _stands_still(line["state"]["since_cycle_s"])
                    yield run_state(line["state"])
        finally:
            own.close()

    def events(self) -> Events:
        """What happens from now on, until the run ends: switches, errors, contacts, interventions, stops, grasps.

        None is missing that comes and goes between two looks; `lost` counts what a reader missed that did not look for
        long. docs/shared_records.md lists the kinds.
        """
        return Events(self.shared())

    def place(self, name: str, position_m: Any, quaternion_wxyz: Any = None) -> None:
        """Simulation: places a free object.

        Args:
            name: Name of the object.
            position_m: x, y, z in the world [m].
            quaternion_wxyz: Orientation; that of the scene by default.
        """
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
        """Simulation: pauses the world, or lets it go on."""
        self.ask({"do": "pause", "paused": paused})

    def step(self, periods: int = 1) -> None:
        """Simulation: advances a paused world by periods of 1 ms."""
        self.ask({"do": "step", "periods": periods}, 30 + 0.02 * periods)

    def reset(self) -> None:
        """Simulation: puts the world back to its start."""
        self.ask({"do": "reset"})

    def close(self) -> None:
        """Closes the connection; streams of this client fall silent."""
        self.connection.close()
        if self._shared is not None:
            self._shared.close()

    def __enter__(self) -> Client:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is not None and os.getpid() == self.connection.process:
            self.take_arms_from(self._commanded)
        self.close()


def connect(socket: str | os.PathLike[str] | None = None) -> Client:
    """Attaches to a running scene.

    Args:
        socket: Name of the scene, or path of its socket; by default the only one that runs.

    Raises:
        Disconnected: No scene runs there.
        Refused: Several scenes run, and none is named.
        VersionMismatch: The run is of another version.
    """
    if socket is None:
        return Client(Connection(only_running_socket()))
    text = os.fspath(socket)
    if "/" not in text and not text.endswith(".sock"):
        return Client(Connection(socket_folder() / f"{text}.sock"))
    return Client(Connection(text))
