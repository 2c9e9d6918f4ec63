#!/usr/bin/env python3
"""Runs with a cockpit, watched and commanded by pages, on simulated and on virtual arms."""

import os
import shutil
import signal
import subprocess
import tempfile
import time
import unittest

from harness import FOLDER, PROGRAM, Late, Run, ask_held, controlling, owner, patient, settle, stand_still, until_owned
from page_client import Closed, Page, http


def drag(page, seconds, beats=True, speed=0.05):
    """Holds a button and drags the pose of the controllet `cartesian` upwards."""
    start = page.value("cartesian/pose")
    begin = time.monotonic()
    last = begin
    while time.monotonic() - begin < seconds:
        if beats:
            page.send({"beat": 1})
        z = start[2] + speed * (time.monotonic() - begin)
        page.send(
            {
                "do": "reference",
                "controllet": "cartesian",
                "input": "pose",
                "stream": True,
                "position_m": [start[0], start[1], z],
                "quaternion_wxyz": list(start[3:]),
            }
        )
        known = len(page.states)
        page.until(lambda p, known=known: len(p.states) > known, "state")
        if None in page.answers or page.newest("released"):
            raise Late(page.answers.pop(None, None))
        if time.monotonic() - last > 0.15:
            raise Late
        last = time.monotonic()
    return page.value("cartesian/pose")[2] - start[2]


def held_since(rows, holds):
    """The first cycle of rows (time, cycle, start, owners) that is held, after one that was not."""
    moved = max((row[1] for row in rows if list(row[3:]) != holds), default=None)
    return moved and min((row[1] for row in rows if row[1] > moved), default=None)


