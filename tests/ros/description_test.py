"""Tests the ROS packages for description, bringup and MoveIt.

Expands their xacros and compares their files with each other and with the models. Needs xacro (PyPI) but no ROS; tries
launch files if the package `launch` is installed.
"""

import functools
import importlib.util
import itertools
import json
import math
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import unittest
import unittest.mock
import xml.etree.ElementTree as ET

import numpy as np
import yaml

try:
    import xacro
except ImportError:
    print("skipped: xacro is not installed, which expands the ROS description")
    sys.exit(77)

ROOT = pathlib.Path(__file__).resolve().parents[2]
ROS = ROOT / "ros"
URDF = ROS / "multipanda_description" / "urdf"
sys.path.insert(0, str(ROS / "multipanda_bringup"))
from multipanda_bringup import arms as bringup

LAYOUTS = {
    "single": ["arm"],
    "dual": ["left", "right"],
    "mixed": ["left", "right"],
    "four_arms": ["near_left", "near_right", "far_left", "far_right"],
}


@functools.cache
def expand(file, **mappings):
    return ET.fromstring(xacro.process_file(str(file), mappings=mappings).toxml())


def numbers(text):
    return np.array([float(x) for x in text.split()])


def rotation(rpy):
    (a, b, c), (s, t, u) = np.cos(rpy), np.sin(rpy)
    return np.array(
        [
            [b * c, s * t * c - a * u, a * t * c + s * u],
            [b * u, s * t * u + a * c, a * t * u - s * c],
            [-t, s * b, a * b],
        ]
    )


def pose(element):
    X = np.eye(4)
    origin = element.find("origin")
    if origin is not None:
        X[:3, :3] = rotation(numbers(origin.get("rpy", "0 0 0")))
        X[:3, 3] = numbers(origin.get("xyz", "0 0 0"))
    return X


class Robot:
    """A URDF: poses of all links, and the mass matrix by plain sums."""

    def __init__(self, root):
        self.joints = {j.get("name"): j for j in root.findall("joint")}
        self.links = {link.get("name"): link for link in root.findall("link")}
        self.parent = {j.find("child").get("link"): j for j in self.joints.values()}
        (self.root,) = set(self.links) - set(self.parent)

    def chain(self, link):
        """Returns the joints from the root to `link`."""
        found = []
        while link != self.root:
            found.insert(0, self.parent[link])
            link = found[0].find("parent").get("link")
        return found

    def pose(self, link, q):
        X = np.eye(4)
        for joint in self.chain(link):
            X = X @ pose(joint) @ self.moved(joint, q.get(joint.get("name"), 0.0))
        return X

    @staticmethod
    def moved(joint, q):
        X = np.eye(4)
        if joint.get("type") == "fixed":
            return X
        axis = numbers(joint.find("axis").get("xyz"))
        if joint.get("type") == "prismatic":
            X[:3, 3] = axis * q
        else:
            K = np.cross(np.eye(3), axis)
            X[:3, :3] = np.eye(3) - math.sin(q) * K + (1 - math.cos(q)) * K @ K
        return X

    def kinetic_energy(self, q, dq, h=1e-6):
        """Returns the kinetic energy of all links. Velocities are central differences of poses, independent of M."""
        energy = 0.0
        for name, link in self.links.items():
            inertial = link.find("inertial")
            if inertial is None:
                continue
            X_LC = pose(inertial)
            before, after = ({j: q.get(j, 0.0) + s * h * dq.get(j, 0.0) for j in set(q) | set(dq)} for s in (-1, 1))
            A, B = self.pose(name, before) @ X_LC, self.pose(name, after) @ X_LC
            v = (B[:3, 3] - A[:3, 3]) / (2 * h)
            S = (B[:3, :3] - A[:3, :3]) / (2 * h) @ ((A[:3, :3] + B[:3, :3]) / 2).T
            omega = np.array([S[2, 1] - S[1, 2], S[0, 2] - S[2, 0], S[1, 0] - S[0, 1]]) / 2
            i = inertial.find("inertia").attrib
            I = np.array(
                [[i["ixx"], i["ixy"], i["ixz"]], [i["ixy"], i["iyy"], i["iyz"]], [i["ixz"], i["iyz"], i["izz"]]], float
            )
            R = self.pose(name, q)[:3, :3] @ X_LC[:3, :3]
            mass = float(inertial.find("mass").get("value"))
            energy += 0.5 * mass * v @ v + 0.5 * omega @ R @ I @ R.T @ omega
        return energy


