#!/usr/bin/env python3
"""The program as its users meet it: exit codes, --json, signals, messages, the demo. Needs the built program."""

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
PATIENCE = 240  # [s] for any call; only a hang reaches it
MAGIC = b"\x89MCAP0\r\n"


def call(*words, timeout=PATIENCE, **environment):
    return subprocess.run([PROGRAM, *map(str, words)], capture_output=True, text=True, timeout=timeout,
                          env={**os.environ, **environment})


class Words(unittest.TestCase):
    def test_help_has_examples_for_every_word(self):
        text = call("--help")
        self.assertEqual(text.returncode, 0)
        words = re.findall(r"^  (\w+) {2,}\S", text.stdout.split("Subcommands:")[1], re.M)
        self.assertGreaterEqual(len(words), 10)
        for word in words:
            help_text = call(word, "--help")
            self.assertEqual(help_text.returncode, 0, word)
            self.assertIn("Examples:\n  multipanda", help_text.stdout, word)

    def test_wrong_words_are_refused_with_the_nearest(self):
        for words, expected in [
            (["rn", "two_arms"], "'run'"),
            (["run", "two_arm", "--fast"], "'two_arms'"),
            (["run", "two_arms", "--secnds", "1"], "'--seconds'"),
            (["list", "controlets"], "'controllets'"),
            (["list", "parameters", "cartesian_impedence"], "'cartesian_impedance'"),
            (["move", "two_arms", "home", "--arm", "lefd", "--fast"], "'left'"),
            (["run", "two_arms", "--address", "lefd=10.0.0.1"], "'left'"),
            (["run", "two_arms", "--backend", "virtual", "--address", "left=10.0.0.1"], "--backend fci"),
        ]:
            answer = call(*words)
            self.assertEqual(answer.returncode, 2, (words, answer))
            self.assertIn(expected, answer.stderr, words)
            self.assertEqual(answer.stdout, "", words)

    def test_wrong_use(self):
        for words in [[], ["run"], ["run", "two_arms", "--seconds", "-1"], ["run", "two_arms", "--report"],
                      ["move", "one_arm", "90", "0", "0", "0", "0", "0", "0"], ["move", "one_arm", "0.1"],
                      ["run", "two_arms", "--backend", "mujco"], ["experiment", "task-1", "--backend", "fci"],
                      ["run", "two_arms", "--backend", "fci", "--address", "left"],
                      ["run", "two_arms", "--backend", "fci", "--address", "left=1.2.3.4", "--address", "left=1.2.3.5"],
                      ["export", "/nowhere", "--csv"], ["report", "/nowhere"], ["repair", "/nowhere"]]:
            answer = call(*words)
            self.assertEqual(answer.returncode, 2, (words, answer))
            self.assertTrue(answer.stderr.strip(), words)

    def test_lists(self):
        for words, expected in [(["list", "controllets"], ["hold", "cartesian_impedance"]),
                                (["list", "features"], ["joint_limits"]), (["list", "models"], ["fer", "fr3"]),
                                (["list", "scenes"], ["one_arm", "two_arms"]),
                                (["list", "parameters", "joint_impedance"], ["stiffness_nm_per_rad", "default"])]:
            answer = call(*words)
            self.assertEqual(answer.returncode, 0, answer.stderr)
            for text in expected:
                self.assertIn(text, answer.stdout)
            self.assertNotIn("refused", answer.stdout)

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
            self.assertEqual([p.name for p in pathlib.Path(folder).iterdir()], ["wrong.yaml"])  # no run was begun


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
        # Tables of states and commands; timing is the computer's.
        with tempfile.TemporaryDirectory() as folder:
            tables = []
            for name in ("a", "b"):
                run = call("run", "two_arms", "--seconds", "2", "--fast", "--record", f"{folder}/{name}")
                self.assertEqual(run.returncode, 0, run.stderr)
                out = f"{folder}/{name}_tables"
                self.assertEqual(call("export", f"{folder}/{name}", "--csv", "--out", out).returncode, 0)
                tables.append({p.name: p.read_bytes() for p in pathlib.Path(out).glob("*.csv")
                               if re.search(r"(state|command)\.csv$", p.name)})
            self.assertGreaterEqual(len(tables[0]), 4)
            self.assertEqual(tables[0], tables[1])

    def test_signals_end_in_hold_with_a_closed_log(self):
        for number in (signal.SIGINT, signal.SIGTERM):
            with tempfile.TemporaryDirectory() as folder:
                process = subprocess.Popen([PROGRAM, "run", "one_arm", "--seconds", "1000", "--json", "--record", folder],
                                           stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
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
        process = subprocess.Popen([PROGRAM, "run", "one_arm", "--seconds", "1000"], stdout=subprocess.PIPE,
                                   stderr=subprocess.STDOUT, text=True)
        self.wait_for_line(process, " Hz ", process.stdout)
        os.kill(process.pid, signal.SIGSTOP)  # so that both are there before it can end by the first
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
        self.assertIn("arm 'left' is there", moved.stderr)
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
            own.write_text("name: own\ntitle: Own\nbase: fer\nmotor_inertia_kg_m2: [1, 1, 1, 1, 0.5, 0.5, 0.25]\n"
                           "link_friction: {viscous_nm_s_per_rad: [1, 2, 3, 4, 5, 6, 7.5]}\n")
            answer = call("export", own, "--urdf", "--mjcf", "--hand", "--out", folder)
            self.assertEqual(answer.returncode, 0, answer.stderr)
            self.assertEqual(answer.stdout.split(), [f"{folder}/own_hand.urdf", f"{folder}/own_hand.xml"])
            self.assertIn('armature="0.25" damping="7.5"', pathlib.Path(folder, "own_hand.xml").read_text())
            self.assertIn('<robot name="own"', pathlib.Path(folder, "own_hand.urdf").read_text())

    def test_hidden_plants_are_not_told(self):
        # What is said is the same with and without; words that ask are unknown; only the states differ.
        words = ["virtual-arm", "one_arm", "--ports", "0", "0", "0", "--seconds", "1", "--json", "--pace", "lockstep",
                 "--idle-stands-still"]
        plain, hidden = call(*words), call(*words, "--hidden", "3")
        self.assertEqual(hidden.returncode, 0, hidden.stderr)

        def said(answer):
            return re.sub(r"\d+", "N", answer.stdout + answer.stderr)

        self.assertEqual(said(plain), said(hidden))
        asked = subprocess.run([PROGRAM, *words, "--hidden", "3"], input="plant left\nhidden\n", capture_output=True,
                               text=True, timeout=PATIENCE)
        self.assertEqual(asked.stderr.count("there is no word"), 2, asked.stderr)

    def test_move_begins_where_a_real_arm_stands(self):
        address = f"127.{64 + os.getpid() // 250 % 64}.{os.getpid() % 250}.77"
        start = subprocess.Popen([PROGRAM, "virtual-arm", "one_arm", "--bind", f"arm={address}", "--pace", "lockstep",
                                  "--idle-stands-still", "--json"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        try:
            self.assertTrue(start.stdout.readline())  # listens
            to = ["--backend", "fci", "--address", f"arm={address}", "--fast", "--speed", "0.2", "--json"]
            # Twice: the second one begins where the first one ended, not where the scene says.
            for goal in (["0.3", "-0.5", "0.1", "-2.2", "-0.1", "1.8", "0.6"], ["home"]):
                moved = call("move", "one_arm", *to, *goal)
                self.assertEqual(moved.returncode, 0, moved.stderr)
                self.assertIn("arm 'arm' is there", moved.stderr)
                self.assertIn(address, json.loads(moved.stdout)["backend"])
        finally:
            start.terminate()
            start.communicate(timeout=PATIENCE)

    def test_an_ignored_fault_fails(self):
        with tempfile.TemporaryDirectory() as folder:
            scene = pathlib.Path(folder) / "fall.yaml"
            # The end effector leaves its box on the way to its goal: the safety stage takes the controllet out.
            scene.write_text(
                "arms:\n  - {name: left, safety: {workspace_min_m: [0, -0.2, 0.2], workspace_max_m: [0.4, 0.2, 0.9]}}\n"
                "controllets:\n  - {name: pose, type: cartesian_impedance, arms: left}\n"
                "active: [pose]\ntimeline:\n  - {at_s: 0.1, reference: {controllet: pose, input: pose, "
                "position_m: [0.55, 0, 0.5], rpy_rad: [pi, 0, 0]}}\n")
            answer = call("run", scene, "--fast", "--seconds", "4", "--json")
            self.assertEqual(answer.returncode, 1, answer.stderr)
            result = json.loads(answer.stdout)
            self.assertFalse(result["success"])
            self.assertEqual([i["rule"] for i in result["interventions"] if "clamped" not in i["rule"]],
                             ["workspace_limit"])
            self.assertEqual(result["cycles"], 4000)  # it was held, not ended

    def test_a_terminal_gets_a_table_and_no_colour_where_none_is_wanted(self):
        for no_colour in ("", "1"):
            text = self.on_terminal("run", "two_arms", "--seconds", "2", NO_COLOR=no_colour)
            self.assertIn("tracking error", text)
            self.assertRegex(text, r"\x1b\[\d+A")  # redrawn in place
            self.assertEqual("\x1b[1m" in text, no_colour == "")
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
            self.assertEqual([(i["arm"], i["rule"]) for i in result["interventions"] if "clamped" not in i["rule"]],
                             [("left", "torque_not_finite")])
            self.assertIn("bit by bit those of a run without it", answer.stderr)
            page = pathlib.Path(result["report"])
            self.assertGreater(page.stat().st_size, 10000)
            self.assertTrue(answer.stderr.rstrip().splitlines()[-1].endswith(str(page)))
            self.assertTrue(pathlib.Path(result["log"]).read_bytes().endswith(MAGIC))


if __name__ == "__main__":
    PROGRAM = str(pathlib.Path(sys.argv.pop(1)).resolve())
    unittest.main(verbosity=2)
