#!/usr/bin/env python3
"""Runs the performance experiment as a user would, shortened, and checks the results.

    performance_run_test.py PROGRAM [CLASS]

Times are not judged here: the machine may be busy. On any machine the following must hold: every cycle and every
switch is recorded, the delay of the plant is found, the bystander is not affected, and figures agree with each other.
"""

import json
import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import unittest

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

from experiments.pages.performance_test import ABOUT, write_cycles

PROGRAM = None
PATIENCE = 560  # [s]
FIGURES = {"median", "mean", "deviation", "p1", "p25", "p75", "p95", "p99", "p999", "worst", "least", "count"}


def experiment(*words, **environment):
    return subprocess.run(
        [PROGRAM, "experiment", *map(str, words)],
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        env={**os.environ, **environment},
    )


class Whole:
    """One run of all conditions: checks that hold on any machine and for all arms whose world waits for the loop."""

    WORDS, ENVIRONMENT = (), {}

    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(cls.folder.cleanup)
        cls.done = experiment(
            "controller-performance", "--fast", "--json", *cls.WORDS, "--out", cls.folder.name, **cls.ENVIRONMENT
        )
        cls.results = json.loads(cls.done.stdout) if cls.done.stdout.strip() else None
        # Prints the experiment's own messages once, whatever fails below.
        if cls.done.returncode != 0:
            print(
                cls.done.stderr,
                *(cls.results or {}).get("problems", []),
                *(cls.results or {}).get("disturbances", []),
                sep="\n",
                file=sys.stderr,
            )

    def setUp(self):
        self.assertIsNotNone(self.results, self.done.stderr)

    def test_passes(self):
        self.assertEqual(self.results["problems"], [])
        self.assertEqual((self.done.returncode, self.results["passed"]), (0, True), self.done.stderr)
        self.assertTrue(self.results["fast"])
        self.assertEqual(self.results["duration_s"], 3)
        page = pathlib.Path(self.results["report"]).read_text(encoding="utf-8")
        self.assertIn("shortened (--fast)", page)
        self.look_at_page(page)

    def test_has_all_five_conditions(self):
        self.assertEqual(list(self.results["conditions"]), ["NF", "CA", "MA", "CA-MA", "C-MA"])
        for name, c in self.results["conditions"].items():
            self.assertEqual(c["cycles"], 3000, name)
            for part in ("control_us", "whole_us", "period_us", "jitter_us"):
                self.assertEqual(set(c[part]), FIGURES, (name, part))
            for f in (c["control_us"], c["whole_us"]):
                self.assertEqual(f["count"], 3000)
                self.assertGreater(f["least"], 0)
                for low, high in (
                    ("least", "p1"),
                    ("p1", "median"),
                    ("median", "p99"),
                    ("p99", "p999"),
                    ("p999", "worst"),
                ):
                    self.assertLessEqual(f[low], f[high], (name, low, high))
            self.assertLess(c["control_us"]["median"], c["whole_us"]["median"])
            self.assertAlmostEqual(
                sum(s["mean"] for k, s in c["stages_us"].items() if k != "write"), c["control_us"]["mean"], delta=1
            )
            usage = c["usage"]
            self.assertGreaterEqual(usage["process_percent"]["count"], 5, name)
            self.assertGreaterEqual(usage["process_percent"]["mean"], usage["loop_percent"]["mean"], name)
            self.assertGreater(usage["loop_percent"]["mean"], 0, name)
            self.assertGreater(usage["memory_mb"]["median"], 10, name)
            (generator,) = c["generator"]
            (channel,) = generator["channels"]
            # One second of lead and three that count, each with a sample in every period or a missed period.
            self.assertGreaterEqual(generator["samples"] + generator["missed"], 4000, (name, generator))
            self.assertEqual(channel["refused"], 0, (name, channel))
            self.look_at_channel(name, generator, channel)

    def test_features_run_where_they_should(self):
        acting = {name: c["features"]["acting_share"] for name, c in self.results["conditions"].items()}
        self.assertEqual(acting["NF"], 0)
        for name in ("MA", "CA-MA", "C-MA"):  # a Panda near its home pose is below m_0
            self.assertGreater(acting[name], 0.9, acting)
        for name in ("CA", "CA-MA"):
            self.assertIn("pairs_largest", self.results["conditions"][name]["features"])

    def test_finds_the_delay_of_the_plant(self):
        found = {c["configured_ms"]: c["arms"] for c in self.results["delay_checks"]}
        self.assertEqual(list(found), [0, 1, 2, 3])
        places = [(configured, arms) for configured, arms in found.items()]
        places += [(c["configured_delay_ms"], c["delay"]) for c in self.results["conditions"].values()]
        for configured, arms in places:
            self.assertEqual(list(arms), ["left", "right"])
            for arm in arms.values():
                self.assertAlmostEqual(arm["correlation_ms"]["median"], configured, delta=0.02)
                self.assertEqual({arm["sequence_ms"]["least"], arm["sequence_ms"]["worst"]}, {configured})
                self.assertEqual(arm["unmatched"], 0)

    def test_switches_in_the_next_cycle(self):
        for kind in ("controllet", "feature"):
            k = self.results["switching"][kind]
            self.assertEqual((k["trials"], k["accepted"], k["in_the_next_cycle"]), (50, 50, 50), kind)
            self.assertGreater(k["received_to_first_torque_ms"]["least"], 0)
        self.look_at_bystander(self.results["switching"])

    def test_machine_and_pictures(self):
        for key in ("processor", "cores", "kernel", "memory_mb"):
            self.assertIn(key, self.results["machine"])
        folder = pathlib.Path(self.results["report"]).parent
        for name in ("index", "stages", "tails", "usage", "delays", "switching"):
            self.assertTrue((folder / f"{name}.png").is_file(), name)
        self.assertFalse((folder / "data").exists())


