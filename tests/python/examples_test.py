#!/usr/bin/env python3
"""The examples in Python, run as a user runs them; what they print is what they did."""

import importlib.util
import pathlib
import re
import subprocess
import sys
import unittest

import harness  # first: it sets the paths
from harness import FOLDER, PATIENCE, ROOT, sockets


class Examples(unittest.TestCase):
    def output_of(self, name, *arguments):
        for _ in range(10):
            done = subprocess.run(
                [sys.executable, str(ROOT / "examples" / "python" / name), *map(str, arguments)],
                capture_output=True,
                text=True,
                timeout=3 * PATIENCE,  # pictures are made, too
                cwd=FOLDER,
            )
            # A busy computer may leave a stream silent for 0.1 s: the arm is held, and the example says so.
            late = ("reference_stale", "not_active", "is not led")
            if not any(word in done.stderr + done.stdout for word in late):
                break
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        self.assertEqual(sockets(), [])
        return done.stdout

    def test_first_arm(self):
        said = self.output_of("first_arm.py", "--record", FOLDER / "runs")
        heights = [float(z) for z in re.findall(r"^at \[.*\s([\d.]+)\s*\]$", said, re.M)]
        self.assertEqual(len(heights), 2, said)
        self.assertLess(abs(heights[0] - heights[1] - 0.05), 0.02)
        self.assertNotIn("failed", said)
        samples = int(re.search(r"torques: \((\d+), 7\)", said).group(1))
        self.assertGreater(samples, 1900)  # two motions of 1 s

    def test_two_arms(self):
        said = self.output_of("two_arms.py")
        self.assertIn("both hands 5 cm higher", said)
        self.assertIn("refused: ", said)
        self.assertIn("to ['dual']", said)
        self.assertIn("{'left': 'left_hold', 'right': 'right_cartesian'}", said)

    def test_stream_policy(self):
        said = self.output_of("stream_policy.py", "--seconds", "2")
        self.assertIn("received: 101", said)
        self.assertIn("held: True", said)
        highest = float(re.search(r"highest: (\d+) mm", said).group(1))
        self.assertLess(abs(highest - 60), 20)  # the circle's diameter

    def test_stream_policy_by_chunks(self):
        said = self.output_of("stream_policy.py", "--seconds", "2", "--chunks")
        self.assertGreater(int(re.search(r"received: (\d+)", said).group(1)), 3)
        self.assertIn("held: True", said)
        self.assertLess(abs(float(re.search(r"highest: (\d+) mm", said).group(1)) - 60), 20)

    def test_space_mouse(self):
        for _ in range(10):
            said = self.output_of("space_mouse.py", "--replay")
            x, y, z = map(int, re.search(r"moved: (-?\d+) (-?\d+) (-?\d+) mm", said).groups())
            if "held: True" in said and x > 75:
                break  # a busy computer may leave the device silent for 0.15 s, which holds the arm
        self.assertIn("held: True", said)
        self.assertLess(abs(x - 100), 25)  # 2 s at 50 mm/s
        self.assertLess(abs(y) + abs(z), 10)

    def test_own_parameters(self):
        said = self.output_of("own_parameters.py")
        self.assertIn("stiffness_n_per_m: Stiffness k. 0 to 3000 N/m.", said)  # from the library's source
        wall, hand = re.search(r"wall (\d+) mm higher, hand (-?\d+) mm higher", said).groups()
        self.assertEqual(int(wall), 60)
        self.assertGreater(int(hand), 50)  # nothing but the wall moves the hand
        self.assertRegex(said, r"refused: .*3")
        self.assertIn("speed_damping on: False", said)

    @unittest.skipUnless(importlib.util.find_spec("numba"), "Numba is not installed: pip install 'multipanda[law]'")
    def test_own_law(self):
        said = self.output_of("own_law.py", "--record", FOLDER / "own_law")
        self.assertLess(float(re.search(r"gradient: (\S+) N m", said).group(1)), 1e-6)
        self.assertLess(float(re.search(r"arrived: ([\d.]+) mrad", said).group(1)), 20)
        self.assertRegex(said, r"refused: .*1")
        self.assertNotIn("failed", said)
        self.assertLess(float(re.search(r"against the Python function: (\S+) N m", said).group(1)), 1e-9)

    def test_gripper(self):
        said = self.output_of("gripper.py")
        self.assertRegex(said, r"refused: .+")
        self.assertIn("grasped: 40 mm wide", said)
        risen, grasped = re.search(r"lifted: (\d+) mm, still grasped: (\w+)", said).groups()
        self.assertLess(abs(int(risen) - 80), 15)
        self.assertEqual(grasped, "True")
        self.assertGreater(int(re.search(r"released: (\d+) mm", said).group(1)), 60)

    def test_contact(self):
        said = self.output_of("contact.py", "--record", FOLDER / "contact")
        height, force = re.search(r"^contact at (\d+) mm, force (-[\d.]+) N$", said, re.M).groups()
        self.assertLess(abs(int(height) - 210), 20)  # of the tool center; the fingers end on the table, at 200 mm
        self.assertIn("owner: cartesian", said)
        largest, cycles = re.search(r"largest force in the log: (-[\d.]+) N in (\d+) cycles", said).groups()
        self.assertLessEqual(float(largest), float(force))
        self.assertGreater(float(largest), -75)  # the spring's force is bounded ("contact_bounds": 60 N)
        self.assertGreater(int(cycles), 3000)

    def test_compare_log(self):
        said = self.output_of("compare_log.py", "--seconds", 3, "--record", FOLDER / "compared")
        figures = dict(re.findall(r"^arm (\w+): rmse ([\d.e+-]+)", said, re.M))
        self.assertLess(float(figures["q"]), 0.01)  # [rad]; both are the same plant
        self.assertTrue((FOLDER / "compared" / "comparison" / "report.html").exists())

    def test_study(self):
        said = self.output_of("study.py", "--out", FOLDER / "study")
        sunk = [float(x) for x in re.findall(r"N/m: the hand sinks by (-?[\d.]+) mm", said)]
        self.assertEqual(len(sunk), 3, said)
        for sunk_mm, stiffness in zip(sunk, (200, 400, 800)):
            hooke_mm = 1e3 * 0.5 * 9.81 / stiffness
            self.assertLess(abs(sunk_mm - hooke_mm), 0.12 * hooke_mm)  # friction holds some, and 1 s is short
        again = self.output_of("study.py", "--out", FOLDER / "study")
        self.assertIn("18 runs, 18 of them done before", again)
        self.assertEqual(re.findall(r".* mm", said), re.findall(r".* mm", again))

    def test_virtual_arm(self):
        tests = ROOT / "examples/python/test_virtual_arm.py"
        done = subprocess.run(
            [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(tests)],
            capture_output=True,
            text=True,
            timeout=2 * PATIENCE,
            cwd=FOLDER,
        )
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        self.assertIn("2 passed", done.stdout)

    def test_each_is_tested_and_listed(self):
        tests = pathlib.Path(__file__).read_text(encoding="utf-8")
        page = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
        names = sorted(path.name for path in (ROOT / "examples" / "python").glob("*.py"))
        self.assertGreater(len(names), 7)
        for name in names:
            self.assertIn(f"](../examples/python/{name})", page)
            self.assertRegex(tests, rf'output_of\("{name}"|examples/python/{name}"')

    def test_the_guide(self):
        """The lines that the guide begins with."""
        guide = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
        code = re.search(r"```python\n(.*?)```", guide, re.S).group(1)
        program = FOLDER / "guide.py"
        program.write_text(code)
        self.assertRegex(self.output_of(program), r"\(\d+, 7\)")


if __name__ == "__main__":
    harness.main()
