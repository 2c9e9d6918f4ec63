#!/usr/bin/env python3
"""Runs `identify` and `predict` as a user would and reads what they print and write.

    identify_test.py PROGRAM

Real measurements are used where they lie next to the project (../shared/data); without them their tests skip.
"""

import json
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

PROGRAM = None
SCENE = pathlib.Path(__file__).resolve().parents[1] / "experiments" / "scenes" / "excitation_fer.yaml"
DATA = pathlib.Path(__file__).resolve().parents[2] / "shared" / "data" / "panda_excitation.csv"
MESSAGES = pathlib.Path(__file__).resolve().parents[1] / "ros/adapter/compat/testing/compat_test_msgs/msg"


def call(*words):
    return subprocess.run([PROGRAM, *map(str, words)], capture_output=True, text=True, timeout=200)


class InFolder(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.path = pathlib.Path(self.folder.name)

    def done(self, *words):
        """What a command prints; it must succeed."""
        done = subprocess.run(
            [PROGRAM, *map(str, words)], capture_output=True, text=True, timeout=200, cwd=self.path, check=False
        )
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        return done.stdout


class Recordings(InFolder):
    """Recordings of other programs are read like our log of the same motion."""

    def write_bag(self, name, storage, arrays):
        """A bag as franka_ros2 makes it: states of the arm, the joints of the whole robot, and what is desired."""
        types = get_typestore(Stores.ROS2_JAZZY)
        own = {}
        for part in ("CollisionIndicators", "Elbow", "Errors", "FrankaRobotState"):
            own.update(get_types_from_msg((MESSAGES / f"{part}.msg").read_text(), f"franka_msgs/msg/{part}"))
        types.register(own)
        make, zero = types.types.__getitem__, np.zeros
        stamp = make("builtin_interfaces/msg/Time")
        header = make("std_msgs/msg/Header")
        vector, point = make("geometry_msgs/msg/Vector3"), make("geometry_msgs/msg/Point")
        turn = make("geometry_msgs/msg/Quaternion")

        def joints(at, names, q, dq, tau):
            return make("sensor_msgs/msg/JointState")(at, names, np.array(q), np.array(dq), np.array(tau))

        def stamped(kind, at, *values):
            inner = make(f"geometry_msgs/msg/{kind}")(*values)
            return make(f"geometry_msgs/msg/{kind}Stamped")(at, inner)

        nothing = vector(0.0, 0.0, 0.0)
        names = [f"fr3_joint{k}" for k in range(1, 8)]
        whole = ["fr3_finger_joint1", *reversed(names)]
        with Writer(self.path / name, version=9, storage_plugin=storage) as bag:
            state = bag.add_connection("/states/robot_state", "franka_msgs/msg/FrankaRobotState", typestore=types)
            topics = [
                bag.add_connection(topic, "sensor_msgs/msg/JointState", typestore=types)
                for topic in ("/joint_states", "/states/desired_joint_states")
            ]
            for k, t in enumerate(arrays["t"]):
                ns = round(1e9 * t)
                late = ns + (k % 3) * 200_000  # stamps of the computer have jitter
                at = header(stamp(late // 10**9, late % 10**9), "")
                q, dq, tau, tau_d = (arrays[key][k] for key in ("q", "dq", "tau_j", "tau_j_d"))
                pose = stamped("Pose", at, point(0.0, 0.0, 0.0), turn(0.0, 0.0, 0.0, 1.0))
                wrench = stamped("Wrench", at, nothing, nothing)
                errors = make("franka_msgs/msg/Errors")(False, False, False, False)
                message = make("franka_msgs/msg/FrankaRobotState")(
                    at,
                    make("franka_msgs/msg/CollisionIndicators")(nothing, nothing, zero(7)),
                    joints(at, names, q, dq, tau),
                    joints(at, names, q + 0.01, dq, tau_d),
                    joints(at, names, q, dq, []),
                    joints(at, names, [], [], 0.1 * tau),
                    zero(7),
                    make("franka_msgs/msg/Elbow")(zero(2)),
                    wrench,
                    wrench,
                    stamped("Inertia", at, 0.0, nothing, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
                    *[pose] * 5,
                    1e-9 * ns,
                    1.0,
                    2,
                    errors,
                    errors,
                )
                bag.write(state, ns, types.serialize_cdr(message, state.msgtype))
                for topic, shift in zip(topics, (0, 0.01)):
                    rows = ([0.02, *(q[::-1] + shift)], [0.0, *dq[::-1]], [0.0, *tau[::-1]])
                    bag.write(topic, ns, types.serialize_cdr(joints(at, whole, *rows), topic.msgtype))

    def test_archives_and_bags_are_read_like_our_log(self):
        text = SCENE.read_text(encoding="utf-8")
        scene = self.path / "scene.yaml"
        scene.write_text(text, encoding="utf-8")
        self.done("run", scene, "--fast", "--seconds", 6, "--record", "own")
        log = next((self.path / "own").iterdir())
        archive = self.path / "archive.npz"
        self.done("export", log, "--npz", "--out", archive)
        data = np.load(archive)
        arrays = {name: data[f"arm/state/{name}"] for name in ("t", "q", "dq", "tau_j", "tau_j_d")}
        np.savez(self.path / "plain.npz", t=arrays["t"], q=arrays["q"], dq=arrays["dq"], tau_J=arrays["tau_j"], u=1)
        self.write_bag("bag_of_mcap", StoragePlugin.MCAP, arrays)
        self.write_bag("bag_of_sqlite", StoragePlugin.SQLITE3, arrays)
        own = json.loads(self.done("predict", log, "--model", "fer", "--json"))
        stored = next((self.path / "bag_of_sqlite").glob("*.db3"))
        for file in (archive, "plain.npz", "bag_of_mcap", "bag_of_sqlite", stored):
            read = json.loads(self.done("predict", file, "--model", "fer", "--hand", "--json"))
            for joint, expected in zip(read["rmse"], own["rmse"]):
                self.assertAlmostEqual(joint, expected, places=9, msg=file)
        compared = json.loads(self.done("compare", "bag_of_mcap", log, "--json", "--lag", 0, "--out", "page"))
        figures = compared["arms"][0]["quantities"]
        self.assertLess(figures["tau"]["rmse_mean"], 1e-9)
        self.assertLess(figures["C_err"]["rmse_mean"], 1e-9)  # tau_J_d is in the bag, gravity from the scene

        fitted = [
            json.loads(self.done("fit", *words, "--windows", 20, "--json"))
            for words in ((log,), ("bag_of_mcap", "--scene", scene))
        ]
        # The bag has the torque in use, which the arm got from the program in the period before.
        self.assertAlmostEqual(fitted[0]["delay_s"], fitted[1]["delay_s"], delta=1e-3)

        page = pathlib.Path(self.done("report", "plain.npz").strip())
        self.assertIn("Joint torques", (self.path / page).read_text(encoding="utf-8"))
        again = json.loads(
            self.done("predict", (self.path / page).with_name("log.mcap"), "--model", "fer", "--hand", "--json")
        )
        self.assertAlmostEqual(again["rmse_mean"], own["rmse_mean"], places=9)

    def test_refusals_say_what_is_missing(self):
        np.save(self.path / "one.npy", np.zeros((9, 7)))
        np.savez(self.path / "wrong.npz", t=np.zeros(9), position=np.zeros((9, 7)))
        (self.path / "empty.mcap").write_bytes(b"")
        for file, said in (
            ("one.npy", "one array without names"),
            ("wrong.npz", r"wrong.npz:1: no column q1; found t,position1"),
            ("empty.mcap", r"empty.mcap: cannot be read"),
        ):
            done = call("predict", self.path / file, "--model", "fer")
            self.assertEqual(done.returncode, 1, done.stderr)
            self.assertRegex(done.stderr, said)

    @unittest.skipUnless(DATA.exists(), f"no {DATA}")
    def test_real_recordings_are_read_like_their_tables(self):
        for model, hand, files in (
            ("fr3", ["--hand"], ("fr3_circle_2.csv", "fr3_circle_2.npz")),
            ("fer", [], ("panda_bag_first_13s.csv", "panda_bag_first_13s.mcap")),
        ):
            table, other = (
                json.loads(self.done("predict", DATA.with_name(file), "--model", model, *hand, "--json"))
                for file in files
            )
            self.assertAlmostEqual(table["rmse_mean"], other["rmse_mean"], places=4)

    @unittest.skipUnless(DATA.exists(), f"no {DATA}")
    def test_touches_of_a_real_arm_are_found(self):
        """45 touches by a person: none missed, none false, within 35 ms; docs/results/control.md has the table."""
        logs = sorted(DATA.parent.glob("panda_touch_*.csv"))
        self.assertEqual(len(logs), 3)
        told = json.loads(self.done("observe", *logs, "--model", "fer", "--hand", "--json"))
        for name in ("observer", "arm"):
            self.assertEqual([told[name][key] for key in ("labeled", "missed", "false_alarms")], [45, 0, 0], name)
        self.assertLess(told["observer"]["median_delay_s"], 0.035)
        self.assertLess(1.3 * told["observer"]["quiet_nm"], told["observer"]["threshold_nm"])
        # Without the stage behind it, noise of the torques hides touches.
        plain = json.loads(self.done("observe", *logs, "--hand", "--json", "--stage", 0))
        self.assertGreater(plain["observer"]["false_alarms"], 0)


class Identify(InFolder):
    @unittest.skipUnless(DATA.exists(), f"no {DATA}")
    def test_real_data_from_file_to_prediction(self):
        model, page = self.path / "panda.yaml", self.path / "page"
        urdf, mjcf = self.path / "panda.urdf", self.path / "panda.xml"
        done = call(
            "identify",
            DATA,
            "--robot",
            "fer",
            "--out",
            model,
            "--json",
            "--report",
            page,
            "--urdf",
            urdf,
            "--mjcf",
            mjcf,
        )
        self.assertEqual(done.returncode, 0, done.stderr)
        result = json.loads(done.stdout)
        for key in ("rmse_train", "rmse_heldout", "consistent", "parameters"):
            self.assertIn(key, result)
        self.assertTrue(result["consistent"])
        self.assertTrue(result["dissipative"])
        self.assertLess(result["rmse_heldout"], 0.115)
        self.assertEqual(sum(s["chosen"] for s in result["cross_validation"]), 1)
        self.assertLess(result["rmse_expected"]["mean"], 0.13)
        self.assertGreater(result["rmse_expected"]["mean"], result["rmse_all"]["mean"])
        self.assertEqual(result["motion"]["repeated_after_s"], [0])
        # Fitted to 60 % of the file, from either end: the error on the rest is the expected one within 25 %.
        sixty = [c for c in result["cuts"] if abs(c["trained_to"] - c["trained_from"] - 0.6) < 1e-9]
        self.assertEqual(len(sixty), 2)
        for cut in sixty:
            self.assertAlmostEqual(cut["expected"]["mean"] / cut["test"]["mean"], 1, delta=0.25)
        self.assertEqual(len(result["parameters"]["link4"]["com_m"]), 3)
        self.assertEqual(len(result["base_parameters"]["values"][0]), 5)
        names = [m["name"] for m in result["models_beside"]]
        self.assertIn("fer", names)
        self.assertIn("fr3", names)
        html = (page / "identification.html").read_text(encoding="utf-8")
        for part in ("<html", "Quality of the model", "unconstrained", "hardly constrained"):
            self.assertIn(part, html)
        for picture in ("models.png", "torque_0.png"):
            self.assertTrue((page / picture).read_bytes().startswith(b"\x89PNG"))
        self.assertIn("link7", urdf.read_text())
        self.assertIn("link7", mjcf.read_text())

        predicted = call("predict", DATA, "--model", model, "--model", "fer", "--json")
        self.assertEqual(predicted.returncode, 0, predicted.stderr)
        prediction = json.loads(predicted.stdout)
        self.assertEqual(len(prediction["rmse"]), 7)
        self.assertAlmostEqual(prediction["rmse_mean"], sum(prediction["rmse"]) / 7, places=12)
        self.assertAlmostEqual(prediction["rmse_mean"], result["rmse_all"]["mean"], places=6)
        self.assertEqual(len(prediction["rmse_unfiltered"]), 7)
        self.assertGreater(prediction["models"][1]["rmse_mean"], 4 * prediction["rmse_mean"])

    def changed(self, name, change):
        """The real log with other columns: change(names, rows)."""
        with open(DATA, encoding="utf-8") as file:
            names, *rows = [line.split(",") for line in file.read().split()]
        change({column: k for k, column in enumerate(names)}, rows)
        file = self.path / name
        file.write_text("\n".join(",".join(row) for row in [names, *rows]) + "\n", encoding="utf-8")
        return file

    @unittest.skipUnless(DATA.exists(), f"no {DATA}")
    def test_a_model_that_is_not_of_this_log_is_warned_of_with_what_fits(self):
        def exchange(at, rows):
            for row in rows:
                for kind in ("q", "dq", "tau"):
                    a, b = at[f"{kind}1"], at[f"{kind}3"]
                    row[a], row[b] = row[b], row[a]

        def delay(at, rows):
            late = [[row[at[f"tau{j}"]] for j in range(1, 8)] for row in rows]
            for row, torques in zip(rows, [late[0]] * 100 + late):
                for j in range(7):
                    row[at[f"tau{j + 1}"]] = torques[j]

        hand = DATA.with_name("fr3_circle_2.csv")
        for words, said in (
            ((DATA, "--model", "fer"), None),
            ((hand, "--model", "fr3", "--hand"), None),
            ((hand, "--model", "fer", "--hand"), "robot 'fr3' or 'fr3v2' would leave 0.3"),
            ((DATA, "--model", "fer", "--hand"), "no hand would leave 0.3"),
            ((hand, "--model", "fr3"), "the hand, which --hand declares would leave 0."),
            ((self.changed("exchanged.csv", exchange), "--model", "fer"), "joints 1 and 3 exchanged would leave 0.3"),
            ((self.changed("late.csv", delay), "--model", "fer"), r"torques that are 1[01]0 ms late would leave 0.3"),
        ):
            done = call("predict", *words)
            self.assertEqual(done.returncode, 0, done.stderr)
            told = done.stdout + done.stderr
            self.assertEqual("expected at most 0.8 and 1.5" in told, said is not None, told)
            self.assertRegex(told, said or "mean")

    @unittest.skipUnless(DATA.exists(), f"no {DATA}")
    def test_prediction_outside_of_the_identified_motion_is_warned_of(self):
        model = self.path / "panda.yaml"
        half = self.changed("half.csv", lambda at, rows: rows.__delitem__(slice(3500, None)))
        done = call("identify", half, "--robot", "fer", "--family", "offset", "--out", model)
        self.assertEqual(done.returncode, 0, done.stderr)
        told = call("predict", half, "--model", model)
        self.assertNotIn("leaves the motion", told.stdout + told.stderr)
        told = call("predict", DATA, "--model", model)
        self.assertRegex(told.stdout + told.stderr, r"leaves the motion from which panda was .*joint \d by 0\.\d\d rad")

    def record(self, name, base):
        scene = self.path / f"{name}.yaml"
        text = SCENE.read_text(encoding="utf-8")
        self.assertIn("    model: fer\n", text)
        scene.write_text(text.replace("    model: fer\n", f"    model: fer\n    base: {base}\n"), encoding="utf-8")
        done = call("run", scene, "--fast", "--seconds", 12, "--record", self.path / name)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        return next((self.path / name).iterdir())

    def test_floor_and_wall_in_one_fit(self):
        floor = self.record("floor", "{position_m: [0, 0, 0]}")
        wall = self.record("wall", "{position_m: [0, 0.4, 1], rpy_rad: [0, 1.5707963, 0]}")
        model = self.path / "both.yaml"
        done = call("identify", floor, wall, "--family", "offset", "--json", "--out", model)
        self.assertEqual(done.returncode, 0, done.stderr)
        result = json.loads(done.stdout)
        # 43 of a level base; two more where gravity is not along the first axis.
        self.assertEqual(result["base_parameters"]["rank"], 45)
        self.assertTrue(any("different bases" in warning for warning in result["warnings"]))
        self.assertEqual(result["parameters"]["base_tilt_rad"], [0, 0])
        self.assertIn("gravity along (1.00, 0.00, 0.00)", done.stderr)
        for log in (floor, wall):
            told = json.loads(call("predict", log, "--model", model, "--json").stdout)
            self.assertLess(told["rmse_mean"], 0.05)
        # An option replaces what the scene says, of one log or of all.
        turned = call("predict", wall, "--model", model, "--json", "--base", f"{wall.name}=0,0,0")
        self.assertGreater(json.loads(turned.stdout)["rmse_mean"], 5)
        for bad, what in (("none.csv=0,0,0", "no such log"), ("0,0", "ROLL,PITCH,YAW"), ("=0,0,0", "ROLL,PITCH,YAW")):
            done = call("identify", floor, wall, "--base", bad)
            self.assertEqual(done.returncode, 2, done.stderr)
            self.assertIn(what, done.stderr)
        file = self.path / "unknown.csv"
        self.write_resting(file)
        done = call("identify", wall, file)
        self.assertEqual(done.returncode, 1, done.stderr)
        self.assertIn("with hand", done.stderr)  # the scene has the hand, the file does not say
        done = call("identify", wall, file, "--hand")
        self.assertEqual(done.returncode, 1, done.stderr)
        self.assertIn("its base is unknown", done.stderr)

    def write_resting(self, file):
        names = ["t"] + [f"{q}{j}" for q in ("q", "dq", "tau") for j in range(1, 8)]
        rest = [0, -0.8, 0, -2.4, 0, 1.6, 0.8] + [0] * 7 + [0, -4, 0, 19, 0.7, 2.3, 0]
        lines = [",".join(names)] + [",".join(str(v + 1e-6 * (k % 7)) for v in [0.001 * k, *rest]) for k in range(2000)]
        file.write_text("\n".join(lines) + "\n", encoding="utf-8")

    def test_refusals_say_what_is_wrong_and_end_as_failures(self):
        file = self.path / "short.csv"
        self.write_resting(file)
        done = call("identify", file)
        self.assertEqual(done.returncode, 1)
        self.assertRegex(done.stderr, r"\d")
        self.assertEqual(call("identify", self.path / "none.csv").returncode, 1)
        unknown = call("identify", file, "--robot", "feer")
        self.assertEqual(unknown.returncode, 2)
        self.assertIn("fer", unknown.stderr)
        self.assertEqual(call("predict", file).returncode, 2)


class Excite(unittest.TestCase):
    def test_an_arm_without_hand_keeps_its_law_to_the_end(self):
        """A bare wrist's rotor has a hundred times the inertia of its link. A law that does not know of it lets it
        swing on its spring until the arm is held. With MULTIPANDA_FULL two arms with 20 seeds each."""
        full = os.environ.get("MULTIPANDA_FULL")
        cases = [(m, s) for m in ("fr3", "fer") for s in range(1, 21)] if full else [("fr3", 1)]
        for model, seed in cases:
            with self.subTest(model=model, seed=seed), tempfile.TemporaryDirectory() as folder:
                scene = pathlib.Path(folder) / "excitation.yaml"
                done = call("excite", model, "--no-hand", "--seed", seed, "--out", scene)
                self.assertEqual(done.returncode, 0, done.stderr)
                for backend in ("mujoco", "virtual"):
                    run = call("run", scene, "--fast", "--json", "--backend", backend)
                    self.assertEqual((run.returncode, json.loads(run.stdout)["faults"]), (0, []), backend)


if __name__ == "__main__":
    PROGRAM = sys.argv.pop(1)
    unittest.main()
