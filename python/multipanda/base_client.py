"""Shared by all parts of a client: requests, the newest records and states, switches and stops."""

from __future__ import annotations

import contextlib
import difflib
import os
import pathlib
import threading
import time
import warnings
from collections.abc import Iterable, Iterator
from typing import Any, TypeVar

from .connection import Connection, Json, stop_run
from .errors import Disconnected, Error, Refused, Timeout
from .follow import Events, Records
from .model import ArmModel
from .pose import Pose
from .program import check_version
from .record import History, Record
from .shared import SharedRecords
from .state import ArmState, RunState, run_state

Names = str | Iterable[str]
T = TypeVar("T")

_FIRST_CYCLE_S = 60  # a real arm may take a while to begin
_CATCH_UP_S = 1  # another thread publishes the state, a moment after the answer
_OLD_S = 0.1  # an older state means that the run has stalled
_EVENTS_S = 0.1  # another thread writes the events, a moment after the state
_LOOKED_THROUGH = 256  # newest events that are searched


class Named(dict[str, T]):
    """Objects of a scene by name. An unknown name raises KeyError with the names that exist.

    Attributes:
        kind: What they are, `arm` or `controllet`.
    """

    def __init__(self, kind: str, found: dict[str, T]) -> None:
        super().__init__(found)
        self.kind = kind

    def __missing__(self, name: str) -> T:
        near = difflib.get_close_matches(name, self, 1)
        meant = f"; did you mean '{near[0]}'?" if near else ""
        raise KeyError(f"the scene has no {self.kind} '{name}'{meant}; it has: {', '.join(self) or 'none'}")


def _names(names: Names) -> list[str]:
    return [names] if isinstance(names, str) else list(names)


