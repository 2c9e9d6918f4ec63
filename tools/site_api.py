"""The pages of the Python reference: assigns public names to pages. mkdocstrings writes the rest."""

from typing import NamedTuple


class Page(NamedTuple):
    title: str
    text: str
    names: tuple[str, ...]  # in `multipanda` or below, with its module


PAGES = {
    "runs": Page(
        "Runs",
        "Starts a scene or attaches to one, and commands it.",
        (
            "run",
            "play",
            "connect",
            "Run",
            "Client",
            "base_client.BaseClient",
            "Summary",
            "RunState",
            "stop_all",
            "running_sockets",
            "Clock",
            "program_path",
        ),
    ),
    "arms": Page(
        "Arms",
        "One arm of a run, its state and its gripper. Units are in the names: meters, radians, seconds, newtons.",
        ("Arm", "ArmState", "Pose", "ArmModel", "model", "Gripper", "GripperState", "Vacuum"),
    ),
    "records": Page(
        "Records and events",
        "Every cycle and every event of a run, from shared memory; episodes mark attempts at a task.",
        ("Record", "Records", "History", "Event", "Events", "Episode", "LoggedEpisode"),
    ),
    "controllets": Page(
        "Controllets",
        "A control law of the scene: parameters, features, goals, streams and a SpaceMouse. Which parameters a"
        " controllet has depends on the scene: `help()` of it, and `stubs()`, show them with units and bounds.",
        (
            "Controllet",
            "instance.Instance",
            "controllet.Feature",
            "Parameter",
            "Goal",
            "Stream",
            "SpaceMouse",
            "JogLimits",
            "stubs",
        ),
    ),
    "laws": Page(
        "Laws",
        "Control laws in Python, compiled into the loop. The guide is [Laws in Python](../python_laws.md).",
        ("law", "Law", "PlacedLaw", "LawParameter", "LawInput", "Evaluation", "law_math"),
    ),
    "cameras": Page(
        "Cameras",
        "Pictures beside a run, drawn or real, with the state of their instant. The guide is [Cameras](../cameras.md).",
        (
            "Cameras",
            "SceneCamera",
            "OpenCvCamera",
            "LeRobotCamera",
            "Camera",
            "Shot",
            "Picture",
            "PairedPicture",
            "SceneView",
            "read_pictures",
            "LoggedPicture",
        ),
    ),
    "logs": Page(
        "Logs and commands",
        "Reads recorded runs, and calls the program's longer commands.",
        ("read_log", "Log", "report", "Report", "experiment", "compare", "identify", "refine", "study", "StudyResult"),
    ),
    "tests": Page(
        "Tests and notebooks",
        "Virtual arms for tests of your own programs, fixtures for pytest, asyncio, and a live table.",
        (
            "virtual_arms",
            "VirtualArms",
            "pytest_plugin.multipanda_run",
            "pytest_plugin.multipanda_virtual_arms",
            "aio",
            "live_table",
        ),
    ),
    "learning": Page(
        "Learning",
        "Tasks for policies and the mapping from actions to set-points, and what LeRobot's packages and"
        " leader arms are made of; the guides are [Learning](../learning.md), [LeRobot](../lerobot.md) and [Leader"
        " arms](../leader.md).",
        (
            "tasks.Task",
            "tasks.TaskArm",
            "tasks.Start",
            "tasks.Truth",
            "tasks.Judgment",
            "tasks.ArmStates",
            "tasks.ActionMapping",
            "tasks.Command",
            "tasks.Quantity",
            "tasks.PosePart",
            "tasks.JointsPart",
            "tasks.WrenchPart",
            "tasks.ScalarPart",
            "tasks.ParameterPart",
            "tasks.GripperPart",
            "tasks.drive.drive",
            "tasks.drive.Drive",
            "lerobot.RunSettings",
            "lerobot.RobotSettings",
            "lerobot.ArmsRobot",
            "lerobot.LeaderSettings",
            "lerobot.ArmsLeader",
            "lerobot.SpaceMouseSettings",
            "lerobot.SpaceMouseLeader",
            "lerobot.ServoLeaderSettings",
            "lerobot.ServoLeader",
            "leader.calibrate",
            "leader.drive",
            "servos.LeaderArm",
            "servos.Calibration",
            "pedal.Pedal",
        ),
    ),
    "native": Page(
        "Worlds",
        "Simulated worlds in your own process, in the package `multipanda_native`; the guide is"
        " [Worlds in Python](../learning.md#worlds-in-python).",
        (
            "multipanda_native.World",
            "multipanda_native.Batch",
            "multipanda_native.commands.Commands",
            "multipanda_native.Arm",
        ),
    ),
    "errors": Page(
        "Errors",
        "Every error has `cause` and `next_step`.",
        ("Error", "Refused", "Timeout", "Disconnected", "VersionMismatch", "ProgramMissing"),
    ),
}


def full_name(entry):
    """A name with its package; default: multipanda."""
    return entry if entry.startswith("multipanda_") else f"multipanda.{entry}"


def pages(package):
    """Markdown of each page, by its path in the site; none in a tree without the package's folder."""
    result = {}
    if not package.exists():
        return result
    for name, page in PAGES.items():
        lines = [f"# {page.title}", "", page.text, ""]
        lines += [f"::: {full_name(entry)}\n" for entry in page.names]
        result[f"python_api/{name}.md"] = "\n".join(lines)
    return result
