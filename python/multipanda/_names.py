"""The public names, which `import multipanda` loads when the first of them is used."""

from .arm import Arm as Arm, Gripper as Gripper, Vacuum as Vacuum
from .camera import (
    Camera as Camera,
    Cameras as Cameras,
    LeRobotCamera as LeRobotCamera,
    OpenCvCamera as OpenCvCamera,
    PairedPicture as PairedPicture,
    Picture as Picture,
    Shot as Shot,
)
from .client import Client as Client, connect as connect
from .commands import (
    Report as Report,
    compare as compare,
    experiment as experiment,
    identify as identify,
    refine as refine,
    report as report,
)
from .connection import running_sockets as running_sockets, stop_all as stop_all
from .controllet import Controllet as Controllet
from .episode import Episode as Episode, LoggedEpisode as LoggedEpisode
from .errors import (
    Disconnected as Disconnected,
    Error as Error,
    ProgramMissing as ProgramMissing,
    Refused as Refused,
    Timeout as Timeout,
    VersionMismatch as VersionMismatch,
)
from .follow import Event as Event, Events as Events, Records as Records
from .goal import Goal as Goal
from .jog import JogLimits as JogLimits
from .law import Evaluation as Evaluation, Law as Law, PlacedLaw as PlacedLaw, law as law
from .law_layout import LawInput as LawInput, LawParameter as LawParameter
from .log import Log as Log, read_log as read_log
from .model import ArmModel as ArmModel, model as model
from .notebook import live_table as live_table
from .parameters import Parameter as Parameter
from .picture_log import LoggedPicture as LoggedPicture, read_pictures as read_pictures
from .pose import Pose as Pose
from .program import program_path as program_path
from .record import History as History, Record as Record
from .scene_camera import SceneCamera as SceneCamera, SceneView as SceneView
from .space_mouse import SpaceMouse as SpaceMouse
from .ssh import Clock as Clock
from .started import Run as Run, Summary as Summary, play as play, run as run
from .state import ArmState as ArmState, GripperState as GripperState, RunState as RunState
from .stream import Stream as Stream
from .stubs import stubs as stubs
from .study import StudyResult as StudyResult, study as study
from .virtual import VirtualArms as VirtualArms, virtual_arms as virtual_arms
