"""Simulated worlds with their control loop in your process, stepped by your program: bit for bit the program's own run.

    import multipanda_native as native

    world = native.World("one_arm", seed=3)
    world.goal("cartesian", "pose", [0.5, 0, 0.4, 0, 1, 0, 0], duration_s=1)
    world.step(1000)
    print(world.arms["arm"].q_rad, world.arms["arm"].F_K_W_true)

A `World` is one of them and raises what it refuses; a `Batch` steps many on threads. Both show their state as read-only
numpy views, which `step` and `reset` update. Quantities, frames and signs: CONVENTIONS.md.
"""

from ._views import Arm
from .batch import Batch
from .world import World

__all__ = ["Arm", "Batch", "World"]
