#!/usr/bin/env python3
"""Arms on another computer: a real sshd on loopback, with a relay between that delays, stalls, falls silent, ends."""

import contextlib
import importlib.util
import os
import pathlib
import random
import signal
import socket
import subprocess
import sys
import threading
import time
import unittest

import harness  # first: it sets the paths
import multipanda as mp
import numpy as np
from harness import FOLDER, PATIENCE, until
from multipanda.bridge import HEADER, MOST_BYTES, Frames, frame
from ssh_server import MISSING, Sshd

if MISSING:
    print(f"skipped: {MISSING}")
    sys.exit(77)

FULL = os.environ.get("MULTIPANDA_FULL") == "1"


class Relay:
    """A TCP relay to a port. Parts arrive after delay_s; 5 % of them stall all that follow, as a lost packet does."""

    def __init__(self, port, delay_s=0.0, stall_s=0.0):
        self.to, self.delay_s, self.stall_s = port, delay_s, stall_s
        self.frozen, self.random, self.stalls = threading.Event(), random.Random(1), 0
        self.bytes_per_s = float("inf")  # to there
        self.server = socket.create_server(("127.0.0.1", 0))
        self.port, self.sockets = self.server.getsockname()[1], []
        threading.Thread(target=self.serve, daemon=True).start()

    def serve(self):
        with contextlib.suppress(OSError):
            while True:
                near, _ = self.server.accept()
                far = socket.create_connection(("127.0.0.1", self.to))
                self.sockets += [near, far]
                for a, b in ((near, far), (far, near)):
                    a.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    parts = []
                    threading.Thread(target=self.read, args=(a, parts), daemon=True).start()
                    threading.Thread(target=self.write, args=(b, parts, b is far), daemon=True).start()

    def read(self, a, parts):
        due = 0.0
        data = b"."
        while data:
            try:
                data = a.recv(65536)
            except OSError:
                data = b""
            due = max(due, time.monotonic() + self.delay_s)
            if self.stall_s and self.random.random() < 0.05:
                due += self.stall_s
                self.stalls += 1
            parts.append((due, data))

    def write(self, b, parts, there):
        with contextlib.suppress(OSError):
            while True:
                if parts and parts[0][0] <= time.monotonic() and not self.frozen.is_set():
                    _, data = parts.pop(0)
                    if not data:
                        break
                    for part in (data[k : k + 1024] for k in range(0, len(data), 1024)):
                        b.sendall(part)
                        if there:
                            time.sleep(len(part) / self.bytes_per_s)
                else:
                    time.sleep(0.0005)
        with contextlib.suppress(OSError):
            b.shutdown(socket.SHUT_RDWR)

    def __enter__(self):
        return self

    def __exit__(self, *left):
        self.server.close()
        for one in self.sockets:
            with contextlib.suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)
            one.close()


def bridges():
    """The process ids of bridges of this test's run."""
    found = []
    for path in pathlib.Path("/proc").glob("[0-9]*/cmdline"):
        with contextlib.suppress(OSError):
            words = path.read_bytes().split(b"\0")
            if any(w.endswith(b"/bridge.py") for w in words) and any(str(FOLDER).encode() in w for w in words):
                found.append(int(path.parent.name))
    return [number for number in found if not harness.ended(number)]


class FramesOfABridge(unittest.TestCase):
    def test_a_stop_before_a_frame_of_wrong_size_is_not_lost(self):
        stop = b'{"do": "stop"}\n'
        frames = Frames()
        found = frames.add(frame(b"d", 1, stop) + HEADER.pack(MOST_BYTES + 1, b"d"[0], 1))
        self.assertEqual(found, [(b"d", 1, stop)])
        self.assertRaises(ValueError, frames.add, b"")


