#!/usr/bin/env python3
"""A run that Python starts: it ends in hold however Python ends, and errors say what to do."""

import contextlib
import os
import pathlib
import signal
import socket
import stat
import subprocess
import sys
import tempfile
import threading
import time
import unittest

import harness  # first: it sets the paths
import multipanda as mp
from harness import FOLDER, PATIENCE, ended, sockets, until

# Starts a scene and a motion of 10 cm, says so, and goes on until it is ended.
SENDER = """
import sys, time
import multipanda as mp
with mp.run("one_arm", record=sys.argv[1]) as run:
    arm = run.arms["arm"]
    run.switch("cartesian", only=True)
    run["cartesian"].goal("pose", arm.state.pose.moved(z=0.1), duration_s=20)
    print(run.process.child.pid, flush=True)
    with run["cartesian"].stream("pose") as stream:
        pose = arm.state.pose
        while sys.argv[2] == "stream":
            stream.send(pose)
            time.sleep(0.01)
    time.sleep(600)
"""


def log_in(folder):
    (found,) = pathlib.Path(folder).glob("*/log.mcap")
    return mp.read_log(found)


def processes_with(folder):
    """Processes that were started with this folder as an argument."""
    found = []
    for path in pathlib.Path("/proc").glob("[0-9]*/cmdline"):
        with contextlib.suppress(OSError):
            if folder.encode() in path.read_bytes() and not ended(path.parent.name):
                found.append(path.parent.name)
    return found


