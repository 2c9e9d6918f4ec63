#!/usr/bin/env python3
"""The report matches the log: all sections, numbers computed independently, and missing data are stated."""

import html.parser
import math
import pathlib
import re
import subprocess
import sys
import tempfile
import unittest

import numpy as np

ROOT = pathlib.Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from report import loading, metrics, report, series, style
from report.testing import sample_run


class Page(html.parser.HTMLParser):
    """Headings, tables as lists of rows, addresses of everything that a browser would load, and all text."""

    def __init__(self, text):
        super().__init__()
        self.headings, self.tables, self.addresses, self.images, self.tags = [], [], [], 0, []
        self.words, self._heading = [], None
        self.feed(text)
        self.text = " ".join(" ".join(self.words).split())

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        self.addresses += [
            value for key, value in attributes if key in ("src", "href", "srcset", "action", "data", "poster")
        ]
        self.images += tag == "img"
        if tag == "table":
            self.tables.append([])
        elif tag == "tr":
            self.tables[-1].append([])
        elif tag in ("td", "th"):
            self.tables[-1][-1].append("")
        elif tag in ("h1", "h2", "h3"):
            self.headings.append("")
        self._heading = tag if tag in ("h1", "h2", "h3", "td", "th", "style", "title") else self._heading

    def handle_endtag(self, tag):
        if tag == self._heading:
            self._heading = None

    def handle_data(self, data):
        if self._heading == "style":
            return
        self.words.append(data)
        if self._heading in ("td", "th"):
            self.tables[-1][-1][-1] += data
        elif self._heading in ("h1", "h2", "h3"):
            self.headings[-1] += data

    def table(self, *head):
        """Rows of the first table whose head begins with these texts."""
        for table in self.tables:
            if table and table[0][: len(head)] == list(head):
                return table[1:]
        raise AssertionError(f"no table {head} in {[t[0] for t in self.tables]}")


class Folder(unittest.TestCase):
    def setUp(self):
        self._folder = tempfile.TemporaryDirectory()
        self.addCleanup(self._folder.cleanup)
        self.folder = pathlib.Path(self._folder.name)

    def report(self, arrays, meta=None, pictures=()):
        npz, meta_file = sample_run.write(self.folder, arrays, meta)
        path = report.make_report(loading.load(npz, meta_file), self.folder / "out", pictures)
        self.html = path.read_text(encoding="utf-8")
        return Page(self.html)


