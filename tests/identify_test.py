#!/usr/bin/env python3
"""Runs `identify` and `predict` as a user would and reads what they print and write.

    identify_test.py PROGRAM

Real measurements are used where they lie next to the project (../shared/data); without them their tests skip.
"""

import json
import pathlib
import subprocess
import sys
import tempfile
import time
import unittest

PROGRAM = None
DATA = pathlib.Path(__file__).resolve().parents[2] / "shared" / "data" / "panda_excitation.csv"


def call(*words):
    return subprocess.run([PROGRAM, *map(str, words)], capture_output=True, text=True, timeout=200)


class Identify(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.path = pathlib.Path(self.folder.name)

    @unittest.skipUnless(DATA.exists(), f"no {DATA}")
    def test_real_data_from_file_to_prediction(self):
        model, page = self.path / "panda.yaml", self.path / "page"
        urdf, mjcf = self.path / "panda.urdf", self.path / "panda.xml"
        begin = time.monotonic()
        done = call(
            "identify",
            DATA,
            "--robot",
            "fer",
            "--out",
            model,
            "--json",
            "--report",
            page,
            "--urdf",
            urdf,
            "--mjcf",
            mjcf,
        )
        taken = time.monotonic() - begin
        self.assertEqual(done.returncode, 0, done.stderr)
        result = json.loads(done.stdout)
        for key in ("rmse_train", "rmse_heldout", "consistent", "parameters"):
            self.assertIn(key, result)
        self.assertTrue(result["consistent"])
        self.assertTrue(result["dissipative"])
        self.assertLess(result["rmse_heldout"], 0.115)
        self.assertEqual(sum(s["chosen"] for s in result["cross_validation"]), 1)
        self.assertEqual(len(result["parameters"]["link4"]["com_m"]), 3)
        self.assertEqual(len(result["base_parameters"]["values"][0]), 4)
        names = [m["name"] for m in result["models_beside"]]
        self.assertIn("fer", names)
        self.assertIn("fer_maker", names)
        self.assertLess(taken, 60)  # 45 s on an idle machine
        self.assertIn("<html", (page / "identification.html").read_text(encoding="utf-8"))
        for picture in ("models.png", "torque_0.png"):
            self.assertTrue((page / picture).read_bytes().startswith(b"\x89PNG"))
        self.assertIn("link7", urdf.read_text())
        self.assertIn("link7", mjcf.read_text())

        predicted = call("predict", DATA, "--model", model, "--model", "fer", "--json")
        self.assertEqual(predicted.returncode, 0, predicted.stderr)
        prediction = json.loads(predicted.stdout)
        self.assertEqual(len(prediction["rmse"]), 7)
        self.assertAlmostEqual(prediction["rmse_mean"], sum(prediction["rmse"]) / 7, places=12)
        self.assertAlmostEqual(prediction["rmse_mean"], result["rmse_all"]["mean"], places=6)
        self.assertEqual(len(prediction["rmse_unfiltered"]), 7)
        self.assertGreater(prediction["models"][1]["rmse_mean"], 4 * prediction["rmse_mean"])

    def test_refusals_say_what_is_wrong_and_end_as_failures(self):
        file = self.path / "short.csv"
        names = ["t"] + [f"{q}{j}" for q in ("q", "dq", "tau") for j in range(1, 8)]
        rest = [0, -0.8, 0, -2.4, 0, 1.6, 0.8] + [0] * 7 + [0, -4, 0, 19, 0.7, 2.3, 0]
        lines = [",".join(names)] + [",".join(str(v + 1e-6 * (k % 7)) for v in [0.001 * k, *rest]) for k in range(2000)]
        file.write_text("\n".join(lines) + "\n", encoding="utf-8")
        done = call("identify", file)
        self.assertEqual(done.returncode, 1)
        self.assertRegex(done.stderr, r"\d")
        self.assertEqual(call("identify", self.path / "none.csv").returncode, 1)
        unknown = call("identify", file, "--robot", "feer")
        self.assertEqual(unknown.returncode, 2)
        self.assertIn("fer", unknown.stderr)
        self.assertEqual(call("predict", file).returncode, 2)


if __name__ == "__main__":
    PROGRAM = sys.argv.pop(1)
    unittest.main()
