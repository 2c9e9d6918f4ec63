#!/usr/bin/env python3
"""Slow and uneven streams, and chunks of actions, through whole runs in lock-step: the simulation is paused and steps
between samples, so nothing here depends on this computer."""

import contextlib
import math
import random
import signal
import subprocess
import sys
import unittest

import harness  # first: it sets the paths
import multipanda as mp
import numpy as np
from harness import FOLDER, PATIENCE, ROOT, until

TIMEOUT_S = 0.3


def scene():
    """one_arm without a timeline; its stream may lose two samples in a row at 20 Hz."""
    text = (ROOT / "config/scenes/one_arm.yaml").read_text(encoding="utf-8").partition("\ntimeline:")[0]
    text = text.replace("duration_s: 10", "duration_s: 0")
    changed = text.replace("pose: {max_speed", f"pose: {{timeout_s: {TIMEOUT_S}, max_speed")
    assert changed != text
    path = FOLDER / "uneven.yaml"
    path.write_text(changed, encoding="utf-8")
    return path


def offset(t):
    """A smooth path [m] from rest."""
    ramp = min(1.0, t) ** 3 * (10 - 15 * min(1.0, t) + 6 * min(1.0, t) ** 2)
    return ramp * np.array([0.03 * math.sin(1.3 * t), 0.05 * math.sin(1.7 * t), 0.03 * (1 - math.cos(1.1 * t))])


@contextlib.contextmanager
def standing_run(**options):
    """A run that moves only by step()."""
    with mp.run(scene(), fast=True, **options) as run:
        run.pause()
        try:
            yield run
        finally:
            run.pause(False)


@contextlib.contextmanager
def stream_of(run):
    """A stream that is closed while the loop runs, which answers then."""
    with run["cartesian"].stream("pose") as stream:
        try:
            yield stream
        finally:
            run.pause(False)


def moved(pose, by):
    return pose.moved(x=by[0], y=by[1], z=by[2])


class Uneven(unittest.TestCase):
    def test_the_set_point_at_20_hz_with_jitter_and_losses_is_smooth(self):
        draw = random.Random(3)
        with standing_run() as run:
            start = run.arms["arm"].state.pose
            with stream_of(run) as stream, run.records() as records:
                begin = run.state().t_s
                now, lost, sent = 0, 0, 0  # [ms]
                for k in range(80):
                    lost = lost + 1 if draw.random() < 0.05 and lost < 2 else 0
                    arrival = round(50 * (k + draw.uniform(0, 0.3)))
                    if lost:
                        continue
                    if arrival > now:
                        run.step(arrival - now)
                        now = arrival
                    self.assertTrue(stream.send(moved(start, offset(0.05 * k))))
                    sent += 1
                counts = stream.counts()
                self.assertEqual((counts["received"], counts["refused"], counts["expired"]), (sent, 0, 0))
                self.assertLess(sent, 80)
                self.assertFalse(run.arms["arm"].state.held)
                at = {}  # while the world is paused, the loop goes on at the same time
                passed = 0.0
                while passed < 1e-3 * now - 0.01:
                    record = next(records)
                    passed = record.t_s - begin
                    at[passed] = record["cartesian/pose"][:3]
        # The lag of the set-point: where it fits the path best.
        t, hand = np.array(list(at)), np.array(list(at.values()))

        def misfit(lag):
            truth = [start.position_m + offset(max(0.0, s - lag)) for s in t[500::20]]
            return np.sum((hand[500::20] - truth) ** 2)

        lags = np.arange(0, 0.15, 0.0025)
        lag = lags[np.argmin([misfit(lag) for lag in lags])]
        print(f"20 Hz, jitter 30 %, lost 5 %: lag {lag / 0.05:.2f} periods")
        self.assertLessEqual(lag, 1.5 * 0.05)
        # Smooth: core/reference/smooth_stream_test.cpp and uneven_streams_test.cpp have the jerk; a hold would step.
        acceleration = np.diff(hand, 2, axis=0) * 1e6
        self.assertLess(np.linalg.norm(acceleration, axis=1).max(), 2)  # [m/s^2]