class WholeRun(unittest.TestCase):
    """Two arms, short; every number of the page is derived here from the arrays independently."""

    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.folder = pathlib.Path(folder.name)
        cls.arrays, cls.meta = sample_run.invent(seconds=4.0)
        path = report.make_report(loading.load(*sample_run.write(cls.folder, cls.arrays, cls.meta)), cls.folder / "out")
        cls.html = path.read_text(encoding="utf-8")
        cls.page = Page(cls.html)

    def test_has_all_sections(self):
        for heading in (
            "At a glance",
            "What is missing",
            "Switches",
            "Interventions",
            "Tracking",
            "Arm left",
            "Arm right",
            "Joint positions",
            "Joint velocities",
            "Joint torques",
            "End effector",
            "Wrench on the environment",
            "Several arms together",
            "Cycle times",
            "Events",
            "Plant",
            "Machine and versions",
        ):
            self.assertIn(heading, self.page.headings)

    def test_needs_nothing_else(self):
        self.assertGreater(len(self.page.addresses), 10)
        for address in self.page.addresses:
            self.assertTrue(address.startswith(("data:image/", "#")), address[:60])
        self.assertNotIn("script", self.page.tags)
        self.assertNotIn("link", self.page.tags)
        self.assertNotIn("@import", self.html)
        self.assertIsNone(re.search(r"url\(", self.html))

    def test_plots_are_next_to_the_page_and_in_it(self):
        files = {path.name for path in (self.folder / "out").glob("*.png")}
        expected = {f"{arm}_{what}.png" for arm in ("left", "right") for what in ("q", "dq", "tau", "pose")}
        expected |= {"left_wrench.png", "coupled_task.png", "overview.png", "cycle_histogram.png", "cycle_times.png"}
        self.assertEqual(files, expected)
        self.assertEqual(self.page.images, len(expected))
        for path in (self.folder / "out").glob("*.png"):
            self.assertEqual(path.read_bytes()[:8], b"\x89PNG\r\n\x1a\n")

    def test_cycle_times(self):
        total = sorted(self.arrays["timing/total"].tolist())
        n = len(total)
        for share, name in ((0.5, "median"), (0.99, "p99"), (0.999, "p99.9")):
            rank = math.ceil(round(share * n, 6))  # nearest rank
            self.assertIn(f"{1e6 * total[rank - 1]:.1f} µs cycle, {name}", self.page.text)
        self.assertIn(f"{1e6 * total[-1]:.1f} µs cycle, worst", self.page.text)

    def test_rate_duration_overruns(self):
        start = self.arrays["timing/start"]
        self.assertIn(f"{(len(start) - 1) / (start[-1] - start[0]):.1f} Hz", self.page.text)
        self.assertIn("4.000 s duration", self.page.text)
        self.assertIn("4 000 cycles recorded", self.page.text)
        self.assertIn("1 overruns", self.page.text)
        self.assertIn("Nothing is known to be missing", self.page.text)

    def test_switches(self):
        rows = self.page.table("t [s]", "started", "stopped", "kept")
        self.assertEqual(len(rows), 5)
        self.assertEqual([row[0] for row in rows], ["1.000", "1.800", "2.600", "3.600", "3.620"])
        self.assertEqual(rows[0][1:4], ["left_joints", "left_cartesian", "right_cartesian"])
        self.assertEqual(rows[0][4], "0 → 0.450 → 0.471")  # 0.45 ms waiting, 21 us computing
        self.assertEqual(rows[0][5], "left: 2.31 / 1.00")
        self.assertEqual(rows[3][4], "–")  # nobody asked for it
        self.assertTrue(rows[3][6].startswith("by the loop"))

    def test_interventions(self):
        rows = self.page.table("rule", "arm", "controllet", "episodes")
        self.assertEqual(rows[0][:6], ["torque not finite", "left", "coupled", "1", "3.600", "3.600"])
        self.assertEqual(
            rows[2],
            ["torque rate clamped", "left", "left_cartesian", "1", "1.000", "1.000", "4", "2310 N m/s", "1000 N m/s"],
        )

    def test_tracking(self):
        rows = {(row[0], row[1]): row for row in self.page.table("arm", "controllet", "active [s]")}
        error = self.arrays["right_cartesian/outputs/position_error_m/values"]
        norms = [math.sqrt(x * x + y * y + z * z) for x, y, z in error]
        row = rows[("right", "right_cartesian")]
        self.assertAlmostEqual(float(row[2]), 1.8, places=2)
        self.assertAlmostEqual(float(row[3]), 1e3 * max(norms), delta=0.006)
        self.assertAlmostEqual(float(row[4]), 1e3 * math.sqrt(sum(v * v for v in norms) / len(norms)), delta=0.006)
        turn = self.arrays["right_cartesian/outputs/orientation_error_rad/values"]
        self.assertAlmostEqual(float(row[5]), math.degrees(max(math.dist(v, (0, 0, 0)) for v in turn)), delta=0.0006)
        second = self.arrays["dual/outputs/second_position_error_m/values"]
        self.assertAlmostEqual(
            float(rows[("right", "dual")][3]), 1e3 * max(math.dist(v, (0, 0, 0)) for v in second), delta=0.006
        )
        self.assertEqual(rows[("right", "coupled")][3:], ["n/a"] * 5)
        self.assertAlmostEqual(float(rows[("left", "left_joints")][7]), 10.0, delta=0.1)  # 0.01 rad at its start

    def test_use_of_limits(self):
        rows = {row[0]: row for row in self.page.table("arm", "largest torque / limit")}
        share, joint = max(
            (abs(value) / limit, j)
            for line in self.arrays["left/command/tau_cmd"]
            for j, (value, limit) in enumerate(zip(line, sample_run.LIMITS["tau_max"]))
        )
        self.assertEqual(rows["left"][1], f"{100 * share:.1f} % (joint {joint + 1})")
        self.assertEqual(rows["right"][5], "n/a")  # no wrench of this arm

    def test_absent_wrench_is_stated(self):
        self.assertEqual(self.page.text.count("Wrench: not available."), 1)

    def test_plant_and_machine_are_stated(self):
        self.assertIn("Plant fidelity set: ideal.", self.page.text)
        self.assertIn("SCHED_FIFO refused", self.page.text)


