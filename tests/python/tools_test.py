#!/usr/bin/env python3
"""Virtual arms, fixtures for pytest, the program's longer commands, asyncio, the notebook's table."""

import asyncio
import contextlib
import importlib.util
import io
import os
import signal
import socket
import subprocess
import sys
import unittest

import harness  # first: it sets the paths
import multipanda as mp
from harness import FOLDER, PATIENCE, ended, until
from multipanda import aio

FIXTURES = """
import socket
pytest_plugins = ["multipanda.pytest_plugin"]

def test_arms(multipanda_virtual_arms):
    arms = multipanda_virtual_arms("one_arm", arm_names=("arm",))
    socket.create_connection((arms.addresses["arm"], arms.ports["arm"]), 10).close()

def test_a_run(multipanda_run):
    run = multipanda_run("one_arm")
    assert run.active == ["cartesian"]
    assert not run.arms["arm"].state.held
"""


class VirtualArms(unittest.TestCase):
    def test_listen_until_the_end(self):
        with mp.virtual_arms("two_arms", arm_names=("left", "right")) as arms:
            self.assertEqual(list(arms.addresses), ["left", "right"])
            self.assertNotEqual(arms.addresses["left"], arms.addresses["right"])
            for name, address in arms.addresses.items():
                socket.create_connection((address, arms.ports[name]), 10).close()
            arms.tell("help")
            until(lambda: "push" in arms.process.messages, "the help of the commands")
        self.assertFalse(arms.result["fault"])
        self.assertIsNotNone(arms.process.child.returncode)
        with self.assertRaises(OSError):
            socket.create_connection((arms.addresses["left"], arms.ports["left"]), 10)

    def test_a_run_drives_them(self):
        with mp.virtual_arms("one_arm", lockstep=False, arm_names=("arm",)) as arms:
            with mp.run("one_arm", address=arms.addresses, backend="fci") as run:
                arm = run.arms["arm"]
                state = run["cartesian"].goal("pose", arm.state.pose.moved(z=0.02), duration_s=0.5).wait(PATIENCE)
                self.assertFalse(state.held)
            self.assertFalse(run.running)

    def test_they_end_with_a_killed_owner(self):
        code = (
            "import sys, time, multipanda as mp\n"
            "arms = mp.virtual_arms('one_arm', arm_names=('arm',))\n"
            "print(arms.process.child.pid, flush=True)\n"
            "time.sleep(600)"
        )
        owner = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
        program = int(owner.stdout.readline())
        owner.send_signal(signal.SIGKILL)
        owner.communicate(timeout=PATIENCE)
        until(lambda: ended(program), "the end of the virtual arms")

    def test_an_unknown_arm_is_refused(self):
        with self.assertRaisesRegex(mp.Refused, "'arm'"):
            mp.virtual_arms("one_arm", arm_names=("harm",))

    def test_fixtures(self):
        if importlib.util.find_spec("pytest") is None:
            self.skipTest("pytest is not installed")
        folder = FOLDER / "fixtures"
        folder.mkdir()
        (folder / "conftest.py").write_text('pytest_plugins = ["multipanda.pytest_plugin"]\n')
        (folder / "test_fixtures.py").write_text(
            FIXTURES.replace('pytest_plugins = ["multipanda.pytest_plugin"]\n', "")
        )
        done = subprocess.run(
            [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(folder)],
            capture_output=True,
            text=True,
            timeout=PATIENCE,
        )
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        self.assertIn("2 passed", done.stdout)


class Commands(unittest.TestCase):
    def test_names_are_checked(self):
        with self.assertRaisesRegex(mp.Refused, "task-1"):
            mp.experiment("task-11x", fast=True, out=FOLDER)
        with self.assertRaises(mp.Refused):
            mp.refine("task-44x", out=FOLDER)
        with self.assertRaisesRegex(mp.Error, "no such file"):
            mp.identify(FOLDER / "nothing.csv")
        with self.assertRaisesRegex(mp.Refused, "--repeats"):
            mp.experiment("task-1", repeat=1)

    def test_an_experiment(self):
        result = mp.experiment("task-1", fast=True, repeats=1, out=FOLDER / "experiment")
        self.assertIsInstance(result, dict)


