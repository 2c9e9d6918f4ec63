"""Tasks for policies, and the mapping from actions to set-points, without Gymnasium and without the simulation.

With them the same policy drives simulated, virtual and real arms (docs/learning.md).
"""

from .actions import (
    ActionMapping,
    Command,
    GripperPart,
    JointsPart,
    ParameterPart,
    PosePart,
    Quantity,
    ScalarPart,
    WrenchPart,
)
from .arms import ArmStates
from .handover import Handover
from .insert import Insert
from .lift_box import LiftBox
from .press_circle import PressCircle
from .reach import Reach
from .task import Judgment, Start, Task, TaskArm, Truth

TASKS: dict[str, type[Task]] = {task.name: task for task in (Reach, PressCircle, Insert, LiftBox, Handover)}

__all__ = [
    "TASKS",
    "ActionMapping",
    "ArmStates",
    "Command",
    "GripperPart",
    "Handover",
    "Insert",
    "Judgment",
    "JointsPart",
    "ParameterPart",
    "LiftBox",
    "PosePart",
    "PressCircle",
    "Quantity",
    "Reach",
    "ScalarPart",
    "Start",
    "Task",
    "TaskArm",
    "Truth",
    "WrenchPart",
]