class OtherLogs(Folder):
    def test_empty(self):
        page = self.report({})
        for heading in (
            "At a glance",
            "Switches",
            "Interventions",
            "Tracking",
            "Cycle times",
            "Plant",
            "Machine and versions",
        ):
            self.assertIn(heading, page.headings)
        self.assertEqual(page.images, 0)
        self.assertIn("No arm is in the log.", page.text)
        self.assertIn("Cycle times are not in the log", page.text)
        self.assertIn("no closing summary", page.text)

    def test_one_arm_without_metadata(self):
        arrays, _ = sample_run.invent(seconds=2.0, arms=("left",))
        page = self.report(arrays)
        self.assertIn("Arm left", page.headings)
        self.assertNotIn("Several arms together", page.headings)
        rows = {row[1]: row for row in page.table("arm", "controllet", "active [s]")}
        self.assertEqual(set(rows), {"left_cartesian", "left_joints"})
        self.assertIn("The log does not name the plant fidelity set.", page.text)
        self.assertIn("Machine, versions and thread set-up are not in the log.", page.text)
        self.assertEqual(page.table("arm", "largest torque / limit")[0][1:4], ["n/a"] * 3)  # no limits known

    def test_killed(self):
        arrays, meta = sample_run.invent(seconds=2.0)
        # Topics of one chunk end at different cycles; a few cycles are lost inside.
        for name in list(arrays):
            if name.startswith("left/"):
                arrays[name] = arrays[name][:-37]
            elif name.startswith("timing/"):
                arrays[name] = np.delete(arrays[name], slice(500, 560), axis=0)
        meta["missing"] = None
        meta["notes"] = ["The log had no footer. It was repaired."]
        page = self.report(arrays, meta)
        self.assertIn("It was repaired.", page.text)
        self.assertIn("no closing summary", page.text)
        self.assertIn("60 of 2000 cycles are not in the log", page.text)

    def test_lost_records_are_stated(self):
        arrays, meta = sample_run.invent(seconds=1.0)
        meta["missing"].update(
            {
                "cycles_lost": "12",
                "events_lost": "3",
                "messages_lost": "7",
                "lost:/left/state": "7",
                "error": "no space left",
            }
        )
        text = self.report(arrays, meta).text
        self.assertIn("12 cycle records dropped", text)
        self.assertIn("3 events", text)
        self.assertIn("7 messages could not be written (no space left): /left/state 7.", text)

    def test_missing_topics_are_stated(self):
        arrays, meta = sample_run.invent(seconds=1.0)
        arrays = {
            name: value for name, value in arrays.items() if not name.startswith(("left/model/", "right/command/"))
        }
        text = self.report(arrays, meta).text
        self.assertIn("Arm left: no model summary", text)
        self.assertIn("Arm right: no commands", text)
        self.assertNotIn("Arm right: no model summary", text)

    def test_strings_of_the_log_are_escaped(self):
        arrays, meta = sample_run.invent(seconds=0.5)
        meta["scene_description"] = "<script>alert(1)</script>"
        page = self.report(arrays, meta)
        self.assertNotIn("script", page.tags)
        self.assertIn("<script>alert(1)</script>", page.text)

    def test_pictures_and_why_there_are_none(self):
        arrays, meta = sample_run.invent(seconds=0.5)
        meta["pictures_missing"] = "no graphics library"
        page = self.report(arrays, meta)
        self.assertIn("No pictures of the scene: no graphics library.", page.text)
        picture = self.folder / "scene_0.png"
        picture.write_bytes((self.folder / "out" / "overview.png").read_bytes())
        meta["pictures"] = [{"file": "scene_0.png", "caption": "t = 0.0 s: start"}]
        with_picture = self.report(arrays, meta, [picture])
        self.assertEqual(with_picture.images, page.images + 1)
        self.assertIn("t = 0.0 s: start", with_picture.text)

    def test_six_and_many_joints(self):
        arrays, meta = sample_run.invent(seconds=0.5, arms=("left",))
        for name, value in arrays.items():
            if name.startswith("left/") and value.ndim == 2 and value.shape[1] == 7:
                arrays[name] = value[:, :6]
        meta["layout"]["arms"][0]["joints"] = 6
        page = self.report(arrays, meta)  # the limits have seven: they belong to another arm and are not used
        self.assertEqual(page.table("arm", "largest torque / limit")[0][1], "n/a")

    def test_command_line(self):
        arrays, meta = sample_run.invent(seconds=0.3, arms=("left",))
        npz, meta_file = sample_run.write(self.folder, arrays, meta)
        call = [sys.executable, "-I", "-B", str(ROOT / "report" / "report.py")]
        done = subprocess.run(
            [*call, npz, "--meta", meta_file, "--out", self.folder / "page"], capture_output=True, text=True
        )
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertTrue((self.folder / "page" / "report.html").exists())
        failed = subprocess.run(
            [*call, self.folder / "none.npz", "--out", self.folder / "page"], capture_output=True, text=True
        )
        self.assertNotEqual(failed.returncode, 0)
        self.assertIn("none.npz", failed.stderr)
        self.assertNotIn("Traceback", failed.stderr)