class Description(unittest.TestCase):
    def test_every_layout_is_the_models_arms(self):
        rng = np.random.default_rng(5)
        for layout, names in LAYOUTS.items():
            robot = Robot(expand(URDF / f"{layout}.urdf.xacro"))
            self.assertEqual(robot.root, "world")
            model = Robot(ET.parse(ROOT / "models/generated/fer_hand.urdf").getroot())
            for name in names:
                with self.subTest(layout=layout, arm=name):
                    self.compare(robot, model, name, rng)

    def test_other_models_without_hand(self):
        rng = np.random.default_rng(6)
        for model in ("fr3", "fr3v2"):
            robot = Robot(
                expand(
                    URDF / "arms.urdf.xacro",
                    arm_names="a b",
                    models=f"fer {model}",
                    hands="true false",
                    bases="[[0,0,0,0,0,0],[0.3,-1,0.5,0.4,-0.2,2]]",
                )
            )
            self.assertNotIn("b_hand", robot.links)
            self.compare(
                robot, Robot(ET.parse(ROOT / f"models/generated/{model}.urdf").getroot()), "b", rng, hand=False
            )

    def compare(self, robot, model, name, rng, hand=True):
        joints = [f"joint{i}" for i in range(1, 8)]
        for joint in joints:
            ours, theirs = robot.joints[f"{name}_{joint}"], model.joints[joint]
            self.assertEqual(ours.find("limit").attrib, theirs.find("limit").attrib)
        X_WB = robot.pose(f"{name}_link0", {})
        frames = [(f"link{i}", f"link{i}") for i in range(8)] + [("link8", "flange")]
        frames += [("hand", "hand"), ("hand_tcp", "hand_tcp")] if hand else []
        for _ in range(5):
            q = dict(zip(joints, rng.uniform(-1.5, 1.5, 7)))
            dq = dict(zip(joints, rng.uniform(-2, 2, 7)))
            ours = {f"{name}_{j}": value for j, value in q.items()}
            for link, frame in frames:
                np.testing.assert_allclose(robot.pose(f"{name}_{link}", ours), X_WB @ model.pose(frame, q), atol=1e-12)
            # Palm and sliding fingers, closed, move like the model's rigid hand: compare the kinetic energy of this
            # arm alone.
            energy = robot.kinetic_energy(ours, {f"{name}_{j}": value for j, value in dq.items()})
            self.assertGreater(energy, 0.01)
            self.assertAlmostEqual(energy, model.kinetic_energy(q, dq), delta=1e-6 * energy)

    def test_ros2_control_has_every_arm_once_with_its_joints(self):
        for layout, names in LAYOUTS.items():
            root = expand(URDF / f"{layout}.urdf.xacro")
            urdf_joints = {j.get("name") for j in root.findall("joint")}
            kinds = {c.find("hardware/plugin").text: c for c in root.findall("ros2_control")}
            expected = {"multipanda_hardware/MujocoSystem"} | (
                {"multipanda_hardware/FciSystem"} if layout == "mixed" else set()
            )
            self.assertEqual(set(kinds), expected)
            found = []
            for component in kinds.values():
                params = {p.get("name"): "".join(p.itertext()) for p in component.findall("hardware/param")}
                here = params["arm_names"].split()
                found += here
                self.assertEqual(
                    [j.get("name") for j in component.findall("joint")],
                    [f"{a}_joint{i}" for a in here for i in range(1, 8)],
                )
                for joint in component.findall("joint"):
                    self.assertIn(joint.get("name"), urdf_joints)
                    self.assertEqual(
                        {i.get("name") for i in joint.findall("command_interface")}, {"position", "velocity", "effort"}
                    )
                robot = Robot(root)
                for arm in here:  # the hardware's base is the description's
                    X = np.eye(4)
                    X[:3, 3] = yaml.safe_load(params[f"arms.{arm}.base.position_m"])
                    X[:3, :3] = rotation(np.array(yaml.safe_load(params[f"arms.{arm}.base.rpy_rad"]), float))
                    np.testing.assert_allclose(robot.pose(f"{arm}_link0", {}), X, atol=1e-12)
                    simulated = "Mujoco" in component.find("hardware/plugin").text
                    self.assertEqual(f"arms.{arm}.fci" in params, not simulated)
                    self.assertEqual(
                        params.get(f"arms.{arm}.fingers"), "movable" if simulated else None
                    )  # otherwise no gripper
            self.assertEqual(sorted(found), sorted(names))

    def test_bases_of_launch_files_and_xacro_are_the_same(self):
        for count in range(1, 6):
            names = [f"a{i}" for i in range(count)]
            robot = Robot(expand(URDF / "arms.urdf.xacro", arm_names=" ".join(names)))
            for name, base in zip(names, bringup.default_bases(count)):
                np.testing.assert_allclose(robot.pose(f"{name}_link0", {})[:3, 3], base[:3], atol=1e-12)

    def test_wrong_lists_are_refused(self):
        with self.assertRaises(xacro.XacroException):
            expand(URDF / "arms.urdf.xacro", arm_names="a b c", models="fer fr3")


