"""The far end of `mp.connect("ssh://...")`, started there by `multipanda bridge`: sockets of a run over one pipe.

Standard library only. Frames: u32 bytes of the contents, u8 kind, u32 number of a channel, contents; little-endian.

    near to far                                     far to near
    b  begin: silence_s [s] (f64)                   h  hello: the path of the run's socket
    p  ping: the near clock                         p  the near clock, the far clock [ns, i64]
    l  opens a connection of lines                  d  its data; empty: the run has ended it
    s  opens a connection of samples
    d  data; of samples the far time until which they may be used [ns, i64], then a packet; empty: closes
    m  mirror: rate [Hz] (f64)                      t  answer to `records` (a line), head and table; empty: the end
    r  asks for the records around a far            m  offset in the memory (u64), bytes
       time [ns, i64]                               r  they have been sent
    e  end: the client leaves in order

If the client leaves otherwise, or nothing comes for silence_s, the arms that it has commanded are held. So they are if
what comes is late by that: a stop would be, too, behind all that a slow network has not yet brought. The run itself
holds them, as soon as this program is dead or silent, for it leads their controllets (`lead`, docs/live_input.md).
"""

from __future__ import annotations

import bisect
import collections
import contextlib
import fcntl
import json
import mmap
import os
import re
import select
import signal
import socket
import struct
import sys
import time

MAGIC = b"\0multipanda bridge 1\n"
HEADER = struct.Struct("<IBI")
HEAD_BYTES = 96  # of the shared records (docs/live_input.md)
MOST_BYTES = 1 << 24  # of a frame
_UNREAD = 1 << 18  # bytes that wait for a slow connection, from which on records are left out
_PATIENCE_S = 2  # for the run
_BEATS = 10  # to the run, in silence_s
_PINGS = 600  # about the last minute's
_HUP, _IN, _OUT = select.POLLHUP | select.POLLERR, select.POLLIN, select.POLLOUT


def frame(kind: bytes, number: int = 0, contents: bytes = b"") -> bytes:
    """A frame as bytes."""
    return HEADER.pack(len(contents), kind[0], number) + contents


def _stops(line: bytes) -> bool:
    """Whether a line stops arms. Others contain the word, too: `stops` of a resume."""
    try:
        request = json.loads(line)
    except ValueError:
        return re.search(rb"\bstop\b", line.lower()) is not None
    word = str(request.get("do") if isinstance(request, dict) else request).strip().lower()
    return word in ("stop", "stop_motion")


class Frames:
    """Frames from parts of a byte stream."""

    def __init__(self) -> None:
        self._left = bytearray()

    def add(self, part: bytes) -> list[tuple[bytes, int, bytes]]:
        """The frames that are complete now. Raises ValueError for invalid ones."""
        self._left += part
        found: list[tuple[bytes, int, bytes]] = []
        while len(self._left) >= HEADER.size:
            size, kind, number = HEADER.unpack_from(self._left)
            if size > MOST_BYTES:
                if found:
                    break  # a stop may be among them
                raise ValueError("not a frame")
            end = HEADER.size + size
            if len(self._left) < end:
                break
            found.append((bytes([kind]), number, bytes(self._left[HEADER.size : end])))
            del self._left[:end]
        return found