class OverSsh(unittest.TestCase):
    """One run and one sshd for all; each test begins with both arms at their Cartesian controllets."""

    @classmethod
    def setUpClass(cls):
        cls.sshd = Sshd(FOLDER / "ssh")
        cls.port = cls.sshd.port
        cls.run_ = mp.run("two_arms")

    @classmethod
    def tearDownClass(cls):
        cls.run_.close()
        cls.sshd.close()

    def setUp(self):
        self.assertIsNone(self.sshd.process.poll(), self.sshd.said())
        self.run_.resume()
        self.run_.switch(["left_cartesian", "right_cartesian"])

    def tearDown(self):
        until(lambda: not bridges(), "the bridge has ended")

    def connect(self, port=None, run=None, **options):
        run = pathlib.Path(self.run_.connection.path).stem if run is None else run
        options = {"program": mp.program_path(), "ssh": ["ssh", "-F", str(self.sshd.config)], **options}
        return mp.connect(f"ssh://127.0.0.1:{port or self.port}/{run}", **options)

    def held(self, arm="left"):
        until(lambda: self.run_.arms[arm].state.held, "hold")

    def test_all_that_a_client_does_from_near_and_far(self):
        for delay_s, stall_s in ((0, 0), (0.2, 0.3)) if FULL else ((0, 0),):
            with self.subTest(delay_s=delay_s), Relay(self.port, delay_s, stall_s) as relay:
                with self.connect(relay.port, silence_s=10) as far:
                    clock, law, arm = far.clock, far["left_cartesian"], far.arms["left"]
                    # One computer: the true offset is 0. A round trip takes at least twice the delay.
                    self.assertLessEqual(abs(clock.ahead_ns), clock.uncertainty_ns)
                    self.assertGreaterEqual(clock.uncertainty_ns, 1e9 * delay_s)
                    states = far.states(20)
                    for state in (far.state(), next(states)):
                        self.assertGreaterEqual(state.since_cycle_s, delay_s - 1e-9 * clock.uncertainty_ns)
                        behind = self.run_.state().t_s - state.t_s
                        self.assertLess(abs(behind - state.since_cycle_s), delay_s + 0.6 + 3 * stall_s)
                    states.close()
                    events = far.events()
                    start = law.set_point("pose")
                    far.switch("left_joint")
                    far.switch("left_cartesian")
                    law.goal("pose", start.moved(z=0.03)).wait(PATIENCE)
                    self.assertLess(abs(arm.state.pose.position_m[2] - start.position_m[2] - 0.03), 0.015)
                    law.damping_ratio = 0.8
                    self.assertEqual(self.run_["left_cartesian"].damping_ratio, 0.8)
                    with self.assertRaisesRegex(mp.Refused, "both own arm 'left'"):
                        far.switch(["dual", "left_joint"])
                    with law.stream("pose") as stream:  # a chunk long enough for the way
                        # A policy that sees the newest state, 2 s of actions at 20 Hz.
                        steps = [start.moved(y=0.02 * k / 40, z=0.03) for k in range(1, 41)]
                        self.assertTrue(stream.follow(steps, 0.05))
                        until(
                            lambda: self.run_.record()["left_cartesian/pose"][1] - start.position_m[1] > 0.015,
                            "the path",
                        )
                        late = stream.counts()["late_samples"]
                    self.assertLessEqual(late, (delay_s + 3 * stall_s) / 0.05 + 2)
                    self.held()
                    far.stop("right")
                    self.assertTrue(self.run_.arms["right"].state.stopped)
                    far.resume()
                    far.switch(["left_cartesian", "right_cartesian"])
                    kinds = set()
                    while "resumed" not in kinds:
                        kinds.add(next(events).kind)
                    self.assertLessEqual({"switched", "target_set", "stopped"}, kinds)
                    self.assertGreater(len(far.history(1)), 3)
                self.assertEqual(self.run_.active, ["left_cartesian", "right_cartesian"])  # it left in order
                self.assertTrue(not stall_s or relay.stalls)

    @unittest.skipIf(importlib.util.find_spec("OpenGL") is None, "PyOpenGL is not installed")
    def test_cameras_are_drawn_where_the_client_is(self):
        camera = mp.SceneCamera([1.4, -1, 1], look_at_m=[0.4, 0, 0.3], width=64, height=48)
        with self.connect(silence_s=10) as far, mp.Cameras(far, {"top": camera}, scene="two_arms") as see:
            pair = see.pair(see.newer("top", 1))
            self.assertGreater(pair.picture.rgb.std(), 5)  # it shows something
            self.assertGreaterEqual(pair.error_s, 0)
            near = self.run_.arms["left"].state.q_rad  # at rest
            np.testing.assert_allclose(pair.record["left/q_rad"], near, atol=0.02)

    @unittest.skipUnless(FULL, "in real time, on a quiet computer: test --long")
    def test_a_stream(self):
        with Relay(self.port, 0.02) as relay, self.connect(relay.port) as far:
            law = far["left_cartesian"]
            start, sent = law.set_point("pose"), 0
            with law.stream("pose") as stream:
                for k in range(60):
                    sent += stream.send(start.moved(y=0.03 * k / 60))
                    time.sleep(0.01)
                until(lambda: stream.counts()["received"] >= sent - 1, "received")
            moved = self.run_.arms["left"].state.pose.position_m - start.position_m
            self.assertGreater(moved[1], 0.005)
            self.held()

    def test_what_waited_on_the_way_is_not_used(self):
        with Relay(self.port) as relay, self.connect(relay.port, silence_s=5) as far:
            law = far["left_cartesian"]
            start = law.set_point("pose")
            with law.stream("pose") as stream:
                stream.send(start)
                until(lambda: stream.counts()["received"] == 1, "received")
                relay.frozen.set()
                self.held()  # silence
                for _ in range(7):
                    stream.send(start.moved(z=0.1))
                with self.assertRaises(mp.Timeout):
                    far.connection.ask({"do": "switch", "activate": ["left_cartesian"]}, 0.3)
                time.sleep(0.2)
                relay.frozen.clear()
                until(lambda: far.connection.ask({"do": "list"}, 30), "it goes on")
                self.assertTrue(self.run_.arms["left"].state.held)  # the switch came too late
                stream._verdict = "accepted"
                far.switch("left_cartesian")
                stream.send(start)
                until(lambda: stream.counts()["received"] == 2, "received")
                self.assertEqual(stream.counts()["lost"], 7)

    def commanding(self, far):
        far["left_cartesian"].goal("pose", far["left_cartesian"].set_point("pose").moved(z=0.1), duration_s=20)

    def lost(self, far, why):
        with self.assertRaisesRegex(mp.Disconnected, why):
            while True:
                far.state()
                time.sleep(0.01)
        self.held()
        self.assertFalse(self.run_.arms["right"].state.held)  # it has not commanded this one
        begun = time.monotonic()
        for call in (far.stop, lambda: far.switch("left_joint"), far.record, lambda: next(far.events())):
            with self.assertRaises((mp.Disconnected, StopIteration)):
                call()
                raise StopIteration  # the newest record stays readable
        far.close()
        self.assertLess(time.monotonic() - begun, PATIENCE)

    def test_silence_holds(self):
        with Relay(self.port) as relay:
            far = self.connect(relay.port, silence_s=0.5)
            self.commanding(far)
            relay.frozen.set()
            self.lost(far, "nothing came from 127.0.0.1:.* for 0.5 s")
            until(lambda: not bridges(), "the bridge has ended")

    def test_samples_that_a_slow_network_piles_up_delay_no_stop(self):
        with Relay(self.port) as relay:
            far = self.connect(relay.port)
            law = far["left_cartesian"]
            start = law.set_point("pose")
            relay.bytes_per_s = 60e3
            with law.stream("pose") as stream:
                for _ in range(200_000):  # far more than it brings
                    try:
                        stream.send(start)
                    except mp.Refused:  # they come too late
                        pass
                    except mp.Disconnected:
                        break
                self.lost(far, "the network is .* s late")

    def test_either_end_is_killed(self):
        far = self.connect()
        self.commanding(far)
        far.connection.link._child.kill()
        self.lost(far, "the connection to 127.0.0.1:.* has ended")
        self.setUp()
        far = self.connect()
        self.commanding(far)
        for each in bridges():
            os.kill(each, signal.SIGKILL)
        self.lost(far, "the connection to 127.0.0.1:.* has ended")

    def test_a_bridge_that_stands_still_is_silence_for_the_run(self):
        far = self.connect(silence_s=0.5)
        self.commanding(far)
        standing = bridges()
        for each in standing:
            os.kill(each, signal.SIGSTOP)
        begun = time.monotonic()
        try:
            self.held()
            self.assertLess(time.monotonic() - begun, 2)
            self.lost(far, "nothing came from 127.0.0.1:.* for 0.5 s")
            self.run_.switch("left_cartesian")  # by somebody there
        finally:
            for each in standing:
                os.kill(each, signal.SIGCONT)
        until(lambda: not bridges(), "the bridge has ended")
        self.assertFalse(self.run_.arms["left"].state.held)  # what it missed does not count any more

    def while_frozen(self, **request):
        """Posts a request to a bridge that stands still for longer than silence_s."""
        far = self.connect(silence_s=0.5)
        standing = bridges()
        for each in standing:
            os.kill(each, signal.SIGSTOP)
        try:
            far.connection.post(request, patience_s=20)
            time.sleep(0.8)
        finally:
            for each in standing:
                os.kill(each, signal.SIGCONT)
        until(lambda: not bridges(), "the bridge has ended")

    def test_what_waits_at_a_frozen_bridge_counts_only_if_it_stops(self):
        def stopped():
            return [self.run_.arms[name].state.stopped for name in ("left", "right")]

        self.while_frozen(do="stop")
        until(lambda: stopped() == [True, True], "the stop")
        self.while_frozen(do="resume", stops=self.run_.connection.ask({"do": "state"})["state"]["stops"])
        time.sleep(0.3)  # a request that was passed on has acted by then
        self.assertEqual(stopped(), [True, True])
        self.run_.resume()

    def test_behind_a_wrong_frame_a_stop_counts_and_nothing_else(self):
        words = [mp.program_path(), "bridge", str(self.run_.connection.path)]
        with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as child:
            said = [b'{"do": "stop"}', b'{"do": "resume"}']
            parts = [frame(b"l", 1), frame(b"p", 0, b"?"), *(frame(b"d", 1, line + b"\n") for line in said)]
            error = child.communicate(b"".join(parts), PATIENCE)[1]
        self.assertIn(b"not a frame", error)
        until(lambda: self.run_.arms["left"].state.stopped, "the stop")
        self.run_.resume()

    def test_a_client_is_killed(self):
        program = (
            "import sys, multipanda as mp\n"
            "far = mp.connect(sys.argv[1], program=sys.argv[2], ssh=['ssh', '-F', sys.argv[3]])\n"
            "law = far['left_cartesian']\n"
            "law.goal('pose', law.set_point('pose').moved(z=0.1), duration_s=20)\n"
            "print(flush=True)\n"
            "sys.stdin.read()\n"
        )
        name = pathlib.Path(self.run_.connection.path).stem
        words = [f"ssh://127.0.0.1:{self.port}/{name}", mp.program_path(), str(self.sshd.config)]
        with subprocess.Popen(
            [sys.executable, "-c", program, *words], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        ) as child:
            self.assertEqual(child.stdout.readline(), b"\n")
            self.assertFalse(self.run_.arms["left"].state.held)
            child.kill()
        self.held()

    def test_a_run_that_ends(self):
        with mp.run("one_arm") as run:
            far = self.connect(run=pathlib.Path(run.connection.path).stem)
            events = far.events()
        with self.assertRaisesRegex(mp.Disconnected, "the run has ended"):
            while True:
                far.switch("joint")
        self.assertLess(len(list(events)), 1000)  # it ends
        far.close()

    @unittest.skipUnless(FULL, "in real time, on a quiet computer: test --long")
    def test_refusals(self):
        with socket.create_server(("127.0.0.1", 0)) as probe:
            closed = probe.getsockname()[1]
        for options, why in (
            ({"port": closed}, "Connection refused"),
            ({"run": "no_such"}, "no run 'no_such' on this computer; running: .*python-"),
            ({"program": "/no/such/multipanda"}, "name the program there"),
            (
                {
                    "ssh": [
                        "ssh",
                        "-F",
                        "/dev/null",
                        "-o",
                        "BatchMode=yes",
                        "-o",
                        "StrictHostKeyChecking=no",
                        "-o",
                        f"UserKnownHostsFile={self.sshd.folder / 'known'}",
                    ]
                },
                "Permission denied",
            ),
        ):
            with self.subTest(why), self.assertRaisesRegex(mp.Disconnected, why):
                self.connect(**options)
        with Relay(self.port, 0.2) as relay, self.assertRaisesRegex(mp.Refused, "answers after 0.4"):
            self.connect(relay.port, silence_s=0.5)
        with self.assertRaises(ValueError) as caught:
            mp.connect("ssh://user:secret@host/run")
        self.assertNotIn("secret", str(caught.exception))
        for url in ("ssh://", "ssh:host", "ssh://-oProxyCommand=x/run", "ssh://-oProxyCommand=x@host/run"):
            with self.assertRaisesRegex(ValueError, "expected ssh://USER@HOST"):
                mp.connect(url)


if __name__ == "__main__":
    harness.main()
