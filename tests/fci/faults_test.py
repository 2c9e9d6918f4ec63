#!/usr/bin/env python3
"""Faults between a run and its virtual arms, for 1, 2 and 4 arms: faults_test.py PROGRAM

`multipanda run --backend fci` controls `multipanda virtual-arm` in another process through the control interface. After
any fault an arm is held and never keeps its last torque, and the other arms miss no cycle. The worlds are in lock-step,
so missed cycles are counted independently of the load of the machine.
"""

import json
import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import time
import unittest

import numpy as np
import pylibfranka as franka
from virtual_arms import PATIENCE_S, VirtualArms

PROGRAM = ""


def scene_text(count):
    """Arms in a row. With more than two arms the first two share a controllet and fail together."""
    lines = ["name: faults", "arms:"]
    names = [f"arm{i}" for i in range(count)]
    for i, name in enumerate(names):
        lines.append(
            f"  - {{name: {name}, model: {['fer', 'fr3'][i % 2]}, hand: true, start_rad: ready, "
            f"base: {{position_m: [0, {1.2 * i}, 0], rpy_rad: [0, 0, {0.3 * i}]}}}}"
        )
    lines += ["controllets:"]
    groups = [[name] for name in names] if count <= 2 else [names[:2]] + [[name] for name in names[2:]]
    for group in groups:
        kind = "joint_impedance" if len(group) == 1 else "dual_cartesian_impedance"
        lines.append(f"  - {{name: law_{group[0]}, type: {kind}, arms: [{', '.join(group)}]}}")
    lines.append(f"active: [{', '.join('law_' + group[0] for group in groups)}]")
    return "\n".join(lines) + "\n", names, groups


class World:
    """Virtual arms in one process, a run in another."""

    def __init__(self, count, seconds=600, options=()):
        self.text, self.names, self.groups = scene_text(count)
        self.seconds, self.options = seconds, options
        self.run = self.messages = None

    def __enter__(self):
        self.folder = tempfile.TemporaryDirectory()
        self.scene = pathlib.Path(self.folder.name, "scene.yaml")
        self.scene.write_text(self.text)
        self.socket = pathlib.Path(self.folder.name, "run.sock")
        versions = [word for name in self.names for word in ("--protocol", f"{name}=any")]  # for pylibfranka, too
        self.arms = VirtualArms(
            PROGRAM, self.scene, self.names, "lockstep", ["--no-gripper", *versions, *self.options]
        ).__enter__()
        try:
            return self.start_run()
        except BaseException:
            self.__exit__()
            raise

    def start_run(self):
        words = [
            PROGRAM,
            "run",
            str(self.scene),
            "--backend",
            "fci",
            "--fast",
            "--json",
            "--seconds",
            str(self.seconds),
            "--socket",
            str(self.socket),
        ]
        for name in self.names:
            words += ["--address", f"{name}={self.arms.address[name]}"]
        self.messages = open(pathlib.Path(self.folder.name, "run.txt"), "w+")
        self.run = subprocess.Popen(
            words, stdout=subprocess.PIPE, stderr=self.messages, text=True, cwd=self.folder.name
        )
        self.wait_for(lambda state: state["t_s"] > 0.2)
        return self

    def ctl(self, *words):
        done = subprocess.run(
            [PROGRAM, "ctl", "--socket", str(self.socket), "--json", *words],
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
        )
        try:
            return json.loads(done.stdout.strip().splitlines()[-1])
        except (IndexError, ValueError):
            return {"ok": False, "reason": done.stdout + done.stderr}

    def state(self):
        return self.ctl("state").get("state", {})

    def wait_for(self, holds, timeout=2 * PATIENCE_S):
        end = time.monotonic() + timeout
        while True:
            state = self.state()
            try:
                if holds(state):
                    return state
            except KeyError:
                pass
            if time.monotonic() > end or self.run.poll() is not None:
                self.messages.seek(0)
                raise AssertionError(f"timed out: {json.dumps(state)[:1500]}\n{self.messages.read()[-2000:]}")
            time.sleep(0.02)

    def goes_on(self, seconds=0.5):
        began = self.state()["t_s"]
        return self.wait_for(lambda state: state["t_s"] > began + seconds)

    def owner(self, name):
        return self.arm(self.state(), name)["controllet"]

    @staticmethod
    def arm(state, name):
        return next(arm for arm in state["arms"] if arm["arm"] == name)

    def end(self):
        self.run.send_signal(signal.SIGINT)
        out, _ = self.run.communicate(timeout=PATIENCE_S)
        return json.loads(out)

    def __exit__(self, *_):
        if self.run is not None:
            if self.run.poll() is None:
                self.run.kill()
            self.run.wait()
            self.run.stdout.close()
        if self.messages is not None:
            self.messages.close()
        self.arms.__exit__()
        self.folder.cleanup()


def robot_at(address):
    return franka.Robot(address, franka.RealtimeConfig.kIgnore)


