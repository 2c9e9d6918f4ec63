#!/usr/bin/env python3
"""Experiments on arms of another process, as a person runs them: arms_experiment_test.py PROGRAM [TestCase...]

`multipanda experiment NAME --backend fci` controls strict virtual arms (`multipanda virtual-arm --strict`), which wait
for every command, so that a busy computer disturbs nothing. By default one short motion; with MULTIPANDA_FULL set,
resumption, a table that is missing, and every task, too. With MULTIPANDA_REALTIME set all arms keep the wall clock's
time, which needs an idle computer.
"""

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

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent / "fci"))
from virtual_arms import PATIENCE_S, VirtualArms

PROGRAM = ""
SOURCE = pathlib.Path(__file__).resolve().parent.parent
FULL = bool(os.environ.get("MULTIPANDA_FULL"))
REALTIME = bool(os.environ.get("MULTIPANDA_REALTIME"))
LONG_RUNS = unittest.skipUnless(FULL, "long: with MULTIPANDA_FULL")
GENERAL = ["mounted", "clear", "user-stop", "bounds", "to-start", "run"]

SHORT = """
title: "A short motion"
scene: {scene}
plants: [ideal, realistic]
repeats: {repeats}
seed: 2
vary:
  - {{key: arms.arm.start_rad, by: 0.02}}
measure:
  window: {{after: start, offset_s: 0.5, duration_s: 1}}
limits:
  - {{metric: q_rmse_rad, at_most: 0.1}}
published:
  - {{metric: q_rmse_rad, value: 0.06, text: "up to 0.06 rad"}}
"""
SCENE = """
name: short
duration_s: {duration}
arms:
  - {{name: arm, model: fer, hand: false, start_rad: {start},
      base: {{position_m: [0.3, -0.2, 0.1], rpy_rad: [0, 0, 0.7]}}}}
objects:
  - {{name: floor, shape: plane}}
  - {{name: shelf, shape: box, size_m: [0.2, 0.2, 0.2], position_m: [1.3, -0.2, 0.2], rpy_rad: [0, 0, 0.7]}}
controllets:
  - {{name: joints, type: joint_impedance, arms: arm}}
active: [joints]
timeline:
  - at_s: 0.3
    motion: {{controllet: joints, input: joints, rise: [0, 0, 0, 0.1, 0, 0, 0], period_s: 1, cycles: {cycles}}}
"""
LONG = 30  # s of motion, for runs that are interrupted
READY = [0, -0.7854, 0, -2.3562, 0, 1.5708, 0.7854]


class Bench:
    """A folder with a short experiment, and virtual arms whose start is elsewhere."""

    def __init__(self, repeats=1, cycles=1, experiment=None, scene=None, names=("arm",)):
        self.holder = tempfile.TemporaryDirectory()
        self.folder = pathlib.Path(self.holder.name)
        self.names = names
        if experiment is None:
            self.experiment = self.folder / "short.yaml"
            motion = {"duration": cycles + 0.8, "cycles": cycles}
            (self.folder / "scene.yaml").write_text(SCENE.format(start=READY, **motion))
            self.experiment.write_text(SHORT.format(scene="scene.yaml", repeats=repeats))
            scene = self.folder / "arms.yaml"
            scene.write_text(SCENE.format(start=[round(x + 0.15, 6) for x in READY], **motion))
            self.name = "short"
        else:
            self.experiment, self.name = experiment, experiment
        self.fast = [] if REALTIME else ["--fast"]
        pace = "realtime" if REALTIME else "lockstep"
        versions = [word for name in names for word in ("--protocol", f"{name}=any")]  # for pylibfranka, too
        self.arms = VirtualArms(PROGRAM, scene, names, pace, ["--no-gripper", "--strict", *versions])

    def __enter__(self):
        self.arms.__enter__()
        return self

    def __exit__(self, *_):
        self.arms.__exit__()
        self.holder.cleanup()

    def words(self, *more):
        words = [PROGRAM, "experiment", str(self.experiment), "--backend", "fci", "--out", str(self.folder / "runs")]
        for name in self.names:
            words += ["--address", f"{name}={self.arms.address[name]}"]
        return [*words, *self.fast, *more]

    def run(self, *more, go=()):
        """Runs to the end; the questions in `go` are answered with go, another one ends the experiment."""
        seen = AtTheTerminal(self.words(*more), go)
        end = time.monotonic() + 600
        while seen.read() and time.monotonic() < end:
            pass
        return seen.end(), seen.text

    def results(self):
        found = sorted(self.folder.glob("runs/*/results.json"))
        return json.loads(found[-1].read_text()) if found else None

    def wait_for_run(self, name, seen):
        """Until the run on arms is about to move: its log is there, and 0.5 s of wall time are over."""
        end = time.monotonic() + 2 * PATIENCE_S
        while not list(self.folder.glob(f"runs/*/logs/{name}.part/*")):
            if not seen.read() or time.monotonic() > end:
                raise AssertionError(f"{name} did not begin:\n{seen.text}")
        time.sleep(0.5)

    def log_folder(self):
        return sorted(self.folder.glob("runs/*"))[-1]


