#!/usr/bin/env python3
"""Trial with LeRobot itself: discovery, its base classes, its record loop and command, its reader of data sets. Skipped
where LeRobot is not installed (it needs Python 3.12 and brings 2.7 GB); docs/lerobot.md says how it was run."""

import importlib.metadata
import importlib.util
import json
import os
import subprocess
import sys
import tempfile
import time
import unittest

if importlib.util.find_spec("lerobot") is None:
    print("skipped: LeRobot is not installed (docs/lerobot.md says how to run this trial)")
    sys.exit(77)

HOME = tempfile.TemporaryDirectory(prefix="mp-hf-")
os.environ |= {"HF_HUB_OFFLINE": "1", "HF_LEROBOT_HOME": HOME.name, "HF_HOME": HOME.name}

import harness  # after the environment of LeRobot, before multipanda
import lerobot_packages
import multipanda as mp
import numpy as np
from harness import FOLDER, PATIENCE, until
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from lerobot.robots import Robot, RobotConfig, make_robot_from_config
from lerobot.teleoperators import Teleoperator, TeleoperatorConfig, make_teleoperator_from_config
from lerobot_scenes import edited, two_arms

FPS = 30
NAMES = ("lerobot_robot_multipanda", "lerobot_teleoperator_multipanda")


def installed(name):
    return any(found.metadata["Name"] == name for found in importlib.metadata.distributions())


def pair_scene(name):
    """Two leaders that a program moves, and two followers that are held."""
    return edited(
        "leaders_and_followers",
        name,
        ("active: [left_lead, right_lead, left_follow, right_follow]", "active: [left_lead, right_joint_lead]"),
        ("  # The left pair again",
         "".join(f"  - {{name: {n}, type: joint_impedance, arms: {a}, inputs: {{joints: {{timeout_s: 0.5}}}}}}\n"
                 for n, a in (("left_joint", "left"), ("right_joint", "right"), ("right_joint_lead", "right_leader")))
         + "  # The left pair again"),
    )  # fmt: skip


def features_of(robot):
    from lerobot.utils.constants import ACTION, OBS_STR
    from lerobot.utils.feature_utils import hw_to_dataset_features

    return hw_to_dataset_features(robot.action_features, ACTION) | hw_to_dataset_features(
        robot.observation_features, OBS_STR
    )


class Discovery(unittest.TestCase):
    @unittest.skipUnless(all(map(installed, NAMES)), "the two packages are not installed here, only on the path")
    def test_both_packages_are_found_by_their_names(self):
        code = (
            "from lerobot.utils.import_utils import register_third_party_plugins as find\n"
            "find()\n"
            "from lerobot.robots import RobotConfig\n"
            "from lerobot.teleoperators import TeleoperatorConfig\n"
            "print(*[c for k in (RobotConfig, TeleoperatorConfig) for c in k.get_known_choices() if 'multipanda' in c])"
        )
        environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"} | {
            "PYTHONPATH": str(harness.ROOT / "python")
        }
        said = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
        leaders = [f"multipanda_{kind}" for kind in ("leader", "space_mouse", "servo_leader")]
        self.assertEqual(said.stdout.split(), ["multipanda", *leaders])


class Contract(unittest.TestCase):
    def robot(self, **settings):
        kind = RobotConfig.get_choice_class("multipanda")
        return make_robot_from_config(kind(id="trial", calibration_dir=FOLDER / "calibration", **settings))

    def round_trip(self, robot, seconds=0.5):
        self.assertIsInstance(robot, Robot)
        self.assertFalse(robot.is_connected)
        with self.assertRaises(ConnectionError):
            robot.get_observation()
        robot.connect()
        self.assertTrue(robot.is_connected and robot.is_calibrated)
        with self.assertRaises(ConnectionError):
            robot.connect()
        seen = robot.get_observation()
        self.assertEqual(list(seen), list(robot.observation_features))
        first = {name: seen[name] for name in robot.action_features}
        run = robot.arms.client
        name = next(iter(first))
        begin = run.state().t_s
        while (t := run.state().t_s - begin) < seconds:
            robot.send_action(first | {name: first[name] + 0.05 * t / seconds})
            time.sleep(1 / FPS)
        self.assertAlmostEqual(robot.get_observation()[name], first[name] + 0.05, delta=0.02)
        robot.disconnect()
        self.assertFalse(robot.is_connected)
        return run

    def test_one_arm(self):
        scene = edited("one_arm", "one_arm_trial", ("duration_s: 10", "duration_s: 0"))
        self.round_trip(self.robot(scene=str(scene)))

    def test_two_arms(self):
        self.round_trip(self.robot(scene=str(two_arms()), arms=["left", "right"], observe=["joints", "velocities"]))

    def test_two_arms_poses(self):
        self.round_trip(self.robot(scene=str(two_arms()), arms=["left", "right"], action="pose", observe=["pose"]))

    def test_two_virtual_arms_behind_the_network_protocol(self):
        with mp.virtual_arms(two_arms(), arm_names=("left", "right")) as arms:
            settings = {"arms": ["left", "right"], "addresses": dict(arms.addresses), "backend": "fci"}
            run = self.round_trip(self.robot(scene=str(two_arms()), **settings))
        self.assertEqual(run.process.child.poll(), 0)