class Leaving(unittest.TestCase):
    def check_hold(self, folder):
        """The log is complete, and its last owner of the arm is hold, at rest."""
        log = log_in(folder)
        self.assertEqual(str(log["arm/command/owner"][-1]), "arm_hold")
        self.assertEqual(str(log["arm/command/owner"][0]), "arm_hold" if len(log["arm/q"]) < 2 else "cartesian")
        self.assertLess(abs(log["arm/dq"][-1]).max(), 0.02)

    def test_with_ends_in_hold_and_leaves_nothing_behind(self):
        with tempfile.TemporaryDirectory() as folder:
            with mp.run("one_arm", record=folder) as run:
                self.assertEqual(run.active, ["cartesian"])
                self.assertTrue(run.running)
                self.assertIn("one_arm", repr(run))
                with self.assertRaises(mp.Refused):
                    run.log  # noqa: B018  not complete yet
            self.assertFalse(run.running)
            self.assertEqual(run.process.child.returncode, 0)
            self.assertTrue(run.summary.success, run.summary.faults)
            self.assertIn("one_arm", str(run.summary))
            self.assertTrue(run.log.exists())
            self.check_hold(folder)
            self.assertEqual(sockets(), [])
            with self.assertRaises(mp.Disconnected):
                run.state()
            run.close()  # again: nothing

    def test_an_exception_ends_in_hold_and_goes_on(self):
        with tempfile.TemporaryDirectory() as folder:
            with self.assertRaisesRegex(ValueError, "mine"), mp.run("one_arm", record=folder) as run:
                run["cartesian"].goal("pose", run.arms["arm"].state.pose.moved(z=0.1), duration_s=20)
                raise ValueError("mine")
            self.assertFalse(run.running)
            self.assertIsNotNone(run.summary)
            self.check_hold(folder)

    def ended_from_outside(self, signal_number, what):
        with tempfile.TemporaryDirectory() as folder:
            sender = subprocess.Popen(
                [sys.executable, "-c", SENDER, folder, what],
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
            )
            program = int(sender.stdout.readline())
            until(lambda: sockets() != [], "the socket")
            sender.send_signal(signal_number)
            sender.communicate(timeout=PATIENCE)
            self.assertEqual(sender.returncode, -signal_number)
            until(lambda: ended(program), "the end of the program")
            self.check_hold(folder)
            self.assertEqual(sockets(), [])

    def test_killed_in_mid_motion_ends_in_hold(self):
        self.ended_from_outside(signal.SIGKILL, "goal")

    def test_killed_in_mid_stream_ends_in_hold(self):
        self.ended_from_outside(signal.SIGKILL, "stream")

    def test_interrupted_in_mid_stream_ends_in_hold(self):
        self.ended_from_outside(signal.SIGINT, "stream")

    def test_interrupted_at_any_moment_leaves_nothing_behind(self):
        """Ctrl-C while Python starts, while the program starts, in a stream, at the end; to Python alone, and to the
        whole group as a terminal sends it."""
        code = (
            "import sys, time\nprint('python', flush=True)\nimport multipanda as mp\nprint('package', flush=True)\n"
            "with mp.run('one_arm', record=sys.argv[1]) as run:\n"
            "    print('run', flush=True)\n"
            "    with run['cartesian'].stream('pose') as stream:\n"
            "        print('stream', flush=True)\n"
            "        for _ in range(50):\n"
            "            stream.send(run.arms['arm'].state.pose)\n"
            "            time.sleep(0.01)\n"
            "    print('closed', flush=True)\n"
        )
        moments = [(word, later) for word in ("python", "package", "run", "stream", "closed") for later in (0, 0.1)]
        for group in (False, True):
            for word, later in moments:
                with self.subTest(f"{word} + {later} s, group: {group}"), tempfile.TemporaryDirectory() as folder:
                    child = subprocess.Popen(
                        [sys.executable, "-c", code, folder],
                        stdout=subprocess.PIPE,
                        stderr=subprocess.DEVNULL,
                        text=True,
                        start_new_session=True,
                    )
                    for line in child.stdout:
                        if line.strip() == word:
                            break
                    time.sleep(later)
                    with contextlib.suppress(ProcessLookupError):
                        (os.killpg if group else os.kill)(child.pid, signal.SIGINT)
                    child.stdout.read()
                    child.stdout.close()
                    child.wait(PATIENCE)
                    until(lambda: processes_with(folder) == [], "the end of the program")  # noqa: B023
                    self.assertEqual(sockets(), [])

    def test_a_program_that_closes_nothing_ends_in_hold(self):
        with tempfile.TemporaryDirectory() as folder:
            code = "import sys, multipanda as mp\nrun = mp.run('one_arm', record=sys.argv[1])\n"
            code += "run['cartesian'].goal('pose', run.arms['arm'].state.pose.moved(z=0.1), duration_s=20)\n"
            code += "print(run.process.child.pid, flush=True)"
            done = subprocess.run(
                [sys.executable, "-c", code, folder], capture_output=True, text=True, timeout=PATIENCE, check=True
            )
            until(lambda: ended(int(done.stdout)), "the end of the program")
            self.check_hold(folder)

    def test_a_line_that_was_interrupted_ends_the_connection(self):
        with mp.run("one_arm") as run:
            other = mp.connect()

            class Interrupted:
                def sendall(self, line):
                    sent.send(line[:5])
                    raise KeyboardInterrupt

                def __getattr__(self, name):
                    return getattr(sent, name)

            sent, other.connection._socket = other.connection._socket, Interrupted()
            with self.assertRaises(KeyboardInterrupt):
                other.ask({"do": "state"})
            other.connection._socket = sent
            with self.assertRaises(mp.Disconnected):
                other.state()
            other.close()
            self.assertEqual(run.active, ["cartesian"])

    def test_the_thread_that_started_it_may_end(self):
        started = []
        thread = threading.Thread(target=lambda: started.append(mp.run("one_arm")))
        thread.start()
        thread.join()
        with started[0] as run:
            before = run.state().cycle
            until(lambda: run.state().cycle > before + 50, "cycles go on")

    def test_a_forked_child_neither_ends_nor_keeps_the_run(self):
        with mp.run("one_arm") as run:
            child = os.fork()
            if child == 0:
                try:
                    run.state()
                except mp.Disconnected as error:
                    run.close()
                    os._exit(0 if "forked" in str(error) else 3)
                os._exit(4)
            self.assertEqual(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), 0)
            self.assertEqual(run.active, ["cartesian"])
            sleeper = os.fork()
            if sleeper == 0:
                signal.pause()
        try:  # the run has ended although the child lives, which had copies of its files
            self.assertEqual(run.process.child.returncode, 0)
        finally:
            os.kill(sleeper, signal.SIGKILL)
            os.waitpid(sleeper, 0)

    def test_a_run_with_an_end_of_its_own(self):
        with mp.run("one_arm", seconds=0.5) as run:
            summary = run.wait(PATIENCE)
        self.assertEqual((summary["cycles"], summary["ended_by"]), (500, "duration"))
        with self.assertRaisesRegex(mp.Refused, "not recorded"):
            run.log  # noqa: B018

    def test_a_scene_that_is_played(self):
        summary = mp.play("two_arms", seconds=7, record=FOLDER / "own")
        self.assertEqual((summary["cycles"], summary["ended_by"]), (7000, "duration"))
        self.assertTrue(summary.log.exists())
        self.assertEqual([s["started"] for s in summary["switches"]][1:3], [["right_joint"], ["dual"]])
        with self.assertRaisesRegex(mp.Refused, "'two_arms'"):
            mp.play("two_arm")

    def test_as_fast_as_possible(self):
        with mp.run("one_arm", fast=True) as run:
            run["cartesian"].goal("pose", run.arms["arm"].state.pose.moved(z=0.03), duration_s=1).wait(PATIENCE)
        self.assertFalse(run.summary["paced"])
        with self.assertRaisesRegex(ValueError, "mp.play"):
            mp.run("one_arm", fast=True, seconds=1)