class AtTheTerminal:
    """The program behind a pseudo-terminal, as a person sees it; with `go` it is answered by lines with these names."""

    def __init__(self, words, go=()):
        words += ["--answers", "-"] if go else []
        self.go = go
        self.pid, self.file = pty.fork()
        if self.pid == 0:
            os.environ["TERM"] = "dumb"
            os.execv(words[0], words)
        self.asked = 0
        self.text = ""
        self.at = 0

    def read(self, timeout=0.1):
        if not select.select([self.file], [], [], timeout)[0]:
            return True
        try:
            data = os.read(self.file, 4096)
        except OSError:
            return False
        self.text += data.decode(errors="replace").replace("\r", "")
        while self.go and (found := re.compile(r"expected: '(.+): \.\.\.'").search(self.text, self.asked)):
            self.asked = found.end()
            self.press(f"{found[1]}: {'go' if found[1] in self.go else 'quit'}\n")
        return bool(data)

    def expect(self, pattern, timeout=2 * PATIENCE_S):
        end = time.monotonic() + timeout
        while not (found := re.compile(pattern).search(self.text, self.at)):
            if not self.read() or time.monotonic() > end:
                raise AssertionError(f"expected {pattern!r} after:\n{self.text[self.at :]}\nall:\n{self.text}")
        self.at = found.end()
        return found

    def press(self, keys):
        os.write(self.file, keys.encode())

    def end(self):
        end = time.monotonic() + PATIENCE_S
        while self.read() and time.monotonic() < end:
            pass
        _, status = os.waitpid(self.pid, 0)
        os.close(self.file)
        return os.waitstatus_to_exitcode(status)


QUESTION = r"\[Enter: go, q: quit\] > "


class Refused(unittest.TestCase):
    """Nothing is connected, so there are no arms."""

    def words(self, *more):
        return subprocess.run([PROGRAM, "experiment", *more], capture_output=True, text=True, stdin=subprocess.DEVNULL)

    def test_without_a_terminal_or_addresses(self):
        done = self.words("task-1", "--backend", "fci", "--address", "arm=127.0.0.9")
        self.assertEqual(done.returncode, 2)
        self.assertIn("there is no terminal;", done.stderr)
        done = self.words("task-1", "--backend", "fci")
        self.assertIn("needs the address of every arm", done.stderr)

    def test_answers_are_for_virtual_arms(self):
        done = self.words("task-1", "--backend", "fci", "--answers", "-", "--address", "arm=192.0.2.7")
        self.assertEqual(done.returncode, 2)
        self.assertIn("virtual arms on this computer only", done.stderr)

    def test_a_first_run_on_physical_arms_is_warned_of(self):
        with tempfile.TemporaryDirectory() as folder:
            os.environ["XDG_STATE_HOME"] = folder
            try:
                # An address for documentation: no arm is there, and none is connected.
                words = [PROGRAM, "experiment", "task-1", "--repeats", "1", "--backend", "fci"]
                seen = AtTheTerminal([*words, "--address", "arm=192.0.2.7", "--out", folder])
                seen.expect("WARNING: there is no record of a first run of this scene on physical arms")
                seen.expect(QUESTION)
                seen.press("q\n")
                self.assertEqual(seen.end(), 1)
            finally:
                del os.environ["XDG_STATE_HOME"]

    def test_what_arms_cannot_do(self):
        with tempfile.TemporaryDirectory() as folder:
            done = self.words("contact-loss", "--backend", "fci", "--answers", "-", "--out", folder,
                              "--address", "arm=127.0.0.9")  # fmt: skip
            self.assertEqual(done.returncode, 2)
            self.assertIn("which only a simulation can do", done.stderr)


