"""A client of the cockpit as a page is one, with Python's standard library: HTTP, WebSocket, the project's wire."""

import base64
import json
import os
import socket
import struct
import time
import urllib.parse
from types import SimpleNamespace

STATE, PLOT, LOG = 1, 2, 3


def http(port, request, timeout=10):
    """Sends bytes, returns everything that comes until the connection closes or a whole answer is there."""
    with socket.create_connection(("127.0.0.1", port), timeout) as connection:
        connection.sendall(request)
        data = b""
        while True:
            head, separator, body = data.partition(b"\r\n\r\n")
            if separator:
                fields = dict(line.split(": ", 1) for line in head.decode().split("\r\n")[1:] if ": " in line)
                fields = {name.lower(): value for name, value in fields.items()}
                if len(body) >= int(fields.get("content-length", 0)):
                    status = int(head.split(b" ")[1])
                    return SimpleNamespace(status=status, fields=fields, body=body)
            block = connection.recv(65536)
            if not block:
                return SimpleNamespace(status=0, fields={}, body=data)
            data += block


class Closed(Exception):
    def __init__(self, code, reason=""):
        super().__init__(f"closed with {code} {reason}")
        self.code, self.reason = code, reason


class Page:
    """One connection. Messages that are not asked for are kept by their kind."""

    def __init__(self, address, host=None, origin=None, token=None, hello=True, timeout=20):
        url = urllib.parse.urlparse(address)
        self.port, self.timeout = url.port, timeout
        self.buffer, self.news, self.states, self.plots, self.slices = b"", [], [], [], []
        self.answers, self.next_id, self.frames = {}, 1, 0
        self.socket = socket.create_connection(("127.0.0.1", url.port), timeout)
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        host = host or f"127.0.0.1:{url.port}"
        origin = f"http://{host}" if origin is None else origin
        key = base64.b64encode(os.urandom(16)).decode()
        head = ["GET /ws HTTP/1.1", f"Host: {host}", "Upgrade: websocket", "Connection: Upgrade"]
        head += [f"Sec-WebSocket-Key: {key}", "Sec-WebSocket-Version: 13"]
        head += [f"Origin: {origin}"] if origin else []
        self.socket.sendall(("\r\n".join(head) + "\r\n\r\n").encode())
        answer = self._until(b"\r\n\r\n")
        self.status = int(answer.split(b" ")[1])
        if self.status != 101 or not hello:
            return
        self.send({"do": "hello", "id": 0, "token": url.fragment if token is None else token})
        self.hello = self.answer(0)["hello"]

    def close(self):
        self.socket.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    # --- frames ---

    def _until(self, mark):
        while mark not in self.buffer:
            self._receive()
        found, _, self.buffer = self.buffer.partition(mark)
        return found

    def _receive(self):
        block = self.socket.recv(65536)
        if not block:
            raise Closed(1006)
        self.buffer += block

    def _exactly(self, count):
        while len(self.buffer) < count:
            self._receive()
        found, self.buffer = self.buffer[:count], self.buffer[count:]
        return found

    def send_frame(self, opcode, data, last=True):
        mask = os.urandom(4)
        size = len(data)
        head = bytes([(0x80 if last else 0) | opcode])
        if size < 126:
            head += bytes([0x80 | size])
        elif size < 65536:
            head += struct.pack(">BH", 0xFE, size)
        else:
            head += struct.pack(">BQ", 0xFF, size)
        self.socket.sendall(head + mask + bytes(byte ^ mask[i % 4] for i, byte in enumerate(data)))

    def send(self, message):
        self.send_frame(1, json.dumps(message).encode())

    def receive(self):
        """Takes one frame and files it."""
        first, second = self._exactly(2)
        size = second & 0x7F
        if size == 126:
            (size,) = struct.unpack(">H", self._exactly(2))
        elif size == 127:
            (size,) = struct.unpack(">Q", self._exactly(8))
        data = self._exactly(size)
        opcode = first & 0x0F
        if opcode == 8:
            code = struct.unpack(">H", data[:2])[0] if len(data) >= 2 else 1005
            raise Closed(code, data[2:].decode())
        if opcode == 9:
            self.send_frame(10, data)
        elif opcode == 1:
            message = json.loads(data)
            if "ok" in message:
                self.answers[message["id"]] = message
            else:
                self.news.append(message)
        elif opcode == 2:
            self._take_numbers(data)

    def _take_numbers(self, data):
        kind, number, count, columns = struct.unpack("<4I", data[:16])
        values = struct.unpack(f"<{(len(data) - 16) // 8}d", data[16:])
        if kind == STATE:
            assert count == len(values)
            self.frames = number
            self.states.append(values)
            self.send({"seen": number})
        else:
            rows = [values[i * columns : (i + 1) * columns] for i in range(count)]
            (self.plots if kind == PLOT else self.slices).append((number, rows))

    # --- messages ---

    def answer(self, number):
        while number not in self.answers:
            self.receive()
        return self.answers.pop(number)

    def ask(self, word, **keys):
        number = self.next_id
        self.next_id += 1
        self.send({"do": word, "id": number, **keys})
        return self.answer(number)

    def until(self, condition, what="this"):
        """Receives until a condition on this page holds; returns its value."""
        end = time.monotonic() + self.timeout
        while not (value := condition(self)):
            assert time.monotonic() < end, f"no {what} within {self.timeout} s"
            self.receive()
        return value

    def newest(self, kind):
        """The newest message of this kind, or None."""
        return next((m[kind] for m in reversed(self.news) if kind in m), None)

    def events(self, kind):
        return [e for m in self.news for e in m.get("events", []) if e["kind"] == kind]

    def value(self, name, state=None):
        """The numbers of a field in a state, by default the newest one."""
        state = self.states[-1] if state is None else state
        at = 0
        for field, count in self.hello["state_fields"]:
            if field == name:
                return state[at : at + count]
            at += count
        raise KeyError(name)
