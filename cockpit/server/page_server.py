"""The cockpit's page server: HTTP and WebSockets for browsers, in a process of its own, so that the process that moves
arms parses nothing from a browser. It checks hosts, origins and the token, keeps the limits (WIRE.md), and passes
messages on as canonical JSON over descriptor 3, a stream socket to the run. A frame there, both ways: size of the
payload, kind, client, number (little-endian), payload.

  from here   S ready: {"port", "token", "page"} or {"error"}   J joined: id   M message; number: when it came [ns]
              U the same beyond the limits: counts if urgent    L left         W number: bytes that were written
  from there  T text   N numbers (binary)   C close; number: code, payload: reason

Only the standard library and websockets (packaged beside this file)."""

import argparse
import asyncio
import collections
import contextlib
import hmac
import http
import json
import math
import pathlib
import re
import resource
import secrets
import signal
import socket
import struct
import sys
import time

from websockets.asyncio.server import ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Response

HEAD = struct.Struct("<IcQq")
TYPES = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".json": "application/json",
    ".map": "application/json",
    ".svg": "image/svg+xml",
    ".png": "image/png",
    ".ico": "image/x-icon",
    ".woff2": "font/woff2",
    ".wasm": "application/wasm",
    ".txt": "text/plain; charset=utf-8",
}
MOST_FILES, MOST_BYTES = 32, 4 << 20  # of the page
# Permissions of the page: scripts and styles only from its own files, no framing.
FIXED = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; "
    "connect-src 'self'; font-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Frame-Options": "DENY",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
    "Connection": "close",
}
NO_PAGE = (
    "This build has no cockpit page: it was built without the page's bundle (docs/cockpit.md says how to add it).\n"
    "Everything else of the cockpit works, for programs too.\n"
)
OWN_HOST = re.compile(r"(127\.0\.0\.1|localhost|\[::1\])(:[0-9]{1,5})?", re.IGNORECASE)
SAYS_STOP = re.compile(r"(?<![a-z_])stop(?![a-z_])", re.IGNORECASE)
GOING_AWAY, UNSUPPORTED, POLICY, TOO_LONG, WRONG_TOKEN = 1001, 1003, 1008, 1009, 4401


def load_page(folder):
    """The page's files by their path, and "/" for index.html; empty without a bundle."""
    files = {}
    for file in folder.glob("*") if folder.is_dir() else ():
        if file.is_file() and re.fullmatch(r"[a-z0-9_-][a-z0-9._-]*", file.name) and file.suffix in TYPES:
            files["/" + file.name] = (TYPES[file.suffix], file.read_bytes())
    if len(files) > MOST_FILES or sum(len(data) for _, data in files.values()) > MOST_BYTES:
        raise ValueError(f"{folder}: a page has at most {MOST_FILES} files of {MOST_BYTES} bytes together")
    return {**files, "/": files["/index.html"]} if "/index.html" in files else {}


class Gaps:
    """Detects that this process stalled: messages that waited meanwhile may be of a sender who has given up
    (core/types/gap_watch.hpp does the same for the run)."""

    LONGEST, SETTLE, LOOKS = 0.5, 0.25, 4  # [s], [s], looks of the event loop

    def __init__(self):
        self.seen, self.boot, self.end, self.looks = time.monotonic(), time.clock_gettime(time.CLOCK_BOOTTIME), 0.0, 99

    def look(self, counts=1):
        now, boot = time.monotonic(), time.clock_gettime(time.CLOCK_BOOTTIME)
        self.looks += counts
        if max(now - self.seen, boot - self.boot) > self.LONGEST:
            self.end, self.looks = now, 0
        self.seen, self.boot = now, boot

    def arrived(self):
        """When a message that is read now came [ns, CLOCK_MONOTONIC]; 0: perhaps before the latest gap's end."""
        self.look(0)
        late = self.end > 0 and (self.seen - self.end < self.SETTLE or self.looks < self.LOOKS)
        return 0 if late else time.monotonic_ns()

    async def watch(self):
        while True:
            self.look()
            await asyncio.sleep(0.1)


def canonical(text):
    """The message as the run reads it; null: not valid JSON. Any text with stop in it stops (docs/live_input.md)."""
    message, good = None, b"null"
    try:
        message = json.loads(text, parse_int=lambda digits: int(digits) if len(digits) < 300 else math.inf)
        if isinstance(message, dict) and str(message.get("do")).strip().lower() == "stop":
            message["do"] = "stop"
        good = json.dumps(message, allow_nan=False, ensure_ascii=False, separators=(",", ":")).encode()
    except (ValueError, RecursionError):
        message = None
    if not isinstance(message, dict) and SAYS_STOP.search(text):
        return b'{"do":"stop","this message, which is not a JSON object":true}'
    return good