class _Mirror:
    """The run's shared records: new ones since the last call."""

    def __init__(self, path: str, rate_hz: float) -> None:
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self.socket.connect(path)
        self.socket.settimeout(_PATIENCE_S)
        self.socket.sendall(b'{"id": 1, "do": "records"}\n')
        self.answer, files = b"", []
        while not self.answer.endswith(b"\n"):
            part, passed, _, _ = socket.recv_fds(self.socket, 65536, 1)
            files += passed
            if not part:
                raise OSError("the run has ended")
            self.answer += part
        self.period_s, self.next_s = 1 / rate_hz, 0.0
        self._memory = mmap.mmap(files[0], 0, mmap.MAP_SHARED, mmap.PROT_READ) if files else b""
        for file in files:
            os.close(file)
        self.first, self.shared = self.answer, bool(files)
        if files:
            size = self._word(1)
            self.first += self._memory[: HEAD_BYTES + size]
            self._table = json.loads(self._memory[HEAD_BYTES : HEAD_BYTES + size])
            self._record, self._event = self._word(8), self._word(10)
            self._start_at = next(at for name, _, at, _ in self._table["fields"] if name == "start_ns")

    def _word(self, number: int) -> int:
        return int(struct.unpack_from("<Q", self._memory, 8 * number)[0])

    def _place(self, number: int, kind: str) -> tuple[int, int]:
        size = self._table[kind + "_bytes"]
        return self._table["first_" + kind] + size * (number % self._table[kind + "s"]), size

    def _slot(self, number: int, kind: str) -> bytes:
        """A patch with a slot, if it is whole."""
        at, size = self._place(number, kind)
        row = self._memory[at : at + size]
        again = self._memory[at : at + 8]
        whole = struct.pack("<Q", 2 * number + 2)
        return frame(b"m", 0, struct.pack("<Q", at) + row) if row[:8] == whole == again else b""

    def news(self) -> bytes:
        """The newest record and all new events, before the counts that announce them."""
        head = self._memory[:HEAD_BYTES]
        records, events = struct.unpack_from("<Q", head, 64)[0], struct.unpack_from("<Q", head, 80)[0]
        patches = [self._slot(n, "event") for n in range(max(self._event, events - self._table["events"]), events)]
        if records > self._record:
            patches.append(self._slot(records - 1, "record"))
        self._record, self._event = records, events
        return b"".join(patches) + frame(b"m", 0, struct.pack("<Q", 0) + head)

    def _start_ns(self, number: int) -> int:
        """When the cycle of a record began [ns]; 0: another has taken its place."""
        at, _ = self._place(number, "record")
        (start_ns,) = struct.unpack_from("<q", self._memory, at + self._start_at)
        return start_ns if struct.unpack_from("<Q", self._memory, at)[0] == 2 * number + 2 else 0

    def around(self, start_ns: int) -> bytes:
        """The records before and after an instant, and news."""
        written = self._word(8)
        numbers = range(max(0, written - self._table["records"]), written)
        after = numbers.start + bisect.bisect_left(numbers, start_ns, key=self._start_ns)
        found = b"".join(self._slot(number, "record") for number in (after - 1, after) if number in numbers)
        return found + self.news()