class Figures(unittest.TestCase):
    def test_labels_beside_long_numbers_are_whole(self):
        """As much ink as with an inch around the figure."""
        with tempfile.TemporaryDirectory() as folder:

            def ink(save):
                figure = style.plt.figure(figsize=(6, 2))
                axis = figure.add_axes((style.LEFT_IN / 6, 0.2, 0.5, 0.6))
                axis.plot([0, 1], [-4e-4, 4e-4])
                axis.set_ylabel("a label [N m]")
                file = pathlib.Path(folder) / "figure.png"
                save(figure, file)
                style.plt.close(figure)
                return np.sum(1 - style.plt.imread(file)[..., :3])

            whole = ink(lambda figure, file: figure.savefig(file, bbox_inches="tight", pad_inches=1))
            np.testing.assert_allclose(ink(style.save), whole, rtol=0.01)

    def test_rotation_error(self):
        """Against the matrix logarithm, at random rotations; the shorter rotation beyond half a turn."""
        rng = np.random.default_rng(7)

        def matrix(q):
            w, x, y, z = q
            return np.array(
                [
                    [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                    [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                    [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
                ]
            )

        for _ in range(200):
            d, a = (q / np.linalg.norm(q) for q in rng.standard_normal((2, 4)))
            e = metrics.rotation_error(d[None], a[None])[0]
            R = matrix(d) @ matrix(a).T
            angle = math.acos(np.clip((np.trace(R) - 1) / 2, -1, 1))
            axis = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / (2 * math.sin(angle))
            np.testing.assert_allclose(e, angle * axis, atol=1e-6)
        np.testing.assert_allclose(
            metrics.rotation_error([[1, 0, 0, 0]], [[-1, 0, 0, 0]]), np.zeros((1, 3)), atol=1e-15
        )

    def test_error_from_target_and_model_where_none_is_shown(self):
        """A controllet without error outputs: target minus model agrees with the outputs of the original."""
        arrays, meta = sample_run.invent(seconds=1.0)
        with tempfile.TemporaryDirectory() as folder:
            shown = loading.load(*sample_run.write(folder, arrays, meta))
            expected = {e["instance"]: e for e in metrics.pose_errors(shown, "right")}["right_cartesian"]
            bare = {k: v for k, v in arrays.items() if not k.startswith("right_cartesian/outputs/")}
            run = loading.load(*sample_run.write(pathlib.Path(folder) / "bare", bare, meta))
            got = {e["instance"]: e for e in metrics.pose_errors(run, "right")}["right_cartesian"]
            self.assertEqual(len(got["t"]), -(-len(expected["t"]) // 10))  # at every model summary
            np.testing.assert_allclose(got["position"], expected["position"][::10], atol=1e-12)
            np.testing.assert_allclose(
                got["rotation"], 0, atol=1e-12
            )  # the synthetic target has the arm's own rotation

    def test_envelope_keeps_every_peak(self):
        rng = np.random.default_rng(3)
        t = np.arange(50_000) * 1e-3
        y = np.sin(t)
        peaks = rng.choice(len(t), 20, replace=False)
        y[peaks] += 5
        thin_t, thin_y = series.envelope(t, y)
        self.assertLessEqual(len(thin_t), 2 * series.COLUMNS + 2)
        self.assertTrue(np.all(np.diff(thin_t) >= 0))
        self.assertEqual(thin_y.max(), y.max())
        for peak in peaks:
            near = np.abs(thin_t - t[peak]) < 0.06
            self.assertGreater(thin_y[near].max(), 3.5)

    def test_no_line_over_a_gap(self):
        t = np.concatenate([np.arange(0, 5, 1e-3), np.arange(8, 12, 1e-3)])
        thin_t, thin_y = series.drawable(t, np.ones(len(t)))
        breaks = np.flatnonzero(np.isnan(thin_y))
        self.assertEqual(len(breaks), 1)
        self.assertTrue(np.all((thin_t[: breaks[0]] < 5) & (thin_t[: breaks[0]] >= 0)))
        self.assertTrue(np.all(thin_t[breaks[0] + 1 :] >= 8))

    def test_jitter_is_distinguished_from_motion(self):
        t = np.arange(20_000) * 1e-3
        self.assertIsNone(series.band_and_mean(t, np.sin(2 * np.pi * t)))
        noise = np.random.default_rng(5).standard_normal(len(t))
        _, low, high, mean = series.band_and_mean(t, noise)
        self.assertEqual(np.nanmin(low), noise.min())
        self.assertEqual(np.nanmax(high), noise.max())
        self.assertLess(np.nanmax(np.abs(mean)), 1.0)


if __name__ == "__main__":
    unittest.main()
