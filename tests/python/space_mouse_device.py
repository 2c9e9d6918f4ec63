"""A SpaceMouse of the tests: a pipe that keeps reports apart, as a hidraw device does, and a hand that repeats them."""

import os
import struct
import threading
import time

PERIOD_S = 0.01  # a device whose cap is deflected reports without pause
AT_REST = (0, 0, 0, 0, 0, 0)
LONGEST_GAP_S = 0.1  # above it a test is not one of the device: this computer was busy


def motion(cap, two_reports=False):
    """The bytes of a deflection; older devices send rotations by themselves."""
    if two_reports:
        return [struct.pack("<B3h", 1, *cap[:3]), struct.pack("<B3h", 2, *cap[3:])]
    return [struct.pack("<B6h", 1, *cap)]


def buttons(bits):
    return struct.pack("<BI", 3, bits)


class Device:
    """`cap` is where the hand holds it; a silent device is one whose radio is lost."""

    def __init__(self, two_reports=False):
        self._reader, self._writer = os.pipe2(os.O_DIRECT | os.O_CLOEXEC)
        self.path = f"/proc/self/fd/{self._reader}"
        self.two_reports, self.cap, self.silent = two_reports, AT_REST, False
        self.longest_gap_s = 0.0
        self._lock = threading.Lock()
        self._told = self._over = False
        self._thread = threading.Thread(target=self._repeat, daemon=True)
        self._thread.start()

    def _repeat(self):
        before = None
        while not self._over:
            with self._lock:
                moves = self.cap != AT_REST
                if (moves or self._told) and not self.silent and self._writer is not None:
                    for report in motion(self.cap, self.two_reports):
                        os.write(self._writer, report)
                    now = time.monotonic()
                    if before is not None and moves:
                        self.longest_gap_s = max(self.longest_gap_s, now - before)
                    before, self._told = (now if moves else None), moves
                else:
                    before = None
            time.sleep(PERIOD_S)

    def push(self, *cap):
        self.cap = cap

    def let_cap_go(self):
        self.cap = AT_REST

    def press(self, bits):
        with self._lock:
            os.write(self._writer, buttons(bits))

    def unplug(self):
        with self._lock:
            if self._writer is not None:
                os.close(self._writer)
            self._writer = None

    def close(self):
        self._over = True
        self._thread.join()
        self.unplug()
        os.close(self._reader)

    @property
    def was_late(self):
        return self.longest_gap_s > LONGEST_GAP_S
