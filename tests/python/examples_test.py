#!/usr/bin/env python3
"""The examples in Python, run as a user runs them; what they print is what they did."""

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
                timeout=PATIENCE,
                cwd=FOLDER,
            )
            # A busy computer may leave a stream silent for 0.1 s: the arm is held, and the example says so.
            if "reference_stale" not in done.stderr and "not_active" not in done.stderr:
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

    def test_the_guide(self):
        """The lines that the guide begins with."""
        guide = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
        code = re.search(r"```python\n(.*?)```", guide, re.S).group(1)
        program = FOLDER / "guide.py"
        program.write_text(code)
        self.assertRegex(self.output_of(program), r"\(\d+, 7\)")


if __name__ == "__main__":
    harness.main()
