"""The same for asyncio: nothing here blocks the event loop.

async with await aio.run("one_arm") as run:
    await run.switch("joint")
    async for state in run.states(20):
        ...
"""

from __future__ import annotations

import asyncio
import os
from collections.abc import AsyncIterator, Callable
from types import TracebackType
from typing import Any, TypeVar

from . import client as _client
from . import started as _started
from .connection import Json, accepted
from .errors import Timeout
from .state import ArmState, RunState

T = TypeVar("T")


class AsyncClient:
    """A client whose requests are awaited. Errors are those of Client.

    Attributes:
        blocking: The client behind it, for everything else: `in_thread()`.
    """

    def __init__(self, blocking: _client.Client) -> None:
        self.blocking = blocking

    async def in_thread(self, call: Callable[..., T], *arguments: Any, **options: Any) -> T:
        """Awaits any blocking call: await run.in_thread(run.blocking.arms["left"].gripper.move, 0.04)."""
        return await asyncio.to_thread(call, *arguments, **options)

    async def ask(self, request: Json, timeout_s: float = 30) -> Json:
        """Sends any request of docs/live_input.md and returns its answer.

        Raises:
            Refused: With the reason; nothing has changed.
            Timeout: No answer within timeout_s [s].
            Disconnected: The run has ended.
        """
        future = asyncio.wrap_future(self.blocking.connection.post(request))
        try:
            return accepted(await asyncio.wait_for(future, timeout_s))
        except asyncio.TimeoutError as late:
            if isinstance(late, Timeout):
                raise
            raise Timeout(
                f"the run did not answer '{request.get('do')}' within {timeout_s:g} s", "see whether it still runs"
            ) from None

    async def state(self) -> RunState:
        """The newest state, as Client.state()."""
        return await self.in_thread(self.blocking.state)

    async def switch(self, *arguments: Any, **options: Any) -> Json:
        """As Client.switch()."""
        return await self.in_thread(self.blocking.switch, *arguments, **options)

    async def stop(self, arms: _client.Names = "all") -> None:
        """As Client.stop()."""
        await self.in_thread(self.blocking.stop, arms)

    async def resume(self, arms: _client.Names = "all") -> None:
        """As Client.resume()."""
        await self.in_thread(self.blocking.resume, arms)

    async def go_to(self, controllet: str, name: str, values: Any, timeout_s: float = 30, **options: Any) -> ArmState:
        """Sets a goal and waits for the arrival for timeout_s [s].

        Errors are those of Controllet.goal() and Goal.wait().
        """
        goal = await self.in_thread(self.blocking[controllet].goal, name, values, **options)
        return await self.in_thread(goal.wait, timeout_s)

    async def states(self, rate_hz: float = 10) -> AsyncIterator[RunState]:
        """As Client.states(): `rate_hz` times a second [Hz]."""
        states = self.blocking.states(rate_hz)
        end = object()
        pending: asyncio.Future[Any] | None = None
        try:
            while True:
                pending = asyncio.ensure_future(asyncio.to_thread(next, states, end))
                state = await asyncio.shield(pending)
                if state is end:
                    return
                yield state
        finally:
            if pending is not None and not pending.done():
                await asyncio.wait([pending])  # a generator cannot be closed while it runs
            await asyncio.to_thread(states.close)  # type: ignore[attr-defined]

    async def close(self) -> None:
        """As Client.close()."""
        await asyncio.shield(asyncio.to_thread(self.blocking.close))

    async def __aenter__(self) -> AsyncClient:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await asyncio.shield(asyncio.to_thread(self.blocking.__exit__, kind, error, trace))


async def run(scene: str | os.PathLike[str], **options: Any) -> AsyncClient:
    """As mp.run()."""
    return AsyncClient(await asyncio.to_thread(_started.run, scene, **options))


async def connect(socket: str | os.PathLike[str] | None = None) -> AsyncClient:
    """As mp.connect()."""
    return AsyncClient(await asyncio.to_thread(_client.connect, socket))
