#!/usr/bin/env python3
"""The examples of learning, run as a user runs them; what they print is what they did."""

import importlib.util
import json
import os
import pathlib
import re
import subprocess
import sys
import unittest

import harness  # first: it sets the paths
from harness import FOLDER, PATIENCE, ROOT, sockets

if importlib.util.find_spec("gymnasium") is None:
    print("skipped: Gymnasium is not installed")
    sys.exit(77)


FULL = os.environ.get("MULTIPANDA_FULL") == "1"


def output_of(name, *arguments, tries=1):
    for _ in range(tries):
        done = subprocess.run(
            [sys.executable, str(ROOT / "examples" / "learning" / name), *map(str, arguments)],
            capture_output=True,
            text=True,
            timeout=3 * PATIENCE,
            cwd=FOLDER,
        )
        if done.returncode == 0:
            break
    if done.returncode != 0:
        raise AssertionError(done.stdout + done.stderr)
    return done.stdout


class Learning(unittest.TestCase):
    def test_first_environment(self):
        said = output_of("first_environment.py")
        self.assertEqual(len(re.findall(r"success: True", said)), 3, said)

    def test_many_worlds(self):
        said = output_of("many_worlds.py", "--worlds", 4)
        errors = [float(x) for x in re.findall(r"worst ([\d.]+) N", said)]
        self.assertEqual(len(errors), 2, said)
        self.assertLess(errors[0], 0.8)
        # An undeclared payload of up to 1 kg looks like a force of up to 9.81 N to the arm.
        self.assertLess(errors[0], errors[1])
        self.assertLess(errors[1], 12)

    def test_own_task(self):
        said = output_of("own_task.py")
        self.assertGreater(float(re.search(r"last second: ([\d.]+)", said).group(1)), 0.7)

    def test_imitate(self):
        said = output_of("imitate.py", "--worlds", 12)
        pupil = float(re.search(r"pupil: ([\d.]+) mm", said).group(1))
        self.assertLess(pupil, 60, said)  # points are 0.1 to 0.4 m away; the teacher is not linear

    def test_learn_press_and_then_on_a_strict_virtual_arm(self):
        """A tenth of the learning runs; what was learned then runs through the client at 20 Hz."""
        out = FOLDER / "learned"
        size = ("--seeds", 1, "--population", 16, "--tries", 2, "--evaluations", 16)
        said = output_of("learn_press.py", *size, "--generations", 6, "--out", out)
        results = json.loads((out / "results.json").read_text())
        for kind in ("variable", "fixed"):
            (one,) = results[kind]
            self.assertEqual(len(one["curve"]), 6)
            self.assertGreater(one["reward"], one["curve"][0] + 0.1, said)  # it has learned
        self.assertGreater((out / "curve.png").stat().st_size, 10_000)
        output_of("learn_press.py", *size, "--generations", 1, "--out", FOLDER / "again")
        again = json.loads((FOLDER / "again" / "results.json").read_text())
        for kind in results:  # seeded, to the last bit
            self.assertEqual(again[kind][0]["curve"][0], results[kind][0]["curve"][0])
        self.arm("--policy", out / "results.json", force_n=4)

    def test_policy_on_arms(self):
        self.arm(force_n=0.5)

    def arm(self, *arguments, force_n):
        # A busy computer may be late for a strict arm, which then stops: the example is begun again.
        said = output_of("policy_on_arms.py", *arguments, tries=5)
        self.assertIn("actions: 90", said)
        self.assertIn("stopped: False", said)
        self.assertLess(abs(float(re.search(r"force: (-?[\d.]+) N", said).group(1)) - 10), force_n, said)
        # 1 to 3 mm, on a busy computer up to 7: actions last longer
        self.assertLess(float(re.search(r"hovering: ([\d.]+) mm", said).group(1)), 10, said)
        self.assertEqual(sockets(), [])

    @unittest.skipUnless(FULL, "a long one: MULTIPANDA_FULL=1")
    def test_handover_through_the_client(self):
        """Two arms with grippers: the scripted policy of the environment hands the bar over in an ordinary run."""
        import multipanda as mp
        import numpy as np
        from multipanda.tasks import Handover, Start
        from multipanda.tasks.drive import drive
        from multipanda.tasks.scripted import handover

        with mp.run(Handover.scene) as run:
            start = Start(numbers={"meeting_m": np.array([0.5, 0, 0.53])})
            drive(run, Handover(), lambda seen: handover(seen[None])[0], start)
            left, right = (run.arms[arm].state.gripper for arm in ("left", "right"))
        self.assertFalse(left.grasped)
        self.assertTrue(right.grasped)

    def test_each_is_tested_and_listed(self):
        tests = pathlib.Path(__file__).read_text(encoding="utf-8")
        page = (ROOT / "docs" / "learning.md").read_text(encoding="utf-8")
        names = sorted(path.name for path in (ROOT / "examples" / "learning").glob("*.py"))
        self.assertEqual(len(names), 6)
        for name in names:
            self.assertIn(f"](../examples/learning/{name})", page)
            self.assertIn(f'output_of("{name}"', tests)

    def test_the_page(self):
        """The lines that the page of the environments begins with."""
        page = (ROOT / "docs" / "learning.md").read_text(encoding="utf-8")
        code = re.search(r"```python\n(.*?)```", page, re.S).group(1)
        subprocess.run([sys.executable, "-c", code], check=True, timeout=PATIENCE, cwd=FOLDER)


if __name__ == "__main__":
    harness.main()
