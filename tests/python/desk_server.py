"""A stand-in for Franka's Desk: HTTPS on loopback, with the answers that public clients of it expect.

Built from those clients, as python/multipanda/desk.py, not from an arm: docs/real_arms.md#ready-by-command.
"""

import base64
import ctypes
import hashlib
import http.server
import json
import pathlib
import socket
import ssl
import threading
import urllib.parse

PASSWORD, USER = 'pass"wört-7', "admin"
PLACES = {
    "panda": {"/desk/api/robot/open-brakes": "Unlocked", "/desk/api/robot/close-brakes": "Locked"},
    "fr3": {"/desk/api/joints/unlock": "Unlocked", "/desk/api/joints/lock": "Locked"},
    "newer": {"/api/arm/joints:unlock": "Unlocked", "/api/arm/joints:lock": "Locked"},
}


def certificate(file):
    """Writes a new self-signed certificate with its key, by the libcrypto that Python's ssl has; its SHA-256."""
    crypto = ctypes.CDLL("libcrypto.so.3")
    for name in (
        "EVP_PKEY_Q_keygen",
        "X509_new",
        "X509_getm_notBefore",
        "X509_getm_notAfter",
        "EVP_sha256",
        "BIO_new_file",
    ):
        getattr(crypto, name).restype = ctypes.c_void_p
    pointer = ctypes.c_void_p
    key = pointer(crypto.EVP_PKEY_Q_keygen(None, None, b"EC", b"P-256"))
    made = pointer(crypto.X509_new())
    crypto.X509_gmtime_adj(pointer(crypto.X509_getm_notBefore(made)), ctypes.c_long(0))
    crypto.X509_gmtime_adj(pointer(crypto.X509_getm_notAfter(made)), ctypes.c_long(86400))
    crypto.X509_set_pubkey(made, key)
    if crypto.X509_sign(made, key, pointer(crypto.EVP_sha256())) <= 0:
        raise OSError("libcrypto signed no certificate")
    out = pointer(crypto.BIO_new_file(str(file).encode(), b"w"))
    crypto.PEM_write_bio_PrivateKey(out, key, None, None, 0, None, None)
    crypto.PEM_write_bio_X509(out, made)
    crypto.BIO_free(out)
    text = pathlib.Path(file).read_text()
    return hashlib.sha256(ssl.PEM_cert_to_DER_cert(text[text.index("-----BEGIN CERTIFICATE") :])).hexdigest().upper()


class Arm:
    """What the arm behind a Desk has, and which requests came."""

    def __init__(self, kind):
        self.kind = kind
        self.brakes, self.fci, self.mode = "Locked", False, "Programming" if kind != "panda" else None
        self.tells_fci = True  # newer systems
        self.holder = None  # (user, id, token)
        self.waiting = []  # requests for control, in order
        self.count = 0
        self.requests = []  # method, path, headers, body
        self.hooks = {}  # path: function(handler), which answers itself if it returns True
        self.sessions = set()

    def own(self, headers):
        return self.holder is not None and headers.get("X-Control-Token") == self.holder[2]

    def next_token(self, user):
        self.count += 1
        return user, 1000 + self.count, f"control/{self.count}+secret=="


