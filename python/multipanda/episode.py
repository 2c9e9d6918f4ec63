"""Attempts at a task, marked in the log: their beginnings and outcomes."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from .base_client import BaseClient
from .errors import Error


class Episode:
    """One attempt, from run.episode() until it is judged. Leaving `with`: success, or failure by an exception.

    A judgment raises `Refused` if the episode is over already, `Timeout` if the run does not answer, `Disconnected`
    once it has ended.

    Attributes:
        client: The run.
        number: Of this attempt in the run, from 1.
        outcome: "success", "failure" or "discard"; empty until it is judged.
    """

    def __init__(self, client: BaseClient) -> None:
        self.client = client
        self.outcome = ""
        self.number = int(client.ask({"do": "episode", "mark": "start"})["episode"])

    def __repr__(self) -> str:
        return f"<episode {self.number}: {self.outcome or 'begun'}>"

    def _judge(self, outcome: str) -> None:
        self.client.ask({"do": "episode", "mark": outcome})
        self.outcome = outcome

    def success(self) -> None:
        """Marks the attempt as successful."""
        self._judge("success")

    def failure(self) -> None:
        """Marks the attempt as failed."""
        self._judge("failure")

    def discard(self) -> None:
        """The attempt does not count. Also possible after its judgment, until the next episode begins."""
        self._judge("discard")

    def __enter__(self) -> Episode:
        return self

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        if not self.outcome and kind is None:
            self.success()
        elif not self.outcome:
            with contextlib.suppress(Error):  # the user should see the exception that ended the block
                self.failure()


@dataclass(frozen=True)
class LoggedEpisode:
    """An attempt in a log.

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