class Asyncio(unittest.TestCase):
    def test_requests_do_not_block_the_event_loop(self):
        async def drive():
            async with await aio.run("one_arm") as run:
                turns = 0

                async def count():
                    nonlocal turns
                    while True:
                        turns += 1
                        await asyncio.sleep(0)

                counter = asyncio.ensure_future(count())
                pose = (await run.state()).arms["arm"].pose
                goal = await run["cartesian"].goal("pose", pose.moved(z=0.02), duration_s=0.3)
                at_goal = await goal.wait(PATIENCE)
                counter.cancel()
                self.assertGreater(turns, 10)
                self.assertLess(abs(at_goal.pose.position_m[2] - pose.position_m[2] - 0.02), 0.01)
                cycles = []
                async for state in run.states(100):
                    cycles.append(state.cycle)
                    if len(cycles) == 4:
                        break
                self.assertEqual(cycles, sorted(cycles))
                both = await asyncio.gather(run.state(), run.ask({"do": "list"}))
                self.assertEqual(both[1]["scene"], "one_arm")
                with self.assertRaises(mp.Refused):
                    await run.ask({"do": "nothing"})
                await run.stop()
                await run.resume()
                law, arm = run["cartesian"], run.arms["arm"]
                await run.switch("cartesian", only=True)
                goal = await law.goal("pose", (await arm.state).pose.moved(z=-0.01), duration_s=0.3)
                self.assertFalse((await goal.wait(PATIENCE)).held)
                await law.set("damping_ratio", 0.8)
                self.assertEqual((await law.damping_ratio, arm.name, law.arms), (0.8, "arm", ("arm",)))
                with self.assertRaisesRegex(mp.Refused, "no gripper"):
                    await arm.gripper.state
                with self.assertRaisesRegex(KeyError, "no arm 'am'; did you mean 'arm'"):
                    run.arms["am"]
                events = await run.events()
                await arm.stop()
                async for event in events:
                    self.assertTrue(event.kind)
                    break
                await arm.resume()
                async with await aio.connect() as other:
                    await other.switch("joint")
                    self.assertEqual((await other.ask({"do": "list"}))["scene"], "one_arm")
                return run.blocking

        run = asyncio.run(drive())
        self.assertFalse(run.running)
        self.assertEqual(run.summary["ended_by"], "stopped")


class Table(unittest.TestCase):
    def test_in_a_terminal(self):
        with mp.run("one_arm") as run, contextlib.redirect_stdout(io.StringIO()) as shown:
            mp.live_table(run, seconds=0.2, rate_hz=50)
        lines = shown.getvalue().splitlines()
        self.assertGreater(len(lines), 4)
        self.assertTrue(any("arm" in line and "cartesian" in line for line in lines))


class Programs(unittest.TestCase):
    def test_the_stubs_of_a_scene(self):
        done = subprocess.run(
            [sys.executable, "-m", "multipanda.stubs", "one_arm"], capture_output=True, text=True, timeout=PATIENCE
        )
        self.assertEqual(done.returncode, 0, done.stderr)
        compile(done.stdout, "stubs", "exec")
        self.assertIn("class Cartesian(mp.Controllet):", done.stdout)

    def test_the_import_needs_numpy_alone(self):
        """With the standard library and numpy only, and without what the tests import."""
        code = (
            "import sys, importlib.abc\n"
            "class Others(importlib.abc.MetaPathFinder):\n"
            "    def find_spec(self, name, path, target=None):\n"
            "        top = name.partition('.')[0]\n"
            "        if path is None and top not in sys.stdlib_module_names and top not in ('numpy', 'multipanda'):\n"
            "            raise ImportError('not allowed: ' + name)\n"
            "sys.meta_path.insert(0, Others())\n"
            "import multipanda, multipanda.aio\n"
        )
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=PATIENCE)
        self.assertEqual(done.returncode, 0, done.stderr)

    def test_it_is_found_next_to_its_tree(self):
        environment = {key: value for key, value in os.environ.items() if key != "MULTIPANDA_PROGRAM"}
        code = (
            "import multipanda as mp\ntry: print(mp.program_path())\nexcept mp.ProgramMissing as e: print(e.next_step)"
        )
        said = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, timeout=PATIENCE, env=environment
        ).stdout
        self.assertIn("multipanda", said)


if __name__ == "__main__":
    harness.main()
