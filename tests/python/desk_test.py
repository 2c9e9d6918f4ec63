#!/usr/bin/env python3
"""`multipanda arm` against a stand-in for Desk (desk_server.py) over real TLS, with a certificate made here."""

import base64
import contextlib
import json
import os
import pathlib
import pty
import re
import signal
import socket
import subprocess
import sys
import threading
import time
import unittest

import harness
from desk_server import PASSWORD, USER, Listener, Server, certificate

DESK = harness.ROOT / "python/multipanda/desk.py"
# The command with other waits: what they bound is tested, not how long they are.
WAITING = """import json, sys
sys.path.insert(0, sys.argv.pop(1))
import desk
vars(desk).update(json.loads(sys.argv.pop(1)))
sys.exit(desk.main())"""
WAITS = {"ANSWER_S": 60, "TAKE_S": 60, "FCI_S": 60, "POLL_S": 0.05, "WATCH_S": 0.05}
UNLOCKS = ("/desk/api/joints/unlock", "/desk/api/robot/open-brakes", "/api/arm/joints:unlock")
KINDS = ("panda", "fr3", "newer")
TAKES = {"newer": "/api/system/control-token:take"}


class Commands(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.pems = [harness.FOLDER / "one.pem", harness.FOLDER / "other.pem"]
        cls.prints = [":".join(re.findall("..", certificate(pem))) for pem in cls.pems]

    def setUp(self):
        self.config = harness.FOLDER / self.id().rpartition(".")[2]
        self.said = ""

    def server(self, kind, pem=0, port=0, known=True):
        server = Server(kind, self.pems[pem], port)
        self.addCleanup(server.close)
        if known:
            pins = self.config / "multipanda/desk_certificates"
            pins.mkdir(parents=True, exist_ok=True)
            (pins / f"127.0.0.1_{server.server_port}").write_text(self.prints[pem])
        return server

    def start(self, *words, password=PASSWORD, waits=None, **pipes):
        environment = {**os.environ, "XDG_CONFIG_HOME": str(self.config), "MULTIPANDA_DESK_PASSWORD": password or ""}
        command = [sys.executable, "-B", "-c", WAITING, str(DESK.parent), json.dumps(WAITS | (waits or {})), *words]
        streams = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **pipes}
        child = subprocess.Popen(command, env=environment, text=True, start_new_session=True, **streams)
        self.addCleanup(lambda: (child.kill(), child.wait()))
        return child

    def end(self, child, code):
        """Waits for the end of a command; everything that it said, which has no secret."""
        out, err = child.communicate(timeout=harness.PATIENCE)
        self.assertEqual(child.returncode, code, out + err)
        self.assertTrue(err.startswith("multipanda arm: untried on a real arm"), err)
        for secret in (PASSWORD, json.dumps(PASSWORD)[1:-1], "secret", base64.b64encode(PASSWORD.encode()).decode()):
            self.assertNotIn(secret, out + err)
        self.assertNotIn("Traceback", err)
        return out + err

    def call(self, *words, code=0, **options):
        return self.end(self.start(*words, **options), code)

    def ready(self, server, *words):
        """`arm ready`, once it is."""
        child = self.start("ready", server.host, "--cleared", *words)
        self.assertIn("is ready", child.stdout.readline())
        return child

    def hear(self, child, expected):
        """What a command says up to a line with that."""
        said = ""
        while expected not in said:
            self.assertTrue(line := child.stderr.readline(), said)
            said += line
        return said

    def assert_free(self, server):
        self.assertIsNone(server.arm.holder)
        self.assertEqual(server.arm.waiting, [])


