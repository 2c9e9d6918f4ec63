#!/usr/bin/env python3
"""Runs `fit` as a user would, on recorded runs.

fit_test.py PROGRAM
"""

import json
import pathlib
import subprocess
import sys
import tempfile
import unittest

PROGRAM = None
SCENES = pathlib.Path(__file__).resolve().parents[1] / "experiments" / "scenes"


def call(*words):
    return subprocess.run([PROGRAM, *map(str, words)], capture_output=True, text=True, timeout=250)


class Fit(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.path = pathlib.Path(self.folder.name)

    def record(self, scene, seconds):
        done = call("run", scene, "--fast", "--seconds", seconds, "--record", self.path / "runs")
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        return next((self.path / "runs").iterdir())

    def test_actuation_of_a_realistic_arm(self):
        log, model = self.record(SCENES / "excitation_fer.yaml", 12), self.path / "tuned.yaml"
        done = call("fit", log, "--json", "--windows", 60, "--threads", 2, "--out", model)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        told = json.loads(done.stdout)
        self.assertIn("pass  1: residual", done.stderr)
        # Motion determines only the sum of delay and lag: 1 ms and 1 / (2 pi 50 Hz).
        total = told["delay_s"] + 1 / (6.283185 * told["bandwidth_hz"])
        self.assertAlmostEqual(1e3 * total, 1 + 3.183, delta=0.3)
        self.assertAlmostEqual(told["torque_noise_nm"], 0.05, delta=0.003)
        for scale in told["friction_scale"]:
            self.assertAlmostEqual(scale, 1, delta=0.05)
        text = model.read_text(encoding="utf-8")
        self.assertIn("command_delay_s", text)
        self.assertEqual(call("fit", log, "--plant-model", model, "--windows", 20, "--threads", 2).returncode, 0)

    def test_stiffness_of_a_table(self):
        log = self.record(SCENES / "task_3.yaml", 13)  # 0 to 30 N and back
        done = call("fit", log, "--surface", "table", "--json", "--windows", 60, "--threads", 2)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        told = json.loads(done.stdout)
        self.assertAlmostEqual(told["stiffness_n_per_m"] / 10000, 1, delta=0.05)
        self.assertLess(abs(told["height_m"]), 5e-5)

    def test_refusals_say_what_is_missing(self):
        table = self.path / "measured.csv"
        names = ["t"] + [f"{kind}{j}" for kind in ("q", "dq", "tau") for j in range(1, 8)]
        rows = "\n".join(
            ",".join([f"{0.001 * k:.3f}"] + ["0.1"] * 7 + ["0.0"] * 7 + [f"{k % 7}"] * 7) for k in range(3000)
        )
        table.write_text(",".join(names) + "\n" + rows + "\n", encoding="utf-8")
        done = call("fit", table)
        self.assertNotEqual(done.returncode, 0, done.stdout + done.stderr)
        log = self.record(SCENES / "task_3.yaml", 0.6)  # before the contact
        done = call("fit", log, "--surface", "tabel")
        self.assertEqual(done.returncode, 2, done.stdout + done.stderr)
        self.assertIn("tabel", done.stderr)
        done = call("fit", log, "--surface", "table")
        self.assertEqual(done.returncode, 1, done.stdout + done.stderr)
        self.assertIn("presses on the surface in", done.stderr)


if __name__ == "__main__":
    PROGRAM = sys.argv.pop(1)
    unittest.main()
