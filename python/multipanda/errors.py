"""Errors, each with its cause and the next step."""

from __future__ import annotations


class Error(Exception):
    """The base of all errors of this package.

    Attributes:
        cause: What happened.
        next_step: What to do.
    """

    def __init__(self, cause: str, next_step: str) -> None:
        self.cause = cause
        self.next_step = next_step
        end = "" if cause.endswith((".", "?", "!")) else "."
        super().__init__(f"{cause}{end} Next: {next_step}" if next_step else cause)

    def __reduce__(self) -> tuple[type[Error], tuple[str, ...]]:
        """Errors of other processes arrive as they were raised."""
        return type(self), (self.cause, self.next_step)


class Refused(Error):
    """A request was refused; nothing has changed.

    Attributes:
        verdict: Its code, as docs/live_input.md lists them: `two_owners`, `out_of_bounds`, `arm_stopped`, ...
        reason: The reason in words.
    """

    def __init__(self, verdict: str, reason: str, next_step: str = "") -> None:
        self.verdict = verdict
        self.reason = reason
        super().__init__(reason, next_step or _STEPS.get(verdict, ""))

    def __reduce__(self) -> tuple[type[Error], tuple[str, ...]]:
        return type(self), (self.verdict, self.reason, self.next_step)


class Timeout(Error, TimeoutError):
    """No answer in time, or a goal that was not reached in time."""


class Disconnected(Error, ConnectionError):
    """The program has ended, or the connection to it is closed. The program ends in hold, or runs on without us."""


class VersionMismatch(Error):
    """The program and this package belong to different versions."""


class ProgramMissing(Error, FileNotFoundError):
    """The program `multipanda` was not found."""


_STEPS = {
    "two_owners": "name one controllet for each arm",
    "arm_stopped": "call resume() once the reason for the stop is gone, then switch again",
    "not_active": "switch to the controllet first",
    "out_of_bounds": "help() of the controllet shows the bounds",
    "wrong_size": "help() of the controllet shows how many numbers are expected",
    "unknown_instance": "run.controllets lists the names",
    "unknown_arm": "run.arms lists the names",
    "observes_itself": "deactivate one of the followers that would follow each other",
    "superseded": "send the request again, if it is still needed",
    "queue_full": "send fewer requests, or open a stream",
    "too_many_clients": "close a client of this run",
}