class Handler(http.server.BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    def log_message(self, *_):
        pass

    def answer(self, status, content="", **headers):
        body = content.encode() if isinstance(content, str) else json.dumps(content).encode()
        self.send_response(status)
        for name, value in {"Content-Length": str(len(body)), **headers}.items():
            self.send_header(name.replace("_", "-"), value)
        self.end_headers()
        self.wfile.write(body)

    def handle_one(self):
        arm, size = self.server.arm, int(self.headers.get("Content-Length") or 0)
        self.body = self.rfile.read(size).decode()
        self.plain, _, self.query = self.path.partition("?")
        arm.requests.append((self.command, self.path, dict(self.headers), self.body))
        hook = arm.hooks.get(self.plain)
        if hook is None or not hook(self):
            with self.server.one_at_a_time:
                (self.newer if arm.kind == "newer" else self.older)(arm)

    do_GET = do_POST = do_DELETE = handle_one

    def older(self, arm):
        request = f"{self.command} {self.plain}"
        if request == "POST /admin/api/login":
            given = json.loads(self.body)
            digest = bytes(map(int, base64.b64decode(given["password"]).decode().split(",")))
            if digest != hashlib.sha256(f"{PASSWORD}#{USER}@franka".encode()).digest() or given["login"] != USER:
                return self.answer(401, {"code": "Unauthorized", "message": f"{self.body} {PASSWORD}"})
            arm.sessions.add(f"session-{len(arm.sessions)}-secret")
            return self.answer(200, max(arm.sessions, key=len))
        if self.plain.startswith("/api"):
            return self.answer(404, f'<html>No handler accepted "{self.plain}"</html>')
        if self.headers.get("Cookie", "").partition("=")[2] not in arm.sessions:
            return self.answer(401, "log in")
        if request == "GET /admin/api/control-token":
            active = arm.holder and {"id": arm.holder[1], "ownedBy": arm.holder[0]}
            return self.answer(200, {"activeToken": active, "fciActive": arm.fci, "tokenRequest": None})
        if request == "GET /admin/api/system-status" and arm.kind == "fr3":
            safety = {"brakeState": [arm.brakes] * 7, "recoverableErrors": {"td2Timeout": False}}
            return self.answer(
                200, {"safety": safety, "derived": {"operatingMode": arm.mode}, "robot": {"robotErrors": []}}
            )
        if request == "POST /admin/api/control-token/request":
            token = arm.next_token(json.loads(self.body)["requestedBy"])
            arm.waiting.append(token)
            if arm.holder is None:
                arm.holder = arm.waiting.pop()
            return self.answer(200, {"token": token[2], "id": token[1]})
        if request.startswith("DELETE /admin/api/control-token/request/"):
            return self.withdraw(
                arm, lambda token: arm.kind == "fr3" and str(token[1]) == self.plain.rpartition("/")[2]
            )
        if request == "DELETE /admin/api/control-token" and not arm.own(self.headers):  # as other clients do
            return self.withdraw(arm, lambda token: arm.kind == "panda" and token[2] == json.loads(self.body)["token"])
        if self.command == "GET":
            return self.answer(404, f'<html>No handler accepted "{self.plain}"</html>')
        if not arm.own(self.headers):
            return self.answer(423, {"code": "ControlTokenUnknown", "message": "no control"})
        if request == "DELETE /admin/api/control-token" and json.loads(self.body)["token"] == arm.holder[2]:
            arm.holder = arm.waiting.pop(0) if arm.waiting else None
            arm.fci = False
            return self.answer(204)
        return self.controlled(arm, request)

    def withdraw(self, arm, chosen):
        kept = [token for token in arm.waiting if not chosen(token)]
        found, arm.waiting = len(kept) < len(arm.waiting), kept
        return self.answer(204) if found else self.answer(404, {"code": "ControlTokenUnknown"})

    def newer(self, arm):
        request = f"{self.command} {self.plain}"
        basic = base64.b64encode(f"{USER}:{PASSWORD}".encode()).decode()
        if self.plain == "/admin/api/login":
            return self.answer(401, "no")
        if self.headers.get("Authorization") != f"Basic {basic}":
            return self.answer(401, {"code": "Unauthorized", "message": f"not {PASSWORD}"})
        read = {
            "GET /api/system/control-token": {
                "owner": arm.holder and arm.holder[0],
                "tokenId": arm.holder and arm.holder[1],
            },
            "GET /api/arm/joints": [{"brakeStatus": arm.brakes}] * 7,
            "GET /api/fci": {"status": "Active" if arm.fci else "Inactive"} if arm.tells_fci else {},
            "GET /api/system/operating-mode": {"status": arm.mode},
            "GET /api/safety/recovery": {"recovery": None},
        }
        if request in read:
            return self.answer(200, read[request])
        if request == "POST /api/system/control-token:take":
            if arm.holder is not None:
                return self.answer(504, {"code": "Timeout", "message": "not released"})
            arm.holder = arm.next_token(json.loads(self.body)["owner"])
            return self.answer(200, {"token": arm.holder[2], "tokenId": arm.holder[1]})
        if not arm.own(self.headers):
            return self.answer(423, {"code": "Locked", "message": "no control"})
        if request == "POST /api/system/control-token:release":
            arm.holder, arm.fci = None, False
            return self.answer(204)
        return self.controlled(arm, request)

    def controlled(self, arm, request):
        """Requests that need control."""
        fci_on = {"newer": "POST /api/fci:activate", "fr3": "POST /desk/api/system/fci"}
        fci_off = {"newer": "POST /api/fci:deactivate"}
        mode = {"newer": "POST /api/system/operating-mode:change", "fr3": "POST /desk/api/operating-mode/execution"}
        if self.plain in PLACES[arm.kind] and self.command == "POST":
            arm.brakes = PLACES[arm.kind][self.plain]
        elif request == mode.get(arm.kind):
            arm.mode = "Execution"
        elif request == fci_on.get(arm.kind, "POST /admin/api/control-token/fci"):
            if arm.brakes != "Unlocked" or arm.mode == "Programming":
                return self.answer(424, {"code": "ActionUnavailable", "message": "unlock first"})
            form = dict(urllib.parse.parse_qsl(self.body)).get("token", "")
            if arm.kind == "fr3" and base64.b64decode(form).decode() != arm.holder[2]:
                return self.answer(400, "another token")
            arm.fci = True
        elif request == fci_off.get(arm.kind, "DELETE /admin/api/control-token/fci"):
            arm.fci = False
        else:
            return self.answer(404, f'<html>No handler accepted "{self.plain}"</html>')
        return self.answer(200)


class Server(http.server.ThreadingHTTPServer):
    """A Desk at a free port of loopback, or at `port`."""

    daemon_threads = True

    def __init__(self, kind, pem, port=0):
        self.arm, self.one_at_a_time = Arm(kind), threading.Lock()
        self.context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        self.context.load_cert_chain(pem)
        super().__init__(("127.0.0.1", port), Handler)
        self.host = f"127.0.0.1:{self.server_port}"
        threading.Thread(target=self.serve_forever, args=(0.05,), daemon=True).start()

    def finish_request(self, request, client_address):  # in the thread of the connection
        try:
            with self.context.wrap_socket(request, server_side=True) as secure:
                self.RequestHandlerClass(secure, client_address, self)
        except OSError:  # a client that has closed
            pass

    def handle_error(self, *_):
        pass

    def close(self):
        self.shutdown()
        self.server_close()


class Listener:
    """A port that does `what` with each connection, and counts them."""

    def __init__(self, what):
        self.socket, self.connections = socket.create_server(("127.0.0.1", 0)), 0
        self.host = f"127.0.0.1:{self.socket.getsockname()[1]}"
        self.what = what
        threading.Thread(target=self.run, daemon=True).start()

    def run(self):
        while True:
            try:
                connection, _ = self.socket.accept()
            except OSError:
                return
            self.connections += 1
            self.what(connection)

    def close(self):
        self.socket.close()
