"""Prints what a task observes, and what its actions mean: python -m multipanda.tasks Insert wrench"""

from __future__ import annotations

import argparse

from . import TASKS
from .task import ACTION_KINDS


def main() -> None:
    """Prints the tables of a task."""
    parser = argparse.ArgumentParser(prog="python -m multipanda.tasks", description=__doc__)
    parser.add_argument("task", choices=list(TASKS))
    parser.add_argument("action", choices=ACTION_KINDS, nargs="?", default="pose")
    chosen = parser.parse_args()
    task = TASKS[chosen.task]()
    print(task.__doc__)
    try:
        mapping = task.mapping(chosen.action)
    except ValueError as wrong:
        parser.error(str(wrong))
    print(f"action '{chosen.action}', {mapping.size} numbers at {mapping.rate_hz:g} Hz:")
    for k, quantity in enumerate(mapping.quantities):
        means = f"{quantity.low:g} to {quantity.high:g} {quantity.unit}".rstrip()
        print(f"  {k:2d} {quantity.name}: {means}{f', axes of the {quantity.frame}' if quantity.frame else ''}")
    print(f"observation, {len(task.observation_names)} numbers:")
    for k, name in enumerate(task.observation_names):
        print(f"  {k:2d} {name}")


if __name__ == "__main__":
    main()
