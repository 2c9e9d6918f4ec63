"""The layers of the project: every folder, what it is for, and which folders its files may include.

Each layer may use only layers listed above it in this table. A file belongs to the layer with the longest
matching path; folders without a row of their own belong to their parent's. tools/check_layers.py checks the tree
against this table.
"""

from typing import NamedTuple


class Layer(NamedTuple):
    folder: str
    role: str
    uses: tuple[str, ...] = ()  # layers that its files may include; "core" stands for every folder of core
    tests_use: tuple[str, ...] = ()  # layers that only its tests may include, wherever these are in the table


def layer(folder, role, uses="", tests_use=""):
    return Layer(folder, role, tuple(uses.split()), tuple(tests_use.split()))


LAYERS = [
    layer("core/types", "poses, joint vectors, sets of arms, result codes, clocks"),
    layer("core/geometry", "convex shapes, obstacles, distances and closest points", "core/types"),
    layer("core/rt", "triple buffer, ring, pacer, thread set-up; the guard of the tests", "core/types"),
    layer("core/trajectory", "quintic pieces, motions of joints and poses within limits", "core/types"),
    layer(
        "core/state",
        "the state of one arm, and the force estimated from it",
        "core/types",
    ),
    layer("core/record", "the record of a cycle: ring of records and events", "core/types core/rt core/state"),
    layer(
        "core/model",
        "`ArmModel` (fixed) and `ModelTerms` (per cycle, on demand); the only folder that includes Pinocchio",
        "core/types core/geometry core/state",
    ),
    layer(
        "core/reference",
        "continuous set-points made from targets; every target passes here",
        "core/types core/rt core/trajectory",
    ),
    layer(
        "core/controllets",
        "one control law per pair of files, and its descriptor",
        "core/types core/state core/model core/reference",
    ),
    layer("core/features", "torques added to any controllet's", "core/types core/geometry core/controllets"),
    layer("core/safety", "the last stage before the torques are written", "core/types core/state core/model"),
    layer(
        "core/modes",
        "the multimode controller: registry, ownership, switching, requests",
        "core/types core/rt core/record core/state core/model core/reference core/controllets"
        " core/features core/safety",
    ),
    layer(
        "core/cycle",
        "the control cycle, and the contract of backends",
        "core/types core/geometry core/state core/model core/record core/safety core/modes",
    ),
    layer(
        "core/plugin",
        "users' libraries: what they export, and the check that they fit",
        "core/types core/state core/model core/reference core/controllets core/modes core/cycle",
    ),
    layer("core/testing", "an arm, a world and laws that the tests of every folder share", "core"),
    layer("common", "child processes, machine description, signals, text helpers"),
    layer("arm_interface", "the contract of an arm: its interface, errors and settings", "core"),
    layer("yaml_reader", "the reader of all YAML files: keys are declared once, read, checked, documented", "common"),
    layer(
        "models",
        "robot parameters as data; URDF and MJCF made from them",
        "common yaml_reader core/types core/geometry core/model",
    ),
    layer("scene", "scene files: read, checked, built", "common yaml_reader core models"),
    layer("logs", "MCAP files: write, read, repair, export", "core"),
    layer("backends", "the view of a simulated world that a backend may offer", "core", "scene logs backends"),
    layer(
        "backends/simulated_arm",
        "the behavior of a simulated arm: modes, checks, reflexes, internal controllers",
        "core arm_interface models scene",
        "backends/mujoco",
    ),
    layer("backends/gripper", "the behavior of simulated grippers", "core", "scene backends/mujoco"),
    layer(
        "backends/mujoco",
        "contact physics of simulated arms",
        "common core arm_interface models scene backends backends/simulated_arm backends/gripper",
        "backends/pinocchio",
    ),
    layer(
        "backends/pinocchio",
        "contact-free reference integrator",
        "core models scene backends/simulated_arm",
    ),
    layer("backends/replay", "a recorded log as a backend", "core logs"),
    layer("fci/wire", "the arm's control interface: bytes of messages", "core"),
    layer("fci/model", "the interface's model library, as arms send it", "core models"),
    layer(
        "fci/server",
        "virtual arms",
        "core arm_interface models scene backends/simulated_arm backends/gripper backends/mujoco fci/wire fci/model",
    ),
    layer(
        "fci/client",
        "the client for real arms, all arms in one loop",
        "core arm_interface scene fci/wire",
        "backends/mujoco fci/model fci/server",
    ),
    layer(
        "fci/simulated_time",
        "virtual arms and the client of real arms without sockets and clocks: an event queue",
        "core arm_interface scene backends/simulated_arm backends/mujoco fci/wire fci/server fci/client",
    ),
    layer(
        "report",
        "reports of runs: Python pages made from exported logs, and the export",
        "common core scene logs backends/mujoco",
    ),
    layer(
        "benchmarks/soak",
        "endurance runs under faults, every cycle checked",
        "core arm_interface scene logs backends/simulated_arm backends/mujoco fci/simulated_time",
    ),
    layer(
        "runtime",
        "a run: loop thread, writer thread, live input",
        "common core arm_interface scene logs backends backends/simulated_arm backends/mujoco backends/pinocchio "
        "backends/replay fci/server fci/client",
    ),
    layer(
        "runtime/embedded",
        "a cycle that another program's loop drives",
        "common core arm_interface models scene backends/mujoco fci/client runtime",
        "backends/simulated_arm fci/server",
    ),
    layer(
        "runtime/motion",
        "motions of one arm through its controllet's inputs",
        "core scene runtime",
        "backends/mujoco",
    ),
    layer(
        "cockpit/server",
        "the page server of the cockpit, a process of its own, and the thread that reads it",
        "common core/types",
    ),
    layer("cockpit/view", "drawing data of a scene", "core models scene"),
    layer(
        "cockpit",
        "contents and control of the cockpit",
        "common core arm_interface models scene logs backends/mujoco fci/server runtime cockpit/server cockpit/view",
        "backends/mujoco",
    ),
    layer("benchmarks/bare", "a law with the libraries alone: the baseline of a control cycle", "core"),
    layer(
        "experiments",
        "experiments as data, their runners and pages",
        "common yaml_reader core arm_interface scene logs backends report runtime runtime/motion benchmarks/bare",
    ),
    layer(
        "experiments/study",
        "studies: tables of runs, and what runs one",
        "common yaml_reader core models scene logs backends runtime experiments",
    ),
    layer(
        "python_bindings",
        "worlds with their control loops, stepped by Python",
        "common core arm_interface scene backends/mujoco runtime",
    ),
    layer(
        "motion_generators",
        "motion generators, each a process of its own",
        "common yaml_reader core models runtime",
    ),
    layer(
        "doctor",
        "diagnosis of computer, network and arms",
        "common core arm_interface scene backends/mujoco fci/wire fci/client runtime",
    ),
    layer(
        "commission",
        "the first hour with real arms, step by step",
        "common core arm_interface models scene fci/wire fci/client report runtime doctor",
    ),
    layer("sysid/measured", "logs of any source as plain numbers", "common yaml_reader core scene logs"),
    layer(
        "sysid/identification",
        "parameters of an arm from its logs",
        "common core models scene backends/simulated_arm backends/mujoco report sysid/measured",
    ),
    layer(
        "sysid/comparison",
        "differences between logs",
        "common logs report sysid/measured sysid/identification",
    ),
    layer(
        "sysid/excitation",
        "motions that excite an arm's parameters",
        "common yaml_reader core models scene",
    ),
    layer(
        "sysid/refine",
        "the whole loop of sim to real for one task",
        "common yaml_reader core models scene report runtime experiments"
        " sysid/measured sysid/identification sysid/comparison sysid/excitation",
    ),
    layer("ros/rcl", "C++ layer on the C library of ROS 2", "common core/types"),
    layer(
        "ros/adapter",
        "topics, services and actions of a run; a module loaded by `run --ros` only",
        "common core arm_interface models scene logs backends runtime runtime/motion ros/rcl",
        "backends/mujoco",
    ),
    layer("ros/generators", "motion generators as ROS nodes", "common models motion_generators ros/rcl"),
    layer(
        "ros/host",
        "multipanda inside ros2_control",
        "common arm_interface models scene runtime runtime/embedded ros/rcl ros/adapter",
    ),
    layer("ros", "ROS packages and their tests", "ros/host"),
    layer(
        "cli",
        "the program `multipanda`; uses ROS only through the loaded module",
        "common yaml_reader core models scene logs backends/mujoco fci/server report runtime cockpit experiments"
        " motion_generators doctor commission sysid/measured sysid/identification sysid/comparison sysid/excitation"
        " sysid/refine benchmarks/soak experiments/study",
    ),
    layer(
        "benchmarks",
        "the program behind `multipanda bench`",
        "common core models scene logs backends/mujoco fci/wire runtime python_bindings ros/rcl benchmarks/bare",
    ),
    layer("examples", "starting points for users, each built and run by the tests", "core fci/client ros/adapter"),
    layer("tests", "tests across folders"),
]

# Third-party headers that only some layers may include (the beginning of the header's path).
LIBRARIES = {
    "mujoco": "common backends/mujoco sysid/identification benchmarks",
    "pinocchio": "core/model sysid/identification benchmarks/bare",
    "yaml-cpp": "yaml_reader models scene runtime/embedded experiments experiments/study commission sysid/measured"
    " sysid/comparison sysid/refine",
    "nlohmann": "yaml_reader scene logs report benchmarks/soak runtime runtime/embedded cockpit cockpit/server"
    " cockpit/view experiments experiments/study python_bindings motion_generators doctor commission"
    " sysid/identification sysid/comparison sysid/refine cli benchmarks",
    "CLI": "cli benchmarks",
    "fmt": "common scene benchmarks/soak runtime runtime/motion cockpit/server experiments"
    " experiments/study doctor commission sysid/identification sysid/comparison sysid/excitation sysid/refine"
    " ros/adapter cli benchmarks",
    "rcl": "ros/rcl ros/host ros benchmarks",
    "rmw": "ros/rcl",
    "rclcpp": "ros",
}
