"""The layers of the project: every folder, what it is for, and which folders its files may include.

Each layer may use only layers listed above it in this table. A file belongs to the layer with the longest
matching path; folders without a row of their own belong to their parent's. tools/check_layers.py checks the tree
against this table and writes the table into the pages that show it.
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
    layer("core/record", "the record of a cycle: ring of records and events", "core/types core/rt"),
    layer(
        "core/state",
        "the state of one arm, and the force estimated from it ([forces.md](docs/forces.md))",
        "core/types",
    ),
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
    layer("support", "child processes, machine description, signals, text helpers"),
    layer("device", "the contract of an arm: its interface, errors and settings", "core"),
    layer("config_file", "the reader of all YAML files: keys are declared once, read, checked, documented", "support"),
    layer(
        "models",
        "robot parameters as data; URDF and MJCF made from them",
        "support config_file core/types core/model",
    ),
    layer("scene", "scene files: read, checked, built", "support config_file core models"),
    layer("logs", "MCAP files: write, read, repair, export", "core"),
    layer("backends", "the view of a simulated world that a backend may offer", "core", "scene logs backends"),
    layer(
        "backends/simulated_arm",
        "the behavior of a simulated arm: modes, checks, reflexes, internal controllers",
        "core device models scene",
        "backends/mujoco",
    ),
    layer("backends/gripper", "the behavior of simulated grippers", "core", "scene backends/mujoco"),
    layer(
        "backends/mujoco",
        "contact physics of simulated arms",
        "core device models scene backends backends/simulated_arm backends/gripper",
        "backends/pinocchio",
    ),
    layer(
        "backends/pinocchio",
        "contact-free reference integrator",
        "core models scene backends/simulated_arm",
    ),
    layer("backends/replay", "a recorded log as a backend", "core logs"),
    layer("fci/wire", "the arm's control interface: bytes of messages ([fci.md](docs/fci.md))", "core"),
    layer("fci/model", "the interface's model library, as arms send it", "core models"),
    layer(
        "fci/server",
        "[virtual arms](docs/virtual_arm.md)",
        "core device models scene backends/simulated_arm backends/gripper backends/mujoco fci/wire fci/model",
    ),
    layer(
        "fci/client",
        "the client for [real arms](docs/real_arms.md), all arms in one loop",
        "core device scene fci/wire",
        "backends/mujoco fci/model fci/server",
    ),
    layer(
        "fci/simulated_time",
        "virtual arms and the client of real arms without sockets and clocks: an event queue"
        " ([simulated_time.md](docs/simulated_time.md))",
        "core device scene backends/simulated_arm backends/mujoco fci/wire fci/server fci/client",
    ),
    layer(
        "report",
        "reports of runs: Python pages made from exported logs, and the export",
        "support core scene logs backends/mujoco",
    ),
    layer(
        "soak",
        "endurance runs: a scene under faults, every cycle checked ([soak.md](docs/soak.md))",
        "core device scene logs backends/simulated_arm backends/mujoco fci/simulated_time",
    ),
    layer(
        "runtime",
        "a run: loop thread, writer thread, live input",
        "support core device scene logs backends backends/simulated_arm backends/mujoco"
        " backends/pinocchio backends/replay "
        "fci/server fci/client",
    ),
    layer(
        "runtime/embedded",
        "a cycle that another program's loop drives",
        "support core device models scene backends/mujoco fci/client runtime",
        "backends/simulated_arm fci/server",
    ),
    layer(
        "runtime/motion",
        "motions of one arm through its controllet's inputs ([arm_motion.md](docs/arm_motion.md))",
        "core scene runtime",
        "backends/mujoco",
    ),
    layer("cockpit/wire", "what browsers speak: HTTP/1.1 and WebSockets ([cockpit_wire.md](docs/cockpit_wire.md))"),
    layer(
        "cockpit/server",
        "the thread of the [cockpit](docs/cockpit.md): connections, token, limits, control",
        "support core/types cockpit/wire",
    ),
    layer("cockpit/view", "what is drawn of a scene", "core models scene"),
    layer(
        "cockpit",
        "what the cockpit shows, and who may command",
        "support core device models scene logs backends/mujoco fci/server runtime cockpit/wire cockpit/server"
        " cockpit/view",
        "backends/mujoco",
    ),
    layer("benchmarks/bare", "a law with the libraries alone: the yardstick of a control cycle", "core"),
    layer(
        "experiments",
        "experiments as data, their runners and pages ([experiments.md](docs/experiments.md))",
        "support config_file core device scene logs backends report runtime runtime/motion benchmarks/bare",
    ),
    layer(
        "study",
        "studies: tables of runs, and what runs one ([studies.md](docs/studies.md))",
        "support config_file core models scene logs backends runtime experiments",
    ),
    layer(
        "native",
        "worlds with their control loops, stepped by Python ([native.md](docs/native.md))",
        "support core device scene backends/mujoco runtime",
    ),
    layer(
        "motion_generators",
        "motion generators, each a process of its own ([motion_generator.md](docs/motion_generator.md))",
        "support config_file core models runtime",
    ),
    layer(
        "doctor",
        "diagnosis of computer, network and arms ([doctor.md](docs/doctor.md))",
        "support core device scene backends/mujoco fci/wire fci/client runtime",
    ),
    layer(
        "commission",
        "the first hour with real arms, step by step ([commission.md](docs/commission.md))",
        "support core device models scene fci/wire fci/client report runtime doctor",
    ),
    layer("sysid/measured", "logs of any source as plain numbers", "config_file core scene logs"),
    layer(
        "sysid/identification",
        "parameters of an arm from its logs ([identification.md](docs/identification.md))",
        "support core models scene backends/simulated_arm backends/mujoco report sysid/measured",
    ),
    layer(
        "sysid/comparison",
        "differences between logs ([compare.md](docs/compare.md))",
        "support logs report sysid/measured sysid/identification",
    ),
    layer(
        "sysid/excitation",
        "motions that excite an arm's parameters ([excitation.md](docs/excitation.md))",
        "config_file core models scene",
    ),
    layer(
        "sysid/refine",
        "the whole loop of sim to real for one task ([refine.md](docs/refine.md))",
        "support config_file core models scene report runtime experiments"
        " sysid/measured sysid/identification sysid/comparison sysid/excitation",
    ),
    layer("ros/rcl", "C++ layer on the C library of ROS 2", "support"),
    layer(
        "ros/adapter",
        "topics, services and actions of a run; a module loaded by `run --ros` only ([ros2.md](docs/ros2.md))",
        "support core device models scene logs backends runtime runtime/motion ros/rcl",
        "backends/mujoco",
    ),
    layer("ros/generators", "motion generators as ROS nodes", "support models motion_generators ros/rcl"),
    layer(
        "ros/host",
        "multipanda inside ros2_control ([ros2_control.md](docs/ros2_control.md))",
        "support device models scene runtime runtime/embedded ros/rcl ros/adapter",
    ),
    layer("ros", "ROS packages and their tests", "ros/host"),
    layer(
        "cli",
        "the program `multipanda`; uses ROS only through the loaded module",
        "support config_file core models scene logs fci/server report runtime cockpit experiments motion_generators"
        " doctor commission sysid/measured sysid/identification sysid/comparison sysid/excitation sysid/refine soak"
        " study",
    ),
    layer(
        "benchmarks",
        "the program behind `multipanda bench`",
        "support core models scene logs backends/mujoco runtime native ros/rcl benchmarks/bare",
    ),
    layer("examples", "starting points for users, each built and run by the tests", "core fci/client ros/adapter"),
    layer("tests", "tests across folders"),
]

# Third-party headers that only some layers may include (the beginning of the header's path).
LIBRARIES = {
    "mujoco": "support backends/mujoco sysid/identification benchmarks",
    "pinocchio": "core/model sysid/identification benchmarks/bare",
    "yaml-cpp": "config_file models scene runtime/embedded experiments study commission sysid/measured sysid/comparison"
    " sysid/refine",
    "nlohmann": "config_file scene logs report soak runtime runtime/embedded cockpit cockpit/server cockpit/view"
    " experiments study native motion_generators doctor commission sysid/identification sysid/comparison"
    " sysid/refine cli benchmarks",
    "CLI": "cli benchmarks",
    "fmt": "soak runtime runtime/motion cockpit/wire cockpit/server experiments study doctor commission"
    " sysid/identification sysid/comparison sysid/excitation sysid/refine ros/adapter cli benchmarks",
    "rcl": "ros/rcl ros/host ros benchmarks",
    "rmw": "ros/rcl",
    "rclcpp": "ros",
}
