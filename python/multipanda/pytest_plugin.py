"""Fixtures for pytest. In your conftest.py: pytest_plugins = ["multipanda.pytest_plugin"]"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

import pytest

from .started import Run, run
from .virtual import VirtualArms, virtual_arms


@pytest.fixture
def multipanda_virtual_arms() -> Iterator[Callable[..., VirtualArms]]:
    """Makes virtual arms that end with the test: multipanda_virtual_arms("one_arm", arm_names=("arm",))."""
    with ExitStack() as stack:

        def make(scene: str, **options: Any) -> VirtualArms:
            return stack.enter_context(virtual_arms(scene, **options))

        yield make


@pytest.fixture
def multipanda_run() -> Iterator[Callable[..., Run]]:
    """Starts scenes that end with the test: multipanda_run("two_arms")."""
    with ExitStack() as stack:

        def make(scene: str, **options: Any) -> Run:
            started = run(scene, **options)
            stack.enter_context(started)
            return started

        yield make
