#!/usr/bin/env python3
"""A run that stood still (SIGSTOP) and goes on: nothing moves, recovers or switches by what was asked before.

A table of scenarios: what the arm did, for how long the run stood still, whose arm it is (simulated in the run, or a
virtual arm of another process, which does not stand still). Meanwhile clients of every kind ask for everything; half of
them are gone when it goes on. With MULTIPANDA_FULL=1 for 1 to 30 s.
"""

import itertools
import json
import os
import pathlib
import random
import signal
import socket
import struct
import subprocess
import sys
import time
import unittest

import harness  # first: it sets the paths
import multipanda as mp
import numpy as np
from harness import FOLDER, PATIENCE, until

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "fci"))
from virtual_arms import VirtualArms

PROGRAM = ""
FULL = os.environ.get("MULTIPANDA_FULL") == "1"
SECONDS = (1.0, 2.0, 5.0, 14.0, 30.0) if FULL else (1.0, 3.0)
SEED = 4
WATCHED_S = 1.0  # after the run goes on
STILL_RAD, BRAKING_RAD = 0.01, 0.05

SCENE = """name: {name}
arms: [{{name: arm, model: fer, hand: true, start_rad: ready}}]
controllets:
  - {{name: joint, type: joint_impedance, arms: arm}}
  - {{name: cartesian, type: cartesian_impedance, arms: arm}}
"""


class Standing:
    """A run in a process of its own, which can be stopped, with its arm simulated or in a third process."""

    numbers = itertools.count()

    def __init__(self, is_virtual):
        self.name = f"standstill{next(self.numbers)}"
        self.path = FOLDER / f"{self.name}.sock"
        scene = FOLDER / f"{self.name}.yaml"
        scene.write_text(SCENE.format(name=self.name))
        self.arms = VirtualArms(PROGRAM, scene, ["arm"], "realtime", ["--no-gripper"]) if is_virtual else None
        if self.arms:
            self.arms.__enter__()
        words = [PROGRAM, "run", str(scene), "--no-timeline", "--full-speed", "--socket", str(self.path)]
        if self.arms:
            words += ["--backend", "fci", "--address", f"arm={self.arms.address['arm']}"]
        self.messages = open(FOLDER / f"{self.name}.txt", "w+")
        self.process = subprocess.Popen(words, stdout=self.messages, stderr=subprocess.STDOUT)
        until(lambda: self.path.exists() or self.process.poll() is not None, "the socket of the run")
        self.client = mp.connect(self.path)
        self.client.state()

    def stand_still(self):
        """Until no thread of the run goes on: on a busy computer some do for a while."""
        os.kill(self.process.pid, signal.SIGSTOP)
        threads = pathlib.Path(f"/proc/{self.process.pid}/task")

        def stopped():
            return all(file.read_text().rpartition(") ")[2][0] == "T" for file in threads.glob("*/stat"))

        until(stopped, "the end of every thread's work")

    @property
    def connections(self):
        """How many sockets the run's clients have opened, also those that it has not accepted yet."""
        return pathlib.Path("/proc/net/unix").read_text().count(f" {self.path}\n")

    def close(self):
        self.process.send_signal(signal.SIGCONT)
        self.client.close()
        self.process.send_signal(signal.SIGINT)
        self.process.wait(PATIENCE)
        self.messages.close()
        if self.arms:
            self.arms.close()

    @property
    def arm(self):
        """The newest state; a busy computer may leave the loop without a cycle for a moment."""
        deadline = time.monotonic() + PATIENCE
        while True:
            try:
                return self.client.connection.ask({"do": "state"})["state"]["arms"][0]
            except (mp.Timeout, IndexError):
                if time.monotonic() > deadline:
                    raise

    def make_ready(self):
        """Held, without an error, as the next scenario expects it. A busy computer may lose a virtual arm again."""
        deadline = time.monotonic() + PATIENCE
        while True:
            self.client.resume()
            state = self.arm
            if state["mode"] == "move" and not state["stopped"]:
                return
            try:
                self.client.ask({"do": "reconnect" if state["mode"] == "disconnected" else "recover", "arm": "arm"})
            except (mp.Refused, mp.Timeout):
                pass
            if time.monotonic() > deadline:
                raise AssertionError(f"the arm does not recover: {state}")

    # --- what the arm did ---

    def idle(self):
        self.client.switch(only=True)

    def motion(self):
        """A busy computer may end it before it is seen."""
        while not self.begin_motion():
            self.make_ready()

    def begin_motion(self):
        self.client.switch("joint", only=True)
        goal = np.array(self.arm["q_rad"]) + [0.5, 0, 0, 0, 0, 0, 0.5]
        goal[0] -= 1.0 if goal[0] > 0.6 else 0.0
        goal[6] -= 1.0 if goal[6] > 1.0 else 0.0
        self.client["joint"].goal("joints", goal, duration_s=6)

        def decided():
            state = self.arm
            moves = max(map(abs, state["dq_rad_per_s"])) > 0.05 or state["mode"] != "move"
            return moves or state["controllet"] != "joint"

        until(decided, "a motion")
        state = self.arm
        return state["controllet"] == "joint" or state["mode"] != "move"

    def reflex(self):
        self.motion()
        if self.arms:
            self.arms.control("reflex arm joint_reflex")
        else:
            self.client.ask({"do": "stop_motion", "arm": "arm"})
        until(lambda: self.arm["mode"] != "move", "a reflex")

    def recovery(self):
        self.reflex()
        # The answer is not waited for: the run stands still in the midst of it.
        self.client.connection.post({"do": "recover", "arm": "arm"}, patience_s=10)
        time.sleep(random.choice([0, 0.001, 0.003, 0.01, 0.03]))


