#!/usr/bin/env python3
"""Tests the built program as users call it: exit codes, --json, signals, messages, the demo."""

import json
import os
import pathlib
import pty
import re
import select
import signal
import socket
import subprocess
import sys
import tempfile
import termios
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


def begun(*words, stderr, **environment):
    """A program that goes on."""
    variables = {**os.environ, **environment}
    return subprocess.Popen(
        [PROGRAM, *map(str, words)], stdout=subprocess.PIPE, stderr=stderr, text=True, env=variables
    )


class Calls(unittest.TestCase):
    """Calls in a folder of the test's own."""

    environment = {}

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def answer(self, *words, code=0):
        """What a call answers that must end with this exit code."""
        answer = call(*words, **self.environment)
        self.assertEqual(answer.returncode, code, (words, answer))
        return answer

    def table(self, *words, code=0):
        """The object that a call prints with --json."""
        return json.loads(self.answer(*words, "--json", code=code).stdout)


class Words(Calls):
    def test_help_has_examples_for_every_command(self):
        text = self.answer("--help")
        words = re.findall(r"^  (\w+) {2,}\S", text.stdout.split("Subcommands:")[1], re.M)
        self.assertGreaterEqual(len(words), 10)
        for word in words:
            help_text = self.answer(word, "--help")
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
            answer = self.answer(*words, code=2)
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
            answer = self.answer(*words, code=2)
            self.assertTrue(answer.stderr.strip(), words)

    def test_lists(self):
        for words, expected in [
            (["list", "controllets"], ["hold", "cartesian_impedance"]),
            (["list", "features"], ["joint_limits"]),
            (["list", "models"], ["fer", "fr3"]),
            (["list", "scenes"], ["one_arm", "two_arms"]),
            (["list", "parameters", "joint_impedance"], ["stiffness_nm_per_rad", "default"]),
        ]:
            answer = self.answer(*words)
            for text in expected:
                self.assertIn(text, answer.stdout)
            self.assertNotIn("refused", answer.stdout)

    def test_backends_by_name(self):
        log = self.table("run", "one_arm", "--seconds", "0.5", "--fast", "--record", self.folder)["log"]
        replayed = self.answer("run", "one_arm", "--fast", "--backend", "replay", "--log", log)
        self.assertIn("largest difference from the recorded torques 0 N m", replayed.stdout + replayed.stderr)
        for backend in ("pinocchio", "mujoco", "virtual"):
            self.answer("run", "one_arm", "--seconds", "0.2", "--fast", "--backend", backend)

    def test_check_reads_a_scene_of_real_arms_and_connects_to_none(self):
        scene = self.folder / "real.yaml"
        right = "{name: right, fci: 127.0.0.9, base: {position_m: [0, 1, 0], rpy_rad: [0, pi/2, 0]}}"
        scene.write_text(f"name: real\narms: [{{name: left, fci: 172.16.0.2}}, {right}]\n")
        with socket.create_server(("127.0.0.9", 1337)) as arm:
            arm.setblocking(False)
            said = self.answer("check", scene).stdout
            self.assertTrue(said.endswith("ok\n"))
            self.assertIn("base at (0, 0, 0) m\n", said)
            self.assertIn("base at (0, 1, 0) m, turned by (0, 1.571, 0) rad\n", said)
            self.assertRaises(BlockingIOError, arm.accept)

    def test_check_reads_every_scene_that_is_shipped(self):
        scenes = [line.split()[0] for line in call("list", "scenes").stdout.splitlines()]
        self.assertGreaterEqual(len(scenes), 4)
        for scene in scenes:
            answer = self.answer("check", scene)
            self.assertTrue(answer.stdout.endswith("ok\n"))

    def test_check_shows_where_bases_and_objects_are_and_how_they_are_turned(self):
        scene = self.folder / "places.yaml"
        scene.write_text(
            "arms:\n  - {name: left}\n  - {name: right, base: {position_m: [0, -0.7, 0.2], rpy_rad: [0, 0.5, -1.2]}}\n"
            "objects:\n  - {name: peg, shape: cylinder, diameter_m: 0.05, length_m: 0.2, fixed: false, mass_kg: 0.35,"
            " position_m: [0.4, 0.1, 0.3], rpy_rad: [0.25, 0, 0]}\n"
        )
        shown = self.answer("check", scene).stdout
        for line in (
            r"arm left: .*, base at \(0, 0, 0\) m$",
            r"arm right: .*, base at \(0, -0\.7, 0\.2\) m, turned by \(0, 0\.5, -1\.2\) rad",
            r"object peg: free, 0\.35 kg, at \(0\.4, 0\.1, 0\.3\) m, turned by \(0\.25, 0, 0\) rad",
        ):
            self.assertRegex(shown, re.compile(line, re.M))

    def test_stiffness_that_an_arm_does_not_bear_is_named(self):
        scene = self.folder / "bare.yaml"
        arms = "arms: [{{name: a, model: fr3, hand: {0}, start_rad: ready}}, {{name: b, model: fr3, hand: {0}, "
        arms += "start_rad: ready, base: {{position_m: [0, 0.4, 0]}}}}]\ncontrollets:\n"
        laws = "  - {name: pair, type: coupled_dual_cartesian_impedance, arms: [a, b]}\n"
        laws += "  - {name: hard, type: cartesian_impedance, arms: a}\n"
        laws += "  - {name: soft, type: cartesian_impedance, arms: a, "
        laws += "parameters: {rotational_stiffness_nm_per_rad: 1}}\n"
        scene.write_text("duration_s: 0.01\n" + arms.format("false") + laws)
        for command in (("check",), ("run", "--fast")):
            said = self.answer(*command, scene)
            pair, hard = [line for line in (said.stdout + said.stderr).splitlines() if "warning" in line]
            share = float(re.search(r"controllet 'pair' has (\S+) of the stiffness .* a, b bear no more", pair)[1])
            self.assertLess(share, 0.2)
            self.assertIn("relative_rotational_stiffness_nm_per_rad", pair)
            self.assertRegex(hard, "controllet 'hard' .* lower rotational_stiffness_nm_per_rad, or declare the hand")
        scene.write_text("duration_s: 0.01\n" + arms.format("true") + laws)
        self.assertNotIn("warning", self.answer("check", scene).stdout)

    def test_friction_of_a_urdf_is_named_where_it_is_left_out(self):
        link = (
            "<link name='{}'><inertial><mass value='1'/>"
            "<inertia ixx='.01' iyy='.01' izz='.01' ixy='0' ixz='0' iyz='0'/></inertial></link>"
        )
        (self.folder / "one.urdf").write_text(
            f"<robot name='one'>{link.format('a')}{link.format('b')}<joint name='hinge' type='revolute'>"
            "<parent link='a'/><child link='b'/><axis xyz='0 0 1'/><dynamics damping='0.75' friction='2.5'/>"
            "<limit lower='-1' upper='1' velocity='2' effort='30'/></joint></robot>"
        )
        (self.folder / "one.yaml").write_text("name: one\nurdf: ./one.urdf\nbase_link: a\ntip_link: b\n")
        scene = self.folder / "scene.yaml"
        scene.write_text("arms: [{name: arm, model: ./one.yaml, hand: false}]\n")
        said = "hinge 0.75 N m s/rad and 2.5 N m"
        self.assertIn(said, self.answer("check", scene).stdout)
        self.assertIn(
            said, self.answer("export", self.folder / "one.yaml", "--urdf", "--out", self.folder / "o").stderr
        )
        ran = self.answer("run", scene, "--fast", "--seconds", "0.1")
        self.assertIn(said, ran.stdout + ran.stderr)

    def test_a_wrong_scene_is_refused_with_its_line(self):
        scene = self.folder / "wrong.yaml"
        scene.write_text("arms:\n  - {name: left}\n  - name: right\n    bse: {position_m: [0, 1, 0]}\n")
        for words in (["check", scene], ["run", scene, "--fast", "--record", self.folder]):
            answer = self.answer(*words, code=2)
            self.assertIn("wrong.yaml:4", answer.stderr)
            self.assertIn("base", answer.stderr)
        self.assertEqual([p.name for p in self.folder.iterdir()], ["wrong.yaml"])  # no run was started


