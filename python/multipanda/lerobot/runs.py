"""Opens and closes the run of a robot or a leader."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable, Mapping
from typing import Any

from ..client import Client, connect
from ..errors import Disconnected, Error, Refused
from ..rotations import Array
from ..started import Run, run
from .settings import RunSettings

_LOGGER = logging.getLogger("multipanda.lerobot")


def open_run(settings: RunSettings) -> Client:
    """Starts the scene, or attaches to a running one."""
    if settings.scene is None:
        return connect(settings.socket)
    return run(
        settings.scene,
        address=settings.addresses,
        backend=settings.backend,
        record=settings.record,
        arguments=settings.arguments,
    )


def close_run(client: Client) -> None:
    """Ends a run that open_run() has started, in hold; leaves any other run.

    Errors are logged, never raised: they would hide why the connection ends.
    """
    try:
        client.close()
    except (Error, OSError) as wrong:
        _LOGGER.error("the run did not end properly: %s", wrong)


class Connected:
    """Shared by robots and leaders: the run, from connect() to disconnect()."""

    _what = "the robot"

    def __init__(self) -> None:
        self._client: Client | None = None

    @property
    def connected(self) -> bool:
        """Whether connect() was called, and disconnect() was not."""
        return self._client is not None

    @property
    def client(self) -> Client:
        """The run. Raises Disconnected before connect()."""
        if self._client is None:
            raise Disconnected(f"{self._what} is not connected", "call connect() first")
        return self._client

    def _open(self, settings: RunSettings, begin: Callable[[Client], None]) -> None:
        """Opens the run and begins with it; an exception closes it again."""
        if self._client is not None:
            raise Refused("connected", f"{self._what} is connected already", "disconnect() first")
        client = open_run(settings)
        try:
            begin(client)
        except BaseException:
            close_run(client)
            raise
        self._client = client


def started_here(client: Client) -> bool:
    """Whether no other client is expected to command its arms."""
    return isinstance(client, Run)


def arms_of(client: Client, names: list[str], joints: int) -> dict[str, Array]:
    """The bases X_WB of the arms: x y z [m], qw qx qy qz. Raises Refused if one is missing or has other joints."""
    bases = {}
    for name in names:
        if name not in client.arms:
            raise Refused("unknown_arm", f"{client.scene} has no arm '{name}'; it has: {', '.join(client.arms)}")
        arm = client.arms[name]
        if arm.joints != joints:
            raise Refused("wrong_size", f"arm '{name}' has {arm.joints} joints, expected {joints}", "set `joints`")
        bases[name] = arm.base.values
    return bases


def with_grippers(client: Client, names: list[str]) -> None:
    """Raises Refused unless each of these arms has fingers."""
    state = client.state()
    for name in names:
        if state.arms[name].gripper is None:
            raise Refused("no_gripper", f"arm '{name}' has no gripper", "leave it out of `grippers`")


def entries(client: Client) -> Mapping[str, dict[str, Any]]:
    """The run's description of its controllets, by name."""
    return {entry["name"]: entry for entry in client.listing()["controllets"]}


def take_from(client: Client, controllets: list[str]) -> None:
    """Holds the arms of these controllets; never raises."""
    with contextlib.suppress(Error, OSError):
        client.take_arms_from(controllets)