def controllers_of(file, names, **more):
    data = yaml.safe_load((ROS / "multipanda_bringup/config" / file).read_text())
    return bringup.controllers(data, bringup.arms_from(" ".join(names), **more))


class Bringup(unittest.TestCase):
    FILES = {
        "one_arm.yaml": LAYOUTS["single"],
        "two_arms.yaml": LAYOUTS["dual"],
        "mixed.yaml": LAYOUTS["mixed"],
        "three_arms.yaml": ["left", "right", "third"],
        "four_arms.yaml": LAYOUTS["four_arms"],
    }

    def test_every_controller_fits_the_description(self):
        for file, defaults in self.FILES.items():
            for names in (defaults, [f"robot{i}" for i in range(len(defaults))]):
                with self.subTest(file=file, names=names):
                    data, started, loaded = controllers_of(file, names)
                    root = expand(URDF / "arms.urdf.xacro", arm_names=" ".join(names))
                    joints = {j.get("name") for c in root.findall("ros2_control") for j in c.findall("joint")}
                    manager = data["controller_manager"]["ros__parameters"]
                    self.assertEqual(manager["update_rate"], 1000)
                    self.assertEqual({"controller_manager", *started, *loaded}, set(data))
                    owned = []
                    for name in [*started, *loaded]:
                        parameters = data[name]["ros__parameters"]
                        self.assertIn("type", manager[name])
                        self.assertLessEqual(set(parameters.get("joints", [])), joints)
                        if "controllets" in parameters:
                            self.check_multimode(parameters, names)
                        if name in started and name != "joint_state_broadcaster":
                            owned += parameters.get("arm_names") or [name.removesuffix("_arm_controller")]
                    self.assertEqual(sorted(owned), sorted(names))  # each arm has one owner at the start
                    for name in names:  # for MoveIt
                        self.assertEqual(
                            data[f"{name}_arm_controller"]["ros__parameters"]["joints"],
                            [f"{name}_joint{i}" for i in range(1, 8)],
                        )

    def check_multimode(self, parameters, names):
        known = (ROOT / "docs/scene_reference.md").read_text()
        self.assertEqual(set(parameters["arms"]), set(parameters["arm_names"]))
        self.assertLessEqual(set(parameters["arm_names"]), set(names))
        for instance in parameters["controllets"].values():
            self.assertLessEqual(set(instance["arms"]), set(names))
            self.assertIn(f"### {instance['type']}\n", known)
        self.assertLessEqual(set(parameters["active"]), set(parameters["controllets"]))
        owners = [arm for name in parameters["active"] for arm in parameters["controllets"][name]["arms"]]
        self.assertEqual(sorted(owners), sorted(parameters["arm_names"]))

    def test_performance_is_measured_as_in_its_experiment(self):
        """The laws, gains and objects of the experiment's scene; features are those of its first condition."""
        data, started, loaded = controllers_of("performance.yaml", ["left", "right"])
        self.assertEqual((started, loaded), (["joint_state_broadcaster", "multimode_controller"], []))
        parameters = data["multimode_controller"]["ros__parameters"]
        self.check_multimode(parameters, ["left", "right"])
        scene = yaml.safe_load((ROOT / "experiments/scenes/performance.yaml").read_text())
        for law in scene["controllets"]:
            given = parameters["controllets"][law["name"]]
            self.assertEqual(given, {key: law[key] for key in ("type", "arms", "parameters", "inputs")})
        for arm in scene["arms"]:
            self.assertEqual(parameters["arms"][arm["name"]]["base"]["position_m"], arm["base"]["position_m"])
        shapes = {o["name"]: {k: v for k, v in o.items() if k not in ("name", "color_rgba")} for o in scene["objects"]}
        self.assertEqual(parameters["objects"], shapes)
        experiment = yaml.safe_load((ROOT / "experiments/controller-performance.yaml").read_text())
        condition = experiment["settings"]["conditions"][0]
        trace = parameters["performance_trace"]
        self.assertEqual((trace["condition"], trace["controllet"]), (condition["name"], condition["controllet"]))
        self.assertEqual(parameters["active"], condition["set"]["active"])
        for key in ("duration_s", "lead_s"):
            self.assertEqual(trace[key], experiment["settings"][key])

    def test_every_law_is_offered(self):
        """One word per law of one arm, one per law of two: all types of the reference but those that need partners."""
        reference = (
            (ROOT / "docs/scene_reference.md").read_text().split("## Controllet types", 1)[1].split("\n## ", 1)[0]
        )
        types = set(re.findall(r"^### (\w+)$", reference, re.MULTILINE))
        followers = {"hold", "joint_follower", "pose_follower", "teleoperation"}  # hold is always there
        for file, names in self.FILES.items():
            if file == "mixed.yaml":
                continue
            data, _, _ = controllers_of(file, names)
            offered = data["multimode_controller"]["ros__parameters"]["controllets"].values()
            expected = types - followers
            if len(names) == 1:
                expected -= {"dual_cartesian_impedance", "coupled_dual_cartesian_impedance", "coupled_ufic"}
            self.assertEqual({instance["type"] for instance in offered}, expected, file)
            for name in names:
                self.assertEqual(
                    sum(name in c["arms"] for c in offered), 6 + 3 * (len(names) % 2 == 0 or name != names[-1])
                )

    def test_every_law_runs_on_simulated_arms(self):
        """The controllets of each default file are switched through in one run of the program, as a scene."""
        program = ROOT / "build" / "multipanda"
        if not program.exists():
            self.skipTest(f"{program} is not built")
        for file, names in self.FILES.items():
            data, _, _ = controllers_of(file, names)
            sections = [s["ros__parameters"] for s in data.values() if "controllets" in s["ros__parameters"]]
            controllets = {k: v for section in sections for k, v in section["controllets"].items()}
            arms = {k: v for section in sections for k, v in section["arms"].items()}
            switches = [
                {"at_s": round(0.1 * (k + 1), 3), "switch": {"activate": [name]}} for k, name in enumerate(controllets)
            ]
            scene = {
                "name": "bringup",
                "arms": [{"name": name, **arm} for name, arm in arms.items()],
                "controllets": [{"name": name, **controllet} for name, controllet in controllets.items()],
                "active": [name for section in sections for name in section["active"]],
                "timeline": switches,
            }
            with tempfile.TemporaryDirectory() as folder:
                path = pathlib.Path(folder) / "bringup.yaml"
                path.write_text(yaml.safe_dump(scene, sort_keys=False))
                seconds = str(0.1 * (len(switches) + 2))
                command = [program, "run", path, "--fast", "--seconds", seconds, "--json"]
                done = subprocess.run(command, capture_output=True, text=True, timeout=100)
            self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
            run = json.loads(done.stdout)
            self.assertTrue(run["success"])
            accepted = [switch["started"] + switch["kept"] for switch in run["switches"] if switch["accepted"]]
            for name, active in zip(controllets, accepted[1:], strict=True):
                self.assertIn(name, active)

    def test_arguments_are_checked(self):
        for wrong in (
            {"arm_names": "a a"},
            {"arm_names": ""},
            {"arm_names": "a b", "models": "fer fer fer"},
            {"arm_names": "a", "hardware": "fci"},
            {"arm_names": "a", "hardware": "gazebo"},
            {"arm_names": "a", "hands": "maybe"},
            {"arm_names": "a", "bases": "[[1, 2]]"},
            {"arm_names": "1a"},
        ):
            with self.assertRaises(ValueError, msg=str(wrong)):
                bringup.arms_from(**wrong)
        with self.assertRaises(ValueError):
            controllers_of("two_arms.yaml", ["a"])

    def test_arguments_reach_the_controller(self):
        data, _, _ = controllers_of(
            "two_arms.yaml",
            ["l", "r"],
            models="fr3",
            hands="true false",
            hardware="mock mujoco",
            bases="[[1,2,3,0,0,1],[0,0,0,0,0,0]]",
        )
        arms = data["multimode_controller"]["ros__parameters"]["arms"]
        self.assertEqual(arms["l"]["base"], {"position_m": [1.0, 2.0, 3.0], "rpy_rad": [0.0, 0.0, 1.0]})
        self.assertEqual((arms["l"]["model"], arms["l"]["hand"], arms["r"]["hand"]), ("fr3", True, False))
        self.assertEqual(arms["l"]["state_interfaces"], ["position", "velocity", "effort"])
        self.assertNotIn("state_interfaces", arms["r"])