class Short(unittest.TestCase):
    def test_a_person_confirms_every_step(self):
        with Bench() as bench:
            seen = AtTheTerminal(bench.words())
            seen.press("\n\n\n\n\n\n\n\n")  # ahead of the questions: they confirm nothing
            seen.expect(r"Nothing has moved yet")
            for part in ("web interface", "within reach", "user stop", "for arms beside people"):
                seen.expect(part)
                seen.expect(QUESTION)
                time.sleep(0.3)
                seen.read(0)
                self.assertEqual(len(re.findall(QUESTION, seen.text[seen.at :])), 0, "answered by itself")
                seen.press("\n")
                time.sleep(0.3)
                seen.press("\n")  # a double press confirms one question
            # From 0.15 rad off, at up to a tenth of 2.175 rad/s.
            way = seen.expect(
                r"joints by up to ([0-9.]+) rad at up to ([0-9.]+) rad/s, the hand at up to ([0-9.]+) m/s"
            )
            self.assertAlmostEqual(float(way[1]), 0.15, delta=0.03)
            self.assertLessEqual(float(way[2]), 0.22)
            self.assertLessEqual(float(way[3]), 0.1)
            seen.expect(QUESTION)
            seen.press("\n")
            # In the base frame: the shelf is 1 m in front of the base along the world's x, which is turned by -0.7.
            place = seen.expect(r"center at \(([-0-9.]+), ([-0-9.]+), ([-0-9.]+)\) m in the base frame")
            for value, expected in zip(place.groups(), (0.765, -0.644, 0.1)):
                self.assertAlmostEqual(float(value), expected, delta=2e-3)
            seen.expect(r"upper face at z = 0\.200 m")
            seen.expect(QUESTION)
            seen.press("\n")
            motion = seen.expect(r"joint 4 by ([0-9.]+) rad")
            self.assertAlmostEqual(float(motion[1]), 0.1, delta=0.03)
            seen.expect(QUESTION)
            seen.press("\n")
            seen.expect(r"short: passed")
            self.assertEqual(seen.end(), 0)
            results = bench.results()
            self.assertEqual([r["plant"] for r in results["runs"]], ["realistic", "measured"])
            page = (bench.log_folder() / "report.html").read_text()
            self.assertIn("no real arm took part", page)
            compared = next(s for s in results["summary"] if s["plant"] == "measured")["between_plants"]
            self.assertLess(compared["q_rmse_rad"], 0.06)
            self.assertGreater(compared["q_rmse_rad"], 0)

    def test_q_stops_and_a_missing_answer_is_a_no(self):
        with Bench() as bench:
            seen = AtTheTerminal(bench.words())
            seen.expect(QUESTION)
            seen.press("x\n")
            seen.expect("expected go or quit, found 'x'")
            seen.expect(QUESTION)
            seen.press("q\n")
            seen.expect("continue with: multipanda experiment")
            self.assertEqual(seen.end(), 1)
            code, text = bench.run(go=["mounted", "clear", "user-stop"])
            self.assertEqual(code, 1)
            self.assertIn("ended on request at 'bounds'", text)
            self.assertIsNone(bench.results())
        sent = bench.arms.ended["arms"]["arm"]
        self.assertEqual(sent["commands_received"], 0, sent)  # no arm was ever commanded

    @LONG_RUNS
    def test_an_interrupted_experiment_is_resumed(self):
        with Bench(repeats=2, cycles=LONG) as bench:
            seen = AtTheTerminal(bench.words(), [*GENERAL, "place shelf"])
            seen.expect(r"measured .* repeat 1")
            seen.expect(rf"Run .*, repeat 2: {LONG}\.8 s")
            bench.wait_for_run("measured_plain_2", seen)
            bench.arms.control("reflex arm joint_reflex")
            seen.expect(r"stopped: .*arm 'arm' is in mode reflex")
            found = seen.expect(r"continue with: multipanda experiment \S+ --resume (\S+)")
            self.assertEqual(seen.end(), 1)
            folder = pathlib.Path(found[1])
            self.assertIsNone(bench.results())
            kept = [file for file in (folder / "logs").glob("measured_*_1.mcap")]
            self.assertEqual(len(kept), 1, list((folder / "logs").iterdir()))
            first, before = kept[0], kept[0].stat().st_mtime_ns
            # An arm in a reflex does not move again before somebody has cleared it.
            code, text = bench.run("--resume", str(folder), go=[*GENERAL, "place shelf"])
            self.assertEqual(code, 1)
            self.assertIn("is in mode reflex", text)
            bench.arms.control("recover arm")
            code, text = bench.run("--resume", str(folder), "--seed", "5", go=GENERAL)
            self.assertEqual(code, 2)
            self.assertIn("was started with another seed", text)
            code, text = bench.run("--resume", str(folder), go=[*GENERAL, "place shelf"])
            self.assertEqual(code, 0, text)
            self.assertNotIn("repeat 1: ", text)  # that run was finished
            self.assertEqual(first.stat().st_mtime_ns, before)
            results = json.loads((folder / "results.json").read_text())
            self.assertEqual(sorted((r["plant"], r["repeat"]) for r in results["runs"]),
                             [("measured", 1), ("measured", 2), ("realistic", 1), ("realistic", 2)])  # fmt: skip

    @LONG_RUNS
    def test_a_surface_that_is_missing_ends_the_run(self):
        """Task 3 looks for its table; the virtual arm's world has none, as if nobody had placed it."""
        with tempfile.TemporaryDirectory() as folder:
            text = (SOURCE / "experiments" / "scenes" / "task_3.yaml").read_text()
            scene = pathlib.Path(folder, "scene.yaml")
            scene.write_text(text.replace("position_m: [0.4, 0, 0.31]", "position_m: [4, 0, 0.31]"))
            with Bench(experiment="task-3", scene=scene) as bench:
                code, text = bench.run("--repeats", "1", "--only", "k10", go=[*GENERAL, "place table"])
                self.assertEqual(code, 1, text)
                self.assertIn("is an object missing?", text)
                self.assertIsNone(bench.results())

    def test_ctrl_c_leaves_the_arm_at_rest(self):
        with Bench(cycles=LONG) as bench:
            seen = AtTheTerminal(bench.words(), [*GENERAL, "place shelf"])
            bench.wait_for_run("measured_plain_1", seen)
            os.kill(seen.pid, signal.SIGINT)
            seen.expect("stopping: the arms hold")
            seen.expect("continue with")
            self.assertEqual(seen.end(), 1)
            import pylibfranka as franka

            robot = franka.Robot(bench.arms.address["arm"], franka.RealtimeConfig.kIgnore)
            first = robot.read_once()
            self.assertNotEqual(first.robot_mode, franka.RobotMode.Move)
            for _ in range(300):
                state = robot.read_once()
            self.assertLess(max(abs(x) for x in state.dq), 1e-3)
            self.assertLess(max(abs(a - b) for a, b in zip(state.q, first.q)), 5e-3)


