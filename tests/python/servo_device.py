"""A leader of the tests: servos on a pseudo-terminal that speak Dynamixel's protocol 2.0, written from its published
description (header, byte stuffing, CRC-16, status packets) and from the control table of the X series."""

import os
import select
import struct
import termios
import threading
import tty

BROADCAST = 254
PING, READ, WRITE, STATUS, SYNC_READ = 0x01, 0x02, 0x03, 0x55, 0x82
TORQUE, ERROR_STATUS, POSITION = 64, 70, 132
HEADER = b"\xff\xff\xfd\x00"
TURN = 4096
SPEEDS = {57600: termios.B57600, 1_000_000: termios.B1000000}


def crc16(data):
    """x^16 + x^15 + x^2 + 1, bit by bit, from 0."""
    value = 0
    for byte in data:
        value ^= byte << 8
        for _ in range(8):
            value = (value << 1 ^ (0x8005 if value & 0x8000 else 0)) & 0xFFFF
    return value


def packet(number, instruction, parameters=b""):
    body = (bytes([instruction]) + parameters).replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")
    head = HEADER + struct.pack("<BH", number, len(body) + 2) + body
    return head + struct.pack("<H", crc16(head))


def instructions(buffer):
    """Takes whole packets off the front of a buffer: (number, instruction, parameters)."""
    while (start := buffer.find(HEADER)) >= 0 and len(buffer) >= start + 7:
        number, length = struct.unpack_from("<BH", buffer, start + 4)
        if len(buffer) < start + 7 + length:
            return
        whole = bytes(buffer[start : start + 7 + length])
        del buffer[: start + 7 + length]
        assert crc16(whole[:-2]) == struct.unpack("<H", whole[-2:])[0], whole
        body = whole[7:-2].replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")
        yield number, body[0], body[1:]


class Servos:
    """Servos at joint angles that a test sets, in counts. `offsets` and `signs` are how they are mounted.

    Faults: `silent` and `corrupt` hold numbers of servos, `alerts` their hardware errors; `babble` is sent without end.
    """

    def __init__(self, count=8, baud=57600, model=1200, offsets=None, signs=None, order=None):
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.port = os.ttyname(self._slave)
        self.baud, self.reads, self.babble, self.damaged = baud, 0, b"", 0
        self.silent, self.corrupt, self.alerts = set(), set(), {}
        self.tables = {k: bytearray(147) for k in (order or range(1, count + 1))}
        for number, table in self.tables.items():
            struct.pack_into("<H", table, 0, model)
            table[6], table[7], table[TORQUE] = 46, number, 1
        self.offsets, self.signs = offsets or [0] * count, signs or [1] * count
        self._stop, self._stopped = os.pipe()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self.set(*[0] * count)
        self._thread.start()

    def set(self, *angles_counts):
        """Angles of joints, in counts."""
        for (number, table), angle, offset, sign in zip(self.tables.items(), angles_counts, self.offsets, self.signs):
            struct.pack_into("<i", table, POSITION, offset + sign * round(angle))
        self.at = list(angles_counts)

    def turn(self, joint, counts):
        self.at[joint] += counts
        self.set(*self.at)

    def _serve(self):
        buffer = bytearray()
        while True:
            ready, _, _ = select.select([self._master, self._stop], [], [], 0 if self.babble else None)
            if self._stop in ready:
                return
            if self._master in ready:
                try:
                    buffer += os.read(self._master, 1024)
                except OSError:
                    return
                if termios.tcgetattr(self._slave)[4] != SPEEDS[self.baud]:
                    buffer.clear()  # at another speed nothing is understood
                for each in instructions(buffer):
                    self._answer(*each)
            if self.babble and select.select([], [self._master], [], 0)[1]:
                os.write(self._master, self.babble)

    def _answer(self, number, instruction, data):
        if instruction == SYNC_READ:
            self.reads += 1
            address, length = struct.unpack_from("<HH", data)
            for each in data[4:]:
                self._status(each, bytes(self.tables[each][address : address + length]))
        for each in self.tables if number == BROADCAST else {number} & set(self.tables):
            table = self.tables[each]
            if instruction == PING:
                self._status(each, bytes(table[0:2]) + bytes([table[6]]))
            elif instruction == READ:
                address, length = struct.unpack("<HH", data)
                self._status(each, bytes(table[address : address + length]))
            elif instruction == WRITE:
                (address,) = struct.unpack_from("<H", data)
                table[address : address + len(data) - 2] = data[2:]
                self._status(each)

    def _status(self, number, data=b""):
        if number in self.silent:
            return
        self.tables[number][ERROR_STATUS] = self.alerts.get(number, 0)
        answer = packet(number, STATUS, bytes([0x80 if number in self.alerts else 0]) + data)
        if number in self.corrupt or self.damaged:
            self.damaged = max(0, self.damaged - 1)
            answer = answer[:-3] + bytes([answer[-3] ^ 0x10]) + answer[-2:]
        os.write(self._master, answer)

    def unplug(self):
        if self._thread.is_alive():
            os.write(self._stopped, b"x")
            self._thread.join()
            os.close(self._slave)
            os.close(self._master)

    def close(self):
        self.unplug()
        os.close(self._stop)
        os.close(self._stopped)