class MoveIt(unittest.TestCase):
    CONFIG = ROS / "multipanda_moveit_config/config"

    def srdf(self, **mappings):
        return expand(self.CONFIG / "arms.srdf.xacro", description=str(URDF.parent), **mappings)

    def test_the_semantic_description_fits_the_description(self):
        for names, hands in (
            (["arm"], ["true"]),
            (["left", "right"], ["true", "false"]),
            (["left", "right"], ["true", "true"]),
        ):
            arguments = {"arm_names": " ".join(names), "hands": " ".join(hands)}
            urdf, srdf = expand(URDF / "arms.urdf.xacro", **arguments), self.srdf(**arguments)
            self.assertEqual(urdf.get("name"), srdf.get("name"))
            robot = Robot(urdf)
            groups = {g.get("name"): g for g in srdf.findall("group")}
            self.assertEqual("both_arms" in groups, len(names) == 2)
            for element in srdf.iter():
                for key in ("link1", "link2", "base_link", "tip_link", "parent_link"):
                    if element.get(key):
                        self.assertIn(element.get(key), robot.links)
                if element.tag == "joint":
                    self.assertIn(element.get("name"), robot.joints)
            for name in names:
                chain = groups[f"{name}_arm"].find("chain")
                moving = [j.get("name") for j in robot.chain(chain.get("tip_link")) if j.get("type") != "fixed"]
                self.assertEqual(moving, [f"{name}_joint{i}" for i in range(1, 8)])
                for state in srdf.findall("group_state"):
                    for joint in state.findall("joint"):
                        limit = robot.joints[joint.get("name")].find("limit")
                        self.assertLessEqual(float(limit.get("lower")), float(joint.get("value")))
                        self.assertLessEqual(float(joint.get("value")), float(limit.get("upper")))

    def test_parameters_name_what_exists(self):
        data = yaml.safe_load((self.CONFIG / "arm.yaml").read_text())
        for model, values in data["joint_accelerations"].items():
            file = {"fr3v2": "fr3"}.get(model, model)  # which takes the limits of its base
            limits = yaml.safe_load((ROOT / f"models/{file}.yaml").read_text())["interface_limits"]
            self.assertEqual(values, [float(x) for x in limits["acceleration_rad_per_s2"]], model)
        arms = bringup.arms_from("left right", hands="true false")
        parameters = bringup.moveit_parameters(data, arms)
        robot = Robot(expand(URDF / "arms.urdf.xacro", arm_names="left right", hands="true false"))
        groups = {g.get("name") for g in self.srdf(arm_names="left right", hands="true false").findall("group")}
        manager = parameters["moveit_simple_controller_manager"]
        self.assertEqual(manager["controller_names"], ["left_arm_controller", "left_gripper", "right_arm_controller"])
        for name in manager["controller_names"]:
            self.assertLessEqual(set(manager[name]["joints"]), set(robot.joints))
        self.assertLessEqual(set(parameters["robot_description_kinematics"]), groups)
        self.assertLessEqual(set(parameters["robot_description_planning"]["joint_limits"]), set(robot.joints))
        planned = {g for g in parameters["ompl"] if isinstance(parameters["ompl"][g], dict)} - {"planner_configs"}
        self.assertEqual(planned, {"left_arm", "right_arm", "both_arms"})


