#!/bin/bash
# Guess: read4ByteTxRx of the Dynamixel SDK returns the present velocity or position of a servo, which are signed.
# So it is: it puts the four bytes together as an unsigned number. A servo that turns backward at 10 units reports
# 4,294,967,286: a control law that subtracts it from a target commands full speed the other way.
# The right number: the bytes of a signed 32-bit number, by Python's struct.
# Seen with dynamixel-sdk 4.1.0 on 2026-11-29, with a servo that answers in memory as protocol 2.0 says.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder"
"$folder/bin/pip" install -q --disable-pip-version-check dynamixel-sdk==4.1.0 pyserial==3.5
"$folder/bin/python" - <<'END'
import struct

from dynamixel_sdk import COMM_SUCCESS, PacketHandler, PortHandler

VELOCITY, ADDRESS, SERVO = -10, 128, 1
handler = PacketHandler(2.0)


class Servo(PortHandler):
    answer = b""

    def clearPort(self):
        self.answer = b""

    def writePort(self, packet):
        body = bytes([0xFF, 0xFF, 0xFD, 0, SERVO, 8, 0, 0x55, 0]) + struct.pack("<i", VELOCITY)
        crc = handler.updateCRC(0, list(body) + [0, 0], len(body))
        self.answer = body + struct.pack("<H", crc)
        return len(packet)

    def readPort(self, length):
        taken, self.answer = self.answer[:length], self.answer[length:]
        return list(taken)

    def setPacketTimeout(self, packet_length):
        pass

    def isPacketTimeout(self):
        return not self.answer


value, result, error = handler.read4ByteTxRx(Servo("servo"), SERVO, ADDRESS)
signed = struct.unpack("<i", struct.pack("<I", value))[0]
print(f"the servo says {VELOCITY}, the SDK {value} (result {result}, error {error}), the same bytes as a signed number {signed}")
assert result == COMM_SUCCESS and error == 0 and signed == VELOCITY
assert value == 2**32 + VELOCITY, "this has changed"
END
