#!/usr/bin/env python3
"""The cockpit of virtual arms, of experiments and of logs, and the world's objects by its requests."""

import math
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest

from harness import FOLDER, PROGRAM, Run, controlling
from page_client import Closed, http

ROOT = pathlib.Path(__file__).resolve().parents[2]
SCENE = """\
name: ball
arms:
  - {name: arm, start_rad: ready}
objects:
  - {name: floor, shape: box, size_m: [4, 4, 0.1], position_m: [0, 0, -0.05]}
  - {name: ball, shape: sphere, diameter_m: 0.1, mass_kg: 2, position_m: [1, 0, 0.05], fixed: false}
controllets:
  - {name: joint, type: joint_impedance, arms: arm}
timeline:
  - {at_s: 0.5, place: {object: ball, position_m: [1, 0.5, 0.05]}}
"""


def scene_file():
    path = os.path.join(FOLDER, "ball.yaml")
    with open(path, "w", encoding="utf-8") as file:
        file.write(SCENE)
    return path


def place_of(page, name, state=None):
    bodies = [body["name"] for body in page.hello["scene"]["bodies"]]
    return page.value("bodies", state)[7 * bodies.index(name) :][:3]


class World(unittest.TestCase):
    BACKEND = ()

    def test_objects_are_placed_pushed_and_put_back(self):
        with Run(scene_file(), *self.BACKEND) as run, controlling(run) as page, run.page() as watcher:
            refused = watcher.ask("push_object", object="ball", force_n=[1, 0, 0])
            self.assertEqual(refused["verdict"], "no_control")
            self.assertTrue(page.ask("place_object", object="ball", position_m=[1, -0.5, 0.05])["ok"])
            page.until(lambda p: abs(place_of(p, "ball")[1] + 0.5) < 0.02, "placed ball")
            inside = page.ask("place_object", object="ball", position_m=[1, 0, -0.05])
            self.assertEqual(inside["verdict"], "arm_refused")
            self.assertTrue(page.ask("push_object", object="ball", force_n=[0, 0, 60], duration_s=0.2)["ok"])
            # (60 - 2 g) N on 2 kg for 0.2 s, then thrown upwards: at least this high.
            rise = 0.5 * (60 / 2 - 9.81) * 0.2**2
            page.until(lambda p: place_of(p, "ball")[2] > 0.05 + rise, "rise")
            for wrong, reason in (
                ({"force_n": [90, 90, 0]}, "100 N"),
                ({"force_n": [1, 0, 0], "duration_s": 10}, "2 s"),
                ({"force_n": [1, 0, 0], "object": "floor"}, "fixed"),
            ):
                self.assertIn(reason, page.ask("push_object", **({"object": "ball"} | wrong))["reason"])
            self.assertTrue(page.ask("reset")["ok"])
            page.until(lambda p: math.dist(place_of(p, "ball"), (1, 0, 0.05)) < 0.02, "start")

    def test_pause_and_step(self):
        if self.BACKEND:
            self.skipTest("the world of virtual arms does not pause")
        with Run(scene_file()) as run, controlling(run) as page:
            self.assertTrue(page.ask("pause")["ok"])
            page.states.clear()
            page.until(lambda p: len(p.states) > 5, "states of a world that stands still")
            before, *others = [page.value("t_s", state)[0] for state in page.states[1:]]
            self.assertEqual({before}, set(others))
            self.assertTrue(page.ask("step", periods=50)["ok"])
            page.until(lambda p: p.value("t_s")[0] >= before + 0.05 - 1e-9, "steps")
            self.assertAlmostEqual(page.value("t_s")[0], before + 0.05, places=6)
            self.assertTrue(page.ask("pause", paused=False)["ok"])
            page.until(lambda p: p.value("t_s")[0] > before + 0.2, "go")


class WorldOfVirtualArms(World):
    BACKEND = ("--backend", "virtual")


class VirtualArms(unittest.TestCase):
    def serve(self, *arguments):
        ports = ["--ports", "0", "0", "0"]
        return Run(command=[PROGRAM, "virtual-arm", scene_file(), *ports, "--cockpit", "0", *arguments])

    def test_shows_and_stops_arms_of_other_programs(self):
        with self.serve() as run, controlling(run) as page, run.page() as watcher:
            self.assertEqual([arm["kind"] for arm in page.hello["scene"]["arms"]], ["virtual"])
            self.assertNotIn("reference", page.hello["commands"])
            for word in ("reference", "switch", "pause"):
                self.assertEqual(page.ask(word)["ok"], False)
            page.until(lambda p: math.dist(place_of(p, "ball"), (1, 0, 0.05)) < 0.02, "ball")
            self.assertTrue(page.ask("place_object", object="ball", position_m=[1, -0.5, 0.05])["ok"])
            page.until(lambda p: abs(place_of(p, "ball")[1] + 0.5) < 0.02, "placed ball")
            rows = page.ask("plot", fields=["arm/q_rad", "arm/tau_J_nm"])
            self.assertTrue(rows["ok"])
            page.until(lambda p: sum(len(part) for _, part in p.plots) > 100, "rows")
            mode = page.hello["names"]["modes"].index("user_stopped")
            self.assertGreater(watcher.ask("stop")["received_ns"], 0)
            page.until(lambda p: p.value("arm/mode")[0] == mode, "stop")
            self.assertEqual(watcher.ask("resume")["verdict"], "no_control")
            self.assertTrue(page.ask("resume", arms="all")["ok"])
            page.until(lambda p: p.value("arm/mode")[0] != mode, "released stop")
            self.assertTrue(page.ask("fault", line="reflex arm joint_reflex")["ok"])
            page.until(lambda p: p.value("arm/errors")[0] != 0, "error")
            page.until(lambda p: (p.newest("state") or {"arms": []})["arms"][0]["cures"], "cure")
            self.assertTrue(page.ask("recover", arm="arm")["ok"])
            page.until(lambda p: p.value("arm/errors")[0] == 0, "recovery")
            self.assertIn("help", page.ask("fault", line="dance arm")["reason"])
            self.assertEqual(watcher.ask("fault", line="close arm")["verdict"], "no_control")

    def test_the_end_is_told(self):
        with self.serve() as run:
            page = run.page()
            run.end()
            with self.assertRaises(Closed) as closed:
                page.until(lambda p: False, "end")
            self.assertEqual(closed.exception.code, 1001)
            self.assertIn("virtual arms", page.newest("ended")["reason"])