class Raw:
    """A client without any of the package's care."""

    def __init__(self, path):
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self.socket.connect(str(path))

    def tell(self, **request):
        self.socket.sendall(json.dumps(request).encode() + b"\n")

    def answers(self, count):
        """So many answers."""
        self.socket.settimeout(PATIENCE)
        with self.socket.makefile("rb") as lines:
            return [json.loads(next(lines)) for _ in range(count)]

    def close(self):
        self.socket.close()


class Standstill(unittest.TestCase):
    def setUp(self):
        random.seed(SEED)

    def requests(self, q):
        """Everything that could move, recover or switch the arm."""
        goal = [x + 0.3 for x in q]
        return [
            {"do": "resume"},
            {"do": "recover", "arm": "arm"},
            {"do": "switch", "activate": ["joint"]},
            {"do": "reference", "controllet": "joint", "input": "joints", "q_rad": goal, "duration_s": 1},
            {"do": "switch", "activate": ["cartesian"], "only": True},
            {"do": "recover", "arm": "arm"},
            {"do": "parameter", "controllet": "arm_hold", "name": "stiffness_nm_per_rad", "value": 10},
        ]

    def ask_all(self, run, q):
        """Clients that ask while the run stands still. Returns those that are still there, and their requests."""
        stayed = []
        for number in range(4):
            client = Raw(run.path)
            requests = self.requests(q)
            for id_, request in enumerate(requests):
                stamps = {"asked_ns": time.monotonic_ns(), "patience_s": 60} if number % 2 else {}
                client.tell(id=id_, **request, **stamps)
            stayed.append((client, len(requests)))
        return stayed

    def scenario(self, run, kind, seconds):
        run.make_ready()
        channel = run.client.ask({"do": "stream", "controllet": "joint", "input": "joints"})
        publisher = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        publisher.connect(channel["path"])
        getattr(run, kind)()
        before = run.arm if kind != "recovery" else None
        run.stand_still()
        try:
            q = before["q_rad"] if before else [0.0] * 7
            clients = self.ask_all(run, q)
            packet = struct.pack("<4sHHIIQq7d", b"MPRS", 1, 7, channel["channel"], 0, 1, 0, *[x + 0.2 for x in q])
            publisher.send(packet)
            connections = run.connections
            late = subprocess.Popen(
                [PROGRAM, "ctl", "--socket", str(run.path), "recover", "arm"],
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                text=True,
            )
            until(lambda: run.connections > connections, "the request of a program, which a busy computer begins late")
            time.sleep(seconds)
            for client, _ in clients[2:]:
                client.close()
        finally:
            os.kill(run.process.pid, signal.SIGCONT)

        def seen():  # by a cycle afterwards, with what a virtual arm has said meanwhile
            state = run.arm
            return state["stopped"] and not (run.arms and state["mode"] == "move")

        until(seen, "the first state afterwards")
        first = run.arm
        begun = time.monotonic()
        drift = 0.0
        while time.monotonic() - begun < WATCHED_S:
            state = run.arm
            drift = max(drift, float(np.max(np.abs(np.subtract(state["q_rad"], first["q_rad"])))))
            self.assertEqual(state["controllet"], "arm_hold")
            self.assertTrue(state["stopped"])
            if run.arms:
                self.assertNotEqual(state["mode"], "move")
        # A virtual arm of another process has come to rest by itself; a simulated one was in motion like its run.
        moving = kind == "motion" and not run.arms
        self.assertLess(drift, BRAKING_RAD if moving else STILL_RAD)
        for client, count in clients[:2]:
            for answer in client.answers(count):
                self.assertEqual((answer["ok"], answer["verdict"]), (False, "timeout"), answer)
                self.assertRegex(answer["reason"], "stalled|is not executed")
            client.close()
        self.assertEqual(late.wait(PATIENCE), 1)
        self.assertRegex(late.stderr.read(), "stalled|no answer")
        late.stderr.close()
        publisher.close()
        # Somebody who looks at the arm and asks again is heard.
        run.make_ready()
        run.client.switch("joint")
        run.client.switch(only=True)

    def table(self, is_virtual):
        run = Standing(is_virtual)
        self.addCleanup(run.close)
        for kind, seconds in itertools.product(("idle", "motion", "reflex", "recovery"), SECONDS):
            with self.subTest(kind=kind, seconds=seconds):
                self.scenario(run, kind, seconds)

    def test_a_simulated_arm(self):
        self.table(False)

    def test_a_virtual_arm(self):
        self.table(True)


if __name__ == "__main__":
    PROGRAM = os.path.abspath(sys.argv[1])
    harness.main()
