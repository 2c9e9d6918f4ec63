#!/usr/bin/env python3
"""Runs `compare` as a user would, on synthetic files with known distances, and checks its output and files.

compare_test.py PROGRAM
"""

import json
import math
import pathlib
import random
import subprocess
import sys
import tempfile
import unittest

PROGRAM = None
PNG = b"\x89PNG"


def write(path, late=0.0, offset=0.0, noise=0.0, seed=1, seconds=4.0, header=None, scale=1.0):
    """An arm that rests for 1 s and swings; delayed by `late` seconds, with `offset` rad on its last joint."""
    draw = random.Random(seed)
    lines = [header or "t,q1,q2,dq1,dq2,tau1,tau2"]
    for k in range(round(1000 * seconds)):
        s = max(0.0, 0.001 * k - 1.0 - late)
        q = [0.3 * (1 - math.cos(2.1 * s)), 0.2 * (1 - math.cos(3.7 * s))]
        dq = [0.63 * math.sin(2.1 * s), 0.74 * math.sin(3.7 * s)]
        tau = [5 * v + draw.gauss(0, noise) for v in dq]
        lines.append(",".join(f"{v:.9g}" for v in [0.001 * k, q[0], q[1] + offset, *(scale * v for v in dq), *tau]))
    path.parent.mkdir(exist_ok=True, parents=True)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return str(path)


class Compare(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.path = pathlib.Path(self.folder.name)

    def run_word(self, *words):
        return subprocess.run(
            [PROGRAM, "compare", *map(str, words), "--out", str(self.path / "page")],
            capture_output=True,
            text=True,
            timeout=240,
        )

    def test_repeats_json_and_page(self):
        for i in range(3):
            write(self.path / f"real/run_{i}.csv", noise=0.2, seed=i)
            write(self.path / f"sim/run_{i}.csv", late=0.0155, offset=0.02 + 0.004 * i)
        done = self.run_word(self.path / "real", self.path / "sim", "--json")
        self.assertEqual(done.returncode, 0, done.stderr)
        results = json.loads(done.stdout)
        arm = results["arms"][0]
        self.assertEqual(arm["repeats"], 3)
        for pair in arm["pairs"]:
            self.assertAlmostEqual(pair["lag_s"], 0.0155, delta=2e-5)
        q = arm["quantities"]["q"]
        self.assertAlmostEqual(q["rmse"][1], 0.024, delta=1e-5)  # mean of 0.020, 0.024, 0.028
        self.assertAlmostEqual(q["rmse_spread_by_axis"][1], 0.004, delta=1e-5)
        self.assertAlmostEqual(q["rmse_mean"], 0.012, delta=2e-5)  # joint 1 has no error
        tau = arm["quantities"]["tau"]
        self.assertAlmostEqual(tau["rmse_mean"], 0.2, delta=0.01)  # only the real log's noise
        self.assertAlmostEqual(tau["noise_floor"], 0.2, delta=0.01)
        self.assertFalse(arm["quantities"]["F_EE"]["available"])
        page = self.path / "page"
        self.assertIn("data:image/png", (page / "report.html").read_text(encoding="utf-8"))
        self.assertEqual(json.loads((page / "results.json").read_text(encoding="utf-8")), results)
        for name in ("bars_arm.png", "q_arm.png", "tau_arm.png"):
            self.assertTrue((page / name).read_bytes().startswith(PNG), name)

    def test_a_log_compared_with_itself(self):
        log = write(self.path / "a.csv", noise=0.3)
        arm = json.loads(self.run_word(log, log, "--json").stdout)["arms"][0]
        self.assertEqual([q["max"] for q in arm["quantities"].values() if q["available"]], [0.0, 0.0, 0.0])

    def test_gate(self):
        real, sim = write(self.path / "a.csv"), write(self.path / "b.csv", offset=0.05)
        gate = self.path / "gate.yaml"
        gate.write_text("q: {rmse: 0.03, max: 0.04}\n", encoding="utf-8")
        done = self.run_word(real, sim, "--gate", gate)
        self.assertEqual(done.returncode, 1)
        self.assertIn("limit exceeded: q max is 0.05 rad at joint 2, above 0.04 rad", done.stdout)
        self.assertNotIn("q rmse", done.stdout)
        gate.write_text("q: {max: 0.06}\n", encoding="utf-8")
        self.assertEqual(self.run_word(real, sim, "--gate", gate).returncode, 0)
        gate.write_text("q: {max: 0.06}\nqq: {max: 1}\n", encoding="utf-8")
        done = self.run_word(real, sim, "--gate", gate)
        self.assertEqual(done.returncode, 2)
        self.assertIn("gate.yaml:2: unknown quantity 'qq'", done.stderr)

    def test_columns_and_refusals(self):
        good = write(self.path / "a.csv")
        own = write(self.path / "own.csv", header="stamp,p1,p2,v1,v2,e1,e2")
        self.assertEqual(
            self.run_word(own, good, "--columns", "t=stamp,q=p{},dq=v{},tau=e{}").returncode, 2
        )  # the map applies to both files
        self.assertEqual(self.run_word(own, own, "--columns", "t=stamp,q=p{},dq=v{},tau=e{}").returncode, 0)
        done = self.run_word(own, good)
        self.assertEqual(done.returncode, 2)
        self.assertIn("own.csv:1: no column of time", done.stderr)
        degrees = write(self.path / "degrees.csv", scale=180 / math.pi)
        done = self.run_word(good, degrees)
        self.assertEqual(done.returncode, 2)
        self.assertIn("57.3 times the slope of q1", done.stderr)
        done = self.run_word(good, good, "--window", "6,7")
        self.assertEqual(done.returncode, 2)
        self.assertIn("window of 6 to 7 s", done.stderr)
        self.assertEqual(self.run_word(good, self.path / "none").returncode, 2)


if __name__ == "__main__":
    PROGRAM = sys.argv.pop(1)
    unittest.main()
