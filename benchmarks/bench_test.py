#!/usr/bin/env python3
"""The benchmark program: its JSON is complete and consistent, and its other outputs and refusals are as documented.

Times are not judged here: they depend on the machine and its load.
"""

import json
import math
import subprocess
import sys
import unittest

PROGRAM = None
ARMS = ("1", "2", "4", "8", "16")
SINGLE = ("hold", "gravity_compensation", "joint_impedance", "cartesian_impedance")
DUAL = ("dual_cartesian_impedance", "coupled_dual_cartesian_impedance")


def call(*words):
    return subprocess.run([PROGRAM, *words], capture_output=True, text=True, timeout=240)


class Json(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.answer = call("--json", "--samples", "20")
        cls.results = json.loads(cls.answer.stdout) if cls.answer.returncode == 0 else {}

    def test_one_object_alone_on_standard_output(self):
        self.assertEqual(self.answer.returncode, 0, self.answer.stderr)
        self.assertEqual(self.answer.stdout.count("\n"), 1)
        self.assertLessEqual({"cycle_us", "switch_ms", "realtime_factor", "limits_us", "machine"}, set(self.results))

    def test_every_key(self):
        expected = {f"{law}/{n}" for law in SINGLE for n in ARMS}
        expected |= {f"{law}/{n}" for law in DUAL for n in ARMS[1:]}
        expected |= {f"{law}+joint_limits/{n}" for law in SINGLE for n in ("1", "2")}
        expected |= {f"{law}+joint_limits/2" for law in DUAL}
        self.assertLessEqual(expected, set(self.results["cycle_us"]))
        ros = self.results["machine"].get("ros") != "not built"
        self.assertEqual(
            set(self.results["switch_ms"]), {"controllet", "feature"} | ({"ros_service"} if ros else set())
        )
        self.assertEqual(
            set(self.results["ros_us"]), {"adapter_in_loop", "cycle_with_adapter", "cycle_without"} if ros else set()
        )
        self.assertEqual(set(self.results["realtime_factor"]), set(ARMS) | {"2+features"})
        acting = {"collision_avoidance", "collision_avoidance+hulls", "joint_limits", "manipulability", "all"}
        self.assertLessEqual(acting | {"none"}, set(self.results["features_us"]))
        self.assertLessEqual(acting, set(self.results["feature_adds_us"]))
        self.assertEqual(
            set(self.results["limits_us"]),
            {"pinocchio_terms", "dual_cartesian_impedance"} | {f"mj_step/{n}" for n in ARMS},
        )
        self.assertLessEqual(
            {"cpu", "cores", "kernel", "governor", "real_time_kernel", "compiler", "build_type"},
            set(self.results["machine"]),
        )

    def test_figures_are_ordered_and_positive(self):
        for section in ("cycle_us", "features_us", "switch_ms", "ros_us", "limits_us"):
            for key, figures in self.results[section].items():
                self.assertEqual(set(figures), {"median", "p999", "worst"}, key)
                self.assertGreater(figures["median"], 0, key)
                self.assertLessEqual(figures["median"], figures["p999"], key)
                self.assertLessEqual(figures["p999"], figures["worst"], key)
        for key, factor in self.results["realtime_factor"].items():
            self.assertTrue(math.isfinite(factor) and factor > 0, key)

    def test_ratios_follow_from_the_figures(self):
        cycle, limits = self.results["cycle_us"], self.results["limits_us"]
        expected = cycle["dual_cartesian_impedance/2"]["median"] / limits["dual_cartesian_impedance"]["median"]
        self.assertAlmostEqual(self.results["ratios"]["dual_cartesian_impedance/2 to bare math"], expected, 3)
        ros = self.results["ros_us"]
        if ros:
            expected = ros["cycle_with_adapter"]["median"] / ros["cycle_without"]["median"]
            self.assertAlmostEqual(self.results["ratios"]["cycle with the ROS adapter to without"], expected, 3)
        hulls = "cycle with collision_avoidance, with base hulls to without"
        features = self.results["features_us"]
        expected = features["collision_avoidance+hulls"]["median"] / features["collision_avoidance"]["median"]
        self.assertAlmostEqual(self.results["ratios"][hulls], expected, 3)

    def test_features_neither_allocate_nor_lock(self):
        for key, calls in self.results["loop_calls"].items():
            self.assertEqual(calls, {"heap": 0, "locks": 0}, key)
        self.assertIn("all", self.results["loop_calls"])

    def test_the_number_of_samples_is_reported(self):
        self.assertEqual(self.results["samples"], 20)


class Words(unittest.TestCase):
    def test_filter_and_markdown(self):
        answer = call("--markdown", "--samples", "5", "--filter", "^cycle_us/hold/")
        self.assertEqual(answer.returncode, 0, answer.stderr)
        for n in ARMS:
            self.assertIn(f"| `hold/{n}` |", answer.stdout)
        self.assertNotIn("cartesian", answer.stdout)

    def test_google_benchmark_by_default(self):
        answer = call(
            "--filter", "^(model/M|cycle_us/hold/1|limits_us/pinocchio_terms)$", "--", "--benchmark_min_time=0.001"
        )
        self.assertEqual(answer.returncode, 0, answer.stderr)
        for name in ("model/M", "cycle_us/hold/1", "limits_us/pinocchio_terms"):
            self.assertIn(name, answer.stdout)

    def test_invalid_arguments_are_refused(self):
        for words in (
            ["--jsn"],
            ["--json", "--markdown"],
            ["--json", "--samples", "0"],
            ["--json", "--filter", "("],
            ["--json", "more"],
            ["--samples", "5"],
        ):
            answer = call(*words)
            self.assertEqual(answer.returncode, 2, (words, answer))
            self.assertEqual(answer.stdout, "", words)
            self.assertTrue(answer.stderr.strip(), words)


if __name__ == "__main__":
    PROGRAM = sys.argv.pop(1)
    unittest.main(verbosity=2)