class Shipped(Whole, unittest.TestCase):
    def look_at_page(self, page):
        self.assertEqual((self.results["backend"], self.results["generator"]), ("mujoco", "socket"))
        self.assertNotIn("ROS topics", page)

    def look_at_channel(self, name, generator, channel):
        """A sample is lost only if there was no room for it."""
        self.assertGreaterEqual(channel["received"] + channel["lost"], generator["samples"] - 10, (name, generator))
        self.assertLessEqual(channel["lost"], generator["unsent"], (name, generator))
        self.assertGreater(channel["received"], 0, (name, generator))

    def look_at_bystander(self, switching):
        self.assertGreater(switching["bystander_cycles"], 500)  # at least those before the first switch
        self.assertEqual(switching["bystander_different"], 0)


class OverRos(Whole, unittest.TestCase):
    """The same on virtual arms over sockets, set-points by ROS topics.

    The arms wait for the loop: in real time a busy machine correctly makes an arm stop itself, which
    docs/experiments.md has figures of. So every torque must arrive, in its own period.
    """

    WORDS = ("--backend", "virtual", "--pace", "lockstep", "--generator", "ros")
    ENVIRONMENT = {
        "ROS_DOMAIN_ID": str(1 + (3 * os.getpid() + 1) % 100),
        "FASTDDS_BUILTIN_TRANSPORTS": "SHM",
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT",
    }

    def look_at_page(self, page):
        self.assertEqual(
            (self.results["backend"], self.results["pace"], self.results["generator"]), ("virtual", "lockstep", "ros")
        )
        self.assertIn("ROS topics", page)
        self.assertIn("The virtual arms run in lock-step", page)

    def look_at_channel(self, name, generator, channel):
        """The number of samples read depends on the machine; the delays show that the run follows."""
        self.assertEqual(channel["sent"], generator["samples"], (name, generator))
        # The goal that ends the course is received, too; a quick machine misses no sample before it.
        self.assertTrue(0 < channel["received"] <= channel["sent"] + 1, (name, generator))

    def look_at_bystander(self, switching):
        """The arms begin after a varying number of periods, so the two runs are not bit-identical."""
        self.assertGreater(switching["bystander_cycles"], 500)