class Ready(Commands):
    def test_ready_holds_control_until_a_signal(self):
        for kind, number in zip(KINDS, (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)):
            with self.subTest(kind):
                server = self.server(kind)
                child = self.ready(server)
                arm = server.arm
                self.assertEqual((arm.brakes, arm.fci, arm.holder[0]), ("Unlocked", True, USER))
                self.assertIn(arm.mode, ("Execution", None))
                words = pathlib.Path(f"/proc/{child.pid}/cmdline").read_bytes().decode()
                self.assertNotIn(PASSWORD, words)
                for command in ("ready", "lock"):
                    said = self.call(command, server.host, "--cleared", "--anyway", code=1)
                    self.assertIn(f"'{USER}' has control", said)
                self.assertIn("may be moving the arm", self.call("lock", server.host, code=1))
                self.assertTrue(arm.fci)
                child.send_signal(number)
                self.end(child, 0)
                self.assert_free(server)
                self.assertEqual(arm.brakes, "Unlocked")
                said = self.call("lock", server.host)
                self.assertIn("does not report it" if kind == "panda" else "is locked", said)
                self.assertEqual(arm.brakes, "Locked")
                self.assert_free(server)
                self.assertFalse([path for _, path, *_ in arm.requests if "force" in path])

    def test_status_takes_no_control(self):
        for kind in KINDS:
            server = self.server(kind)
            child = self.start("status", server.host)
            out, err = child.communicate(timeout=harness.PATIENCE)
            joints, mode = (None, None) if kind == "panda" else ("locked", "Programming")
            expected = {"holder": None, "joints": joints, "fci": False, "mode": mode, "errors": ""}
            self.assertEqual(json.loads(out), expected, err)
            self.assertEqual({method for method, path, *_ in server.arm.requests if "login" not in path}, {"GET"})

    def test_lock_ends_an_active_fci_only_when_told(self):
        for kind in KINDS:
            server = self.server(kind)
            server.arm.brakes, server.arm.fci = "Unlocked", True
            self.assertIn("--anyway ends the FCI", self.call("lock", server.host, code=1))
            self.assertEqual((server.arm.brakes, server.arm.count), ("Unlocked", 0))
            self.call("lock", server.host, "--anyway")
            self.assertEqual((server.arm.brakes, server.arm.fci), ("Locked", False))
            self.assert_free(server)

    def test_an_fci_that_the_arm_does_not_tell_is_not_called_active_and_refuses_lock(self):
        server = self.server("newer")
        server.arm.tells_fci = False
        child = self.start("ready", server.host, "--cleared")
        self.assertIn("the FCI was requested, but the arm does not report it", child.stdout.readline())
        self.assertTrue(server.arm.fci)
        child.send_signal(signal.SIGTERM)
        self.end(child, 0)
        server.arm.brakes, server.arm.count = "Unlocked", 0
        self.assertIn("may be active", self.call("lock", server.host, code=1))
        self.assertEqual((server.arm.brakes, server.arm.count), ("Unlocked", 0))
        self.call("lock", server.host, "--anyway")
        self.assertEqual(server.arm.brakes, "Locked")

    def test_a_signal_during_the_request_for_control_gives_it_back(self):
        for kind in KINDS:
            server, asked, sent = self.server(kind), threading.Event(), threading.Event()

            def slow(handler):
                asked.set()
                sent.wait(harness.PATIENCE)

            server.arm.hooks[TAKES.get(kind, "/admin/api/control-token/request")] = slow
            child = self.start("ready", server.host, "--cleared")
            self.assertTrue(asked.wait(harness.PATIENCE))
            child.send_signal(signal.SIGTERM)
            child.send_signal(signal.SIGINT)
            sent.set()
            self.end(child, 128 + signal.SIGINT)  # the lower number first, both pending
            self.assertEqual(server.arm.count, 1)
            self.assertEqual(server.arm.brakes, "Locked")
            self.assert_free(server)

    def test_an_error_on_the_way_gives_control_back(self):
        for kind in KINDS:
            for status, advice in ((424, "release the user stop"), (500, "release the user stop"), (423, "--take")):
                server = self.server(kind)
                answer = lambda handler: (
                    handler.answer(status, {"code": "UserStop", "message": f"x3\n{PASSWORD}"}) or True
                )
                server.arm.hooks.update(dict.fromkeys(UNLOCKS, answer))
                said = self.call("ready", server.host, "--cleared", code=1)
                self.assertIn(f"HTTP {status}", said)
                self.assertIn("UserStop", said)
                self.assertIn(advice, said)
                self.assert_free(server)

    def test_brakes_that_stay_locked_are_reported(self):
        server = self.server("fr3")
        server.arm.hooks["/desk/api/joints/unlock"] = lambda handler: handler.answer(200) or True
        child = self.start("ready", server.host, "--cleared")
        harness.until(lambda: any("unlock" in path for _, path, *_ in server.arm.requests), "the request to unlock")
        child.send_signal(signal.SIGTERM)  # while it waits for the brakes
        self.end(child, 128 + signal.SIGTERM)
        self.assertFalse(server.arm.fci)
        self.assert_free(server)

    def test_control_outlasts_a_look_that_fails(self):
        for kind in KINDS:
            server, answers = self.server(kind), [True] * 2
            child = self.ready(server)
            server.arm.hooks[f"/{'api/system' if kind == 'newer' else 'admin/api'}/control-token"] = lambda handler: (
                bool(answers) and (handler.connection.close() or answers.pop())
            )
            self.hear(child, "Control is kept")
            harness.until(lambda: not answers, "two lost answers")
            before = len(server.arm.requests)
            harness.until(lambda: len(server.arm.requests) > before + 3, "more looks")
            self.assertTrue(server.arm.fci)
            child.terminate()
            self.assertEqual(child.wait(harness.PATIENCE), 0)
            self.assert_free(server)

    def test_a_session_that_expires_is_renewed(self):
        for kind in ("panda", "fr3"):  # newer systems have none
            server = self.server(kind)
            child = self.ready(server)
            for renewed in (1, 2):
                server.arm.sessions.clear()
                harness.until(lambda: server.arm.sessions or child.poll() is not None, "another session")
                before = len(server.arm.requests)
                harness.until(lambda: len(server.arm.requests) > before + 3 or child.poll() is not None, "more looks")
                self.assertIsNone(child.poll(), renewed)
            self.assertTrue(server.arm.fci)
            server.arm.sessions.clear()
            child.terminate()
            self.end(child, 0)
            self.assert_free(server)

    def test_brakes_between_locked_and_unlocked_are_neither(self):
        for kind, path in (("fr3", "/desk/api/joints/lock"), ("newer", "/api/arm/joints:lock")):
            server = self.server(kind)
            server.arm.brakes = "Locking"
            self.assertIn('"joints": "unknown"', self.call("status", server.host))
            server.arm.hooks[path] = lambda handler: handler.answer(200) or True
            said = self.call("lock", server.host, code=1, waits={"BRAKES_S": 1})
            self.assertIn("no locked joints within 1 s", said)
            self.assert_free(server)

    def test_a_lost_answer_to_the_request_for_control_is_told(self):
        for kind in KINDS:
            server = self.server(kind)
            server.arm.hooks[TAKES.get(kind, "/admin/api/control-token/request")] = lambda handler: (
                handler.connection.close() or True
            )
            self.assertIn("may have been granted", self.call("lock", server.host, code=1))

    def test_control_that_was_lost_is_reported_and_not_released(self):
        for kind in KINDS:
            server = self.server(kind)
            child = self.ready(server)
            server.arm.holder = ("anna", 7, "of-anna")
            said = self.end(child, 1)
            self.assertIn("control was lost to 'anna'", said)
            self.assertNotIn("not given back", said)
            self.assertEqual(server.arm.holder[0], "anna")