class Record(unittest.TestCase):
    def test_the_record_loop_with_leaders_and_followers(self):
        from lerobot.processor import make_default_processors
        from lerobot.scripts.lerobot_record import record_loop

        with mp.run(pair_scene("record_trial"), record=FOLDER / "recorded") as run:
            socket, arms = str(run.connection.path), ["left", "right"]
            leaders = [f"{arm}_leader" for arm in arms]
            teleop = make_teleoperator_from_config(
                TeleoperatorConfig.get_choice_class("multipanda_leader")(
                    socket=socket, leaders=leaders, arms=arms, guides=dict.fromkeys(leaders, "")
                )
            )
            robot = make_robot_from_config(RobotConfig.get_choice_class("multipanda")(socket=socket, arms=arms))
            self.assertIsInstance(teleop, Teleoperator)
            dataset = LeRobotDataset.create(
                "local/trial", FPS, features=features_of(robot), root=FOLDER / "by_lerobot", robot_type=robot.name,
                use_videos=False,
            )  # fmt: skip
            teleop_step, robot_step, seen_step = make_default_processors()
            rest = {arm: run.arms[arm].state.q_rad for arm in leaders}
            with teleop, robot:
                for k in range(2):
                    with run.episode():
                        for arm in leaders:
                            law = "left_lead" if arm == "left_leader" else "right_joint_lead"
                            goal = rest[arm] + (0.15 if k == 0 else 0)
                            run[law].goal("joints", goal, duration_s=1.5)
                        record_loop(
                            robot=robot, teleop=teleop, events={"exit_early": False}, fps=FPS, dataset=dataset,
                            teleop_action_processor=teleop_step, robot_action_processor=robot_step,
                            robot_observation_processor=seen_step, control_time_s=2, single_task="Follow",
                        )  # fmt: skip
                    dataset.save_episode()
            dataset.finalize()
            self.assertTrue(all(run.arms[arm].state.held for arm in arms))
        read = LeRobotDataset("local/trial", root=FOLDER / "by_lerobot")
        self.assertEqual(read.num_episodes, 2)
        self.assertGreater(len(read), 0.6 * 2 * 2 * FPS)
        self.assertLess(len(read), 1.1 * 2 * 2 * FPS)
        state, action = (np.stack([row.numpy() for row in read.hf_dataset[k]]) for k in ("observation.state", "action"))
        self.assertGreater(np.ptp(action[:, 0]), 0.1)
        self.assertLess(np.abs(state - action).max(), 0.12)  # the followers follow
        self.compare_with_the_log(run.log, read, FOLDER / "by_export")

    def compare_with_the_log(self, log, by_loop, out):
        """The same episodes from the log, read by the same reader: the same features, the same motion."""
        words = [mp.program_path(), "export", log, "--lerobot", out, "--fps", FPS, "--task", "Follow"]
        words += ["--arms", "left,right", "--leader", "left=left_leader,right=right_leader"]
        environment = os.environ | {"MULTIPANDA_PYTHON": sys.executable}
        done = subprocess.run(list(map(str, words)), env=environment, capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        read = LeRobotDataset("local/exported", root=out, delta_timestamps={"action": [0, 1 / FPS, 2 / FPS]})
        self.assertEqual(read.num_episodes, 2)
        for name in ("observation.state", "action"):
            self.assertEqual(read.features[name]["names"], by_loop.features[name]["names"])
        item = read[5]
        self.assertEqual(item["task"], "Follow")
        self.assertEqual(tuple(item["action"].shape), (3, 14))
        mine, theirs = (
            np.stack([row.numpy() for row in found.hf_dataset["observation.state"]]) for found in (read, by_loop)
        )
        np.testing.assert_allclose(mine[0], theirs[0], atol=0.02)
        np.testing.assert_allclose(mine.max(axis=0), theirs.max(axis=0), atol=0.02)
        stats = json.loads((out / "meta/stats.json").read_text(encoding="utf-8"))
        self.assertEqual(set(stats["action"]), set(by_loop.meta.stats["action"]))
        self.assertEqual(set(stats), set(by_loop.meta.stats))

    @unittest.skipUnless(all(map(installed, NAMES)), "the two packages are not installed here, only on the path")
    def test_the_command_lerobot_record(self):
        with mp.run(pair_scene("command_trial")) as run:
            root = FOLDER / "by_command"
            socket = str(run.connection.path)
            words = [
                sys.executable, "-m", "lerobot.scripts.lerobot_record", "--robot.type=multipanda",
                f"--robot.socket={socket}", "--robot.arms=[left, right]", "--robot.observe=[joints, velocities]",
                "--teleop.type=multipanda_leader", f"--teleop.socket={socket}",
                "--teleop.leaders=[left_leader, right_leader]", "--teleop.arms=[left, right]",
                "--teleop.guides={left_leader: '', right_leader: ''}", "--dataset.repo_id=local/command",
                f"--dataset.root={root}", "--dataset.num_episodes=2", "--dataset.episode_time_s=1",
                "--dataset.reset_time_s=1", "--dataset.single_task=Stay", f"--dataset.fps={FPS}",
                "--dataset.push_to_hub=false", "--dataset.video=false", "--play_sounds=false",
            ]  # fmt: skip
            environment = os.environ | {"PYTHONPATH": str(harness.ROOT / "python")}
            done = subprocess.run(words, env=environment, capture_output=True, text=True, timeout=5 * PATIENCE)
            self.assertEqual(done.returncode, 0, done.stdout[-3000:] + done.stderr[-6000:])
            until(lambda: all(run.arms[arm].state.held for arm in ("left", "right")), "hold")
            read = LeRobotDataset("local/command", root=root)
            self.assertEqual(read.num_episodes, 2)
            self.assertEqual(read.features["observation.state"]["shape"], (28,))
            at = run.arms["left"].state.q_rad
            np.testing.assert_allclose(read[len(read) - 1]["observation.state"].numpy()[:7], at, atol=0.02)


if __name__ == "__main__":
    print(
        f"LeRobot {importlib.metadata.version('lerobot')}, Python {sys.version.split()[0]}; {lerobot_packages.__name__}"
    )
    harness.main()
