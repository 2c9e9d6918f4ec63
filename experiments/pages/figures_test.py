#!/usr/bin/env python3
"""Figures of synthetic runs whose errors are known in closed form, and verdicts on them."""

import pathlib
import sys
import tempfile
import unittest

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent.parent))

from experiments.pages import beside, frame, task_metrics, task_page
from experiments.pages.task_run import TaskRun, rotate, rotate_back

PERIOD = 0.001
MEASURE = {
    "window": {"after": "motion", "offset_s": 0.0, "duration_s": 10.0},
    "force": [{"arm": "arm", "direction": [0.0, 0.0, -1.0], "instance": "press", "desired": "force_desired_n"}],
    "path": {"arm": "arm", "instance": "press", "input": "pose", "plane": "xy"},
}
CONTACT, MOTION, END = 1.25, 3.0, 14.0


def invent(**changes):
    """Arrays of a run: 10 N desired, true force off by 0.4 sin(2 pi t), 5 N before contact, path 3 mm off."""
    t = np.arange(0.0, END, PERIOD)
    n, zeros = len(t), np.zeros((len(t), 7))
    true = np.where(t >= CONTACT, 10 + 0.4 * np.sin(2 * np.pi * t), 0.0)
    true[(t >= CONTACT) & (t < CONTACT + 0.05)] = 14.0
    tau = np.outer(np.sin(t), np.arange(7.0))
    gravity = np.ones((n, 7))
    circle = np.column_stack([0.4 + 0.1 * np.cos(t), 0.1 * np.sin(t), np.full(n, 0.3)])
    out = {
        "arm/state/t": t,
        "arm/state/cycle": np.arange(1, n + 1),
        "arm/state/q": zeros,
        "arm/state/dq": zeros,
        "arm/state/tau_j": tau + gravity,
        "arm/state/tau_j_d": tau + 0.2,
        "arm/command/t": t,
        "arm/command/tau_controllet": tau,
        "arm/command/tau_feature": zeros,
        "arm/command/tau_cmd": tau.copy(),
        "arm/command/limited": zeros.copy(),
        "arm/command/owner": np.full(n, "press"),
        "arm/wrench/t": t,
        "arm/wrench/has_estimate": np.ones(n),
        "arm/wrench/has_contact_truth": np.ones(n),
        "arm/wrench/contact_force": np.column_stack([np.zeros(n), np.zeros(n), -true]),
        "arm/wrench/contact_torque": np.zeros((n, 3)),
        "arm/wrench/estimated_force": np.column_stack([np.zeros(n), np.zeros(n), -true - 0.3]),
        "arm/wrench/estimated_torque": np.zeros((n, 3)),
        "arm/model/t": t[::5],
        "arm/model/cycle": np.arange(1, n + 1)[::5],
        "arm/model/tau_gravity": gravity[::5],
        "arm/model/pose_position": circle[::5] - np.array([0.003, 0.0, 0.05]),
        "arm/model/pose_orientation": np.tile([0.0, 0, 0, 1], (len(t[::5]), 1)),
        "arm/model/twist_linear": np.zeros((len(t[::5]), 3)),
        "press/pose/t": t,
        "press/pose/cycle": np.arange(1, n + 1),
        "press/pose/value": np.column_stack([circle, np.tile([1.0, 0, 0, 0], (n, 1))]),
        "press/pose/rate": np.zeros((n, 6)),
        "press/pose/kind": np.array(["pose"]),
        "press/pose/frame": np.array(["world"]),
        "press/outputs/force_desired_n/t": t,
        "press/outputs/force_desired_n/values": np.full((n, 1), 10.0),
    }
    out.update(changes)
    return out