class Errors(unittest.TestCase):
    def test_an_unknown_scene_is_refused_with_the_nearest(self):
        with self.assertRaises(mp.Refused) as caught:
            mp.run("two_arm")
        self.assertIn("'two_arms'", caught.exception.reason)
        self.assertEqual(caught.exception.verdict, "not_understood")
        self.assertIn("Next: ", str(caught.exception))
        self.assertEqual(sockets(), [])

    def test_a_program_that_dies_is_disconnected(self):
        run = mp.run("one_arm")
        waiting = []

        def watch():
            try:
                waiting.extend(run.states(50))
                waiting.append("ended")
            except mp.Disconnected:
                waiting.append("ended")

        watcher = threading.Thread(target=watch)
        watcher.start()
        os.kill(run.process.child.pid, signal.SIGKILL)
        with self.assertRaises(mp.Disconnected):
            while True:
                run.state()
        watcher.join(PATIENCE)
        self.assertEqual(waiting[-1], "ended")
        with self.assertRaisesRegex(mp.Error, "without a summary"):
            run.close()

    def test_a_program_that_does_not_answer_is_a_timeout(self):
        with mp.run("one_arm") as run:
            os.kill(run.process.child.pid, signal.SIGSTOP)
            stopped = pathlib.Path(f"/proc/{run.process.child.pid}/stat")
            until(lambda: stopped.read_text().rpartition(") ")[2][0] == "T", "the program stands still")
            try:
                with self.assertRaises(mp.Timeout) as caught:
                    run.ask({"do": "list"}, 0.1)
            finally:
                os.kill(run.process.child.pid, signal.SIGCONT)
            self.assertIsInstance(caught.exception, TimeoutError)
            self.assertIn("Next: ", str(caught.exception))
            self.assertEqual(run.state().scene, "one_arm")  # a late answer is no answer to another request

    def test_nobody_listens(self):
        for where in (None, "nobody", FOLDER / "nobody.sock"):
            with self.assertRaises(mp.Disconnected) as caught:
                mp.connect(where)
            self.assertIn("multipanda run", caught.exception.next_step)

    def test_two_runs_must_be_named(self):
        with mp.run("one_arm") as a, mp.run("two_arms") as b:
            with self.assertRaises(mp.Refused) as caught:
                mp.connect()
            self.assertIn(str(b.connection.path), caught.exception.reason)
            with mp.connect(a.connection.path) as client:
                self.assertEqual(client.scene, "one_arm")

    def fake_program(self, text):
        path = FOLDER / "fake"
        path.write_text("#!/bin/sh\n" + text)
        path.chmod(path.stat().st_mode | stat.S_IXUSR)
        kept = os.environ["MULTIPANDA_PROGRAM"]
        os.environ["MULTIPANDA_PROGRAM"] = str(path)
        self.addCleanup(os.environ.__setitem__, "MULTIPANDA_PROGRAM", kept)

    def test_a_program_of_another_version(self):
        self.fake_program("echo 7.3.1\n")
        with self.assertRaises(mp.VersionMismatch) as caught:
            mp.run("one_arm")
        self.assertIn("7.3.1", caught.exception.cause)
        self.assertIn("same version", caught.exception.next_step)

    def test_a_run_of_an_unknown_version(self):
        path = FOLDER / "old.sock"
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as server:
            server.bind(str(path))
            server.listen(1)

            def answer():
                client, _ = server.accept()
                with client, client.makefile("rwb") as lines:
                    lines.readline()
                    lines.write(b'{"id": 1, "ok": true, "scene": "x", "arms": [], "controllets": []}\n')
                    lines.flush()
                    lines.readline()

            thread = threading.Thread(target=answer)
            thread.start()
            with self.assertRaises(mp.VersionMismatch):
                mp.connect(path)
            thread.join(PATIENCE)

    def test_the_version_is_that_of_the_program(self):
        said = subprocess.run([mp.program_path(), "--version"], capture_output=True, text=True, check=True)
        self.assertEqual(said.stdout.strip(), mp.__version__)

    def test_a_program_that_is_missing(self):
        kept = os.environ["MULTIPANDA_PROGRAM"]
        self.addCleanup(os.environ.__setitem__, "MULTIPANDA_PROGRAM", kept)
        os.environ["MULTIPANDA_PROGRAM"] = "/nowhere/multipanda"
        with self.assertRaises(mp.ProgramMissing) as caught:
            mp.run("one_arm")
        self.assertIn("/nowhere/multipanda", str(caught.exception))

    def test_a_folder_that_is_open_to_others(self):
        folder = FOLDER / "multipanda"
        folder.mkdir(mode=0o700, exist_ok=True)
        folder.chmod(0o755)
        self.addCleanup(folder.chmod, 0o700)
        with self.assertRaisesRegex(mp.Error, "chmod 700"):
            mp.run("one_arm")


if __name__ == "__main__":
    harness.main()
