#!/usr/bin/env python3
"""A Robotiq gripper at an arm of a run: requests, a stream of widths, a stop. Emulated from its manual; no hardware."""

import math
import os
import pathlib
import pty
import select
import threading
import time
import tty
import unittest

import harness  # first: it sets the paths
import multipanda as mp
from harness import until

SCENE = """
name: robotiq
arms:
  - {{name: arm, model: fr3, hand: false, fci: {{robotiq: {port}}}}}
controllets:
  - {{name: joint, type: joint_impedance, arms: arm}}
"""
OPEN, CLOSED = 3, 228  # positions at the ends


def check(frame):
    """CRC-16 of Modbus, low byte first."""
    crc = 0xFFFF
    for byte in frame:
        crc ^= byte
        for _ in range(8):
            crc = (crc >> 1) ^ 0xA001 if crc & 1 else crc >> 1
    return crc.to_bytes(2, "little")


class Emulated:
    """Modbus RTU, slave 9: three registers from 0x03E8 are written, three from 0x07D0 read. Activation needs 50 ms."""

    def __init__(self):
        self.master, self.slave = pty.openpty()
        tty.setraw(self.slave)
        self.port = os.ttyname(self.slave)
        self.out, self.position, self.active_s, self.targets, self.foreign = bytes(6), 100.0, 0.0, [], 0
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    @property
    def goes(self):
        return bool(self.out[0] & 8)

    def close(self):
        self._ending.set()
        self._thread.join()
        os.close(self.master)
        os.close(self.slave)

    def _serve(self):
        waiting, then = b"", time.monotonic()
        while not self._ending.is_set():
            if select.select([self.master], [], [], 0.001)[0]:
                waiting += os.read(self.master, 256)
            now = time.monotonic()
            self._live(now - then)
            then = now
            while len(waiting) >= (size := 15 if waiting[1:2] == b"\x10" else 8):
                frame, waiting = waiting[: size - 2], waiting[size:]
                os.write(self.master, self._answer(frame))

    def _live(self, dt):
        self.active_s = self.active_s + dt if self.out[0] & 1 else 0.0
        if self.goes and self.active_s > 0.05:
            step = (20 + 130 * self.out[4] / 255) / (85 / (CLOSED - OPEN)) * dt
            self.position += max(-step, min(step, self._target() - self.position))

    def _target(self):
        return min(max(self.out[3], OPEN), CLOSED)

    def _answer(self, frame):
        if frame[:7] == bytes([9, 16, 3, 0xE8, 0, 3, 6]):
            self.out, answer = frame[7:], frame[:6]
            if self.goes and self.targets[-1:] != [self.out[3]]:
                self.targets.append(self.out[3])
        elif frame == bytes([9, 3, 7, 0xD0, 0, 3]):
            state = 0 if not self.out[0] & 1 else 3 if self.active_s > 0.05 else 1
            there = 3 if self.goes and state == 3 and abs(self._target() - self.position) < 0.5 else 0
            first = self.out[0] & 9 | state << 4 | there << 6
            answer = bytes([9, 3, 6, first, 0, 0, self.out[3], int(self.position), 0])
        else:
            self.foreign += 1
            return b""
        return answer + check(answer)


class Robotiq(unittest.TestCase):
    def test_it_follows_widths_until_its_arm_is_stopped(self):
        device = Emulated()
        self.addCleanup(device.close)
        scene = pathlib.Path(harness.FOLDER, "robotiq.yaml")
        scene.write_text(SCENE.format(port=device.port))
        with mp.virtual_arms(scene) as arms, mp.run(scene, address=arms.addresses) as run:
            hand = run.arms["arm"].gripper
            until(lambda: run.arms["arm"].state.gripper is not None, "the gripper")
            with self.assertRaisesRegex(mp.Refused, "homed first"):
                hand.move(0.03)
            self.assertEqual(device.targets, [])
            hand.homing()
            until(lambda: hand.state.max_width_m == 0.085, "the range")
            hand.move(0.06)
            before, began = len(device.targets), time.monotonic()
            while (now := time.monotonic() - began) < 2:  # 20 to 60 mm at about 30 Hz
                hand.follow(0.04 + 0.02 * math.cos(math.pi * now), 0.15, silence_s=1)
                time.sleep(1 / 30)
            self.assertGreater(len(device.targets) - before, 20)  # a busy computer sends fewer than 60
            middle = CLOSED - 0.04 / 0.085 * (CLOSED - OPEN)
            self.assertLess(min(device.targets[before:]), middle)
            self.assertGreater(max(device.targets[before:]), middle)
            hand.move(0.08)

            def closes():
                hand.follow(0, 0.02, silence_s=1)
                return device.position > OPEN + 30

            until(closes, "closing fingers")
            run.stop()
            until(lambda: not device.goes, "the end of the motion")
            self.assertLess(device.position, CLOSED - 20)
            with self.assertRaisesRegex(mp.Refused, "stopped"):
                until(lambda: closes() and False, "the refusal")
            self.assertFalse(device.goes)
        self.assertEqual(device.foreign, 0)


if __name__ == "__main__":
    harness.main()