class Holders(Commands):
    def test_another_holder_keeps_control(self):
        for kind in KINDS:
            server = self.server(kind)
            server.arm.holder = ("anna\x1b[31m", 7, "of-anna")
            for command in ("ready", "lock"):
                said = self.call(command, server.host, "--cleared", code=1)
                self.assertIn("'anna [31m' has control", said)
            self.assertEqual((server.arm.holder[1], server.arm.count), (7, 0))

    def test_taking_needs_the_button(self):
        for kind in KINDS:
            server = self.server(kind)
            server.arm.holder = ("anna", 7, "of-anna")
            said = self.call("lock", server.host, "--take", code=1, waits={"TAKE_S": 1})
            self.assertIn("press the circle button ON THE ARM", said)
            self.assertEqual((server.arm.holder[0], server.arm.waiting), ("anna", []))  # nothing of ours waits
        for kind in ("panda", "fr3"):
            server = self.server(kind)
            server.arm.holder = ("anna", 7, "of-anna")
            child = self.start("lock", server.host, "--take")
            harness.until(lambda: server.arm.waiting, "the request")
            self.assertIn(
                ("POST", "/admin/api/control-token/request?force"), [request[:2] for request in server.arm.requests]
            )
            server.arm.holder = server.arm.waiting.pop()  # the button
            self.end(child, 0)
            self.assert_free(server)

    def test_control_that_cannot_be_given_back_is_an_error(self):
        for kind in KINDS:
            server = self.server(kind)
            child = self.ready(server)
            release = "/api/system/control-token:release" if kind == "newer" else "/admin/api/control-token"
            server.arm.hooks[release] = lambda handler: (
                handler.command in ("DELETE", "POST") and (handler.answer(503, "busy") or True)
            )
            child.send_signal(signal.SIGTERM)
            self.assertIn("was not given back", self.end(child, 1))


