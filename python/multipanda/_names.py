"""The public names, which `import multipanda` loads when the first of them is used."""

from ._version import __version__
from .arm import Arm, Gripper, Vacuum
from .camera import Camera, Cameras, LeRobotCamera, OpenCvCamera, PairedPicture, Picture, Shot
from .client import Client, connect
from .commands import Report, compare, experiment, identify, refine, report
from .connection import running_sockets, stop_all
from .controllet import Controllet
from .episode import Episode, LoggedEpisode
from .errors import Disconnected, Error, ProgramMissing, Refused, Timeout, VersionMismatch
from .follow import Event, Events, Records
from .goal import Goal
from .jog import JogLimits
from .law import Evaluation, Law, PlacedLaw, law
from .law_layout import LawInput, LawParameter
from .log import Log, read_log
from .model import ArmModel, model
from .notebook import live_table
from .parameters import Parameter
from .picture_log import LoggedPicture, read_pictures
from .pose import Pose
from .program import program_path
from .record import History, Record
from .scene_camera import SceneCamera, SceneView
from .space_mouse import SpaceMouse
from .ssh import Clock
from .started import Run, Summary, play, run
from .state import ArmState, GripperState, RunState
from .stream import Stream
from .stubs import stubs
from .study import StudyResult, study
from .virtual import VirtualArms, virtual_arms

__all__ = [
    "Arm",
    "ArmModel",
    "ArmState",
    "Camera",
    "Cameras",
    "Client",
    "Clock",
    "Controllet",
    "Disconnected",
    "Episode",
    "Error",
    "Evaluation",
    "Event",
    "Events",
    "Goal",
    "Gripper",
    "GripperState",
    "History",
    "JogLimits",
    "Law",
    "LawInput",
    "LawParameter",
    "LeRobotCamera",
    "Log",
    "LoggedEpisode",
    "LoggedPicture",
    "OpenCvCamera",
    "PairedPicture",
    "Parameter",
    "Picture",
    "PlacedLaw",
    "Pose",
    "ProgramMissing",
    "Record",
    "Records",
    "Refused",
    "Report",
    "Run",
    "RunState",
    "SceneCamera",
    "SceneView",
    "Shot",
    "SpaceMouse",
    "Stream",
    "StudyResult",
    "Summary",
    "Timeout",
    "Vacuum",
    "VersionMismatch",
    "VirtualArms",
    "__version__",
    "compare",
    "connect",
    "experiment",
    "identify",
    "law",
    "live_table",
    "model",
    "play",
    "program_path",
    "read_log",
    "read_pictures",
    "refine",
    "report",
    "run",
    "running_sockets",
    "stop_all",
    "stubs",
    "study",
    "virtual_arms",
]