class Connection(ServerConnection):
    """Handles all received messages at once; reads are short: a flood of one client must not delay another's stop."""

    def connection_made(self, transport):
        transport.max_size = 4096  # of a read [bytes]
        super().connection_made(transport)


class Client:
    def __init__(self, number, connection, limits):
        self.number, self.connection, self.limits = number, connection, limits
        self.heard = self.filled = time.monotonic()
        self.allowance = limits["burst"]
        self.over = False  # only a stop still counts, until the connection has closed
        self.queue, self.more = collections.deque(), asyncio.Event()

    def may_send(self):
        now = time.monotonic()
        rate, burst = self.limits["messages_per_s"], self.limits["burst"]
        self.allowance = min(burst, self.allowance + rate * (now - self.filled)) - 1
        self.filled = now
        return self.allowance >= 0

    def put(self, text, payload):
        self.queue.append((text, payload))
        self.more.set()

    async def write(self, tell):
        """Sends the run's messages in their order, as fast as the client reads."""
        with contextlib.suppress(ConnectionClosed):
            while True:
                while self.queue:
                    text, payload = self.queue.popleft()
                    await self.connection.send(payload, text=text)
                    tell(b"W", self.number, len(payload))
                self.more.clear()
                await self.more.wait()


class Server:
    def __init__(self, files, limits, token):
        self.files, self.limits, self.token = files, limits, token
        self.clients, self.next, self.gaps = {}, 1, Gaps()
        self.tasks = set()

    # --- the run ---

    def tell(self, kind, client=0, number=0, payload=b""):
        self.run.write(HEAD.pack(len(payload), kind, client, number) + payload)

    async def listen_to_run(self, reader):
        """Until the run ends."""
        with contextlib.suppress(asyncio.IncompleteReadError, ConnectionError):
            while True:
                size, kind, client, number = HEAD.unpack(await reader.readexactly(HEAD.size))
                payload = await reader.readexactly(size)
                if client not in self.clients:
                    continue
                if kind == b"C":
                    self.later(self.close_soon(self.clients[client], number, payload.decode()))
                else:
                    self.clients[client].put(kind == b"T", payload)

    # --- HTTP ---

    @staticmethod
    def answer(status, kind, body):
        status = http.HTTPStatus(status)
        fields = {**FIXED, "Content-Type": kind, "Content-Length": str(len(body))}
        return Response(status.value, status.phrase, Headers(fields), body)

    def refuse(self, reason):
        return self.answer(403, TYPES[".txt"], (reason + "\n").encode())

    def take_request(self, _connection, request):
        """The answer; None: it becomes a WebSocket."""
        hosts, origins = request.headers.get_all("Host"), request.headers.get_all("Origin")
        if len(hosts) != 1 or not OWN_HOST.fullmatch(hosts[0]):
            return self.refuse("this server answers to 127.0.0.1, localhost and [::1] only")
        if origins and [o.lower() for o in origins] != [f"http://{hosts[0].lower()}"]:
            return self.refuse("a page of another origin has no access")
        if request.path == "/ws":
            return None if origins else self.refuse("expected the header Origin: http:// and the host")
        if request.path in self.files:
            return self.answer(200, *self.files[request.path])
        no_page = not self.files and request.path in ("/", "/index.html")
        return self.answer(404, TYPES[".txt"], (NO_PAGE if no_page else "There is no such file.\n").encode())

    # --- WebSockets ---

    async def serve(self, connection):
        with contextlib.suppress(ConnectionClosed):
            try:
                first = await asyncio.wait_for(connection.recv(), self.limits["first_s"])
            except asyncio.TimeoutError:
                return await connection.close(POLICY, "expected the token")
            if isinstance(first, bytes):
                return await connection.close(UNSUPPORTED, "messages are texts")
            if len(first) > self.limits["first_message"]:
                return await connection.close(TOO_LONG, "the first message is longer than 1 kB")
            hello = json.loads(canonical(first))
            hello = hello if isinstance(hello, dict) else {}
            token = hello.get("token")
            known = isinstance(token, str) and hmac.compare_digest(token.encode(errors="replace"), self.token.encode())
            if hello.get("do") != "hello" or not known:
                return await connection.close(
                    WRONG_TOKEN, "the first message has the token of the address that the run printed"
                )
            await self.serve_client(connection, hello.get("id"))

    async def serve_client(self, connection, name):
        client = Client(self.next, connection, self.limits)
        self.next += 1
        stay = [other for other in self.clients.values() if not other.over]
        if len(stay) >= self.limits["connections"]:
            quiet = min(stay, key=lambda other: other.heard)
            quiet.over = True
            self.later(self.close_soon(quiet, POLICY, "too many pages are open: this one made room for another"))
        self.clients[client.number] = client
        self.tell(b"J", client.number, payload=json.dumps(None if isinstance(name, dict | list) else name).encode())
        writer = asyncio.create_task(client.write(self.tell))
        try:
            async for message in connection:
                await self.take(client, message)
        finally:
            writer.cancel()
            del self.clients[client.number]
            self.tell(b"L", client.number)

    async def take(self, client, message):
        client.heard = time.monotonic()
        is_text = isinstance(message, str)
        if not client.over and not (is_text and client.may_send()):
            client.over = True
            why = (POLICY, "too many messages") if is_text else (UNSUPPORTED, "messages are texts")
            self.later(self.close_soon(client, *why))
        text = canonical(message if is_text else message.decode(errors="replace"))
        if not client.over or b"stop" in text.lower():
            self.tell(b"U" if client.over else b"M", client.number, self.gaps.arrived(), text)
            await self.run.drain()

    @staticmethod
    async def close_soon(client, code, reason):
        """Not before what was said has been read, or not read for a while."""
        await asyncio.sleep(0.2)
        try:
            await asyncio.wait_for(client.connection.close(code, reason), 1)
        except asyncio.TimeoutError:  # it does not read
            client.connection.transport.abort()

    def later(self, work):
        task = asyncio.create_task(work)
        self.tasks.add(task)
        task.add_done_callback(self.tasks.discard)

    # --- all of it ---

    async def main(self, listening):
        reader, self.run = await asyncio.open_connection(sock=socket.socket(fileno=3))
        self.later(self.gaps.watch())
        limits = self.limits
        async with serve(
            self.serve,
            create_connection=Connection,
            sock=listening,
            backlog=socket.SOMAXCONN,
            process_request=self.take_request,
            compression=None,
            server_header=None,
            max_size=limits["message"],
            open_timeout=limits["first_s"],
            ping_interval=limits["ping_s"],
            ping_timeout=limits["silent_s"] - limits["ping_s"],
            close_timeout=1,
        ) as server:
            self.tell(b"S", payload=ready(self.files, listening, self.token))
            await self.listen_to_run(reader)
            server.close(code=GOING_AWAY, reason="the run has ended")