class Certificates(Commands):
    def test_pinned_at_first_use_and_refused_when_changed(self):
        server = self.server("fr3", known=False)
        self.assertIn("pinned", self.call("status", server.host, "--certificate", self.prints[0]))
        self.assertNotIn("pinned", self.call("status", server.host))
        port = server.server_port
        server.close()
        other = self.server("fr3", pem=1, port=port, known=False)
        said = self.call("ready", other.host, "--cleared", code=1)
        for text in (*self.prints, f"--certificate {self.prints[1]}"):
            self.assertIn(text, said)
        self.assertEqual(other.arm.requests, [])
        self.call("status", other.host, "--certificate", self.prints[0], code=1)
        self.assertEqual(other.arm.requests, [])
        self.call("status", other.host, "--certificate", self.prints[1].lower().replace(":", ""))
        self.call("status", other.host)

    def test_a_first_certificate_is_shown_before_the_password_goes_there(self):
        for answer, code in ((b"no\n", 1), (b"\x04", 130), (b"yes\n", 0)):
            server = self.server("newer", known=False)
            master, slave = pty.openpty()
            child = self.start("status", server.host, stdin=slave, preexec_fn=lambda: take_terminal(slave))
            os.close(slave)
            self.assertIn("untried", child.stderr.readline())
            self.assertIn(f"SHA-256 is {self.prints[0]}", child.stderr.readline())
            self.assertFalse([request for request in server.arm.requests if "Authorization" in request[2]])
            os.write(master, answer)
            child.communicate(timeout=harness.PATIENCE)
            os.close(master)
            self.assertEqual(child.returncode, code)
            sent = [request for request in server.arm.requests if "Authorization" in request[2]]
            self.assertEqual(bool(sent), code == 0)

    def test_without_a_terminal_a_first_certificate_is_refused(self):
        for kind in KINDS:
            server = self.server(kind, known=False)
            for words in (["status"], ["lock"], ["ready", "--cleared"]):
                said = self.call(words[0], server.host, *words[1:], code=1)
                self.assertIn(f"--certificate {self.prints[0]}", said)
            sent = [request for request in server.arm.requests if "Authorization" in request[2] or request[3]]
            self.assertEqual(sent, [])

    def test_a_wrong_password_pins_nothing(self):
        for kind in KINDS:
            server = self.server(kind, known=False)
            words = ("status", server.host, "--certificate", self.prints[0])
            said = self.call(*words, password="hunter2", code=1)
            self.assertIn(f"refused user '{USER}'", said)
            self.assertNotIn("hunter2", said)
        self.assertEqual([path for path in self.config.rglob("*") if path.is_file()], [])