class Chunks(unittest.TestCase):
    def test_actions_are_there_in_time_while_this_process_does_nothing(self):
        with standing_run() as run:
            start = run.arms["arm"].state.pose
            with stream_of(run) as stream, run.records() as records:
                begin = run.state().t_s
                for k in range(5):  # 16 actions at 20 Hz, of which 10 come to pass
                    ahead = 0.05 * np.arange(1, 17)
                    actions = [moved(start, offset(0.5 * k + s)) for s in ahead]
                    self.assertTrue(stream.send(actions, at=begin + 0.5 * k + ahead))
                    run.step(500)
                counts = stream.counts()
                self.assertEqual((counts["received"], counts["refused"], counts["late_samples"]), (5, 0, 0))
                worst, t = 0.0, 0.0
                while t < 2.4:
                    record = next(records)
                    t = record.t_s - begin
                    if t > 0.3:
                        wrong = record["cartesian/pose"][:3] - start.position_m - offset(t)
                        worst = max(worst, float(np.linalg.norm(wrong)))
                self.assertLess(worst, 1.5e-3)
                print(f"chunks of 16 at 20 Hz: the set-point is within {1e3 * worst:.2f} mm of the path at each time")
                # After the last action: silence.
                run.step(round(1e3 * (0.3 + TIMEOUT_S)) + 20)
                self.assertTrue(run.arms["arm"].state.held)
                self.assertEqual(run.arms["arm"].state.last_intervention, "reference_stale")

    def send_two_seconds(self, run, stream):
        start, now = run.arms["arm"].state.pose, run.state().t_s
        ahead = 0.05 * np.arange(1, 41)
        stream.send([start.moved(z=0.05 * s) for s in ahead], at=now + ahead)
        return start, now, ahead

    def test_late_actions_are_counted(self):
        with standing_run() as run:
            with stream_of(run) as stream:
                run.step(300)
                start, now = run.arms["arm"].state.pose, run.state().t_s
                times = now - 0.1 + 0.05 * np.arange(40)  # the first three are not in the future
                stream.send([start] * 40, at=times)
                run.step(100)
                self.assertIn(stream.counts()["late_samples"], (3, 4))  # rounding of now

    def test_a_stop_a_refusal_a_goal_and_the_end_discard_what_is_queued(self):
        for way in ("stop", "refused", "goal", "close", "sample"):
            with self.subTest(way), standing_run() as run:
                law, arm = run["cartesian"], run.arms["arm"]
                stream = law.stream("pose")
                start, now, ahead = self.send_two_seconds(run, stream)
                run.step(300)
                self.assertFalse(arm.state.held)
                # Requests to the loop are answered by its next cycle.
                run.pause(False)
                if way == "stop":
                    arm.stop()
                    arm.resume()
                    law.activate()
                elif way == "refused":
                    stream.send([start.moved(x=5)] * 2, at=now + 100 + ahead[:2])
                    self.assertEqual(stream.counts()["verdict"], "out_of_bounds")
                elif way == "goal":
                    law.goal("pose", start)
                elif way == "close":
                    stream.close()
                    law.activate()
                else:
                    stream.send(start)
                reached = arm.state.pose.position_m[2]
                run.pause()
                run.step(700)
                if way in ("refused", "sample"):
                    self.assertTrue(arm.state.held)  # silence
                else:
                    self.assertTrue(law.active)
                # The queue would have gone on to 10 cm; at 29 times real time some of it may have passed meanwhile.
                self.assertLess(arm.state.pose.position_m[2], reached + 0.02)
                run.pause(False)
                stream.close()

    def test_a_client_that_is_killed_takes_its_actions_along(self):
        sender = (
            "import sys, numpy as np, multipanda as mp\n"
            "run = mp.connect(sys.argv[1])\n"
            "stream = run['cartesian'].stream('pose')\n"
            "start, ahead = run.arms['arm'].state.pose, 0.25 * np.arange(1, 41) - 0.2\n"
            "stream.send([start.moved(z=0.01 * s) for s in ahead], at=run.state().t_s + ahead)\n"
            "print(stream.counts()['received'], flush=True)\n"
            "sys.stdin.read()\n"
        )
        with mp.run(scene()) as run:
            run.pause()
            child = subprocess.Popen(
                [sys.executable, "-c", sender, str(run.connection.path)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )
            self.assertEqual(child.stdout.readline(), "1\n")
            run.step(300)
            self.assertFalse(run.arms["arm"].state.held)
            child.send_signal(signal.SIGKILL)
            child.communicate(timeout=PATIENCE)
            until(lambda: run.ask({"do": "channels"})["channels"] == [], "its channel is closed")
            run.step(round(1e3 * (0.25 + TIMEOUT_S)) + 20)
            self.assertTrue(run.arms["arm"].state.held)
            run.pause(False)

    def test_chunks_are_checked_before_they_are_sent(self):
        with standing_run() as run:
            with stream_of(run) as stream:
                start, now = run.arms["arm"].state.pose, run.state().t_s
                self.assertEqual(stream.longest_chunk, 64)
                for count, times, expected in (
                    (2, [now + 1], "a time for each of 2"),
                    (65, now + 0.01 * np.arange(65), "1 to 64 samples"),
                    (2, [now + 1, now + 1], "increasing"),
                    (2, [now + 1, now + 1 + 2 * TIMEOUT_S], "held in between"),
                    (2, [now + 1, math.nan], "finite"),
                ):
                    with self.assertRaisesRegex(ValueError, expected):
                        stream.send([start] * count, at=times)
                with self.assertRaisesRegex(ValueError, "7 numbers|a pose"):
                    stream.send([[1, 2, 3]], at=[now + 1])
                self.assertEqual(stream.counts()["received"], 0)
                stream.send([start], at=[now + 11])  # too far ahead
                self.assertEqual(stream.counts()["verdict"], "out_of_bounds")
                until(lambda: stream._verdict != "accepted", "the news of it")
                with self.assertRaises(mp.Refused):
                    stream.send([start], at=[now + 1])


if __name__ == "__main__":
    harness.main()
