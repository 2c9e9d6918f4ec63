#!/usr/bin/env python3
"""One afternoon (docs/tutorials/afternoon.md) with the example's own commands: leaders that are emulated drive two arms
over ssh, their episodes become a data set, a network learns from it, and drives the arms over ssh.

MULTIPANDA_FULL=1: with the tutorial's twenty episodes and twenty trials.
"""

import contextlib
import importlib.util
import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import unittest

for package, extra in (("OpenGL", "cameras"), ("dynamixel_sdk", "leader")):
    if importlib.util.find_spec(package) is None:
        print(f"skipped: {package} is not installed (./multipanda setup, or pip install 'multipanda[{extra}]')")
        sys.exit(77)

import harness  # first: it sets the paths
import multipanda as mp
import numpy as np
from harness import FOLDER, PATIENCE, ROOT, Silent, until
from leader_test import A, B, calibration, event, mounted, pose
from lerobot_environment import export, python_with_arrow
from ssh_server import MISSING, Sshd

if MISSING:
    print(f"skipped: {MISSING}")
    sys.exit(77)

FULL = os.environ.get("MULTIPANDA_FULL") == "1"
EPISODES, TRIALS, STEPS = (20, 20, 6000) if FULL else (3, 2, 500)
EXAMPLE = ROOT / "examples" / "afternoon"
sys.path.insert(0, str(EXAMPLE))

from drive import wilson
from record import ARMS, BOX_M

SCENE = EXAMPLE / "scene.yaml"
SIDE = {"left": 1, "right": -1}
LOW_M, HIGH_M = BOX_M[2], BOX_M[2] + 0.1
FAR_M, TOUCH_M, SQUEEZE_M = 0.17, 0.115, 0.07  # of a pad from the box's middle