@unittest.skipUnless(
    importlib.util.find_spec("launch") and importlib.util.find_spec("launch_ros"), "launch is not installed"
)
class LaunchFiles(unittest.TestCase):
    """Every file yields its nodes; packages are found in the source tree."""

    def setUp(self):
        patch = unittest.mock.patch(
            "ament_index_python.packages.get_package_share_directory", lambda package: str(ROS / package)
        )
        patch.start()
        self.addCleanup(patch.stop)

    def nodes(self, file, **arguments):
        from launch import LaunchContext
        from launch.actions import IncludeLaunchDescription, OpaqueFunction

        spec = importlib.util.spec_from_file_location("launch_file", file)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        context = LaunchContext()
        context.launch_configurations.update(arguments)

        def walk(entities):
            for entity in entities:
                if (
                    isinstance(entity, (OpaqueFunction, IncludeLaunchDescription))
                    or entity.__class__.__name__ == "DeclareLaunchArgument"
                ):
                    yield from walk(entity.execute(context) or [])
                elif hasattr(entity, "entities"):
                    yield from walk(entity.entities)
                else:
                    yield entity

        return list(walk(module.generate_launch_description().entities))

    def executables(self, nodes):
        return [n.node_executable for n in nodes if hasattr(n, "node_executable")]

    def test_each_layout_starts_what_it_needs(self):
        for layout, names in LAYOUTS.items():
            with self.subTest(layout=layout):
                nodes = self.nodes(ROS / f"multipanda_bringup/launch/{layout}.launch.py")
                self.assertEqual(
                    self.executables(nodes),
                    ["robot_state_publisher", "ros2_control_node", "spawner", "spawner", *(["relay"] * len(names))],
                )

    def test_arguments_pass_through_the_layouts(self):
        nodes = self.nodes(
            ROS / "multipanda_bringup/launch/dual.launch.py", arm_names="a b", hardware="mock", rviz="true"
        )
        self.assertEqual(
            self.executables(nodes), ["robot_state_publisher", "ros2_control_node", "spawner", "spawner", "rviz2"]
        )
        with self.assertRaises(ValueError):
            self.nodes(ROS / "multipanda_bringup/launch/single.launch.py", hardware="fci")

    def test_standalone_and_moveit(self):
        self.assertTrue(self.nodes(ROS / "multipanda_bringup/launch/standalone.launch.py"))
        for names in ("arm", "left right"):
            nodes = self.nodes(ROS / "multipanda_moveit_config/launch/moveit.launch.py", arm_names=names, rviz="true")
            self.assertEqual(self.executables(nodes), ["move_group", "rviz2"])