class Words(unittest.TestCase):
    def test_refusals(self):
        with tempfile.TemporaryDirectory() as folder:
            shipped = next(pathlib.Path(__file__).resolve().parent.glob("controller-performance.yaml")).read_text(
                encoding="utf-8"
            )
            base = str(pathlib.Path(__file__).resolve().parent)
            absolute = shipped.replace("scenes/", f"{base}/scenes/").replace("courses/", f"{base}/courses/")
            for change, expected in (
                (("lead_s: 1", "led_s: 1"), "'lead_s'"),
                (("plant: realistic", "plant: 3"), "plant"),
                (("controllet: dual, course", "controllet: dul, course"), "'dul'"),
                (("duration_s: 30", "duration_s: -1"), "above 0"),
                (("[manipulability]", "[manipulabilty]"), "'manipulability'"),
            ):
                self.assertIn(change[0], absolute)
                file = pathlib.Path(folder) / "changed.yaml"
                file.write_text(absolute.replace(*change), encoding="utf-8")
                done = experiment(file, "--fast", "--out", folder, "--only", "NF")
                self.assertNotEqual(done.returncode, 0, change)
                self.assertIn(expected, done.stderr, change)

    def test_an_interrupted_experiment_goes_on_where_it_was(self):
        with tempfile.TemporaryDirectory() as folder:
            words = [PROGRAM, "experiment", "controller-performance", "--fast", "--repeats", "1", "--only", "NF,CA"]
            with subprocess.Popen([*words, "--out", folder], stdout=subprocess.PIPE, text=True) as begun:
                said = []
                for line in begun.stdout:
                    said.append(line)
                    if line.lstrip().startswith("NF") and "repeat 1" in line:
                        begun.send_signal(signal.SIGINT)
            self.assertEqual(begun.returncode, 1, said)
            command = next(line for line in said if "continue with: " in line).split("continue with: ")[1].split()
            for wrong in (["--seed", "9"], ["--pace", "lockstep", "--backend", "virtual"]):
                self.assertIn("was started with another", experiment(*command[2:], *wrong).stderr)
            done = experiment(*command[2:], "--json")
            results = json.loads(done.stdout)
            self.assertNotIn("NF     repeat", done.stderr)  # it had finished
            self.assertIn("CA     repeat 1", done.stderr)
            self.assertEqual(list(results["conditions"]), ["NF", "CA"])
            self.assertEqual([c["cycles"] for c in results["conditions"].values()], [3000, 3000])
            again = experiment(*command[2:])
            self.assertIn("no interrupted experiment", again.stderr)

    def test_a_measurement_inside_a_controller_manager_beside(self):
        with tempfile.TemporaryDirectory() as name:
            folder = pathlib.Path(name)
            file = folder / "NF_1.npz"
            write_cycles(file, 2000, 1, 2, 40.0)
            with np.load(file) as archive:
                np.savez(file, **{key: archive[key] for key in archive.files}, about=[json.dumps(ABOUT)])
            words = ("controller-performance", "--fast", "--repeats", "1", "--only", "NF", "--json", "--out", folder)
            done = experiment(*words, "--beside", folder)
            results = json.loads(done.stdout)
            self.assertAlmostEqual(results["manager"]["NF"]["control_us"]["median"], 40)
            self.assertEqual(results["conditions"]["NF"]["cycles"], 3000)
            page = pathlib.Path(results["report"]).read_text(encoding="utf-8")
            self.assertIn("not measured inside a controller_manager", page)
            self.assertIn("there is no condition 'CA'", experiment(*words, "--beside", f"CA={file}").stderr)

    def test_only_one_condition(self):
        with tempfile.TemporaryDirectory() as folder:
            done = experiment("controller-performance", "--fast", "--only", "NX", "--out", folder)
            self.assertNotEqual(done.returncode, 0)
            self.assertIn("unknown condition 'NX'", done.stderr)


if __name__ == "__main__":
    PROGRAM = sys.argv.pop(1)
    unittest.main()
