"""A table of the arms that updates itself, in a notebook or a terminal."""

from __future__ import annotations

import html
import sys
from collections.abc import Callable

from .base_client import BaseClient
from .state import RunState

_COLUMNS = ("arm", "controllet", "position [m]", "joint angles [rad]", "state")


def rows(state: RunState) -> list[tuple[str, ...]]:
    """One row of text per arm."""
    table: list[tuple[str, ...]] = []
    for arm in state.arms.values():
        said = "stopped" if arm.stopped else arm.mode
        if arm.errors:
            said = arm.reason or ", ".join(arm.errors)
        position = ", ".join(f"{x:.4f}" for x in arm.pose.position_m)
        table.append((arm.arm, arm.controllet, position, ", ".join(f"{q:.3f}" for q in arm.q_rad), said))
    return table


def as_html(state: RunState) -> str:
    """The table for a notebook."""
    head = "".join(f"<th>{html.escape(name)}</th>" for name in _COLUMNS)
    body = "".join("<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in rows(state))
    caption = f"{html.escape(state.scene)}: {state.t_s:.3f} s, {state.rate_hz:.0f} Hz, {state.overruns} overruns"
    return f"<table><caption>{caption}</caption><tr>{head}</tr>{body}</table>"


def as_text(state: RunState) -> str:
    """The table for a terminal."""
    lines = [f"{state.t_s:9.3f} s  {state.rate_hz:.0f} Hz  {state.overruns} overruns"]
    lines += ["  " + "  ".join(row) for row in rows(state)]
    return "\n".join(lines)


def _notebook_view() -> Callable[[str], None] | None:
    """Shows a page in place of the one before, inside a notebook; None elsewhere."""
    if "IPython" not in sys.modules:
        return None
    from IPython import get_ipython  # type: ignore[import-not-found, unused-ignore]
    from IPython.display import HTML, display  # type: ignore[import-not-found, unused-ignore]

    if get_ipython() is None:
        return None
    handle = display(HTML(""), display_id=True)  # type: ignore[no-untyped-call, unused-ignore]
    return lambda page: handle.update(HTML(page))  # type: ignore[no-untyped-call, unused-ignore]


def live_table(client: BaseClient, seconds: float = 10, rate_hz: float = 5) -> None:
    """Shows the arms in a notebook or a terminal, until the cell is interrupted, without effect on the loop.

    Args:
        client: The run.
        seconds: Loop time for which it is shown [s].
        rate_hz: Update rate [Hz].
    """
    show = _notebook_view()
    end: float | None = None
    try:
        for state in client.states(rate_hz):
            if show is not None:
                show(as_html(state))
            else:
                print(as_text(state), flush=True)
            end = state.t_s + seconds if end is None else end
            if state.t_s >= end:
                return
    except KeyboardInterrupt:
        return