def run_of(arrays, measure=None, objects=None, **entry):
    folder = pathlib.Path(tempfile.mkdtemp())
    np.savez(folder / "run.npz", **arrays)
    words = {
        "name": "invented",
        "npz": "run.npz",
        "plant": "ideal",
        "variant": "a",
        "repeat": 1,
        "instance_arms": {"press": ["arm"]},
        "timeline": [{"at_s": 0.5, "what": "reference"}, {"at_s": MOTION, "what": "motion"}],
        **entry,
    }
    if objects is not None:
        np.savez(folder / "objects.npz", **objects)
        words["objects"] = "objects.npz"
    return TaskRun(words, measure or MEASURE, folder)


class Figures(unittest.TestCase):
    def test_force(self):
        figures, _ = task_metrics.figures(run_of(invent()))
        self.assertAlmostEqual(figures["force_rmse_n"], 0.4 / np.sqrt(2), places=6)
        self.assertAlmostEqual(figures["force_max_n"], 0.4, places=4)
        self.assertAlmostEqual(figures["force_low_n"], 9.6, places=4)
        self.assertAlmostEqual(figures["force_high_n"], 10.4, places=4)
        self.assertAlmostEqual(figures["force_est_rmse_n"], np.sqrt(0.08 + 0.09), places=6)
        self.assertAlmostEqual(figures["impact_peak_n"], 14.0)
        self.assertAlmostEqual(figures["contact_s"], CONTACT)
        self.assertAlmostEqual(figures["contact_to_window_s"], MOTION - CONTACT)
        self.assertAlmostEqual(figures["settling_s"], 0.049, places=6)  # 14 N until then; 0.4 N is within half a newton
        self.assertEqual(figures["contact_lost_s"], 0)

    def test_lost_contact_counts(self):
        arrays = invent()
        rows = (arrays["arm/wrench/t"] >= 5) & (arrays["arm/wrench/t"] < 5.25)
        arrays["arm/wrench/contact_force"][rows] = 0
        figures, _ = task_metrics.figures(run_of(arrays))
        self.assertAlmostEqual(figures["contact_lost_s"], 0.25, places=6)
        self.assertAlmostEqual(figures["force_max_n"], 10.0)

    def test_path_only_in_its_plane(self):
        figures, _ = task_metrics.figures(run_of(invent()))
        self.assertAlmostEqual(figures["path_rms_m"], 0.003, places=9)
        self.assertAlmostEqual(figures["path_max_m"], 0.003, places=9)
        self.assertAlmostEqual(figures["x_rmse_m"], 0.003, places=9)
        measure = dict(MEASURE, path=dict(MEASURE["path"], plane="xyz"))
        figures, _ = task_metrics.figures(run_of(invent(), measure))
        self.assertAlmostEqual(figures["x_rmse_m"], np.hypot(0.003, 0.05), places=9)

    def test_torques(self):
        figures, _ = task_metrics.figures(run_of(invent()))
        self.assertAlmostEqual(figures["c_err_rmse_nm"], 0.2, places=9)
        # sent one cycle before, less what is there: -cos(t) dt times the joint's factor
        self.assertAlmostEqual(figures["tau_max_nm"], 6 * PERIOD, places=5)
        self.assertAlmostEqual(figures["torque_rate_nm_per_s"], 6.0, places=2)
        self.assertEqual(figures["limiter_hits"], 0)

    def test_limiter_hits_count_from_contact_to_the_end(self):
        arrays = invent()
        t = arrays["arm/command/t"]
        for at in (0.2, CONTACT + 0.1, 5.0, 13.5):  # before contact, after it, in the window, after it
            arrays["arm/command/limited"][np.argmin(np.abs(t - at)), 2] = 1
        figures, _ = task_metrics.figures(run_of(arrays))
        self.assertEqual(figures["limiter_hits"], 2)

    def test_no_contact_and_no_window(self):
        arrays = invent()
        arrays["arm/wrench/contact_force"][:] = 0
        measure = dict(MEASURE, window={"after": "contact", "offset_s": 1.5, "duration_s": 10.0})
        self.assertIsNone(run_of(arrays, measure).window)
        self.assertEqual(task_metrics.figures(run_of(arrays, measure)), ({}, {}))
        run = run_of(invent(), measure)
        self.assertAlmostEqual(run.window[0], CONTACT + 1.5)

    def test_a_run_that_ended_early_has_no_figures(self):
        measure = dict(MEASURE, window={"after": "motion", "offset_s": 0.0, "duration_s": 20.0})
        self.assertNotIn("force_rmse_n", task_metrics.figures(run_of(invent(), measure))[0])

    def test_a_law_without_force(self):
        arrays = invent()
        for name in ("t", "values"):
            del arrays[f"press/outputs/force_desired_n/{name}"]
        with self.assertRaises(ValueError):
            task_metrics.figures(run_of(arrays))
        measure = dict(MEASURE, force=[dict(MEASURE["force"][0], desired_n=9.0)])
        figures, _ = task_metrics.figures(run_of(arrays, measure))
        self.assertAlmostEqual(figures["force_rmse_n"], np.sqrt(1 + 0.08), places=6)

    def test_created_energy(self):
        """2 J/s are gained while pressing with 10 N on a body moving at 0.1 m/s: 1 J/s goes into it, 3 are created."""
        arrays = invent()
        t, tm = arrays["arm/state/t"], arrays["arm/model/t"]
        arrays["arm/wrench/contact_force"][:] = [0, 0, -10]
        arrays["arm/model/twist_linear"] = np.tile([0.0, 0, -0.1], (len(tm), 1))
        arrays["press/outputs/stored_energy_j/t"], arrays["press/outputs/stored_energy_j/values"] = (
            t,
            (5 + 2 * t)[:, None],
        )
        figures, _ = task_metrics.figures(run_of(arrays))
        self.assertAlmostEqual(figures["energy_gain_w"], 3.0, places=3)

    def test_grasp(self):
        """A box that rises with its set-point but stays 1 mm behind, turns 0.01 rad about y, slides 2 mm along x."""
        arrays = invent()
        t, tm = arrays["arm/state/t"], arrays["arm/model/t"]
        lift = np.interp(t, [4, 8], [0, 0.2])
        arrays["press/pose/value"][:, :3] = np.column_stack([np.full(len(t), 0.5), np.zeros(len(t)), 0.3 + lift])
        hand = np.column_stack([np.full(len(tm), 0.5), np.full(len(tm), 0.1), np.interp(tm, t, 0.3 + lift)])
        arrays["arm/model/pose_position"] = hand
        late = (t >= 6).astype(float)
        angle = 0.01 * (t >= 12)
        box = np.column_stack([0.5 + 0.002 * late, np.zeros(len(t)), 0.3 + lift - 0.001 * late])
        pose = np.column_stack([t, box, np.cos(angle / 2), np.zeros(len(t)), np.sin(angle / 2), np.zeros(len(t))])
        measure = dict(
            MEASURE,
            force=[dict(MEASURE["force"][0], direction=[0.0, -1.0, 0.0])],
            grasp={"name": "box", "instance": "press", "input": "pose"},
        )
        arrays["arm/wrench/contact_force"] = np.tile([0.0, -10, 0], (len(t), 1))
        arrays["arm/wrench/contact_force"][t < CONTACT] = 0
        figures, _ = task_metrics.figures(run_of(arrays, measure, {"box/pose": pose}))
        self.assertAlmostEqual(figures["lift_error_m"], 0.001, places=6)
        self.assertAlmostEqual(figures["tilt_rad"], 0.01, places=6)
        # The point under the hand lies on the axis of the turn (y through the box): only the slide and the lag move it.
        self.assertAlmostEqual(figures["slip_m"], np.hypot(0.002, 0.001), places=5)
        self.assertEqual(figures["held"], 1)
        arrays["arm/wrench/contact_force"][t > 10] = 0
        self.assertEqual(task_metrics.figures(run_of(arrays, measure, {"box/pose": pose}))[0]["held"], 0)

    def test_arms_have_estimates_only(self):
        """A measured run: no contact truth, no objects. The estimate is 0.3 N above the sine of 0.4 N."""
        arrays = invent()
        arrays["arm/wrench/has_contact_truth"][:] = 0
        t = arrays["arm/wrench/t"]
        arrays["arm/wrench/estimated_force"][t < CONTACT] = 0
        arrays["arm/wrench/estimated_force"][(t > 0.5) & (t < 0.51), 2] = -5  # 10 ms of noise are no contact
        measure = dict(MEASURE, grasp={"name": "box", "instance": "press", "input": "pose"})
        with self.assertRaises(ValueError):
            task_metrics.figures(run_of(arrays, measure))  # a simulation always has true forces
        run = run_of(arrays, measure, plant="measured")
        figures, _ = task_metrics.figures(run)
        self.assertAlmostEqual(figures["force_rmse_n"], np.sqrt(0.08 + 0.09), places=6)
        self.assertAlmostEqual(figures["force_est_rmse_n"], figures["force_rmse_n"])
        self.assertAlmostEqual(figures["contact_s"], CONTACT)
        for name in task_metrics.NOT_ON_ARMS:
            self.assertNotIn(name, figures)
        limits = [{"metric": "held", "at_most": {}, "at_least": {"measured": 1, "ideal": 1}, "variants": []}]
        runs = [{"plant": p, "variant": "a", "repeat": 1, "metrics": {}} for p in ("measured", "ideal")]
        variants = [{"name": "a", "tags": [], "reported": False}]
        rows = frame.judge(limits, runs, variants, ["ideal", "measured"], {("measured", "held")})
        self.assertEqual([row["plant"] for row in rows], ["ideal"])

    def test_measured_beside_simulated(self):
        """Both estimates are compared, 0.2 N apart, although the simulation also has true forces; joints 0.05 rad."""
        arrays = invent()
        arrays["arm/wrench/has_contact_truth"][:] = 0
        arrays["arm/wrench/estimated_force"][:, 1] += 0.2
        arrays["arm/state/q"] = arrays["arm/state/q"] + 0.05
        one = task_metrics.series_of(run_of(invent()))
        other = task_metrics.series_of(run_of(arrays, plant="measured"))
        for a, b in ((one, other), (other, one)):
            found = task_metrics.difference(a, b)
            self.assertAlmostEqual(found["f_rmse_n"], 0.2, places=6)
            self.assertAlmostEqual(found["q_rmse_rad"], 0.05, places=6)
        # Two simulations are compared by their true forces.
        self.assertAlmostEqual(task_metrics.difference(one, dict(one))["f_rmse_n"], 0)
        published = [
            {"metric": "f_rmse_n", "value": 1.7, "text": ""},
            {"metric": "q_rmse_rad", "value": 0.04, "text": ""},
        ]
        canvas = beside.figure(one, other, "arm", published, ("simulated", "measured"))
        rows = [axis.get_title(loc="left") for axis in canvas.axes]
        self.assertIn("difference [N], paper: ± 1.7 N", rows)
        places = [line.get_ydata()[0] for line in canvas.axes[rows.index("difference [N], paper: ± 1.7 N")].lines[-2:]]
        self.assertEqual(places, [-1.7, 1.7])
        summary = {("measured", "a"): {"between_plants": task_metrics.difference(other, one)}}
        table = beside.table(summary, [{"name": "a", "label": "a"}], published, "measured")
        self.assertIn("beyond", table)  # 0.05 rad
        self.assertIn("within", table)

    def test_loss(self):
        arrays = invent()
        tm = arrays["arm/model/t"]
        after = np.maximum(tm - 5, 0)
        arrays["arm/model/pose_position"][:, 2] = 0.3 - 0.02 * (1 - np.exp(-after / 0.1))
        arrays["arm/model/twist_linear"] = np.column_stack(
            [np.zeros(len(tm)), np.zeros(len(tm)), -0.2 * np.exp(-after / 0.1) * (tm >= 5)]
        )
        measure = dict(MEASURE, loss={"arm": "arm", "at_s": 5.0, "direction": [0.0, 0.0, -1.0]})
        figures, _ = task_metrics.figures(run_of(arrays, measure))
        self.assertAlmostEqual(figures["loss_speed_m_per_s"], 0.2, places=6)
        self.assertAlmostEqual(figures["loss_travel_m"], 0.02, places=6)

    def test_runs_against_each_other(self):
        other = invent()
        other["arm/state/q"] = np.full_like(other["arm/state/q"], 0.05)
        other["arm/model/pose_position"] = other["arm/model/pose_position"] + np.array([0.003, 0.004, 0])
        a, b = task_metrics.series_of(run_of(invent())), task_metrics.series_of(run_of(other))
        found = task_metrics.difference(a, b)
        self.assertAlmostEqual(found["q_rmse_rad"], 0.05, places=9)
        self.assertAlmostEqual(found["x_rmse_m"], 0.005, places=9)
        self.assertAlmostEqual(found["dq_rmse_rad_per_s"], 0, places=12)
        to_mean = [task_metrics.difference(s, task_metrics.mean_series([a, b])) for s in (a, b)]
        self.assertAlmostEqual(task_metrics.pooled(to_mean)["q_rmse_rad"], 0.025, places=9)

    def test_rotations(self):
        half = np.array([[np.cos(np.pi / 4), 0, 0, np.sin(np.pi / 4)]])  # a quarter turn about z
        np.testing.assert_allclose(rotate(half, np.array([[1.0, 0, 0]])), [[0, 1, 0]], atol=1e-12)
        np.testing.assert_allclose(rotate_back(half, np.array([[0.0, 1, 0]])), [[1, 0, 0]], atol=1e-12)