class Strangers(Commands):
    """What is at the address is no Desk, or a broken one."""

    def refused(self, host, expected, **waits):
        said = self.call("ready", host, "--cleared", code=1, waits=waits)
        self.assertRegex(said, expected)
        self.assertIn("Next: ", said)

    def test_no_https(self):
        def page(connection):
            connection.recv(4096)
            connection.sendall(b"HTTP/1.1 200 OK\r\n\r\n")
            connection.close()

        waiting = []
        for what, expected, waits in (
            (lambda connection: connection.close(), "unreachable or not a Desk", {}),
            (page, "not a Desk", {}),
            (waiting.append, "did not answer within 1 s", {"ANSWER_S": 1}),
        ):
            listener = Listener(what)
            self.addCleanup(listener.close)
            self.refused(listener.host, expected, **waits)
        with socket.create_server(("127.0.0.1", 0)) as free:
            closed = f"127.0.0.1:{free.getsockname()[1]}"
        self.refused(closed, "unreachable .*refused")
        self.refused("127.0.0.1:99999", "not a Desk")

    def test_answers_of_something_else(self):
        def drip(handler):
            with contextlib.suppress(OSError):
                for _ in range(200):
                    handler.wfile.write(b"H")
                    time.sleep(0.05)
            return True

        def close(handler):
            handler.close_connection = True
            handler.connection.close()
            return True

        text = lambda content, **headers: lambda handler: handler.answer(200, content, **headers) or True
        for path in ("/api/system", "/admin/api/login", "/admin/api/control-token", "/admin/api/control-token/request"):
            for answer in (
                text("<html>welcome</html>"),
                text("[" * (1 << 20)),
                text("x" * (3 << 20)),
                text("{}"),
                text('{"token": "a\\r\\nX-Evil: 1", "id": {}, "activeToken": 3}'),
                text('"a; b\\r\\nX-Evil: 1"'),
                text("[]"),
                text(b"\xff\x00".decode("latin-1")),
                drip,
                close,
            ):
                server = self.server("fr3")
                server.arm.hooks[path] = answer
                waits = {"ANSWER_S": 1} if answer is drip else {}
                child = self.start("ready", server.host, "--cleared", waits=waits)
                if path == "/api/system" and answer not in (drip, close):  # says which interface there is, no more
                    self.assertIn("is ready", child.stdout.readline())
                    child.terminate()
                    self.end(child, 0)
                    continue
                said = self.end(child, 1)
                self.assertRegex(said, "not a Desk|did not answer within 1 s|'somebody' has control")
                self.assertEqual(server.arm.brakes, "Locked")
                self.assertFalse([request for request in server.arm.requests if "X-Evil" in request[2]])

    def test_a_redirect_is_not_followed(self):
        elsewhere = Listener(lambda connection: connection.close())
        self.addCleanup(elsewhere.close)
        for path in ("/api/system", "/admin/api/login"):
            for status in (301, 302, 307, 308):
                server = self.server("panda")
                server.arm.hooks[path] = lambda handler: (
                    handler.answer(status, "", Location=f"https://{elsewhere.host}/{PASSWORD[:4]}") or True
                )
                self.refused(server.host, f"redirects to 'https://{elsewhere.host}")
        self.assertEqual(elsewhere.connections, 0)


class Passwords(Commands):
    def test_from_a_prompt_that_does_not_echo(self):
        server = self.server("fr3", known=False)
        master, slave = pty.openpty()
        self.addCleanup(os.close, master)
        child = self.start("status", server.host, password=None, stdin=slave, preexec_fn=lambda: take_terminal(slave))
        os.close(slave)
        shown = b""
        while b"Password of 'admin' for" not in shown:
            shown += os.read(master, 1000)
        os.write(master, f"{PASSWORD}\n".encode())
        said = self.hear(child, "first contact")
        os.write(master, b"yes\n")
        out, err = child.communicate(timeout=harness.PATIENCE)
        self.assertEqual(child.returncode, 0, said + err)
        self.assertNotIn(PASSWORD, out + said + err)
        os.set_blocking(master, False)
        with contextlib.suppress(OSError):
            shown += os.read(master, 1000)
        self.assertNotIn(PASSWORD, shown.decode())

    def test_without_one(self):
        self.assertIn("MULTIPANDA_DESK_PASSWORD", self.call("status", "127.0.0.1", password=None, code=1))
        self.assertIn("keyring", self.call("status", "127.0.0.1", "--keyring", password=None, code=1))

    def test_on_the_command_line_is_refused_and_not_repeated(self):
        for words in (
            ["status", f"{USER}:{PASSWORD}@127.0.0.1"],
            ["status", "127.0.0.1", PASSWORD],
            ["status", "127.0.0.1", f"--password={PASSWORD}"],
            ["status", "127.0.0.1", "--password", PASSWORD],
            ["status", f"https://127.0.0.1/{PASSWORD}"],
        ):
            child = self.start(*words, password=None)
            out, err = child.communicate(timeout=harness.PATIENCE)
            self.assertIn(child.returncode, (1, 2))
            self.assertNotIn(PASSWORD, out + err)
            self.assertRegex(err, "HOST|unexpected")

    def test_somebody_in_reach_ends_it(self):
        server = self.server("fr3")
        self.assertIn("nobody is in reach", self.call("ready", server.host, code=1))
        self.assertEqual(server.arm.requests, [])


def take_terminal(slave):
    import fcntl
    import termios

    fcntl.ioctl(slave, termios.TIOCSCTTY, 0)


if __name__ == "__main__":
    unittest.main()
