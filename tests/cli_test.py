#!/usr/bin/env python3
"""Tests the built program as users call it: exit codes, --json, signals, messages, the demo."""

import json
import os
import pathlib
import pty
import re
import select
import signal
import subprocess
import sys
import tempfile
import time
import unittest

PROGRAM = None
PATIENCE = 240  # [s] for any call; only reached by a hang
MAGIC = b"\x89MCAP0\r\n"


def call(*arguments, timeout=PATIENCE, **environment):
    return subprocess.run(
        [PROGRAM, *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=timeout,
        env={**os.environ, **environment},
    )


class Words(unittest.TestCase):
    def test_help_has_examples_for_every_command(self):
        text = call("--help")
        self.assertEqual(text.returncode, 0)
        words = re.findall(r"^  (\w+) {2,}\S", text.stdout.split("Subcommands:")[1], re.M)
        self.assertGreaterEqual(len(words), 10)
        for word in words:
            help_text = call(word, "--help")
            self.assertEqual(help_text.returncode, 0, word)
            self.assertIn("Examples:\n  multipanda", help_text.stdout, word)

    def test_invalid_arguments_are_refused_with_the_nearest(self):
        for words, expected in [
            (["rn", "two_arms"], "'run'"),
            (["run", "two_arm", "--fast"], "'two_arms'"),
            (["run", "two_arms", "--secnds", "1"], "'--seconds'"),
            (["list", "controlets"], "'controllets'"),
            (["list", "parameters", "cartesian_impedence"], "'cartesian_impedance'"),
            (["move", "two_arms", "home", "--arm", "lefd", "--fast"], "'left'"),
            (["run", "two_arms", "--address", "lefd=10.0.0.1"], "'left'"),
            (["run", "two_arms", "--backend", "virtual", "--address", "left=10.0.0.1"], "--backend fci"),
            (["run", "two_arms", "--fast", "--backend", "pinochio"], "'pinocchio'"),
            (["run", "two_arms", "--fast", "--backend", "replay"], "--log LOG"),
            (["run", "two_arms", "--fast", "--log", "log.mcap"], "--backend replay"),
        ]:
            answer = call(*words)
            self.assertEqual(answer.returncode, 2, (words, answer))
            self.assertIn(expected, answer.stderr, words)
            self.assertEqual(answer.stdout, "", words)

    def test_invalid_usage(self):
        for words in [
            [],
            ["run"],
            ["run", "two_arms", "--seconds", "-1"],
            ["run", "two_arms", "--report"],
            ["move", "one_arm", "90", "0", "0", "0", "0", "0", "0"],
            ["move", "one_arm", "0.1"],
            ["run", "two_arms", "--backend", "mujco"],
            ["experiment", "task-1", "--backend", "fci"],
            ["run", "two_arms", "--backend", "fci", "--address", "left"],
            ["run", "two_arms", "--backend", "fci", "--address", "left=1.2.3.4", "--address", "left=1.2.3.5"],
            ["export", "/nowhere", "--csv"],
            ["report", "/nowhere"],
            ["repair", "/nowhere"],
        ]:
            answer = call(*words)
            self.assertEqual(answer.returncode, 2, (words, answer))
            self.assertTrue(answer.stderr.strip(), words)

    def test_lists(self):
        for words, expected in [
            (["list", "controllets"], ["hold", "cartesian_impedance"]),
            (["list", "features"], ["joint_limits"]),
            (["list", "models"], ["fer", "fr3"]),
            (["list", "scenes"], ["one_arm", "two_arms"]),
            (["list", "parameters", "joint_impedance"], ["stiffness_nm_per_rad", "default"]),
        ]:
            answer = call(*words)
            self.assertEqual(answer.returncode, 0, answer.stderr)
            for text in expected:
                self.assertIn(text, answer.stdout)
            self.assertNotIn("refused", answer.stdout)

    def test_backends_by_name(self):
        with tempfile.TemporaryDirectory() as folder:
            recorded = call("run", "one_arm", "--seconds", "0.5", "--fast", "--json", "--record", folder)
            self.assertEqual(recorded.returncode, 0, recorded.stderr)
            log = json.loads(recorded.stdout)["log"]
            replayed = call("run", "one_arm", "--fast", "--backend", "replay", "--log", log)
            self.assertEqual(replayed.returncode, 0, replayed.stderr)
            self.assertIn("largest difference from the recorded torques 0 N m", replayed.stdout + replayed.stderr)
        for backend in ("pinocchio", "mujoco", "virtual"):
            answer = call("run", "one_arm", "--seconds", "0.2", "--fast", "--backend", backend)
            self.assertEqual(answer.returncode, 0, (backend, answer.stderr))

    def test_check_reads_every_scene_that_is_shipped(self):
        scenes = [line.split()[0] for line in call("list", "scenes").stdout.splitlines()]
        self.assertGreaterEqual(len(scenes), 4)
        for scene in scenes:
            answer = call("check", scene)
            self.assertEqual(answer.returncode, 0, answer.stderr)
            self.assertTrue(answer.stdout.endswith("ok\n"))

    def test_a_wrong_scene_is_refused_with_its_line(self):
        with tempfile.TemporaryDirectory() as folder:
            scene = pathlib.Path(folder) / "wrong.yaml"
            scene.write_text("arms:\n  - {name: left}\n  - name: right\n    bse: {position_m: [0, 1, 0]}\n")
            for words in (["check", scene], ["run", scene, "--fast", "--record", folder]):
                answer = call(*words)
                self.assertEqual(answer.returncode, 2)
                self.assertIn("wrong.yaml:4", answer.stderr)
                self.assertIn("base", answer.stderr)
            self.assertEqual([p.name for p in pathlib.Path(folder).iterdir()], ["wrong.yaml"])  # no run was started


class Runs(unittest.TestCase):
    def test_json_is_one_object_and_nothing_else(self):
        with tempfile.TemporaryDirectory() as folder:
            answer = call("run", "two_arms", "--seconds", "2", "--fast", "--json", "--record", folder)
            self.assertEqual(answer.returncode, 0, answer.stderr)
            self.assertEqual(answer.stdout.count("\n"), 1)
            result = json.loads(answer.stdout)
            self.assertEqual(result["cycles"], 2000)
            self.assertEqual(result["overruns"], 0)
            self.assertEqual(set(result["cycle_us"]), {"median", "p99", "p999", "worst"})
            self.assertLessEqual(result["cycle_us"]["median"], result["cycle_us"]["worst"])
            self.assertTrue(result["success"])
            self.assertEqual(result["records_lost"], 0)
            self.assertIsNone(result["report"])
            log = pathlib.Path(result["log"]).read_bytes()
            self.assertTrue(log.startswith(MAGIC) and log.endswith(MAGIC))
            repaired = call("repair", folder)
            self.assertEqual(repaired.returncode, 0, repaired.stderr)
            self.assertIn("nothing changed", repaired.stdout)
            exported = call("export", folder, "--csv", "--out", folder + "/tables")
            self.assertEqual(exported.returncode, 0, exported.stderr)
            self.assertGreater(len(exported.stdout.splitlines()), 5)

    def test_the_same_scene_gives_the_same_log_twice(self):
        # Tables of states and commands; timing depends on the computer.
        with tempfile.TemporaryDirectory() as folder:
            tables = []
            for name in ("a", "b"):
                run = call("run", "two_arms", "--seconds", "2", "--fast", "--record", f"{folder}/{name}")
                self.assertEqual(run.returncode, 0, run.stderr)
                out = f"{folder}/{name}_tables"
                self.assertEqual(call("export", f"{folder}/{name}", "--csv", "--out", out).returncode, 0)
                tables.append(
                    {
                        p.name: p.read_bytes()
                        for p in pathlib.Path(out).glob("*.csv")
                        if re.search(r"(state|command)\.csv$", p.name)
                    }
                )
            self.assertGreaterEqual(len(tables[0]), 4)
            self.assertEqual(tables[0], tables[1])

    def test_signals_end_in_hold_with_a_closed_log(self):
        for number in (signal.SIGINT, signal.SIGTERM):
            with tempfile.TemporaryDirectory() as folder:
                process = subprocess.Popen(
                    [PROGRAM, "run", "one_arm", "--seconds", "1000", "--json", "--record", folder],
                    stdout=subprocess.PIPE,
                    stderr=subprocess.PIPE,
                    text=True,
                )
                self.wait_for_line(process, " Hz ")  # it is running
                process.send_signal(number)
                out, err = process.communicate(timeout=PATIENCE)
                self.assertEqual(process.returncode, 0, err)
                result = json.loads(out)
                self.assertEqual(result["ended_by"], "stopped")
                self.assertEqual(result["switches"][-1]["started"], [f"{self.arm()}_hold"])
                self.assertGreater(result["cycles"], 200)
                log = pathlib.Path(result["log"]).read_bytes()
                self.assertTrue(log.endswith(MAGIC))

    def test_a_second_signal_ends_at_once(self):
        process = subprocess.Popen(
            [PROGRAM, "run", "one_arm", "--seconds", "1000"],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self.wait_for_line(process, " Hz ", process.stdout)
        os.kill(process.pid, signal.SIGSTOP)  # so that both signals are pending before it handles the first
        process.send_signal(signal.SIGINT)
        process.send_signal(signal.SIGTERM)
        os.kill(process.pid, signal.SIGCONT)
        process.communicate(timeout=PATIENCE)
        self.assertIn(process.returncode, (128 + signal.SIGINT, 128 + signal.SIGTERM))

    def arm(self):
        return re.search(r"arm (\w+):", call("check", "one_arm").stdout).group(1)

    def wait_for_line(self, process, text, stream=None):
        stream = stream or process.stderr
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            line = stream.readline()
            if not line:
                self.fail("the program ended early")
            if text in line:
                return
        self.fail(f"no line with '{text}'")

    def test_move_goes_home_and_to_angles(self):
        home = call("move", "two_arms", "home", "--fast", "--json")
        self.assertEqual(home.returncode, 0, home.stderr)
        goal = ["0.3", "-0.5", "0.1", "-2.2", "-0.1", "1.8", "0.6"]
        moved = call("move", "two_arms", "--arm", "left", "--fast", "--json", "--speed", "0.2", *goal)
        self.assertEqual(moved.returncode, 0, moved.stderr)
        self.assertIn("arm 'left' reached its goal", moved.stderr)
        self.assertNotIn("right", [i["arm"] for i in json.loads(moved.stdout)["interventions"]])

    def test_virtual_arms_run_the_same_scene(self):
        answer = call("run", "two_arms", "--seconds", "1", "--fast", "--json", "--backend", "virtual")
        self.assertEqual(answer.returncode, 0, answer.stderr)
        result = json.loads(answer.stdout)
        self.assertEqual((result["backend"], result["cycles"]), ("virtual", 1000))

    def test_an_experiment_runs_through_virtual_arms(self):
        with tempfile.TemporaryDirectory() as folder:
            answer = call("experiment", "task-1", "--fast", "--repeats", "1", "--backend", "virtual", "--out", folder)
            self.assertEqual(answer.returncode, 0, answer.stderr)
            self.assertIn("task-1: passed", answer.stdout)

    def test_a_model_is_exported(self):
        with tempfile.TemporaryDirectory() as folder:
            own = pathlib.Path(folder) / "own.yaml"
            own.write_text(
                "name: own\ntitle: Own\nbase: fer\nmotor_inertia_kg_m2: [1, 1, 1, 1, 0.5, 0.5, 0.25]\n"
                "link_friction: {viscous_nm_s_per_rad: [1, 2, 3, 4, 5, 6, 7.5]}\n"
            )
            answer = call("export", own, "--urdf", "--mjcf", "--hand", "--out", folder)
            self.assertEqual(answer.returncode, 0, answer.stderr)
            self.assertEqual(answer.stdout.split(), [f"{folder}/own_hand.urdf", f"{folder}/own_hand.xml"])
            self.assertIn('armature="0.25" damping="7.5"', pathlib.Path(folder, "own_hand.xml").read_text())
            answer = call("export", "fer", "--mjcf", "--rotor-hidden", "0.5", "--out", folder)
            self.assertEqual(answer.returncode, 0, answer.stderr)
            self.assertIn('armature="0.05"', pathlib.Path(folder, "fer.xml").read_text())
            self.assertIn('<robot name="own"', pathlib.Path(folder, "own_hand.urdf").read_text())

    def test_hidden_plants_are_not_revealed(self):
        # The output is the same with and without hidden plants; only the states differ.
        words = [
            "virtual-arm",
            "one_arm",
            "--ports",
            "0",
            "0",
            "0",
            "--seconds",
            "1",
            "--json",
            "--pace",
            "lockstep",
            "--idle-stands-still",
        ]
        plain, hidden = call(*words), call(*words, "--hidden", "3")
        self.assertEqual(hidden.returncode, 0, hidden.stderr)

        def said(answer):
            return re.sub(r"\d+", "N", answer.stdout + answer.stderr)

        self.assertEqual(said(plain), said(hidden))
        asked = subprocess.run(
            [PROGRAM, *words, "--hidden", "3"],
            input="plant left\nhidden\n",
            capture_output=True,
            text=True,
            timeout=PATIENCE,
        )
        self.assertEqual(asked.stderr.count("unknown command"), 2, asked.stderr)

    def test_move_begins_at_the_measured_position_of_a_real_arm(self):
        address = f"127.{64 + os.getpid() // 250 % 64}.{os.getpid() % 250}.77"
        start = subprocess.Popen(
            [
                PROGRAM,
                "virtual-arm",
                "one_arm",
                "--bind",
                f"arm={address}",
                "--pace",
                "lockstep",
                "--idle-stands-still",
                "--json",
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        try:
            self.assertTrue(start.stdout.readline())  # listens
            to = ["--backend", "fci", "--address", f"arm={address}", "--fast", "--speed", "0.2", "--json"]
            # The second move begins where the first one ended, not at the scene's start.
            for goal in (["0.3", "-0.5", "0.1", "-2.2", "-0.1", "1.8", "0.6"], ["home"]):
                moved = call("move", "one_arm", *to, *goal)
                self.assertEqual(moved.returncode, 0, moved.stderr)
                self.assertIn("arm 'arm' reached its goal", moved.stderr)
                self.assertIn(address, json.loads(moved.stdout)["backend"])
        finally:
            start.terminate()
            start.communicate(timeout=PATIENCE)

    def test_an_ignored_fault_fails(self):
        with tempfile.TemporaryDirectory() as folder:
            scene = pathlib.Path(folder) / "fall.yaml"
            # The end effector leaves its workspace, and the safety stage deactivates the controllet.
            scene.write_text(
                "arms:\n  - {name: left, safety: {workspace_min_m: [0, -0.2, 0.2], workspace_max_m: [0.4, 0.2, 0.9]}}\n"
                "controllets:\n  - {name: pose, type: cartesian_impedance, arms: left}\n"
                "active: [pose]\ntimeline:\n  - {at_s: 0.1, reference: {controllet: pose, input: pose, "
                "position_m: [0.55, 0, 0.5], rpy_rad: [pi, 0, 0]}}\n"
            )
            answer = call("run", scene, "--fast", "--seconds", "4", "--json")
            self.assertEqual(answer.returncode, 1, answer.stderr)
            result = json.loads(answer.stdout)
            self.assertFalse(result["success"])
            self.assertEqual(
                [i["rule"] for i in result["interventions"] if "clamped" not in i["rule"]], ["workspace_limit"]
            )
            self.assertEqual(result["cycles"], 4000)  # the arm was held and the run continued
            lines = re.findall(r"^intervention: (\w+): ([\w ]+) in (\d+) cycle", answer.stderr, re.M)
            self.assertEqual(len({(arm, rule) for arm, rule, _ in lines}), len(lines))  # one line per rule
            self.assertEqual(
                sorted((arm, rule.replace(" ", "_"), int(n)) for arm, rule, n in lines),
                sorted((i["arm"], i["rule"], i["count"]) for i in result["interventions"]),
            )

    def test_a_terminal_gets_a_table_without_color_on_request(self):
        for no_color in ("", "1"):
            text = self.on_terminal("run", "two_arms", "--seconds", "2", NO_COLOR=no_color)
            self.assertIn("limited", text)
            self.assertRegex(text, r"\x1b\[\d+A")  # redrawn in place
            self.assertEqual("\x1b[1m" in text, no_color == "")
            plain = re.sub(r"\x1b\[[0-9;]*[A-Za-z]", "", text)
            table = plain.split("100 %")[0]
            self.assertLessEqual(max(len(line) for line in re.split(r"[\r\n]+", table)), 100)

    def on_terminal(self, *words, **environment):
        pid, terminal = pty.fork()
        if pid == 0:
            os.environ.update({"TERM": "xterm", "COLUMNS": "", **environment})
            os.execv(PROGRAM, [PROGRAM, *words])
        text = b""
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            if not select.select([terminal], [], [], 1)[0]:
                continue
            try:
                piece = os.read(terminal, 65536)
            except OSError:
                break
            if not piece:
                break
            text += piece
        self.assertEqual(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), 0, text)
        os.close(terminal)
        return text.decode()


class LiveCommands(unittest.TestCase):
    """A running scene and `multipanda ctl`, in a separate runtime folder."""

    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.environment = {"XDG_RUNTIME_DIR": self.folder.name}
        self.runs = []

    def tearDown(self):
        for process in self.runs:
            process.terminate()
            process.communicate(timeout=PATIENCE)

    def start(self, *arguments):
        process = subprocess.Popen(
            [PROGRAM, "run", *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env={**os.environ, **self.environment},
        )
        self.runs.append(process)
        return process

    def socket(self, process):
        for line in process.stdout:
            if line.startswith("live input (multipanda ctl): "):
                return line.split(": ", 1)[1].strip()
        self.fail("no socket")

    def ctl(self, *arguments):
        return call("ctl", *arguments, **self.environment)

    def test_a_run_without_its_timeline_takes_commands(self):
        self.socket(self.start("two_arms", "--no-timeline"))
        short = self.ctl("list").stdout
        names = re.findall(r"^[* ] (\w+)", short, re.M)
        self.assertLess(len(short.splitlines()), len(names) + 3)
        joints = next(c for c in json.loads(self.ctl("list", "--json").stdout)["controllets"] if "joint" in c["type"])
        full = self.ctl("list", joints["name"]).stdout
        self.assertIn("stiffness_nm_per_rad", full)
        self.assertNotIn("\n  " + next(n for n in names if n != joints["name"]) + " ", full)
        self.assertEqual(self.ctl("list", joints["name"] + "x").returncode, 2)
        for values in (["60,60,60,60,30,30,30"], ["60", "60", "60", "60", "30", "30", "30"]):
            answer = self.ctl("parameter", joints["name"], "stiffness_nm_per_rad", *values)
            self.assertEqual(answer.returncode, 0, answer.stderr)
        answer = self.ctl("reference", joints["name"], joints["inputs"][0]["name"], "q_rad=0.1,0.2")
        self.assertEqual(answer.returncode, 2)
        self.assertIn("expected a list of 7 numbers, found a list of 2", answer.stderr)
        arm = joints["arms"][0]
        for value, note in (("on", ""), ("released", "use 'off'")):
            answer = self.ctl("user-stop", arm, value)
            self.assertEqual(answer.returncode, 0, answer.stderr)
            self.assertIn(note, answer.stderr)
        state = json.loads(self.ctl("state", "--json").stdout)["state"]
        self.assertEqual([a["error_names"] for a in state["arms"]], [[], []])
        self.assertGreater(state["cycle"], 0)

    def test_objects_keep_their_orientation_and_a_missed_grasp_is_explained(self):
        self.socket(self.start("grippers", "--no-timeline"))
        answer = self.ctl("place", "box", "position_m=0.6,0.4,0.1")
        self.assertEqual(answer.returncode, 0, answer.stderr)
        answer = self.ctl("gripper", "left", "grasp", "--width", "0.04")
        self.assertEqual(answer.returncode, 1)
        self.assertIn("nothing of that width was grasped", answer.stderr)

    def test_a_payload_above_the_rating_is_refused(self):
        self.socket(self.start("one_arm", "--no-timeline"))
        arm = json.loads(self.ctl("list", "--json").stdout)["arms"][0]
        name = arm["name"] if isinstance(arm, dict) else arm
        answer = self.ctl("load", name, "mass_kg=50")
        self.assertEqual(answer.returncode, 1, answer.stdout)
        self.assertRegex(answer.stderr, r"a payload of 50 kg is too heavy for arm '.+': at most 2\.\d+ kg beside hand")
        self.assertIn("largest_load_kg", answer.stderr)
        before = self.positions()
        answer = self.ctl("load", name, "mass_kg=0.3")
        self.assertEqual(answer.returncode, 0, answer.stderr)
        self.assertRegex(
            answer.stdout,
            rf"{name}: a payload of 0\.3 kg is declared: with hand and tool \(0\.71\d* kg\) the flange carries "
            r"1\.01\d kg of the 3 kg that the model is rated for, 1\.98\d kg remain",
        )
        self.assertLess(abs(self.positions()[3] - before[3]), 0.1)  # not thrown up

    def test_goals_beyond_the_limits_of_the_scene_are_refused(self):
        scene = pathlib.Path(self.folder.name) / "tight.yaml"
        text = "arms: [{name: left, safety: {position_max_rad: [0.5, 0.5, 0.5, -1, 0.5, 2.5, 1.5]}}]\n"
        scene.write_text(text + "controllets: [{name: joints, type: joint_impedance, arms: left}]\nactive: [joints]\n")
        self.socket(self.start(str(scene)))
        q = self.positions()
        for first, accepted in ((0.49, True), (0.51, False)):  # the manufacturer's limit is 2.7 rad
            goal = ",".join(str(x) for x in [first, *q[1:]])
            answer = self.ctl("reference", "joints", "joints", f"q_rad={goal}")
            self.assertEqual(answer.returncode, 0 if accepted else 1, answer.stderr)
            if not accepted:
                self.assertRegex(answer.stderr, r"joint 1: 0\.51 rad is outside of .+ to 0\.5 rad")

    def positions(self):
        """Joint positions of the first arm, from the first cycle on."""
        while not (arms := json.loads(self.ctl("state", "--json").stdout)["state"]["arms"]):
            self.assertIsNone(self.runs[-1].poll())
        return arms[0]["q_rad"]

    def test_two_runs_of_a_scene_have_sockets_of_their_own(self):
        first, second = self.start("one_arm", "--no-timeline"), self.start("one_arm", "--no-timeline")
        sockets = {self.socket(first), self.socket(second)}
        self.assertEqual(len(sockets), 2)
        for path in sockets:
            self.assertEqual(self.ctl("--socket", path, "state").returncode, 0)

    def test_every_command_of_ctl_has_an_example_of_its_own(self):
        for name in re.findall(r"^  ([\w-]+) {2,}\S", call("ctl", "--help").stdout.split("Subcommands:")[1], re.M):
            footer = call("ctl", name, "--help").stdout.split("Example")[1]
            self.assertEqual(footer.count("multipanda"), 1, name)
            self.assertIn(f"multipanda ctl {name}", footer)


class Refusals(unittest.TestCase):
    def test_a_folder_is_not_a_scene(self):
        with tempfile.TemporaryDirectory() as folder:
            answer = call("check", folder)
            self.assertEqual(answer.returncode, 2)
            self.assertIn("this is a folder", answer.stderr)

    def test_an_event_after_the_end_is_named(self):
        with tempfile.TemporaryDirectory() as folder:
            scene = pathlib.Path(folder) / "late.yaml"
            scene.write_text("duration_s: 2\narms: [{name: left}]\ntimeline: [{at_s: 5, stop: left}]\n")
            self.assertIn(
                "warning: the scene ends at 2 s: 1 event from 5 s on never happens", call("check", scene).stdout
            )
            events = ", ".join(f"{{at_s: {t}, stop: left}}" for t in (1, 2, 3.5))
            scene.write_text(f"duration_s: 2\narms: [{{name: left}}]\ntimeline: [{events}]\n")
            self.assertIn("ends at 2 s: 2 events from 2 s on never happen\n", call("check", scene).stdout)
            scene.write_text("duration_s: 2\narms: [{name: left}]\ntimeline: [{at_s: 1.9, stop: left}]\n")
            self.assertNotIn("warning", call("check", scene).stdout)

    def test_a_key_without_effect_is_noted_once(self):
        address = f"127.{64 + os.getpid() // 250 % 64}.{os.getpid() % 250}.78"
        with tempfile.TemporaryDirectory() as folder:
            scene = pathlib.Path(folder) / "old.yaml"
            scene.write_text(f"arms:\n  - {{name: left, fci: {{address: {address}, rate_limit: true}}}}\n")
            words = ["virtual-arm", str(scene), "--bind", f"left={address}", "--pace", "lockstep", "--json"]
            pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
            with subprocess.Popen([PROGRAM, *words], text=True, **pipes) as arm:
                try:
                    self.assertTrue(arm.stdout.readline())  # listens
                    answer = call("run", scene, "--fast", "--seconds", "0.1", "--record", folder)
                finally:
                    arm.terminate()
            self.assertEqual(answer.returncode, 0, answer.stderr)
            text = answer.stdout + answer.stderr
            self.assertEqual(text.count("'fci: rate_limit' has no effect"), 1, text)

    def test_a_refused_experiment_leaves_no_folder(self):
        root = pathlib.Path(__file__).resolve().parent.parent
        with tempfile.TemporaryDirectory() as folder:
            file = pathlib.Path(folder) / "mine.yaml"
            out = pathlib.Path(folder) / "out"
            head = f"title: mine\nscene: {root}/experiments/scenes/task_1.yaml\n"
            for text, expected in (
                ("limits: [{metric: x_rsme_m, at_most: 1}]\n", "'x_rmse_m'"),
                ("set: {controllets.joins.parameters.x: 1}\n", "leads nowhere"),
                ("set: {duration_s: 0.2}\n", "the scene ends before this event"),
            ):
                file.write_text(head + text)
                answer = call("experiment", file, "--fast", "--out", out)
                self.assertEqual(answer.returncode, 2, answer.stderr)
                self.assertIn(expected, answer.stderr)
                self.assertEqual(list(out.iterdir()) if out.exists() else [], [])

    def test_parameters_of_a_scene_are_listed_for_its_joints(self):
        answer = call("list", "parameters", "joint_impedance", "--scene", "two_arms")
        self.assertEqual(answer.returncode, 0, answer.stderr)
        for values in re.findall(r"default \[(.*)\]", answer.stdout):
            self.assertEqual(len(values.split(",")), 7)


class Demo(unittest.TestCase):
    def test_fast_demo(self):
        with tempfile.TemporaryDirectory() as folder:
            answer = call("demo", "--fast", "--json", "--record", folder)
            self.assertEqual(answer.returncode, 0, answer.stderr)
            result = json.loads(answer.stdout)
            self.assertEqual(result["cycles"], 20000)
            self.assertEqual(result["records_lost"], 0)
            self.assertEqual(result["faults"], [])
            started = [s["started"] for s in result["switches"]]
            self.assertEqual(started[0], ["left_pose", "right_pose"])
            for expected in (["left_joints"], ["both_dual"], ["both_coupled"], ["left_hold"]):
                self.assertIn(expected, started)
            kept = next(s for s in result["switches"] if s["started"] == ["left_joints"])["kept"]
            self.assertEqual(kept, ["right_pose"])
            self.assertEqual(
                [(i["arm"], i["rule"]) for i in result["interventions"] if "clamped" not in i["rule"]],
                [("left", "torque_not_finite")],
            )
            self.assertIn("bit by bit those of a run without it", answer.stderr)
            page = pathlib.Path(result["report"])
            self.assertGreater(page.stat().st_size, 10000)
            self.assertTrue(answer.stderr.rstrip().splitlines()[-1].endswith(str(page)))
            self.assertTrue(pathlib.Path(result["log"]).read_bytes().endswith(MAGIC))


if __name__ == "__main__":
    PROGRAM = str(pathlib.Path(sys.argv.pop(1)).resolve())
    unittest.main(verbosity=2)