class Person:
    """Who leads: turns the joints of both leaders, and presses the pedal."""

    def __init__(self, run, leaders, pedal):
        self.run, self.leaders, self.pedal = run, leaders, pedal
        self.models = {arm: mp.model(str(SCENE), arm=arm) for arm in ARMS}
        self.start = {arm: run.arms[arm].state.q_rad for arm in ARMS}
        self.hands = {arm: self.models[arm].pose(self.start[arm]) for arm in ARMS}
        self.at = dict(self.start)
        self.set()

    def set(self):
        for arm in ARMS:
            pose(self.leaders[arm], self.at[arm])

    def angles(self, arm, x_m, y_m, away_m, z_m):
        """Joints of the leader with the pad beside a place."""
        hand = self.hands[arm].position_m
        by = {"x": x_m - hand[0], "y": y_m + SIDE[arm] * away_m - hand[1], "z": z_m - hand[2]}
        return self.models[arm].inverse(self.hands[arm].moved(**by), self.at[arm])

    def move(self, goal, seconds):
        """Slowly at both ends. Ends early where nobody reads any more."""
        begin, start = time.monotonic(), dict(self.at)
        while (share := (time.monotonic() - begin) / seconds) < 1:
            smooth = share**2 * (3 - 2 * share)
            self.at = {arm: start[arm] + smooth * (goal[arm] - start[arm]) for arm in ARMS}
            self.set()
            time.sleep(0.005)
        self.at = dict(goal)
        self.set()

    def press(self, key):
        os.write(self.pedal, event(key, 1, time.monotonic_ns() // 10**9))

    def pads(self, *place):
        return {arm: self.angles(arm, *place) for arm in ARMS}

    def demonstrate(self, x_m, y_m, random, begun):
        """Lifts the box, judges, and puts it down."""
        self.press(A)
        begun()
        self.move(self.pads(x_m, y_m, TOUCH_M, LOW_M), random.uniform(1.6, 2.2))
        self.move(self.pads(x_m, y_m, SQUEEZE_M, LOW_M), random.uniform(0.9, 1.2))
        self.move(self.pads(x_m, y_m, SQUEEZE_M, HIGH_M), random.uniform(1.5, 2))
        time.sleep(1)
        lifted = self.run.objects()["box"].position_m[2] > LOW_M + 0.05
        self.press(A if lifted else B)
        self.move(self.pads(x_m, y_m, SQUEEZE_M, LOW_M), 1.2)
        self.move(self.pads(x_m, y_m, FAR_M, LOW_M), 1)
        self.move(self.start, 0.8)
        return lifted


class Afternoon(unittest.TestCase):
    def setUp(self):
        signal.signal(signal.SIGINT, signal.default_int_handler)  # else ignored, as behind nohup, also by record.py
        self.stack, self.random, self.placed = contextlib.ExitStack(), np.random.default_rng(7), 0
        self.addCleanup(self.stack.close)
        folder = self.folder = pathlib.Path(tempfile.mkdtemp(dir=FOLDER))
        (folder / "multipanda").symlink_to(mp.program_path())
        self.sshd = Sshd(folder / "sshd", {"PATH": f"{folder}:/usr/bin:/bin"})
        self.stack.callback(self.sshd.close)
        (folder / "ssh").write_text(f'#!/bin/sh\nexec {shutil.which("ssh")} -F {self.sshd.config} "$@"\n')
        (folder / "ssh").chmod(0o755)
        self.environment = {**os.environ, "PATH": f"{folder}:{os.environ['PATH']}"}

    def address(self, run):
        return f"ssh://127.0.0.1:{self.sshd.port}/{pathlib.Path(run.connection.path).stem}"

    def command(self, name, *words, python=sys.executable):
        words = [str(python), "-u", str(EXAMPLE / name), *map(str, words)]
        done = subprocess.run(
            words, env=self.environment, capture_output=True, text=True, timeout=PATIENCE + 60 * TRIALS
        )
        print(done.stdout, done.stderr[-500:], flush=True)
        return done.returncode, done.stdout + done.stderr

    def record(self, run, count):
        """Episodes by record.py, until enough have succeeded; fewer if this computer is too busy to lead arms."""
        leaders = {arm: mounted() for arm in ARMS}
        for servos in leaders.values():
            self.stack.callback(servos.close)
        (self.folder / "pedal").unlink(missing_ok=True)
        os.mkfifo(self.folder / "pedal")
        pedal = os.open(self.folder / "pedal", os.O_RDWR)
        self.stack.callback(os.close, pedal)
        person = Person(run, leaders, pedal)
        said, done = [], 0
        pictures = run.folder / "pictures.mcap"
        words = [EXAMPLE / "record.py", pictures, "--run", self.address(run), "--pedal", self.folder / "pedal"]
        words += ["--leaders", *(calibration(leaders[arm]) for arm in ARMS)]
        with subprocess.Popen(
            [sys.executable, "-u", *map(str, words)],
            env=self.environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        ) as program:  # fmt: skip
            reader = threading.Thread(target=lambda: said.extend(program.stdout), daemon=True)
            reader.start()

            def heard(word, count=1):
                until(lambda: sum(word in line for line in said) >= count or program.poll() is not None, said)
                if program.poll() is not None or sum("are held" in line for line in said):
                    raise Silent

            try:
                heard("the arms follow")
                while done < count:
                    self.placed += 1  # evenly over somewhat more than the trials' places: the policy cannot extrapolate
                    x, y = BOX_M[0] + 0.18 * (0.6180 * self.placed % 1 - 0.5), 0.05 * (0.7549 * self.placed % 1 - 0.5)
                    run.place("box", [x, y, BOX_M[2] + 0.0005])
                    lifted = person.demonstrate(x, y, self.random, lambda: heard("begins", done + 1))
                    heard("success", done + lifted)
                    done += lifted
            except Silent:
                pass
            finally:
                program.send_signal(signal.SIGINT)
                program.wait(PATIENCE)
                reader.join()
                print("".join(said[-4:]), flush=True)
        return done

    def recorded(self):
        """The folders of logs with enough episodes."""
        folders, missing = [], EPISODES
        for _ in range(20):
            with mp.run(SCENE, record=self.folder / f"runs{len(folders)}") as run:
                done = self.record(run, missing)
            if done:
                folders.append(run.log.parent)
                missing -= done
                print(f"{missing} demonstrations are missing", flush=True)
            if not missing:
                return folders
        raise AssertionError(f"{missing} demonstrations are missing: this computer is too busy to lead arms")

    def driven(self, policy):
        """Whether each trial succeeded; those in which a test elsewhere has stopped all arms are repeated."""
        outcomes, batch = [], min(TRIALS, 5)
        for attempt in range(20):
            with mp.run(SCENE) as run:
                start = run.arms["left"].state.q_rad
                words = [policy, "--run", self.address(run), "--trials", batch, "--seed", 1000 + attempt]
                code, said = self.command("drive.py", *words)
                if code and re.search("stopped|not reached|did not answer|no picture", said):
                    continue
                self.assertEqual(code, 0, said)
                self.assertTrue(all(run.arms[arm].state.held for arm in ARMS))
                self.assertGreater(np.max(np.abs(run.arms["left"].state.q_rad - start)), 0.01)  # it did something
            found = re.findall(r"^trial \d+: (success|failure)$", said, re.M)
            self.assertEqual(len(found), batch)
            count = found.count("success")
            self.assertRegex(said, rf"(?m)^{count} of {batch} succeeded: \d+% to \d+% \(95 %, Wilson\)$")
            outcomes += [each == "success" for each in found]
            print(f"{sum(outcomes)} of {len(outcomes)}: {wilson(sum(outcomes), len(outcomes))}", flush=True)
            if len(outcomes) >= TRIALS:
                return outcomes
        raise AssertionError("this computer is too busy to drive arms")

    def test_all_of_it(self):
        folders = self.recorded()
        data, policy = self.folder / "lift", self.folder / "policy.npz"
        words = ["--fps", 10, "--observe", "joints,torques", "--task", "Lift the box"]
        said = export(*folders, "--lerobot", data, *words)
        about = json.loads((data / "meta/info.json").read_text())
        late = said.count("left out: it has no picture of camera")  # a busy computer
        self.assertEqual(about["total_episodes"] + late, EPISODES, said)
        self.assertGreater(about["total_frames"], 30 * about["total_episodes"])
        for name in ("top", "front"):
            self.assertEqual(about["features"][f"observation.images.{name}"]["shape"], [72, 96, 3])
        for episode in json.loads((data / "meta/multipanda.json").read_text())["episodes"]:
            self.assertEqual(episode["outcome"], "success")
            self.assertLess(max(episode["picture_age_s"].values()), 0.5)
            self.assertLess(max(episode["pairing_error_s"].values()), 0.1)
        code, said = self.command("train.py", data, policy, "--steps", STEPS, python=python_with_arrow())
        self.assertEqual(code, 0, said)
        losses = [float(x) for x in re.findall(r"loss ([\d.]+)", said)]
        self.assertEqual(len(losses), 10)
        self.assertLess(losses[-1], 0.3 * losses[0])
        outcomes = self.driven(policy)
        self.assertGreaterEqual(sum(outcomes), 0.5 * TRIALS if FULL else 0)

    def test_wilson(self):
        """Against the quadratic that the interval solves: (p - share)^2 = z^2 p (1 - p) / n."""
        for successes, trials in ((0, 20), (17, 20), (20, 20), (1, 2)):
            for p in wilson(successes, trials):
                self.assertAlmostEqual((p - successes / trials) ** 2, 1.96**2 * p * (1 - p) / trials, delta=1e-12)


if __name__ == "__main__":
    harness.main()