class Bridge:
    """One client."""

    def __init__(self, path: str) -> None:
        self.path = path
        self.sockets: dict[int, socket.socket] = {}
        self.waiting: dict[int, bytearray] = {}  # for the run, by channel
        self.lines: dict[int, bytearray] = {}  # the begun line of a channel
        self.commanded: set[str] = set()
        self.lead = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self.lead.settimeout(_PATIENCE_S)
        self.lead.connect(path)
        # Files of a killed program are closed in their order: this one, which holds the arms, after the commands'.
        high = fcntl.fcntl(self.lead, fcntl.F_DUPFD_CLOEXEC, 200)
        self.lead.close()
        self.lead = socket.socket(fileno=high)
        self.lead.settimeout(_PATIENCE_S)
        self.next_beat_s = 0.0
        self.out = bytearray(MAGIC + frame(b"h", 0, path.encode()))
        self.mirror: _Mirror | None = None
        self.heard_s, self.silence_s = time.monotonic(), 10.0
        self.ways_ns: collections.deque[int] = collections.deque(maxlen=_PINGS)  # of pings, plus the clocks' offset
        self.ended = ""  # why

    def note(self, number: int, data: bytes) -> None:
        """Remembers whom the client commands."""
        known = len(self.commanded)
        *whole, self.lines[number] = (self.lines[number] + data).split(b"\n")
        for line in whole:
            with contextlib.suppress(ValueError, AttributeError, TypeError):
                request = json.loads(line)
                named = request.get("activate") if request.get("do") == "switch" else None
                if request.get("do") in ("reference", "stream"):
                    named = request.get("controllet")
                names = [named] if isinstance(named, str) else named or ()
                self.commanded |= {name for name in names if isinstance(name, str)}
        if len(self.commanded) > known:
            self.beat()

    def beat(self, **more: int) -> None:
        """Tells the run that this client is alive, and which controllets end with it."""
        self.next_beat_s = time.monotonic() + self.silence_s / _BEATS
        line = {"do": "lead", "controllets": sorted(self.commanded), "silence_s": self.silence_s, **more}
        try:
            self.lead.sendall(json.dumps(line).encode() + b"\n")
        except OSError:
            self.lose_lead()

    def lose_lead(self) -> None:
        """The run has ended, as its other connections show, or has received nothing from here for too long."""
        self.lead.close()
        self.next_beat_s = float("inf")
        self.ended = "the run has ended, or received nothing from here for too long: its arms are held"

    def take(self, kind: bytes, number: int, contents: bytes) -> None:
        """Does what a frame says."""
        if kind == b"p":
            now_ns = time.monotonic_ns()
            self.out += frame(b"p", 0, contents + struct.pack("<q", now_ns))
            self.ways_ns.append(now_ns - struct.unpack("<q", contents)[0])
            late_s = 1e-9 * (self.ways_ns[-1] - min(self.ways_ns))
            if late_s > self.silence_s:
                self.ended = f"the network is {late_s:.1f} s late, more than silence_s: its arms are held"
        elif kind == b"b":
            self.silence_s = min(max(0.2, struct.unpack("<d", contents)[0]), 60)  # what a run accepts
            self.beat()
        elif kind == b"e":
            self.commanded.clear()
            self.beat(id=1)
            with contextlib.suppress(OSError), self.lead.makefile("rb") as answers:  # refusals have no id
                any(json.loads(answer).get("id") == 1 for answer in answers)
            self.ended = "in order"
        elif kind in (b"l", b"s"):
            lines = kind == b"l"
            own = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM if lines else socket.SOCK_SEQPACKET)
            try:
                own.settimeout(_PATIENCE_S)
                own.connect(self.path if lines else self.path + ".stream")
                own.setblocking(False)
            except OSError:
                own.close()
                self.out += frame(b"d", number)
                return
            self.sockets[number], self.waiting[number], self.lines[number] = own, bytearray(), bytearray()
        elif kind == b"m":
            try:
                mirror = _Mirror(self.path, *struct.unpack("<d", contents))
                self.mirror = mirror if mirror.shared else None
                self.out += frame(b"t", 0, mirror.first)
            except (OSError, ValueError):
                self.out += frame(b"t", 0, b'{"ok": false, "reason": "the run does not answer"}\n')
        elif kind == b"r":
            reads = len(self.out) < _UNREAD  # a client that asks and does not read gets none
            around = self.mirror.around(*struct.unpack("<q", contents)) if self.mirror and reads else b""
            self.out += around + frame(b"r", number)
        elif kind == b"d" and number in self.sockets:
            if not contents:
                self.close(number)
            elif self.sockets[number].type == socket.SOCK_SEQPACKET:
                if time.monotonic_ns() <= struct.unpack_from("<q", contents)[0]:
                    with contextlib.suppress(OSError):  # full: the next sample is newer anyway
                        self.sockets[number].send(contents[8:])
            else:
                self.note(number, contents)
                if self.ended:
                    return self.pass_stops(contents)
                self.waiting[number] += contents
                self.send(number)

    def send(self, number: int) -> None:
        """Sends the data that waits for the run."""
        try:
            with contextlib.suppress(BlockingIOError):
                while self.waiting[number]:
                    del self.waiting[number][: self.sockets[number].send(self.waiting[number])]
        except OSError:
            self.close(number)

    def close(self, number: int) -> None:
        """Closes a channel."""
        self.sockets.pop(number).close()
        self.out += frame(b"d", number)

    def turn(self, frames: Frames) -> None:
        """Waits for events and handles them."""
        poll = select.poll()
        if self.lead.fileno() >= 0:
            poll.register(self.lead, _IN)  # first: after its end nothing more is passed on
        poll.register(0, _IN)
        if self.out:
            poll.register(1, _OUT)
        of_file = {own.fileno(): number for number, own in self.sockets.items()}
        for file, number in of_file.items():
            unread = len(self.out) < MOST_BYTES  # if the client does not read, the run waits; this buffer stays small
            poll.register(file, (_IN if unread else 0) | (_OUT if self.waiting[number] else 0))
        if self.mirror:
            poll.register(self.mirror.socket, _IN)
        due = min(self.mirror.next_s if self.mirror else float("inf"), self.next_beat_s)
        now = time.monotonic()
        ready = poll.poll(max(0.0, 1e3 * min(due - now, self.heard_s + self.silence_s - now, 1)))
        if time.monotonic() > self.heard_s + self.silence_s:  # or this program stood still: its client has given up
            self.ended = f"nothing came from the client for {self.silence_s:g} s"
            return
        if time.monotonic() >= self.next_beat_s:
            self.beat()
        for file, events in ready:
            if file == self.lead.fileno():
                answer = self.lead.recv(1 << 12)
                if not answer:
                    self.lose_lead()
                elif b"unknown request" in answer:
                    self.ended = "the run is older than this bridge and would hold no arms: start it again"
                if self.ended:
                    return
            elif file == 0:
                part = os.read(0, 1 << 16)
                self.heard_s = time.monotonic()
                if not part:
                    self.ended = "the client is gone"
                for one in frames.add(part):
                    try:
                        self.take(*one)
                    except (struct.error, OSError, ValueError, ArithmeticError) as wrong:  # stops behind it count
                        self.ended = f"not a frame that can be served: {wrong}"
            elif file in of_file and of_file[file] in self.sockets:
                self.serve(of_file[file], events)
            elif self.mirror and file == self.mirror.socket.fileno():  # the run sends nothing here but its end
                self.out += self.mirror.news() + frame(b"t")
                self.mirror = None
        if self.mirror and time.monotonic() >= self.mirror.next_s and len(self.out) < _UNREAD:
            self.mirror.next_s = max(self.mirror.next_s + self.mirror.period_s, time.monotonic())
            self.out += self.mirror.news()
        if self.out:
            with contextlib.suppress(BlockingIOError):
                del self.out[: os.write(1, self.out[: 1 << 16])]

    def serve(self, number: int, events: int) -> None:
        """A socket of the run is ready."""
        if events & _OUT:
            self.send(number)
        if events & (_IN | _HUP) and number in self.sockets:
            try:
                data = self.sockets[number].recv(1 << 16)
            except BlockingIOError:
                return
            except OSError:
                data = b""
            if data:
                self.out += frame(b"d", number, data)
            else:
                self.close(number)

    def run(self) -> None:
        """Serves until the client leaves or is silent."""
        frames = Frames()
        try:
            while not self.ended:
                self.turn(frames)
        except (OSError, ValueError) as wrong:  # a broken pipe
            self.ended = str(wrong)
        self.last_stops(frames)
        for own in (*self.sockets.values(), self.lead):
            own.close()

    def last_stops(self, frames: Frames) -> None:
        """Stops count however late they are; everything else is too old."""
        with contextlib.suppress(OSError, ValueError):  # BlockingIOError: all is read
            while part := os.read(0, 1 << 16):
                for kind, _, contents in frames.add(part):
                    if kind == b"d":
                        self.pass_stops(contents)

    def pass_stops(self, contents: bytes) -> None:
        """Passes stops to the run on a separate connection; half a line that contains stop counts, too."""
        for line in contents.split(b"\n"):
            if _stops(line):
                with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as own:
                    own.settimeout(_PATIENCE_S)
                    own.connect(self.path)
                    own.sendall(line + b"\n")


def main() -> int:
    """Serves standard input and output."""
    for number in (signal.SIGHUP, signal.SIGTERM, signal.SIGINT, signal.SIGPIPE):
        signal.signal(number, signal.SIG_IGN)  # the end of the pipe holds the arms
    for file in (0, 1):
        fcntl.fcntl(file, fcntl.F_SETFL, fcntl.fcntl(file, fcntl.F_GETFL) | os.O_NONBLOCK)
    path = os.path.abspath(sys.argv[1])
    try:
        bridge = Bridge(path)
    except OSError as wrong:
        print(f"no run listens at {path} ({wrong.strerror})", file=sys.stderr)
        return 2
    bridge.run()
    with contextlib.suppress(OSError):
        print(bridge.ended, file=sys.stderr, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