class Verdicts(unittest.TestCase):
    VARIANTS = [
        {"name": "a_x", "tags": ["a", "x", "a_x"], "reported": False, "label": ""},
        {"name": "p", "tags": ["p"], "reported": True, "label": ""},
    ]

    def judged(self, limit, figures):
        runs = [
            {"plant": "ideal", "variant": v, "repeat": i + 1, "metrics": {"m": x} if x is not None else {}}
            for v, values in figures.items()
            for i, x in enumerate(values)
        ]
        return frame.judge(
            [{"metric": "m", "at_most": {}, "at_least": {}, "variants": [], **limit}],
            runs,
            self.VARIANTS,
            ["ideal", "realistic"],
        )

    def test_the_worst_repeat_counts(self):
        (row,) = self.judged({"at_most": {"ideal": 2}}, {"a_x": [1, 2.1, 1.5], "p": [9]})
        self.assertEqual((row["passed"], row["worst"], row["repeat"], row["variant"]), (False, 2.1, 2, "a_x"))
        (row,) = self.judged({"at_least": {"ideal": 2}}, {"a_x": [3, 2.0]})
        self.assertEqual((row["passed"], row["worst"], row["repeat"]), (True, 2.0, 2))

    def test_reported_variants_only_by_name(self):
        (row,) = self.judged({"at_most": {"ideal": 2}, "variants": ["p"]}, {"a_x": [1], "p": [9]})
        self.assertEqual((row["variant"], row["passed"]), ("p", False))
        (row,) = self.judged({"at_most": {"ideal": 2}, "variants": ["x"]}, {"a_x": [1], "p": [9]})
        self.assertEqual((row["variant"], row["passed"]), ("a_x", True))

    def test_what_was_not_measured_is_not_passed(self):
        (row,) = self.judged({"at_most": {"ideal": 2}}, {"a_x": [1, None]})
        self.assertEqual((row["passed"], row["worst"], row["repeat"]), (False, None, 2))
        self.assertIn("could not be measured", frame.sentence(row, lambda m, v: (m, v)))

    def test_a_missed_limit_is_named_once(self):
        row = dict(
            metric="x_rmse_m", plant="ideal", variant="plain", bound="at_most", limit=0.005, worst=0.0073, repeat=1
        )
        self.assertEqual(
            frame.sentence(row, task_page._label),
            "plain on ideal: end effector 7.3 mm in repeat 1, at most 5 mm allowed",
        )


if __name__ == "__main__":
    unittest.main()