class BaseClient:
    """A connection to a running scene: what Client has besides arms and controllets. Errors are those of Client.

    Attributes:
        scene: Name of the scene.
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
        self.streaming: dict[str, Any] = {}
        try:
            self._listing = connection.ask({"do": "list"})
            check_version(self._listing.get("version"), f"the run at {connection.path}")
        except BaseException:
            connection.close()
            raise
        self.scene: str = self._listing["scene"]

    def ask(self, request: Json, timeout_s: float = 30) -> Json:
        """Sends any request of docs/live_input.md and returns its answer; waits for it for timeout_s [s]."""
        answer = self.connection.ask(request, timeout_s)
        self._answered = max(self._answered, int(answer.get("cycle", 0)))
        self._answered_ns = self.connection.answered_ns(answer)
        return answer

    def listing(self) -> Json:
        """The answer to `list`."""
        return self.ask({"do": "list"})

    def commanded(self, controllet: str) -> None:
        """Records that this client commands a controllet."""
        self._commanded.add(controllet)

    def take_arms_from(self, controllets: Iterable[str]) -> None:
        """Deactivates the active ones: their arms are held. Never raises."""
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
            self.connection.check()  # a forked child would continue to read without noticing the end of the run
        if self._shared is not None:
            return self._shared
        with self._sharing:
            if self._not_shared is not None:
                raise self._not_shared
            if self._shared is None:
                self.connection.check()
                try:
                    link = self.connection.link
                    self._shared = SharedRecords(pathlib.Path(self.connection.path)) if link is None else link.records()
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

    def record_at(self, start_ns: int) -> tuple[Record, float]:
        """The state at an instant of the last 2 s, interpolated between the records around it.

        Args:
            start_ns: The instant by time.monotonic_ns() [ns].

        Returns:
            The record, and the time to the nearest one that was recorded [s].

        Raises:
            Timeout: The run has made no cycle yet.
        """
        self.record()  # waits for the first cycle
        found = self.shared().at(start_ns)
        if found is None:
            raise Timeout("the run has made no cycle", "see its messages")
        return found[0], 1e-9 * found[1]

    def records(self) -> Records:
        """Every record from now on, until the run ends or the loop is left. `lost` counts those missed.

        for record in run.records(): print(record.cycle, record["left/q_rad"])
        """
        return Records(self.shared())

    def base(self, arm: str) -> Pose:
        """Pose of an arm's base in the world [m], as Arm.base."""
        entry: Json = next(entry for entry in self._listing["arms"] if entry["name"] == arm)
        if "base_on" in entry:
            raise Refused(
                "out_of_bounds",
                f"arm '{arm}' stands on arm '{entry['base_on']['arm']}': its base does not stand still",
                "give poses in the world",
            )
        return Pose(entry["base_position_m"], entry["base_quaternion_wxyz"])

    def arm_model(self, arm: str) -> ArmModel:
        """As Arm.model, but of the scene's file alone."""
        raise Refused(
            "unknown_scene",
            "a client that has connected to a run does not know its scene's file",
            f'mp.model(SCENE, arm="{arm}")',
        )

    def history(self, seconds: float = 1) -> History:
        """The newest records as arrays, one row per cycle: run.history(0.5)["left/q_rad"]. At least 2 s are kept."""
        shared, rows = self.shared(), self.shared().block(1)
        period_s = float(Record(shared.layout, rows[-1])["period_s"][0]) if len(rows) else 1e-3
        return History(shared.layout, shared.block(max(1, round(seconds / max(period_s, 1e-4)))))

    def _fresh(self, arm: str | None) -> Record | None:
        """The newest record if it is complete for an arm, or for all arms."""
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
        if record is None or record.errors(arm):  # the reason of an error is text, available only by request
            return None
        oldest_ns = time.monotonic_ns() - 1e9 * (_OLD_S + self.connection.delay_s)
        new = record.start_ns >= self._answered_ns and record.cycle >= self._answered
        return record if new and record.start_ns > oldest_ns else None

    def arm_state(self, arm: str) -> ArmState:
        """The newest state of one arm, as state() has it, or Timeout."""
        record = self._fresh(arm)
        return self._asked_state().arms[arm] if record is None else record.arm(arm)

    def state(self) -> RunState:
        """The newest state of all arms, not older than the last answer to this client. Waits for the first cycle.

        Never returns a state older than 0.1 s: it waits up to 1 s for the next cycle.

        Raises:
            Timeout: The run did not answer, or its loop has stalled.
            Disconnected: The run has ended.
        """
        record = self._fresh(None)
        return self._asked_state() if record is None else record.state(self.shared().rate_hz())

    def _asked_state(self) -> RunState:
        now = time.monotonic()
        deadline, soon = now + _FIRST_CYCLE_S, now + _CATCH_UP_S
        while True:
            answer = self.connection.ask({"do": "state"})
            data = answer["state"]
            current = data["since_cycle_s"] <= _OLD_S
            if data["arms"] and current and (data["cycle"] >= self._answered or time.monotonic() > soon):
                way_s = 1e-9 * (time.monotonic_ns() - self.connection.answered_ns(answer))
                return run_state({**data, "since_cycle_s": data["since_cycle_s"] + max(0.0, way_s)})
            if data["arms"] and not current and time.monotonic() > soon:
                raise Timeout(
                    f"the run has made no cycle for {data['since_cycle_s']:.1f} s",
                    "a law that does not return, or a busy computer: see its messages; arms without commands stop "
                    "themselves",
                )
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
        """Holds arms from the next cycle on until resume(). Not a safety-rated stop.

        It uses a connection of its own, so it works while this client waits, and after close(). With a wrong name
        it stops all arms, and warns.
        """
        try:
            answer = stop_run(self.connection.path, _names(arms), link=self.connection.link)
        except (Disconnected, OSError):  # the socket's file is gone, or this process has too many open
            answer = self.connection.ask({"do": "stop", "arms": _names(arms)}, 5)
        self._answered_ns = time.monotonic_ns()
        if "message" in answer:
            warnings.warn(answer["message"], stacklevel=2)

    def resume(self, arms: Names = "all", stops: int | None = None) -> None:
        """Allows switches of stopped arms again; they stay in hold until the next switch.

        Args:
            arms: Their names.
            stops: `stops` of the state that the caller has seen; None: of the newest.

        Raises:
            Refused: One of the arms was stopped after that state.
        """
        if stops is None:
            stops = self.ask({"do": "state"})["state"]["stops"]
        self.ask({"do": "resume", "arms": _names(arms), "stops": stops})

    def states(self, rate_hz: float = 10) -> Iterator[RunState]:
        """state(), `rate_hz` times a second of wall time [Hz], until the run ends or the loop is left.

        Raises:
            Timeout: The run's loop has stalled for 1 s.
            Disconnected: This process was forked, or the run has ended before.
        """
        self.connection.check()
        due = time.monotonic()
        with contextlib.suppress(Disconnected):
            while True:
                yield self.state()
                due = max(due + 1 / rate_hz, time.monotonic())
                time.sleep(max(0.0, due - time.monotonic()))

    def events(self) -> Events:
        """Events from now on, until the run ends: switches, errors, contacts, interventions, stops, grasps.

        Short events are included; `lost` counts events missed by a reader that did not read for
        long. docs/live_input.md lists the kinds.
        """
        return Events(self.shared())

    @staticmethod
    def newest_events(shared: SharedRecords, since_s: float) -> Iterator[Json]:
        """Events since since_s [s], the newest first: `kind`, `arm`, `text`."""
        for number in range(shared.events_written - 1, max(-1, shared.events_written - _LOOKED_THROUGH), -1):
            _, t_ns, event = shared.read_event(number) or (0, 0, {})
            if 1e-9 * t_ns <= since_s:
                return
            yield event

    def objects(self) -> dict[str, Pose]:
        """Simulation: the present poses of the free objects in the world."""
        found = self.ask({"do": "state"})["state"]["objects"]
        return {name: Pose(each["position_m"], each["quaternion_wxyz"]) for name, each in found.items()}

    def lost_by(self, controllet: str, arm: ArmState, since_s: float = 0) -> str:
        """Why a controllet no longer owns an arm with this state: from the run's events since since_s [s].

        If the run shares no events, from the state.
        """
        deadline = time.monotonic() + _EVENTS_S
        while not arm.stopped:
            try:
                shared = self.shared()
            except Refused:
                break
            for event in self.newest_events(shared, since_s):
                stopped = event["text"].partition("stopped ")[2].partition(";")[0].split(", ")
                if event["kind"] == "switched" and controllet in stopped:
                    return str(event["text"].partition("because of ")[2]) or "another switch"
            if time.monotonic() > deadline:
                break
            time.sleep(0.002)
        if arm.stopped:
            return "it is stopped until resume()"
        return arm.reason or arm.removed_by.replace("_", " ") or "another switch"

    def loss(self, controllet: str, arms: Iterable[str], run: RunState, since_s: float = 0) -> str:
        """The arm that a controllet has lost, its new owner, and why; empty if it owns all of its arms."""
        for arm in (run.arms[name] for name in arms):
            if arm.controllet != controllet:
                why = self.lost_by(controllet, arm, since_s)
                return f"{controllet} lost {arm.arm}, which {arm.controllet} owns now: {why}"
        return ""

    def close(self) -> None:
        """Closes the connection; streams of this client fall silent."""
        self.connection.close()
        if self._shared is not None:
            self._shared.close()
        if self.connection.link is not None:
            self.connection.link.close()