class Runs(Calls):
    def test_json_is_one_object_and_nothing_else(self):
        answer = self.answer("run", "two_arms", "--seconds", "2", "--fast", "--json", "--record", self.folder)
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
        repaired = self.answer("repair", self.folder)
        self.assertIn("nothing changed", repaired.stdout)
        exported = self.answer("export", self.folder, "--csv", "--out", self.folder / "tables")
        self.assertGreater(len(exported.stdout.splitlines()), 5)

    def test_the_same_scene_gives_the_same_log_twice(self):
        # Tables of states and commands; timing depends on the computer.
        tables = []
        for name in ("a", "b"):
            self.answer("run", "two_arms", "--seconds", "2", "--fast", "--record", f"{self.folder}/{name}")
            out = f"{self.folder}/{name}_tables"
            self.answer("export", f"{self.folder}/{name}", "--csv", "--out", out)
            found = [path for path in pathlib.Path(out).glob("*.csv") if path.stem.endswith(("state", "command"))]
            tables.append({path.name: path.read_bytes() for path in found})
        self.assertGreaterEqual(len(tables[0]), 4)
        self.assertEqual(tables[0], tables[1])

    def test_signals_end_in_hold_with_a_closed_log(self):
        for number in (signal.SIGINT, signal.SIGTERM):
            words = ["run", "one_arm", "--seconds", "1000", "--json", "--record", self.folder]
            process = begun(*words, stderr=subprocess.PIPE)
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

    def test_a_nervous_second_signal_ends_in_hold(self):
        process = begun("run", "one_arm", "--seconds", "1000", "--json", stderr=subprocess.PIPE)
        self.wait_for_line(process, " Hz ")
        os.kill(process.pid, signal.SIGSTOP)  # so that both signals are pending before it handles the first
        process.send_signal(signal.SIGINT)
        process.send_signal(signal.SIGTERM)
        os.kill(process.pid, signal.SIGCONT)
        out, err = process.communicate(timeout=PATIENCE)
        self.assertEqual(process.returncode, 0, err)
        self.assertEqual(json.loads(out)["switches"][-1]["started"], [f"{self.arm()}_hold"])

    def test_a_terminal_that_goes_on_takes_no_resume_of_before(self):
        pid, terminal = pty.fork()
        if pid == 0:
            os.execv(PROGRAM, [PROGRAM, "run", "one_arm", "--no-timeline"])
        text = b""
        while b"keys: space" not in text or b" Hz" not in text:
            text += os.read(terminal, 4096)
        os.write(terminal, b" ")
        os.kill(pid, signal.SIGSTOP)
        while any(
            file.read_text().rpartition(") ")[2][0] != "T" for file in pathlib.Path(f"/proc/{pid}/task").glob("*/stat")
        ):
            time.sleep(0.01)
        os.write(terminal, b"r")
        time.sleep(1)
        os.kill(pid, signal.SIGCONT)
        while b"stalled" not in text:
            text += os.read(terminal, 4096)
        time.sleep(0.5)
        os.write(terminal, b"\x03")
        try:
            while piece := os.read(terminal, 4096):
                text += piece
        except OSError:  # its end
            pass
        self.assertEqual(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), 0, text)
        self.assertNotIn(b"resume: arm", text)

    def test_keys_count_after_a_shell_had_the_terminal(self):
        pid, terminal = pty.fork()
        if pid == 0:
            os.execv(PROGRAM, [PROGRAM, "run", "one_arm", "--no-timeline"])
        text = b""
        while b"keys: space" not in text or b" Hz" not in text:
            text += os.read(terminal, 4096)
        os.kill(pid, signal.SIGSTOP)  # Ctrl-Z; then the shell's own settings, as after `fg`
        settings = termios.tcgetattr(terminal)
        settings[3] |= termios.ICANON | termios.ECHO
        termios.tcsetattr(terminal, termios.TCSANOW, settings)
        os.kill(pid, signal.SIGCONT)
        while termios.tcgetattr(terminal)[3] & termios.ICANON:
            time.sleep(0.01)
        os.write(terminal, b" ")
        while b"stop: arm" not in text:
            text += os.read(terminal, 4096)
        os.write(terminal, b"\x03")
        try:
            while os.read(terminal, 4096):
                pass
        except OSError:  # its end
            pass
        self.assertEqual(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), 0, text)

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
        self.answer("move", "two_arms", "home", "--fast", "--json")
        goal = ["0.3", "-0.5", "0.1", "-2.2", "-0.1", "1.8", "0.6"]
        moved = self.answer("move", "two_arms", "--arm", "left", "--fast", "--json", "--speed", "0.2", *goal)
        self.assertIn("arm 'left' reached its goal", moved.stderr)
        self.assertNotIn("right", [i["arm"] for i in json.loads(moved.stdout)["interventions"]])

    def test_virtual_arms_run_the_same_scene(self):
        result = self.table("run", "two_arms", "--seconds", "1", "--fast", "--backend", "virtual")
        self.assertEqual((result["backend"], result["cycles"]), ("virtual", 1000))

    def test_an_experiment_runs_through_virtual_arms(self):
        words = ["experiment", "task-1", "--fast", "--repeats", "1", "--backend", "virtual", "--out", self.folder]
        self.assertIn("task-1: passed", self.answer(*words).stdout)

    def test_a_model_is_exported(self):
        own = self.folder / "own.yaml"
        own.write_text(
            "name: own\ntitle: Own\nbase: fer\nmotor_inertia_kg_m2: [1, 1, 1, 1, 0.5, 0.5, 0.25]\n"
            "link_friction: {viscous_nm_s_per_rad: [1, 2, 3, 4, 5, 6, 7.5]}\n"
        )
        answer = self.answer("export", own, "--urdf", "--mjcf", "--hand", "--out", self.folder)
        self.assertEqual(answer.stdout.split(), [f"{self.folder}/own_hand.urdf", f"{self.folder}/own_hand.xml"])
        self.assertIn('armature="0.25" damping="7.5"', (self.folder / "own_hand.xml").read_text())
        answer = self.answer("export", "fer", "--mjcf", "--rotor-hidden", "0.5", "--out", self.folder)
        self.assertIn('armature="0.302860728"', (self.folder / "fer.xml").read_text())
        self.assertIn('<robot name="own"', (self.folder / "own_hand.urdf").read_text())

    def test_hidden_plants_are_not_revealed(self):
        # The output is the same with and without hidden plants; only the states differ.
        words = "virtual-arm one_arm --ports 0 0 0 --seconds 1 --json --pace lockstep --idle-stands-still".split()
        plain, hidden = self.answer(*words), self.answer(*words, "--hidden", "3")

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
        words = ["virtual-arm", "one_arm", "--bind", f"arm={address}", "--pace", "lockstep", "--idle-stands-still"]
        start = begun(*words, "--json", stderr=subprocess.DEVNULL)
        try:
            self.assertTrue(start.stdout.readline())  # listens
            to = ["--backend", "fci", "--address", f"arm={address}", "--fast", "--speed", "0.2", "--json"]
            # The second move begins where the first one ended, not at the scene's start.
            for goal in (["0.3", "-0.5", "0.1", "-2.2", "-0.1", "1.8", "0.6"], ["home"]):
                moved = self.answer("move", "one_arm", *to, *goal)
                self.assertIn("arm 'arm' reached its goal", moved.stderr)
                self.assertIn(address, json.loads(moved.stdout)["backend"])
        finally:
            start.terminate()
            start.communicate(timeout=PATIENCE)

    def test_an_ignored_fault_fails(self):
        scene = self.folder / "fall.yaml"
        # The end effector leaves its workspace, and the safety stage deactivates the controllet.
        scene.write_text(
            "arms:\n  - {name: left, safety: {workspace_min_m: [0, -0.2, 0.2], workspace_max_m: [0.4, 0.2, 0.9]}}\n"
            "controllets:\n  - {name: pose, type: cartesian_impedance, arms: left}\n"
            "active: [pose]\ntimeline:\n  - {at_s: 0.1, reference: {controllet: pose, input: pose, "
            "position_m: [0.55, 0, 0.5], rpy_rad: [pi, 0, 0]}}\n"
        )
        answer = self.answer("run", scene, "--fast", "--seconds", "4", "--json", code=1)
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