class FaultMatrix(unittest.TestCase):
    counts = (1, 2, 4)

    def others(self, world, name):
        group = next(group for group in world.groups if name in group)
        return [other for other in world.names if other not in group], group

    def held(self, world, name):
        """Checks that the arm's group is held, the other controllets run and time advances."""
        others, group = self.others(world, name)
        world.wait_for(
            lambda state: all(world.arm(state, member)["controllet"] == f"{member}_hold" for member in group)
        )
        state = world.goes_on() if others else world.state()
        for other in others:
            self.assertTrue(world.arm(state, other)["controllet"].startswith("law_"), other)
            self.assertEqual(world.arm(state, other)["mode"], "move")

    def no_cycle_missed(self, world, names):
        for name in names:
            self.assertEqual(world.arms.ended["arms"][name]["commands_missed"], 0, name)

    def test_recovery_from_a_reflex_ends_in_hold(self):
        for count in self.counts:
            with self.subTest(arms=count), World(count) as world:
                name = world.names[-1]
                self.assertFalse(world.ctl("recover", name)["ok"])  # no error to recover from
                world.arms.control(f"reflex {name} cartesian_reflex")
                self.held(world, name)
                self.assertEqual(world.arm(world.state(), name)["mode"], "reflex")
                self.assertTrue(world.ctl("recover", name)["ok"])
                world.wait_for(lambda state: world.arm(state, name)["mode"] == "move")
                world.goes_on(0.3)
                self.assertEqual(world.owner(name), f"{name}_hold")  # never back to the previous controllet
                self.assertTrue(world.ctl("switch", f"law_{name}")["ok"])
                world.goes_on(0.3)
                self.assertEqual(world.owner(name), f"law_{name}")
                summary = world.end()
                others = [other for other in world.names if other != name]
                taken_out = {
                    i["arm"]
                    for i in summary["interventions"]
                    if not any(word in i["rule"] for word in ("stop", "rate", "clamp"))
                }
                self.assertEqual(taken_out, {name}, summary["interventions"])
            self.no_cycle_missed(world, others)

    def test_lost_connection_and_reconnection(self):
        for count in self.counts:
            with self.subTest(arms=count), World(count) as world:
                name = world.names[-1]
                world.arms.control(f"close {name}")
                self.held(world, name)
                world.wait_for(lambda state: world.arm(state, name)["mode"] == "disconnected")
                self.assertTrue(world.ctl("reconnect", name)["ok"])
                world.wait_for(lambda state: world.arm(state, name)["mode"] == "move")
                self.assertEqual(world.owner(name), f"{name}_hold")
                world.end()
            self.no_cycle_missed(world, self.others(world, name)[0])

    def test_lost_duplicated_and_reordered_datagrams(self):
        for count in self.counts:
            # In lock-step with several arms each lost state costs a wait of wall-clock time, so only a few are lost.
            share = "0.02" if count == 1 else "0.004"
            with (
                self.subTest(arms=count),
                World(
                    count, options=["--loss", share, "--duplicate", "0.05", "--reorder", share, "--seed", "5"]
                ) as world,
            ):
                world.goes_on(3.0 if count == 1 else 0.5)
                state = world.state()
                for name in world.names:
                    self.assertEqual(world.arm(state, name)["mode"], "move", name)
                world.end()
            for name in world.names:
                self.assertGreater(world.arms.ended["arms"][name]["commands_lost"], 0)

    def test_arms_of_a_killed_program_brake(self):
        for count in self.counts:
            with self.subTest(arms=count), World(count) as world:
                world.run.kill()
                world.run.wait()
                for name in world.names:
                    robot = robot_at(world.arms.address[name])
                    first = robot.read_once()
                    self.assertNotEqual(first.robot_mode, franka.RobotMode.Move)
                    while (state := robot.read_once()).time.to_sec() < first.time.to_sec() + 0.5:
                        pass
                    np.testing.assert_allclose(state.dq, np.zeros(7), atol=1e-3)
                    np.testing.assert_allclose(state.q, first.q, atol=2e-2)
                    self.assertEqual(state.control_command_success_rate, 0.0)

    def test_a_suspended_program_loses_its_arms_and_recovers_them(self):
        for count in self.counts:
            with self.subTest(arms=count), World(count) as world:
                world.run.send_signal(signal.SIGSTOP)
                time.sleep(3)  # longer than the world waits, plus twenty periods without a command
                world.run.send_signal(signal.SIGCONT)
                for name in world.names:
                    world.wait_for(lambda state: world.arm(state, name)["controllet"] == f"{name}_hold")
                name = world.names[0]
                world.wait_for(lambda state: world.arm(state, name)["mode"] == "reflex")
                self.assertTrue(world.ctl("recover", name)["ok"])
                world.wait_for(lambda state: world.arm(state, name)["mode"] == "move")
                world.end()

    def test_a_run_still_answers_after_its_virtual_arms_were_killed(self):
        for count in self.counts:
            with self.subTest(arms=count):
                world = World(count).__enter__()
                world.arms.process.kill()
                for name in world.names:
                    world.wait_for(lambda state: world.arm(state, name)["mode"] == "disconnected")
                self.assertFalse(world.ctl("reconnect", world.names[0])["ok"])
                summary = world.end()
                self.assertFalse(summary["success"])
                world.run.stdout.close()
                world.messages.close()
                world.arms.close(expected=-9)
                world.folder.cleanup()


if __name__ == "__main__":
    PROGRAM = os.path.abspath(sys.argv.pop(1))
    unittest.main(verbosity=2)