class Packages(unittest.TestCase):
    def test_the_documented_lines_build_every_package(self):
        packages = {path.parent.name for path in ROS.glob("*/package.xml")} - {"tests"}
        self.assertGreater(len(packages), 5)
        patterns = []
        for page in ("ros2.md", "ros2_control.md"):
            patterns += re.findall(r"--base-paths (?:src/multipanda/)?ros/(\S*)", (ROOT / "docs" / page).read_text())
        self.assertEqual(len(patterns), 3)
        for pattern in patterns:
            found = {path.name for path in ROS.glob(pattern) if (path / "package.xml").exists()}
            self.assertEqual(found, packages, pattern)

    def test_the_folder_of_the_packages_is_not_built_as_an_empty_one(self):
        cmake = shutil.which("cmake")
        if not cmake:
            self.skipTest("cmake is not installed")
        with tempfile.TemporaryDirectory() as build:
            result = subprocess.run([cmake, "-S", ROS, "-B", build], capture_output=True, text=True, check=False)
        self.assertNotEqual(result.returncode, 0)
        self.assertRegex(result.stderr, r"is not a package[^$]*--base-paths")

    def test_files_are_well_formed_and_complete(self):
        for package in ("multipanda_description", "multipanda_bringup", "multipanda_moveit_config"):
            root = ET.parse(ROS / package / "package.xml").getroot()
            self.assertEqual(root.find("name").text, package)
            for file in itertools.chain((ROS / package).rglob("*.yaml"), (ROS / package).rglob("*.rviz")):
                self.assertIsNotNone(yaml.safe_load(file.read_text()), file)
            for file in (ROS / package).rglob("*.py"):
                compile(file.read_text(), str(file), "exec")


if __name__ == "__main__":
    unittest.main(verbosity=1)