class LiveCommands(Calls):
    """A running scene and `multipanda ctl`, in a separate runtime folder."""

    def setUp(self):
        super().setUp()
        self.environment = {"XDG_RUNTIME_DIR": str(self.folder)}
        self.runs = []

    def tearDown(self):
        for process in self.runs:
            process.terminate()
            process.communicate(timeout=PATIENCE)

    def start(self, *arguments):
        self.runs.append(begun("run", *arguments, stderr=subprocess.STDOUT, **self.environment))
        return self.runs[-1]

    def socket(self, process):
        for line in process.stdout:
            if line.startswith("live input (multipanda ctl): "):
                return line.split(": ", 1)[1].strip()
        self.fail("no socket")

    def ctl(self, *words, code=0):
        return self.answer("ctl", *words, code=code)

    def test_a_run_without_its_timeline_takes_commands(self):
        self.socket(self.start("two_arms", "--no-timeline"))
        short = self.ctl("list").stdout
        names = re.findall(r"^[* ] (\w+)", short, re.M)
        self.assertLess(len(short.splitlines()), len(names) + 3)
        joints = next(c for c in self.table("ctl", "list")["controllets"] if "joint" in c["type"])
        full = self.ctl("list", joints["name"]).stdout
        self.assertIn("stiffness_nm_per_rad", full)
        self.assertNotIn("\n  " + next(n for n in names if n != joints["name"]) + " ", full)
        self.ctl("list", joints["name"] + "x", code=2)
        for values in (["60,60,60,60,30,30,30"], ["60", "60", "60", "60", "30", "30", "30"]):
            answer = self.ctl("parameter", joints["name"], "stiffness_nm_per_rad", *values)
        answer = self.ctl("reference", joints["name"], joints["inputs"][0]["name"], "q_rad=0.1,0.2", code=2)
        self.assertIn("expected 7 numbers, found 2", answer.stderr)
        arm = joints["arms"][0]
        for value in ("on", "off"):
            self.ctl("user-stop", arm, value)
        state = self.table("ctl", "state")["state"]
        self.assertEqual([a["error_names"] for a in state["arms"]], [[], []])
        self.assertGreater(state["cycle"], 0)

    def test_objects_keep_their_orientation_and_a_missed_grasp_is_explained(self):
        self.socket(self.start("grippers", "--no-timeline"))
        self.ctl("place", "box", "position_m=0.6,0.4,0.1")
        answer = self.ctl("gripper", "left", "grasp", "--width", "0.04", code=1)
        self.assertIn("nothing of that width was grasped", answer.stderr)

    def test_a_payload_above_the_rating_is_refused(self):
        self.socket(self.start("one_arm", "--no-timeline"))
        arm = self.table("ctl", "list")["arms"][0]
        name = arm["name"] if isinstance(arm, dict) else arm
        answer = self.ctl("load", name, "mass_kg=50", code=1)
        self.assertRegex(answer.stderr, r"a payload of 50 kg is too heavy for arm '.+': at most 2\.\d+ kg besides hand")
        self.assertIn("largest_load_kg", answer.stderr)
        before = self.positions()
        answer = self.ctl("load", name, "mass_kg=0.3")
        self.assertRegex(
            answer.stdout,
            rf"{name}: a payload of 0\.3 kg is declared: with hand and tool \(0\.71\d* kg\) the flange carries "
            r"1\.01\d kg of the 3 kg that the model is rated for, 1\.98\d kg remain",
        )
        self.assertLess(abs(self.positions()[3] - before[3]), 0.1)  # not thrown up

    def test_goals_beyond_the_limits_of_the_scene_are_refused(self):
        scene = self.folder / "tight.yaml"
        text = "arms: [{name: left, safety: {position_max_rad: [0.5, 0.5, 0.5, -1, 0.5, 2.5, 1.5]}}]\n"
        scene.write_text(text + "controllets: [{name: joints, type: joint_impedance, arms: left}]\nactive: [joints]\n")
        self.socket(self.start(str(scene)))
        q = self.positions()
        for first, accepted in ((0.49, True), (0.51, False)):  # the manufacturer's limit is 2.7 rad
            goal = ",".join(str(x) for x in [first, *q[1:]])
            answer = self.ctl("reference", "joints", "joints", f"q_rad={goal}", code=0 if accepted else 1)
            if not accepted:
                self.assertRegex(answer.stderr, r"joint1: 0\.51 rad is outside of .+ to 0\.5 rad")

    def positions(self):
        """Joint positions of the first arm, from the first cycle on."""
        while not (arms := self.table("ctl", "state")["state"]["arms"]):
            self.assertIsNone(self.runs[-1].poll())
        return arms[0]["q_rad"]

    def test_two_runs_of_a_scene_have_sockets_of_their_own(self):
        first, second = self.start("one_arm", "--no-timeline"), self.start("one_arm", "--no-timeline")
        sockets = {self.socket(first), self.socket(second)}
        self.assertEqual(len(sockets), 2)
        for path in sockets:
            self.ctl("--socket", path, "state")

    def test_stop_reaches_all_runs_of_the_computer(self):
        if not os.environ.get("MULTIPANDA_ALONE"):  # in a network namespace of its own, whose sockets it sees only
            words = ["unshare", "-rn", sys.executable, "-B", __file__, PROGRAM, self.id().removeprefix("__main__.")]
            try:
                alone = subprocess.run(
                    words, capture_output=True, text=True, env=os.environ | {"MULTIPANDA_ALONE": "1"}
                )
            except FileNotFoundError:
                self.skipTest("there is no unshare")
            if "unshare:" in alone.stderr:
                self.skipTest(alone.stderr.strip())
            return self.assertEqual(alone.returncode, 0, alone.stderr)
        elsewhere = self.folder / "else where"
        elsewhere.mkdir()
        first = self.socket(self.start("one_arm", "--no-timeline"))
        second = self.socket(self.start("two_arms", "--no-timeline", "--socket", str(elsewhere / "x")))
        other = {"XDG_RUNTIME_DIR": str(elsewhere)}

        def stopped(path):
            return [arm["stopped"] for arm in self.table("ctl", "--socket", path, "state")["state"]["arms"]]

        def resume():
            for path in (first, second):
                self.ctl("--socket", path, "resume")

        self.positions()
        answer = call("ctl", "stop", **other)
        self.assertEqual(answer.returncode, 0, answer.stderr)
        self.assertEqual((stopped(first), stopped(second)), ([True], [True, True]), answer.stdout)
        resume()
        answer = call("ctl", "stop", "lefd", "--json", **other)  # an arm of neither
        self.assertEqual(answer.returncode, 0, answer.stderr)
        for line in answer.stdout.splitlines():
            self.assertIn("there is no arm 'lefd'", json.loads(line)["message"])
        self.assertEqual((stopped(first), stopped(second)), ([True], [True, True]))
        resume()
        answer = call("ctl", "--socket", str(elsewhere / "y"), "stop", **other)
        self.assertEqual(answer.returncode, 1)
        self.assertIn("all runs are stopped", answer.stderr)
        self.assertEqual((stopped(first), stopped(second)), ([True], [True, True]))
        resume()
        answer = call("ctl", "--socket", second, "stop", "left")
        self.assertEqual(answer.returncode, 0, answer.stderr)
        self.assertEqual((stopped(first), stopped(second)), ([False], [True, False]))
        # A run that stands still keeps nobody else from stopping, and stops when it goes on.
        resume()
        os.kill(self.runs[0].pid, signal.SIGSTOP)
        answer = call("ctl", "stop", **other)
        os.kill(self.runs[0].pid, signal.SIGCONT)
        self.assertEqual(answer.returncode, 1)
        self.assertEqual((stopped(first), stopped(second)), ([True], [True, True]))

    def test_every_command_of_ctl_has_an_example_of_its_own(self):
        for name in re.findall(r"^  ([\w-]+) {2,}\S", call("ctl", "--help").stdout.split("Subcommands:")[1], re.M):
            footer = call("ctl", name, "--help").stdout.split("Example")[1]
            self.assertEqual(footer.count("multipanda"), 1, name)
            self.assertIn(f"multipanda ctl {name}", footer)