def ready(files, listening, token):
    return json.dumps({"port": listening.getsockname()[1], "token": token, "page": bool(files)}).encode()


def listen(port, or_any):
    """On 127.0.0.1; `or_any`: on any free port if that one is taken."""
    for candidate in [port, 0] if or_any else [port]:
        # With this protocol asyncio lets small messages not wait for each other (TCP_NODELAY).
        listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP)
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listening.bind(("127.0.0.1", candidate))
            listening.listen(socket.SOMAXCONN)
            return listening
        except OSError as error:
            listening.close()
            failed = error
    raise ValueError(
        f"the cockpit cannot listen on 127.0.0.1:{port}: {failed.strerror}; name another port, or 0 for any free one"
    )


def main():
    for name in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):  # it ends with the run
        signal.signal(name, signal.SIG_IGN)
    parser = argparse.ArgumentParser()
    parser.add_argument("page", type=pathlib.Path)
    parser.add_argument("--port", type=int, required=True)
    parser.add_argument("--or-any", action="store_true")
    parser.add_argument("--limits", type=json.loads, required=True)
    arguments = parser.parse_args()
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)  # silent connections must not block others
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(most, 65536) if most > 0 else 65536, most))
    try:
        files, listening = load_page(arguments.page), listen(arguments.port, arguments.or_any)
    except (OSError, ValueError) as error:
        payload = json.dumps({"error": str(error)}).encode()
        socket.socket(fileno=3).sendall(HEAD.pack(len(payload), b"S", 0, 0) + payload)
        return 1
    asyncio.run(Server(files, arguments.limits, secrets.token_hex(16)).main(listening))
    return 0


if __name__ == "__main__":
    sys.exit(main())
