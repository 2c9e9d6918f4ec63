"""Tasks for policies, and the mapping from actions to set-points, without Gymnasium and without the simulation.

With them the same policy drives simulated, virtual and real arms (docs/learning.md).
"""

from .actions import (
    ActionMapping as ActionMapping,
    Command as Command,
    GripperPart as GripperPart,
    JointsPart as JointsPart,
    ParameterPart as ParameterPart,
    PosePart as PosePart,
    Quantity as Quantity,
    ScalarPart as ScalarPart,
    WrenchPart as WrenchPart,
)
from .arms import ArmStates as ArmStates
from .handover import Handover as Handover
from .insert import Insert as Insert
from .lift_box import LiftBox as LiftBox
from .press_circle import PressCircle as PressCircle
from .reach import Reach as Reach
from .task import Judgment as Judgment, Start as Start, Task as Task, TaskArm as TaskArm, Truth as Truth

TASKS: dict[str, type[Task]] = {task.name: task for task in (Reach, PressCircle, Insert, LiftBox, Handover)}