class NewScene(Calls):
    # Shipped scenes that the command writes.
    SHIPPED = {
        "fr3_duo": ("2", "fr3v2", "franka", "duo", "both"),
        "mobile_fr3_duo": ("2", "fr3v2", "franka", "mobile_duo", "both"),
        "two_fr3": ("2", "fr3", "franka", "table", "both"),
        "wall_fr3": ("1", "fr3", "franka", "wall", "force"),
    }
    # Every answer at least once.
    OTHERS = (("3", "fer", "none", "ceiling", "poses"), ("2", "fr3", "other", "wall", "lead"))
    KEYS = ("arms", "model", "hand", "mount", "use")

    def options(self, answers):
        return [word for key, answer in zip(self.KEYS, answers) for word in (f"--{key}", answer)]

    def test_shipped_scenes_are_what_it_writes(self):
        for name, answers in self.SHIPPED.items():
            file = self.folder / f"{name}.yaml"
            answer = self.answer("new", "scene", *self.options(answers), "--name", name, "--out", file)
            self.assertTrue(answer.stdout.endswith(f"ok\nwrote {file}; next: multipanda run {file}\n"))
            shipped = pathlib.Path(__file__).resolve().parent.parent / f"config/scenes/{name}.yaml"
            self.assertEqual(file.read_text().splitlines()[1:], shipped.read_text().splitlines()[1:])

    def test_other_answers_run(self):
        for answers in self.OTHERS:
            file = self.folder / f"{answers[3]}.yaml"
            self.answer("new", "scene", *self.options(answers), "--name", "mine", "--out", file)
            ran = self.table("run", file, "--fast")
            self.assertEqual((ran["success"], ran["cycles"], ran["interventions"]), (True, 12000, []), answers)

    def test_questions_are_asked_again_until_the_answer_is_valid(self):
        asked = "2\nfr4\nfr3v2\n\nduo\nboth\nmy-duo\nmy_duo\n"
        words = [PROGRAM, "new", "scene"]
        done = subprocess.run(words, input=asked, capture_output=True, text=True, cwd=self.folder, timeout=PATIENCE)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("expected one of fer, fr3, fr3v2, found 'fr4'", done.stderr)
        self.assertIn("found 'my-duo'", done.stderr)
        again, options = self.folder / "again", self.options(self.SHIPPED["fr3_duo"])
        self.answer("new", "scene", *options, "--name", "my_duo", "--out", again)
        self.assertEqual((self.folder / "my_duo.yaml").read_text(), again.read_text())

    def test_invalid_answers_write_nothing(self):
        whole = [*self.options(self.SHIPPED["wall_fr3"]), "--name", "mine", "--out", self.folder / "mine.yaml"]
        for words, expected in (
            (["--arms", "9"], "1 to 8"),
            (["--mount", "duo"], "expected one of table, wall, ceiling, found 'duo'; with 1 arms"),
            (["--name", "9"], "found '9'"),
            (["--out", self.folder / "none" / "a"], "No such file"),
        ):
            self.assertIn(expected, self.answer("new", "scene", *whole, *words, code=2).stderr)
        with open(os.devnull) as nobody:
            done = subprocess.run([PROGRAM, "new", "scene"], stdin=nobody, capture_output=True, text=True)
        self.assertEqual(done.returncode, 2)
        self.assertTrue(done.stderr.endswith("multipanda new: no answer; give --arms\n"), done.stderr)
        self.assertEqual(list(self.folder.iterdir()), [])
        self.answer("new", "scene", *whole)
        self.assertIn("mine.yaml exists", self.answer("new", "scene", *whole, code=2).stderr)
        self.answer("new", "scene", *whole, "--force")


