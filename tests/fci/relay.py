"""Forwards between a program and an arm and records what the program sends: TCP stream and UDP datagrams."""

import selectors
import socket
import struct
import threading
import time

PORT = 1337
HEADER = struct.Struct("<III")  # command, command_id, size


class Relay:
    """with Relay(address, arm_address, on_motion) as relay: programs reach the arm at `address`.

    The relay changes only the UDP port in Connect, so that states arrive at the relay. `tcp` is the stream as sent by
    the program, `motions` has the datagrams of each motion. Programs wait for one more state after a motion has begun
    and after a reflex has ended it; the relay then calls `on_motion` to cause one.
    """

    ROBOT_MODE = {1377: 1372, 2373: 2364}  # offset in the state, by its size
    MOVE, REFLEX = 2, 4
    SOON = 0.05

    def __init__(self, address, arm_address, on_motion):
        self.address, self.arm_address, self.on_motion = address, arm_address, on_motion
        self.tcp, self.motions = bytearray(), []

    def __enter__(self):
        self.listener = socket.create_server((self.address, PORT))
        self.to_program, self.to_arm = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
        for side in (self.to_program, self.to_arm):
            side.bind((self.address, 0))
        self.ending = False
        self.thread = threading.Thread(target=self._run, daemon=True)
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.ending = True
        self.thread.join()
        for each in (self.listener, self.to_program, self.to_arm):
            each.close()

    def _run(self):
        program = arm = program_port = arm_at = call_at = None
        mode = 0
        chosen = selectors.DefaultSelector()
        for each in (self.listener, self.to_program, self.to_arm):
            chosen.register(each, selectors.EVENT_READ)
        while not self.ending:
            if call_at is not None and time.monotonic() >= call_at:
                call_at = None
                self.on_motion()
            for key, _ in chosen.select(0.01):
                if key.fileobj is self.listener:
                    program, _ = self.listener.accept()
                    arm = socket.create_connection((self.arm_address, PORT), source_address=(self.address, 0))
                    for each in (program, arm):
                        each.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                        chosen.register(each, selectors.EVENT_READ)
                elif key.fileobj is self.to_arm:
                    state, arm_at = self.to_arm.recvfrom(4096)
                    self.to_program.sendto(state, (program.getpeername()[0], program_port))
                    before, mode = mode, state[self.ROBOT_MODE[len(state)]]
                    if mode == self.MOVE and before != self.MOVE:
                        self.motions.append([])
                    if mode in (self.MOVE, self.REFLEX) and mode != before:
                        call_at = time.monotonic() + self.SOON
                elif key.fileobj is self.to_program:
                    command = self.to_program.recv(4096)
                    self.motions[-1].append(command)
                    self.to_arm.sendto(command, arm_at)
                else:
                    data = key.fileobj.recv(65536)
                    if not data:
                        chosen.unregister(program)
                        chosen.unregister(arm)
                        program.close()
                        arm.close()
                        break
                    if key.fileobj is program:
                        if not self.tcp:  # Connect: header, version, port
                            (program_port,) = struct.unpack_from("<H", data, HEADER.size + 2)
                            self.tcp += data
                            data = (
                                data[: HEADER.size + 2]
                                + struct.pack("<H", self.to_arm.getsockname()[1])
                                + data[HEADER.size + 4 :]
                            )
                        else:
                            self.tcp += data
                    (arm if key.fileobj is program else program).sendall(data)
        chosen.close()
        for each in (program, arm):
            if each is not None:
                each.close()

    def messages(self):
        """The TCP stream as a list of (command, command_id, payload); Connect without its port."""
        found, at = [], 0
        while at < len(self.tcp):
            command, number, size = HEADER.unpack_from(self.tcp, at)
            payload = bytes(self.tcp[at + HEADER.size : at + size])
            found.append((command, number, payload[:2] if command == 0 else payload))
            at += size
        return found
