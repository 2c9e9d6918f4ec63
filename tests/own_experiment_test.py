"""The experiment of the documentation, as the page runs it: own_experiment_test.py PROGRAM."""

import json
import pathlib
import re
import subprocess
import sys
import tempfile
import unittest

PROGRAM = pathlib.Path(sys.argv.pop(1))
ROOT = pathlib.Path(__file__).resolve().parents[1]
EXPERIMENT = ROOT / "examples" / "experiments" / "payload.yaml"
GRAVITY, MASS_KG = 9.81, 0.5


def run(file, folder):
    command = [PROGRAM, "experiment", file, "--fast", "--repeats", "1", "--out", folder]
    done = subprocess.run(command, capture_output=True, text=True, timeout=250)
    (results,) = pathlib.Path(folder).glob("*/results.json")
    return done, json.loads(results.read_text())


class OwnExperiment(unittest.TestCase):
    def test_the_hand_sinks_as_a_spring_does(self):
        with tempfile.TemporaryDirectory() as folder:
            done, results = run(EXPERIMENT, folder)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        self.assertEqual(len(results["runs"]), 6)
        for one in results["runs"]:
            stiffness = float(one["variant"].removeprefix("k"))
            self.assertAlmostEqual(one["metrics"]["x_rmse_m"], MASS_KG * GRAVITY / stiffness, delta=1e-4)

    def test_a_heavier_payload_breaks_the_limits(self):
        with tempfile.TemporaryDirectory() as folder:
            scene = EXPERIMENT.with_name("payload_scene.yaml").read_text()
            (pathlib.Path(folder) / "payload_scene.yaml").write_text(scene.replace("mass_kg: 0.5", "mass_kg: 0.6"))
            heavy = pathlib.Path(folder) / EXPERIMENT.name
            heavy.write_text(EXPERIMENT.read_text())
            done, results = run(heavy, folder)
        self.assertEqual(done.returncode, 1)
        self.assertIn("FAILED", done.stdout)
        self.assertEqual({limit["passed"] for limit in results["limits"] if limit["metric"] == "x_rmse_m"}, {False})

    def test_the_page_shows_the_file(self):
        """Each line of the page's excerpt is a line of the file."""
        page = (ROOT / "docs" / "experiments.md").read_text()
        (excerpt,) = re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)
        lines = [line.split("  #")[0].rstrip() for line in EXPERIMENT.read_text().splitlines()]
        for line in excerpt.splitlines():
            self.assertIn(line.rstrip(), lines)


if __name__ == "__main__":
    unittest.main()
