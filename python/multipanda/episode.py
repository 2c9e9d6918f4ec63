"""Attempts at a task, marked in the log: where they began, and how they were judged."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable
from dataclasses import dataclass
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np

from .errors import Error

if TYPE_CHECKING:
    from .client import Client


class Episode:
    """One attempt, from run.episode() until it is judged. Leaving `with`: success, or failure by an exception.

    Attributes:
        client: The run.
        number: Of this attempt in the run, from 1.
        outcome: "success", "failure" or "discard"; empty until it is judged.
    """

    def __init__(self, client: Client) -> None:
        self.client = client
        self.outcome = ""
        self.number = int(client.ask({"do": "episode", "mark": "start"})["episode"])

    def __repr__(self) -> str:
        return f"<episode {self.number}: {self.outcome or 'begun'}>"

    def _judge(self, outcome: str) -> None:
        self.client.ask({"do": "episode", "mark": outcome})
        self.outcome = outcome

    def success(self) -> None:
        """The task was done.

        Raises:
            Refused: The episode is over already.
            Timeout: The run did not answer.
            Disconnected: The run has ended.
        """
        self._judge("success")

    def failure(self) -> None:
        """The task was not done.

        Raises:
            Refused: The episode is over already.
            Timeout: The run did not answer.
            Disconnected: The run has ended.
        """
        self._judge("failure")

    def discard(self) -> None:
        """The attempt does not count. Also possible after its judgment, until the next episode begins.

        Raises:
            Refused: Another episode has begun.
            Timeout: The run did not answer.
            Disconnected: The run has ended.
        """
        self._judge("discard")

    def __enter__(self) -> Episode:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self.outcome:
            return
        if kind is None:
            self.success()
            return
        with contextlib.suppress(Error):  # the reason for leaving is the one to see
            self.failure()


@dataclass(frozen=True)
class LoggedEpisode:
    """An attempt as the log has it.

    Attributes:
        number: Of the attempt in the run, from 1.
        start_s: When it began, in loop time.
        end_s: When it was judged; not a number if it was not.
        outcome: "success", "failure" or "discard"; empty if the run ended before.
    """

    number: int
    start_s: float
    end_s: float
    outcome: str


def logged_episodes(times_s: Iterable[float], events: Iterable[dict[str, Any]]) -> list[LoggedEpisode]:
    """From the events of a log. An episode that was discarded after its judgment is discarded."""
    found: dict[int, LoggedEpisode] = {}
    for t_s, event in zip(times_s, events):
        if event["kind"] != "episode":
            continue
        number, mark = round(np.atleast_1d(event["values"])[0]), event["item"]
        if mark == "start":
            found[number] = LoggedEpisode(number, t_s, float("nan"), "")
        elif number in found:
            before = found[number]
            end_s = t_s if not before.outcome else before.end_s
            found[number] = LoggedEpisode(number, before.start_s, end_s, mark)
    return list(found.values())