class Experiments(unittest.TestCase):
    def test_every_run_greets_the_pages_anew(self):
        out = tempfile.mkdtemp(dir=FOLDER)
        command = [PROGRAM, "experiment", "task-1", "--fast", "--repeats", "1", "--out", out, "--cockpit", "0"]
        with Run(command=command, by_signal=True) as run, run.page() as page:
            greeted = page.hello["kind"] == "run"  # or "none" between two runs
            page.until(lambda p: sum("hello" in message for message in p.news) + greeted >= 2, "second run")
            hello = page.newest("hello")
            self.assertEqual(hello["kind"], "run")
            self.assertEqual(hello["scene"]["name"], "task_1")

    def test_a_stop_ends_the_experiment(self):
        def begin():
            out = tempfile.mkdtemp(dir=FOLDER)
            command = [PROGRAM, "experiment", "task-1", "--fast", "--out", out, "--cockpit", "0"]
            return Run(command=command, by_signal=True)

        def assert_stopped(run, runs):
            self.assertEqual(run.wait(), 1)
            self.assertIn("stopped in the cockpit: no further run is started", run.lines)
            self.assertIn("no report; finished runs are kept", run.lines)
            self.assertEqual(sum(" repeat " in line for line in run.lines), runs, run.lines)

        with self.subTest("between two runs"), begin() as run, run.page() as page:
            page.until(lambda p: p.newest("ended"), "end of a run")
            answer = page.ask("stop")
            self.assertTrue(answer["ok"])
            # On a busy computer the next one may have begun already; it is held to its end.
            assert_stopped(run, 1 if answer.get("no_further_run") else 2)
        with self.subTest("in a run, without a resume"), begin() as run, run.page() as page:
            self.assertTrue(page.ask("stop")["ok"])
            assert_stopped(run, 1)


class Reports(unittest.TestCase):
    def test_report_cockpit_shows_the_log_and_where_objects_were(self):
        folder = tempfile.mkdtemp(dir=FOLDER)
        record = [PROGRAM, "run", scene_file(), "--fast", "--seconds", "1", "--record", folder]
        subprocess.run(record, check=True, capture_output=True)
        with Run(command=[PROGRAM, "report", folder, "--cockpit", "0"]) as shown, shown.page() as page:
            self.assertEqual(page.hello["kind"], "log")
            for t, y in ((0.3, 0.0), (0.9, 0.5)):
                state = page.ask("log_state", log=0, t_s=t)
                page.until(lambda p, n=state["slice"]: any(s == n for s, _ in p.slices), "slice")
                (((at, *values),),) = [rows for number, rows in page.slices if number == state["slice"]]
                self.assertAlmostEqual(at, t, delta=2e-3)
                self.assertLess(abs(place_of(page, "ball", values)[1] - y), 0.02)
                self.assertLess(abs(page.value("objects/ball", values)[1] - y), 0.02)
        left = [PROGRAM, "report", folder, "--until-input-ends"]
        self.assertEqual(subprocess.run(left, capture_output=True, check=False).returncode, 2)


class WithoutPage(unittest.TestCase):
    def test_a_program_without_the_page_says_so_and_does_all_else(self):
        shutil.copy2(pathlib.Path(PROGRAM).parent / "libmultipanda_cockpit.so", FOLDER)
        program = shutil.copy2(PROGRAM, os.path.join(FOLDER, "program"))  # the bundle is beside the original
        command = [program, "run", scene_file(), "--no-timeline", "--cockpit", "0"]
        with (
            Run(
                command=command, environment={"MULTIPANDA_SHARE": str(ROOT), "MULTIPANDA_PYTHON": sys.executable}
            ) as run,
            run.page() as page,
        ):
            self.assertTrue(any("no cockpit page" in line for line in run.lines), run.lines)
            answer = http(page.port, b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n")
            self.assertEqual(answer.status, 404)
            self.assertIn(b"no cockpit page", answer.body)
            self.assertEqual(page.ask("control", take=True)["control"], "taken")

    def test_the_build_goes_on_without_node(self):
        tools = os.path.join(FOLDER, "tools")
        os.mkdir(tools)
        for name in ("bash", "cat", "dirname", "mkdir", "sha256sum"):
            os.symlink(shutil.which(name), os.path.join(tools, name))
        script = ROOT / "cockpit/page/page.sh"
        build = os.path.join(FOLDER, "build")
        words = [os.path.join(tools, "bash"), script, "build", build]
        done = subprocess.run(words, env={"PATH": tools}, capture_output=True, text=True, check=False)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("the page is left out", done.stderr)
        self.assertFalse(os.path.exists(os.path.join(build, "cockpit_page")))


if __name__ == "__main__":
    try:
        unittest.main()
    finally:
        shutil.rmtree(FOLDER, ignore_errors=True)