class Pages(Calls):
    def test_docs_prints_the_page_that_a_message_names(self):
        page = (pathlib.Path(__file__).resolve().parent.parent / "docs/errors.md").read_text()
        for name in ("docs/errors.md", "errors", "docs/errors.md#what"):
            self.assertEqual(self.answer("docs", name).stdout, page)
        self.assertIn("\ncontrollets/force\n", self.answer("docs").stdout)
        self.assertIn("did you mean 'errors'?", self.answer("docs", "erors", code=2).stderr)
        self.assertTrue(self.answer("docs", "scene").stdout.startswith("# "))


class Refusals(Calls):
    def test_check_names_the_errors_of_several_parts_at_once(self):
        scene = self.folder / "wrong.yaml"
        scene.write_text(
            "arms:\n"
            "  - {name: left, model: fr4}\n"
            "  - {name: right, base: {position_m: [0, 1]}}\n"
            "  - {name: third, base: {position_m: [0, 2, 0]}}\n"
            "objects: [{name: ball, shape: sphere, radius_m: 0.1}]\n"
            "contact_bounds: {hand_speed_m_per_s: 90}\n"
            "controllets: [{name: pose, type: cartesian_impedance, arms: left}]\n"
        )
        said = self.answer("check", scene, code=2).stderr.rstrip().split("\n")
        self.assertEqual([re.findall(r"wrong.yaml:(\d)", line) for line in said], [["2"], ["3"], ["5"], ["6"]], said)

    def test_a_folder_is_not_a_scene(self):
        self.assertIn("this is a folder", self.answer("check", self.folder, code=2).stderr)

    def test_an_event_after_the_end_is_named(self):
        scene = self.folder / "late.yaml"
        scene.write_text("duration_s: 2\narms: [{name: left}]\ntimeline: [{at_s: 5, stop: left}]\n")
        self.assertIn("warning: the scene ends at 2 s: 1 event from 5 s on never happens", call("check", scene).stdout)
        events = ", ".join(f"{{at_s: {t}, stop: left}}" for t in (1, 2, 3.5))
        scene.write_text(f"duration_s: 2\narms: [{{name: left}}]\ntimeline: [{events}]\n")
        self.assertIn("ends at 2 s: 2 events from 2 s on never happen\n", call("check", scene).stdout)
        scene.write_text("duration_s: 2\narms: [{name: left}]\ntimeline: [{at_s: 1.9, stop: left}]\n")
        self.assertNotIn("warning", call("check", scene).stdout)

    def test_a_refused_experiment_leaves_no_folder(self):
        root = pathlib.Path(__file__).resolve().parent.parent
        file = self.folder / "mine.yaml"
        out = self.folder / "out"
        head = f"title: mine\nscene: {root}/experiments/scenes/task_1.yaml\n"
        for text, expected in (
            ("limits: [{metric: x_rsme_m, at_most: 1}]\n", "'x_rmse_m'"),
            ("set: {controllets.joins.parameters.x: 1}\n", "does not exist"),
            ("set: {duration_s: 0.2}\n", "the scene ends before this event"),
        ):
            file.write_text(head + text)
            self.assertIn(expected, self.answer("experiment", file, "--fast", "--out", out, code=2).stderr)
            self.assertEqual(list(out.iterdir()) if out.exists() else [], [])

    def test_parameters_of_a_scene_are_listed_for_its_joints(self):
        answer = self.answer("list", "parameters", "joint_impedance", "--scene", "two_arms")
        for values in re.findall(r"default \[(.*)\]", answer.stdout):
            self.assertEqual(len(values.split(",")), 7)


class Demo(Calls):
    def test_fast_demo(self):
        answer = self.answer("demo", "--fast", "--json", "--record", self.folder)
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
