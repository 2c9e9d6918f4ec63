#!/usr/bin/env python3
"""The side by side of clients, without arms: its time stamps, the pairs of states and answers, its tables."""

import pathlib
import socket
import subprocess
import sys
import time
import unittest

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
import clients


def datagram(message):
    return message.to_bytes(8, "little") + bytes(1369)


class Measured(unittest.TestCase):
    def test_datagrams_of_one_address_in_order_with_times(self):
        with (
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as arm,
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as program,
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other,
        ):
            address = clients.VirtualArms("", "", ["arm"]).address["arm"]
            arm.bind((address, 0))
            for each in (program, other):
                each.bind(("127.0.0.1", 0))
            try:
                capture = clients.Capture(address)
            except PermissionError:
                self.skipTest("packets may not be captured here")
            began = time.time_ns()
            arm.sendto(datagram(2**40), program.getsockname())
            other.sendto(datagram(3), program.getsockname())  # not the arm's
            program.sendto(datagram(2**40)[:371], arm.getsockname())
            arm.recv(400)
            packets = capture.read()
            self.assertEqual(capture.close(), 0)
        self.assertEqual([packet[1:] for packet in packets], [(True, 2**40), (False, 2**40)])
        times = [began, *(at for at, _, _ in packets), time.time_ns()]
        self.assertEqual(times, sorted(times))

    def test_answers_belong_to_the_state_that_they_name(self):
        state, answer = (lambda at, n: (at, True, n)), (lambda at, n: (at, False, n))
        # 7 is answered before 6, 6 twice; 8 never; 4 was sent before the capture began.
        packets = [answer(900, 4), state(1000, 6), state(2000, 7), answer(2030, 7), answer(2600, 6), answer(2700, 6)]
        self.assertEqual(clients.answer_times([*packets, state(3000, 8)]), {6: (1000, 1600), 7: (2000, 30)})

    def test_a_thread_that_computes_is_counted(self):
        spinner = subprocess.Popen([sys.executable, "-c", "while True: pass"])
        try:
            while sum(clients.cpu_s(spinner.pid).values()) < 0.05:
                time.sleep(0.01)
            used = sum(clients.cpu_s(spinner.pid).values())
            ticks = pathlib.Path(f"/proc/{spinner.pid}/stat").read_text().rsplit(")", 1)[1].split()
            self.assertGreaterEqual(0.01 * (int(ticks[11]) + int(ticks[12])) + 0.03, used)  # the kernel's other counter
        finally:
            spinner.kill()
            spinner.wait()


class Table(unittest.TestCase):
    def test_medians_and_ratios_within_rounds(self):
        cpu = clients.QUANTITIES[0]
        rounds = [
            {"multipanda": {cpu: 6, clients.MODEL: 2}, "peer": {cpu: 2}},
            {"multipanda": {cpu: 4}, "peer": {cpu: 4}},
            {"multipanda": {cpu: 5}},  # the peer failed in this round
            {"multipanda": {cpu: 9}, "peer": {cpu: 6}},
        ]
        lines = clients.tables(rounds).splitlines()
        self.assertIn(f"| {cpu} | 5.5 (4 to 9) | 4 (2 to 6) |", lines)  # of 4 5 6 9 and of 2 4 6
        self.assertIn(f"| {clients.MODEL} | 2 (2 to 2) | – |", lines)
        self.assertIn(f"| {cpu} | 1.5 (1 to 3) |", lines)  # 3, 1, 1.5: not 5.5 / 4
        self.assertIn(f"| {clients.MODEL} | – |", lines)

    def test_help_names_the_right_that_it_needs(self):
        answer = subprocess.run([sys.executable, HERE / "clients.py", "--help"], capture_output=True, text=True)
        self.assertEqual(answer.returncode, 0, answer.stderr)
        self.assertIn("root", answer.stdout)


if __name__ == "__main__":
    unittest.main(verbosity=2)