class Tasks(unittest.TestCase):
    """The paper's tasks, one variant each; the limits of the plant `realistic` hold on the arms, too."""

    def check(self, name, variant, names, places):
        scene = SOURCE / "experiments" / "scenes" / (name.replace("-", "_") + ".yaml")
        if name == "ufic-vs-impedance":
            scene = SOURCE / "experiments" / "scenes" / "task_4.yaml"
        with Bench(experiment=name, scene=scene, names=names) as bench:
            only = ["--only", variant] if variant else []
            code, text = bench.run("--repeats", "1", *only, go=[*GENERAL, *(f"place {p}" for p in places)])
            results = bench.results()
            self.assertIsNotNone(results, text)
            self.assertEqual({r["plant"] for r in results["runs"]}, {"realistic", "measured"})
            for run in results["runs"]:
                self.assertEqual(run["faults"], [])
            print(f"{name} {variant}:", json.dumps(results["summary"][-1], default=str))
            self.assertEqual(results["problems"], [], text)
            self.assertEqual(code, 0)

    @LONG_RUNS
    def test_task_1(self):
        self.check("task-1", None, ["arm"], [])

    @LONG_RUNS
    def test_task_2(self):
        self.check("task-2", None, ["arm"], [])

    @LONG_RUNS
    def test_task_3(self):
        self.check("task-3", "k10", ["arm"], ["table"])

    @LONG_RUNS
    def test_task_4(self):
        self.check("task-4", "mu03_k10", ["arm"], ["table"])

    @LONG_RUNS
    def test_task_5(self):
        self.check("task-5", "known", ["left", "right"], ["table", "box"])

    @LONG_RUNS
    def test_ufic_vs_impedance(self):
        self.check("ufic-vs-impedance", "ufic_k10,impedance_k10", ["arm"], ["table"])


if __name__ == "__main__":
    PROGRAM = os.path.abspath(sys.argv.pop(1))
    unittest.main(verbosity=2)
