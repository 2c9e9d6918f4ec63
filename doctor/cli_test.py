"""`doctor` and `communication-test` as users call them: exit codes, --json, missing permissions, virtual arms.

cli_test.py PROGRAM        the built multipanda
"""

import json
import os
import pwd
import subprocess
import sys
import unittest

PROGRAM = None
PATIENCE = 120  # [s] for any call; reached only by a hang
IDS = [
    "virtual_machine",
    "realtime_kernel",
    "sched_fifo",
    "memory_lock",
    "rt_throttling",
    "governor",
    "idle_states",
    "clock_source",
    "load",
    "isolated_cores",
    "steal",
    "timer_wake_up",
    "control_cycle",
    "loop_guard",
    "dds",
]


def call(*words, **options):
    return subprocess.run(
        [PROGRAM, *map(str, words)],
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
        stdin=subprocess.DEVNULL,
        **options,
    )


def address(number):
    """Of this process alone: several tests may run at the same time, and the ports are fixed."""
    return f"127.{130 + os.getpid() // 250 % 100}.{os.getpid() % 250}.{number}"


class VirtualArm:
    def __init__(self, where, *words):
        self.process = subprocess.Popen(
            [PROGRAM, "virtual-arm", "one_arm", "--bind", f"arm={where}", "--json", *words],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        assert "listening" in self.process.stdout.readline()

    def __enter__(self):
        return self

    def tell(self, words):
        self.process.stdin.write(words + "\n")
        self.process.stdin.flush()

    def __exit__(self, *_):
        self.process.terminate()
        self.process.communicate(timeout=PATIENCE)


class Doctor(unittest.TestCase):
    def judged(self, answer):
        self.assertEqual(answer.stdout.count("\n"), 1, answer.stderr)
        result = json.loads(answer.stdout)
        self.assertEqual(answer.returncode, 1 if result["verdict"] == "bad" else 0, answer.stderr)
        for finding in result["findings"]:
            self.assertIn(finding["judged"], ("ok", "unknown", "warning", "bad"))
            if finding["judged"] in ("warning", "bad"):
                self.assertTrue(finding["cause"] and finding["cure"], finding)
            self.assertIn(finding["subject"], answer.stderr)  # the same lines are printed
        return result

    def test_this_computer(self):
        result = self.judged(call("doctor", "--seconds", 0.3, "--json", "--scene", "one_arm"))
        self.assertEqual([finding["id"] for finding in result["findings"]], IDS)
        self.assertEqual(result["purpose"], "simulated_arms")
        self.assertNotEqual(result["verdict"], "bad")  # for simulated arms no property of a computer is
        found = {finding["id"]: finding for finding in result["findings"]}
        timer = found["timer_wake_up"]
        counted = timer["figures"]["count"]["value"]
        self.assertGreaterEqual(counted + timer["figures"]["missed"]["value"], 300)
        self.assertEqual(sum(bar["count"] for bar in timer["histogram"]), counted)
        self.assertGreater(found["control_cycle"]["figures"]["p50"]["value"], 0)
        if "heap_calls" in found["loop_guard"]["figures"]:  # not counted under a sanitizer
            self.assertEqual(found["loop_guard"]["figures"]["heap_calls"]["value"], 0)
            self.assertEqual(found["loop_guard"]["figures"]["lock_calls"]["value"], 0)

    @unittest.skipUnless(os.geteuid() == 0, "only the superuser can become somebody else")
    def test_without_permissions(self):
        nobody = pwd.getpwnam("nobody")
        try:
            answer = call(
                "doctor",
                "--seconds",
                0.1,
                "--json",
                user=nobody.pw_uid,
                group=nobody.pw_gid,
                extra_groups=[],
                env={"PATH": os.environ["PATH"]},
            )
        except PermissionError:
            self.skipTest("the program lies where nobody else may run it")
        if answer.returncode == 127:
            self.skipTest("its libraries lie where nobody else may read them")
        self.judged(answer)

    def test_invalid_arguments(self):
        for words in (
            ["doctor", "--scene", "one_amr"],
            ["doctor", "--seconds", "-1"],
            ["communication-test"],
            ["communication-test", "127.0.0.1"],
        ):  # there is no user to ask
            answer = call(*words)
            self.assertEqual(answer.returncode, 2, (words, answer))
        self.assertIn("'one_arm'", call("doctor", "--scene", "one_amr").stderr)

    def test_an_arm_that_is_not_there(self):
        where = address(1)
        result = self.judged(call("doctor", where, "--seconds", 0.1, "--json"))
        found = {finding["id"]: finding for finding in result["findings"]}
        self.assertEqual(found[f"arm_version:{where}"]["judged"], "bad")
        self.assertEqual(result["verdict"], "bad")
        self.assertEqual(call("communication-test", where, "--yes").returncode, 1)

    def test_a_virtual_arm(self):
        where = address(2)
        with VirtualArm(where, "--pace", "realtime"):
            result = self.judged(call("doctor", where, "--seconds", 0.5, "--json"))
            found = {finding["id"]: finding for finding in result["findings"]}
            self.assertIn("protocol version 5 (Panda)", found[f"arm_version:{where}"]["measured"])
            self.assertEqual(found[f"network_card:{where}"]["judged"], "ok")
            self.assertGreater(found[f"round_trip:{where}"]["figures"]["count"]["value"], 0)
            self.assertGreater(found[f"state_stream:{where}"]["figures"]["rate"]["value"], 0)


class CommunicationTest(unittest.TestCase):
    def run_test(self, where, seconds):
        answer = call("communication-test", where, "--seconds", seconds, "--yes", "--json")
        self.assertEqual(answer.stdout.count("\n"), 1, answer)
        return answer, {finding["id"]: finding for finding in json.loads(answer.stdout)["findings"]}

    def test_in_lock_step_nothing_is_lost(self):
        where = address(3)
        # Until its first command an arm follows the wall clock, and a busy client would miss states; unless the world
        # stands still meanwhile.
        with VirtualArm(where, "--pace", "lockstep", "--idle-stands-still"):
            for _ in range(2):  # the arm is unchanged
                answer, found = self.run_test(where, 2)
                self.assertEqual(answer.returncode, 0, answer.stderr)
                self.assertEqual(found["torque_control"]["figures"]["answered"]["value"], 2000)
                self.assertEqual(found["states_lost"]["figures"]["lost"]["value"], 0)
                self.assertEqual(found["success_rate"]["figures"]["average"]["value"], 1)

    def test_lost_packets_stop_the_arm_and_are_named(self):
        where = address(4)
        with VirtualArm(where, "--pace", "lockstep", "--loss", "0.95", "--seed", "5"):
            answer, found = self.run_test(where, 5)
            self.assertEqual(answer.returncode, 1)
            self.assertEqual(found["torque_control"]["judged"], "bad")

    def test_in_real_time(self):
        where = address(5)
        with VirtualArm(where, "--pace", "realtime"):
            answer, found = self.run_test(where, 1)
            # The losses depend on this computer; the test checks that all of them were counted.
            figures = found["torque_control"]["figures"]
            if answer.returncode == 0:
                self.assertGreaterEqual(figures["periods"]["value"], 1000)
            self.assertLessEqual(
                figures["answered"]["value"] + found["states_lost"]["figures"]["lost"]["value"],
                figures["periods"]["value"] + 1,
            )


if __name__ == "__main__":
    PROGRAM = sys.argv.pop(1)
    unittest.main(verbosity=2)
