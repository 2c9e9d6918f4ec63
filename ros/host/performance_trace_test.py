#!/usr/bin/env python3
"""The multimode controller's measurement of itself, read as the page reads it and compared with what is known.

    performance_trace_test.py DRIVE_HOST BUSY_LAW

DRIVE_HOST calls the hosts as a controller_manager does, in lock-step, and times each update() from outside.
"""

import pathlib
import subprocess
import sys
import tempfile
import unittest

import numpy as np

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from experiments.pages import in_manager, performance_metrics

DRIVE, BUSY = None, None
SCENE = (ROOT / "experiments/scenes/performance.yaml").read_text(encoding="utf-8")
ARMS = {
    "controller.arm_names": "[left, right]",
    "controller.arms.left.model": "fer",
    "controller.arms.left.base.position_m": "[0, 0.26, 0]",
    "controller.arms.right.model": "fer",
    "controller.arms.right.base.position_m": "[0, -0.26, 0]",
}
DUAL = {
    "controller.controllets.dual.type": "dual_cartesian_impedance",
    "controller.controllets.dual.arms": "[left, right]",
    "controller.active": "dual",
}
LATE = [900, 1300]


class Driven(unittest.TestCase):
    def drive(self, settings, delay_s=0.002, cycles=2000, duration_s=1.5, late=()):
        """One activation; returns (trace, times of the updates from outside [us], what was said)."""
        with tempfile.TemporaryDirectory() as name:
            folder = pathlib.Path(name)
            plant = f"plant: {{fidelity: realistic, command_delay_s: {delay_s}}}"
            self.assertIn("plant: {fidelity: realistic}", SCENE)
            scene = folder / "scene.yaml"
            scene.write_text(SCENE.replace("plant: {fidelity: realistic}", plant), encoding="utf-8")
            words = {
                "hardware.scene": scene,
                "cycles": cycles,
                "times": folder / "times.txt",
                "controller.performance_trace.folder": folder / "measured",
                "controller.performance_trace.condition": "NF",
                "controller.performance_trace.duration_s": duration_s,
                "controller.performance_trace.lead_s": 0.2,
                **({"late": f"[{', '.join(map(str, late))}]"} if late else {}),
                **settings,
            }
            done = subprocess.run(
                [DRIVE, *(f"{key}={value}" for key, value in words.items())],
                capture_output=True,
                text=True,
                timeout=300,
            )
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertEqual([p.name for p in (folder / "measured").iterdir()], ["NF_1.npz"], done.stdout)
            trace = in_manager.InsideTrace({"condition": "NF", "npz": "measured/NF_1.npz"}, folder)
            return trace, np.loadtxt(folder / "times.txt"), done.stdout

    def test_cycles_times_and_delays_are_those_of_the_loop(self):
        trace, outside, said = self.drive({**ARMS, **DUAL}, delay_s=0.002, late=LATE)
        # 1500 cycles after 200, none missing, in order.
        np.testing.assert_array_equal(trace["cycle"], np.arange(201, 1701))
        self.assertEqual((trace.missing, trace.about["full"]), (0, True))
        self.assertIn("1500 cycles are in", said)
        self.assertIn("memory was full", said)

        # Each update() encloses its step; on the median little else is in it.
        outside = outside[trace["cycle"] - 1]
        self.assertTrue(np.all(trace["whole_us"] < outside), np.max(trace["whole_us"] - outside))
        self.assertTrue(np.all(trace.control_us < trace["whole_us"]))
        self.assertGreater(np.median(trace["whole_us"]), 0.7 * np.median(outside))
        figures = in_manager.figures([trace])
        self.assertAlmostEqual(figures["whole_us"]["median"], np.median(trace["whole_us"]))
        self.assertAlmostEqual(figures["whole_us"]["worst"], np.max(trace["whole_us"]))

        # The loop slept before these cycles.
        period = dict(zip(trace["cycle"][1:], trace.period_us))
        for cycle in LATE:
            self.assertGreater(period[cycle], 5000)
        self.assertGreater(figures["jitter_us"]["worst"], 4000)

        # The plant uses a torque 2 ms after it was sent.
        for arm in ("left", "right"):
            delay = figures["delay"][arm]
            self.assertEqual({delay["sequence_ms"]["least"], delay["sequence_ms"]["worst"]}, {2.0})
            self.assertGreater(delay["sequence_ms"]["count"], 1400)
            self.assertAlmostEqual(delay["correlation_ms"]["median"], 2.0, delta=0.02)

    def test_a_known_computing_time_shows_in_its_stage(self):
        busy = 300.0
        law = {
            "controller.plugins": f"[{BUSY}]",
            "controller.controllets.busy.type": "busy",
            "controller.controllets.busy.arms": "left",
            "controller.active": "busy",
        }
        medians = []
        for busy_us in (0.0, busy):
            trace, _, _ = self.drive(
                {**ARMS, **law, "controller.controllets.busy.parameters.busy_us": busy_us}, cycles=800, duration_s=0.5
            )
            stage = trace["stages_us"][:, 1]
            medians.append(np.median(stage))
            self.assertGreaterEqual(np.min(stage), busy_us)
            self.assertTrue(np.all(trace.control_us >= stage) and np.all(trace["whole_us"] >= trace.control_us))
        self.assertLess(medians[0], busy / 2)
        self.assertEqual(performance_metrics.STAGES[1], "controllets")

    def test_without_the_arms_own_state_no_delay_is_claimed(self):
        plain = {
            f"controller.arms.{arm}.{key}": value
            for arm in ("left", "right")
            for key, value in (("state_interfaces", "[position, velocity, effort]"), ("gravity_compensation", "robot"))
        }
        trace, _, _ = self.drive({**ARMS, **DUAL, **plain}, cycles=800, duration_s=0.5)
        self.assertEqual(in_manager.figures([trace])["delay"], {"left": None, "right": None})

    def test_a_name_that_is_wrong_is_refused(self):
        with self.assertRaisesRegex(AssertionError, "no controllet 'dul'.*did you mean 'dual'"):
            self.drive({**ARMS, **DUAL, "controller.performance_trace.controllet": "dul"})


if __name__ == "__main__":
    DRIVE, BUSY = sys.argv.pop(1), sys.argv.pop(1)
    unittest.main()