class Watching(unittest.TestCase):
    def test_describes_the_run(self):
        with Run("two_arms") as run, run.page() as page:
            hello = page.hello
            self.assertEqual((hello["kind"], hello["wire"]), ("run", 1))
            self.assertEqual(hello["scene"]["name"], "two_arms")
            self.assertEqual([arm["name"] for arm in hello["scene"]["arms"]], ["left", "right"])
            self.assertLess(len(str(hello)), 200_000)
            self.assertTrue(hello["scene"]["simulated"])
            arm = hello["scene"]["arms"][0]
            self.assertEqual(len(arm["q_min_rad"]), arm["joints"])
            page.ask("subscribe", rate_hz=60)
            page.until(lambda p: len(p.states) > 10, "states")
            self.assertEqual(len(page.states[-1]), sum(count for _, count in hello["state_fields"]))
            numbers = [page.value("cycle", state)[0] for state in page.states]
            self.assertEqual(sorted(set(numbers)), numbers)
            # Two ways to the tool center point: the record's own, and the hand's body and the model's offset.
            bodies = hello["scene"]["bodies"]
            hand = [body["name"] for body in bodies].index("left/hand")
            x, y, z, w, a, b, c = page.value("bodies")[7 * hand : 7 * hand + 7]
            offset = 0.1034  # of the hand's tool center point along its z axis [m]
            tip = [
                x + offset * 2 * (a * c + w * b),
                y + offset * 2 * (b * c - w * a),
                z + offset * (1 - 2 * (a * a + b * b)),
            ]
            for mine, theirs in zip(tip, page.value("left/position_m"), strict=True):
                self.assertAlmostEqual(mine, theirs, places=4)
            timed = lambda p: (p.newest("state") or {"cycle_times_us": {"median": 0}})["cycle_times_us"]["median"] > 0
            page.until(timed, "a slow state with times of cycles")
            self.assertEqual(page.newest("state")["arms"][0]["errors"], 0)
            self.assertGreater(sum(page.ask("histogram")["counts"]), 0)
            self.assertGreater(page.value("left/manipulability")[0], 0.01)

    def test_plots_every_cycle(self):
        with Run("two_arms") as run, run.page() as page:
            answer = page.ask("plot", fields=["cycle", "left/q_rad"])
            self.assertEqual(answer["columns"], [["cycle", 1], ["left/q_rad", 7]])
            page.until(lambda p: sum(len(rows) for _, rows in p.plots) > 500, "rows")
            rows = [row for _, part in page.plots for row in part]
            self.assertEqual({len(row) for row in rows}, {9})
            steps = [b[1] - a[1] for a, b in zip(rows, rows[1:], strict=False)]
            self.assertGreaterEqual(min(steps), 1)
            self.assertEqual(sorted(steps)[len(steps) // 2], 1)
            self.assertIn("nearest", page.ask("plot", fields=["left/q_rat"])["reason"] + "nearest")
            self.assertEqual(page.ask("plot", fields=["left/q_rat"])["ok"], False)

    def test_says_that_there_is_no_page(self):
        with Run("one_arm") as run:
            port = int(run.address.partition("/#")[0].rpartition(":")[2])
            answer = http(port, b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n")
            if answer.status != 200:  # a build with the bundle serves it
                self.assertEqual(answer.status, 404)
                self.assertIn(b"no cockpit page", answer.body)
                self.assertTrue(any("no cockpit page" in line for line in run.lines))
            self.assertIn("frame-ancestors 'none'", answer.fields["content-security-policy"])
            self.assertEqual(http(port, b"GET / HTTP/1.1\r\nHost: evil.example\r\n\r\n").status, 403)
            self.assertEqual(Page(run.address, origin="http://evil.example", hello=False).status, 403)
            with self.assertRaises(Closed) as wrong:
                run.page(token="0" * 32)
            self.assertEqual(wrong.exception.code, 4401)

    def test_the_end_is_told(self):
        with Run("one_arm") as run:
            page = run.page()
            run.end()
            with self.assertRaises(Closed) as closed:
                page.until(lambda p: False, "end")
            self.assertEqual(closed.exception.code, 1001)
            self.assertTrue(page.newest("ended"))

    def test_a_page_that_does_not_read_delays_nobody(self):
        with Run("two_arms") as run, run.page() as busy, run.page() as page:
            busy.send({"do": "subscribe", "id": 1, "rate_hz": 120})
            busy.send({"do": "plot", "id": 2, "fields": ["left/q_rad", "right/q_rad"]})
            page.ask("subscribe", rate_hz=60)
            page.until(lambda p: len(p.states) > 100, "states")
            self.assertLess(page.value("since_cycle_s")[0], 1)


class Commanding(unittest.TestCase):
    BACKEND = ()

    @patient
    def test_a_watcher_stops_within_one_cycle(self):
        with Run("two_arms", *self.BACKEND) as run, controlling(run) as page, run.page() as watcher:
            watcher.ask("plot", fields=["cycle", "start_ns", "left/owner", "right/owner"])
            names = page.hello["names"]["controllets"]
            holds = [names.index("left_hold"), names.index("right_hold")]
            for _ in range(5):
                self.assertTrue(ask_held(page, "switch", activate=["left_joint", "right_joint"])["ok"])
                watcher.plots.clear()
                received = watcher.ask("stop")["received_ns"]
                rows = watcher.until(
                    lambda p: held_since(rows := [row for _, part in p.plots for row in part], holds) and rows,
                    "records in hold",
                )
                # The first cycle in hold against the last one that had begun when the server took the stop.
                arrived = max(cycle for _, cycle, start, *_ in rows if start <= received)
                self.assertLessEqual(held_since(rows, holds), arrived + 1)
                self.assertEqual(watcher.ask("resume", arms="all")["verdict"], "no_control")
                self.assertEqual(page.ask("resume", arms="all", stops=0)["verdict"], "arm_stopped")
                self.assertTrue(page.ask("resume", arms="all")["ok"])

    @patient
    def test_nothing_acts_that_was_asked_while_the_run_stood_still(self):
        with Run("one_arm") as run, controlling(run) as page, run.page() as watcher:
            settle(page)
            stand_still(run.process.pid)
            page.send({"beat": 1})
            requests = (
                {"do": "resume"},
                {"do": "switch", "activate": ["joint"]},
                {"do": "set_load", "arm": "arm", "mass_kg": 1},
            )
            for number, request in enumerate(requests, 901):
                page.send({"id": number, **request})
            time.sleep(2)
            os.kill(run.process.pid, signal.SIGCONT)
            verdicts = [page.answer(901 + n)["verdict"] for n in range(len(requests))]
            self.assertEqual(verdicts, ["timeout"] * len(requests))
            self.assertTrue(watcher.ask("stop", arms=["ram"])["ok"])  # of a wrong name, from a page that watches
            page.states.clear()
            page.until(lambda p: p.states and p.value("arm/stopped")[0], "a stopped arm")
            self.assertEqual(owner(page), "arm_hold")
            time.sleep(0.5)
            page.states.clear()
            page.until(lambda p: len(p.states) > 4, "states")
            self.assertTrue(page.ask("resume")["ok"])
            self.assertTrue(ask_held(page, "switch", activate=["joint"])["ok"])

    @patient
    def test_switches_for_the_one_in_control(self):
        with Run("one_arm", *self.BACKEND) as run, controlling(run) as page, run.page() as watcher:
            self.assertEqual(watcher.ask("switch", activate=["joint"])["verdict"], "no_control")
            done = ask_held(page, "switch", activate=["joint"])
            self.assertEqual(done["started"], ["joint"])
            self.assertIn("times_ms", done)
            self.assertEqual(len(done["torque_steps"]), 1)
            watcher.until(lambda p: p.events("switched"), "event")
            until_owned(page, "joint")
            refused = page.ask("switch", activate=["jiont"])
            self.assertEqual(refused["verdict"], "unknown_instance")
            self.assertIn("joint", refused["reason"])
            self.assertTrue(page.ask("parameter", controllet="joint", name="stiffness_nm_per_rad", value=50)["ok"])
            page.until(lambda p: p.newest("list"), "list")
            stiff = {"controllet": "joint", "name": "stiffness_nm_per_rad"}
            self.assertEqual(page.ask("parameter", **stiff, value=60)["verdict"], "not_held")
            self.assertEqual(ask_held(page, "parameter", **stiff, value=1e9)["verdict"], "out_of_bounds")
            self.assertEqual(watcher.ask("control", take=True)["control"], "requested")
            page.until(lambda p: p.newest("control")["requests"], "request")
            self.assertTrue(page.ask("control", give=watcher.hello["client"])["ok"])
            self.assertEqual(page.ask("switch", activate=["cartesian"])["verdict"], "no_control")
            watcher.ask("subscribe", rate_hz=60)
            self.assertEqual(watcher.ask("switch", activate=["cartesian"])["verdict"], "not_held")
            self.assertTrue(ask_held(watcher, "switch", activate=["cartesian"])["ok"])

    @patient
    def test_release_rests_and_keeps_the_controllet(self):
        with Run("one_arm", *self.BACKEND) as run, controlling(run) as page:
            ask_held(page, "switch", activate=["cartesian"])
            until_owned(page, "cartesian")
            self.assertGreater(drag(page, 1), 0.02)
            page.send({"release": True})
            settle(page)
            self.assertEqual(owner(page), "cartesian")
            first = page.value("cartesian/pose")[2]
            drag(page, 0.5)  # without a switch
            page.send({"release": True})
            settle(page)
            self.assertGreater(page.value("cartesian/pose")[2], first + 0.005)
            refused = page.ask(
                "reference", controllet="cartesian", input="pose", position_m=[0.4, 0, 0.5], rpy_rad=[0, 0, 0]
            )
            self.assertEqual(refused["verdict"], "not_held")

    @patient
    def test_lost_beats_hold(self):
        with Run("one_arm", *self.BACKEND) as run, controlling(run) as page:
            ask_held(page, "switch", activate=["cartesian"])
            until_owned(page, "cartesian")
            drag(page, 0.5)
            page.until(lambda p: p.newest("released"), "release")  # no more beats
            self.assertIn("200 ms", page.newest("released")["cause"])
            page.until(lambda p: owner(p) == "arm_hold", "hold")
            settle(page)

    @patient
    def test_a_goal_ends_with_the_hold(self):
        with Run("one_arm", *self.BACKEND) as run, controlling(run) as page:
            ask_held(page, "switch", activate=["cartesian"])
            until_owned(page, "cartesian")
            start = page.value("cartesian/pose")
            page.send({"beat": 1})
            answer = page.ask(
                "reference",
                controllet="cartesian",
                input="pose",
                duration_s=30,
                position_m=[start[0], start[1], start[2] + 0.1],
                quaternion_wxyz=list(start[3:]),
            )
            if answer.get("verdict") == "not_held":
                raise Late
            self.assertTrue(answer["ok"], answer)
            page.until(lambda p: owner(p) == "arm_hold", "hold")
            settle(page)
            self.assertLess(page.value("arm/position_m")[2], start[2] + 0.05)

    @patient
    def test_a_closed_page_holds(self):
        with Run("one_arm", *self.BACKEND) as run, run.page() as watcher:
            watcher.ask("subscribe", rate_hz=60)
            page = controlling(run)
            ask_held(page, "switch", activate=["cartesian"])
            until_owned(page, "cartesian")
            drag(page, 0.5)
            page.close()
            watcher.until(lambda p: p.states and owner(p) == "arm_hold", "hold")
            settle(watcher)
            watcher.until(lambda p: p.newest("control")["holder"] is None, "free control")
            self.assertEqual(watcher.ask("control", take=True)["control"], "taken")


class CommandingVirtualArms(Commanding):
    BACKEND = ("--backend", "virtual")


class Logs(unittest.TestCase):
    def test_two_logs_are_shown(self):
        runs = []
        for scale in ("2", "3"):
            folder = tempfile.mkdtemp(dir=FOLDER)
            subprocess.run(
                [PROGRAM, "run", "two_arms", "--fast", "--seconds", scale, "--record", folder],
                check=True,
                capture_output=True,
            )
            runs.append(folder)
        with Run(command=[PROGRAM, "cockpit", *runs, "--port", "0"]) as shown, shown.page() as page:
            logs = page.hello["logs"]
            self.assertEqual(page.hello["kind"], "log")
            self.assertEqual([log["rows"] for log in logs], [2000, 3000])
            self.assertTrue(any(event["kind"] == "switched" for event in logs[0]["events"]))
            for number, log in enumerate(logs):
                answer = page.ask(
                    "log_columns", log=number, fields=["left/position_m", "cycle"], from_s=0, to_s=log["t_to_s"]
                )
                page.until(lambda p, n=answer["slice"]: any(s == n for s, _ in p.slices), "slice")
                rows = dict(page.slices)[answer["slice"]]
                self.assertEqual(len(rows), [2000, 1500][number])
                self.assertEqual(len(rows[0]), 5)
                state = page.ask("log_state", log=number, t_s=1.5)
                page.until(lambda p, n=state["slice"]: any(s == n for s, _ in p.slices), "slice")
                ((at, *values),) = dict(page.slices)[state["slice"]]
                self.assertEqual(at, page.value("t_s", values)[0])
                place = page.value("left/position_m", values)
                (same,) = [row for row in rows if abs(row[0] - page.value("t_s", values)[0]) < 4e-4]
                for mine, theirs in zip(place, same[1:4], strict=True):
                    self.assertAlmostEqual(mine, theirs, places=6)
            self.assertEqual(page.ask("stop")["ok"], False)


if __name__ == "__main__":
    try:
        unittest.main()
    finally:
        shutil.rmtree(FOLDER, ignore_errors=True)
