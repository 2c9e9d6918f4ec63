"""The asyncio interface: nothing here blocks the event loop.

async with await aio.run("one_arm") as run:
    await run.switch("joint")
    goal = await run["joint"].goal("joints", q_rad)
    state = await goal.wait()
    await run.arms["arm"].gripper.move(0.04)
    async for state in run.states(20):
        ...
"""

from __future__ import annotations

import asyncio
import functools
import inspect
import os
from collections.abc import AsyncIterator, Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

from . import client as _client, started as _started
from .arm import Arm, Gripper, Vacuum
from .base_client import Named
from .connection import Json, accepted
from .controllet import Controllet, Feature
from .episode import Episode
from .errors import Timeout
from .follow import Events, Records
from .goal import Goal
from .parameters import Parameter
from .state import RunState
from .stream import Stream

T = TypeVar("T")
_WAITING = (Arm, Controllet, Episode, Events, Feature, Goal, Gripper, Records, Stream, Vacuum)


def _awaited(value: Any) -> Any:
    if isinstance(value, Named):
        return Named(value.kind, {name: _awaited(each) for name, each in value.items()})
    if isinstance(value, dict):
        return {name: _awaited(each) for name, each in value.items()}
    return Awaited(value) if isinstance(value, _WAITING) else value


async def _each(iterator: Iterator[T]) -> AsyncIterator[T]:
    end: Any = object()
    pending: asyncio.Future[Any] | None = None
    try:
        while True:
            pending = asyncio.ensure_future(asyncio.to_thread(next, iterator, end))
            value = await asyncio.shield(pending)
            if value is end:
                return
            yield value
    finally:
        if pending is not None and not pending.done():
            await asyncio.wait([pending])  # a generator cannot be closed while it runs
        if hasattr(iterator, "close"):
            await asyncio.to_thread(iterator.close)


async def _in_own_thread(call: Callable[..., T], *arguments: Any, **options: Any) -> T:
    """As asyncio.to_thread(), whose threads may all be waiting."""
    own = ThreadPoolExecutor(1)
    try:
        return await asyncio.get_running_loop().run_in_executor(own, functools.partial(call, *arguments, **options))
    finally:
        own.shutdown(wait=False)


class Awaited:
    """An arm, a controllet, a goal, a stream, ... whose methods, properties and parameters are awaited.

    `await arm.stop()`, `await arm.state`, `await law.set("damping_ratio", 0.7)`, `async with law.stream("pose")`; what
    they return waits in the same way. Errors are those of the object behind it.

    Attributes:
        blocking: The object behind it.
    """

    def __init__(self, blocking: Any) -> None:
        self.blocking = blocking

    def __getattr__(self, name: str) -> Any:
        blocking, member = self.blocking, inspect.getattr_static(type(self.blocking), name, None)

        async def call(*arguments: Any, **options: Any) -> Any:
            to_thread = _in_own_thread if name == "stop" else asyncio.to_thread
            return _awaited(await to_thread(getattr(blocking, name), *arguments, **options))

        async def read() -> Any:
            return _awaited(await asyncio.to_thread(getattr, blocking, name))

        if isinstance(member, (property, Parameter)):
            return read()
        return call if inspect.isfunction(member) else _awaited(getattr(blocking, name))

    def __aiter__(self) -> AsyncIterator[Any]:
        return _each(iter(self.blocking))

    async def __aenter__(self: T) -> T:
        return self

    async def __aexit__(self, kind: Any, error: Any, trace: Any) -> None:
        await asyncio.shield(asyncio.to_thread(self.blocking.__exit__, kind, error, trace))


class AsyncClient(Awaited):
    """A client whose requests are awaited: all methods of Client and Run, and `arms`, `controllets`, `run["name"]`.

    Errors are those of Client.
    """

    def __getitem__(self, name: str) -> Awaited:
        return Awaited(self.blocking[name])

    async def in_thread(self, call: Callable[..., T], *arguments: Any, **options: Any) -> T:
        """Awaits any blocking call: await run.in_thread(mp.read_log, "runs/one")."""
        return await asyncio.to_thread(call, *arguments, **options)

    async def ask(self, request: Json, timeout_s: float = 30) -> Json:
        """Sends any request of docs/live_input.md and returns its answer.

        Raises:
            Refused: With the reason; nothing has changed.
            Timeout: No answer within timeout_s [s].
            Disconnected: The run has ended.
        """
        future = asyncio.wrap_future(self.blocking.connection.post(request, patience_s=timeout_s))
        try:
            return accepted(await asyncio.wait_for(future, timeout_s))
        except asyncio.TimeoutError as late:
            if isinstance(late, Timeout):
                raise
            raise Timeout(
                f"the run did not answer '{request.get('do')}' within {timeout_s:g} s", "check whether it still runs"
            ) from None

    def states(self, rate_hz: float = 10) -> AsyncIterator[RunState]:
        """As Client.states(): `rate_hz` times a second [Hz]."""
        return _each(self.blocking.states(rate_hz))

    async def close(self) -> None:
        """As Client.close()."""
        await asyncio.shield(asyncio.to_thread(self.blocking.close))


async def run(scene: str | os.PathLike[str], **options: Any) -> AsyncClient:
    """As mp.run()."""
    return AsyncClient(await asyncio.to_thread(_started.run, scene, **options))


async def connect(socket: str | os.PathLike[str] | None = None, **options: Any) -> AsyncClient:
    """As mp.connect()."""
    return AsyncClient(await asyncio.to_thread(_client.connect, socket, **options))
