"""`multipanda arm`: unlocks an arm's joints, activates its FCI and locks it again, by the web interface of its Desk.

A separate program, which moves no arm. Sources of the interface: docs/real_arms.md#ready-by-command.
"""

from __future__ import annotations

import argparse
import base64
import contextlib
import getpass
import hashlib
import http.client
import json
import os
import pathlib
import re
import signal
import socket
import ssl
import sys
import time
import urllib.parse
from collections.abc import Callable, Iterator
from typing import Any

ANSWER_S, BRAKES_S, FCI_S, TAKE_S, POLL_S, WATCH_S = 10, 60, 15, 30, 0.5, 5  # brakes open within about 10 s
MISSED = 6  # checks of control that may fail in a row before control, and with it the FCI, is given up
ENDINGS = {signal.SIGINT, signal.SIGTERM, signal.SIGHUP}
REACH = "check power, cable and address, and that a browser shows the arm's Desk there"
OTHER = "check the address; this system version may have another interface"
STOPPED = "release the user stop, acknowledge errors and run due self-tests in Desk, then try again"
HOLDER = "ask that user to release it in Desk or to end `arm ready`; --take requests it"
ADVICE = {401: "check --user and the password by logging in with a browser", 404: OTHER, 423: HOLDER}
LOGIN = "POST /admin/api/login"
# The request of a newer FR3's interface, then those of older systems: after HTTP 404 the next one is tried.
ACTIONS = {
    "unlock": ["POST /api/arm/joints:unlock", "POST /desk/api/joints/unlock", "POST /desk/api/robot/open-brakes"],
    "lock": ["POST /api/arm/joints:lock", "POST /desk/api/joints/lock", "POST /desk/api/robot/close-brakes"],
    "execute": ["POST /api/system/operating-mode:change", "POST /desk/api/operating-mode/execution"],
    "fci on": ["POST /api/fci:activate", "POST /desk/api/system/fci", "POST /admin/api/control-token/fci"],
    "fci off": ["POST /api/fci:deactivate", "DELETE /admin/api/control-token/fci"],
    "give back": ["POST /api/system/control-token:release", "DELETE /admin/api/control-token"],
    "withdraw": ["", "DELETE /admin/api/control-token/request/{id}", "DELETE /admin/api/control-token"],
}


class DeskError(Exception):
    """What happened, and the next step. `status` is that of the HTTP answer, if there was one."""

    def __init__(self, cause: str, next_step: str, status: int = 0) -> None:
        self.status = status
        super().__init__(f"{cause}\nNext: {next_step}")


def pause(seconds: float) -> None:
    """Waits. Signals are blocked otherwise: they end nothing between a request for control and its answer."""
    if info := signal.sigtimedwait(ENDINGS, seconds):
        raise SystemExit(128 + info.si_signo)


def say(text: object) -> None:
    print(f"multipanda arm: {text}", file=sys.stderr, flush=True)


def dig(value: Any, *keys: str) -> Any:
    """value[key][key]..., or None: what a system version does not report."""
    for key in keys:
        value = value.get(key) if isinstance(value, dict) else None
    return value


def fingerprint(text: str) -> str:
    """The SHA-256 of a certificate, as browsers show it."""
    if not re.fullmatch(r"[0-9A-F]{64}", digits := text.strip().replace(":", "").upper()):
        raise argparse.ArgumentTypeError("expected the 64 hexadecimal digits of a SHA-256")
    return ":".join(re.findall("..", digits))


class Web:
    """HTTPS to one arm: a connection per request, whose certificate is checked before anything is sent."""

    def __init__(self, host: str, accepted: str | None) -> None:
        found = re.fullmatch(r"([A-Za-z0-9._-]+|\[[0-9A-Fa-f:.]+\])(?::([0-9]{1,5}))?", host)
        if not found:  # not repeated: it may contain a password
            raise DeskError("HOST is not a host name or address", "give it alone, such as 172.16.0.2")
        self.host, self.address, self.secrets = host, (found[1].strip("[]"), int(found[2] or 443)), set[str]()
        self.context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        self.context.check_hostname, self.context.verify_mode = False, ssl.CERT_NONE  # self-signed: pinned instead
        base = pathlib.Path(os.environ.get("XDG_CONFIG_HOME", ""))
        base = base if base.is_absolute() else pathlib.Path.home() / ".config"
        self.pin = base / "multipanda/desk_certificates" / "{}_{}".format(*self.address)
        self.expected = accepted or (self.pin.read_text("utf-8").strip() if self.pin.exists() else None)
        self.new, self.unknown = not self.pin.exists() or accepted is not None, self.expected is None

    def clean(self, text: Any) -> str:
        """Text from the other side, for a message: without secrets, pages and control characters."""
        text = text if isinstance(text, str) else json.dumps(text)
        for secret in self.secrets:
            text = text.replace(secret, "***").replace(json.dumps(secret)[1:-1], "***")
        text = "a page instead of an answer" if text.lstrip().startswith("<") else text
        return "".join(letter if letter.isprintable() else " " for letter in text)[:200].strip()

    def _check(self, certificate: bytes) -> None:
        found = fingerprint(hashlib.sha256(certificate).hexdigest())
        if self.expected not in (None, found):
            cause = f"the certificate of {self.host} has changed; nothing was sent\n  expected {self.expected}"
            advice = (
                "find out why: an update, a reset, another arm, or an attack? If a browser at the arm shows it, too"
            )
            raise DeskError(f"{cause}\n  found    {found}", f"{advice}: --certificate {found}")
        self.expected = found

    def exchange(self, request: str, body: str | None, headers: dict[str, str], limit_s: float) -> tuple[int, str]:
        """Status and text of the answer. A redirect is refused: nothing is ever sent elsewhere."""
        method, path = request.split()

        def late(*_: object) -> None:
            raise DeskError(f"{self.host} did not answer within {limit_s:g} s", REACH)

        signal.signal(signal.SIGALRM, late)
        signal.setitimer(signal.ITIMER_REAL, limit_s)  # of all of it, also if the answer comes byte by byte
        try:
            with socket.create_connection(self.address) as raw:
                with self.context.wrap_socket(raw, server_hostname=self.address[0]) as secure:
                    self._check(secure.getpeercert(True) or b"")
                    link = http.client.HTTPConnection("arm")  # its name is in the header Host
                    link.sock = secure
                    link.request(method, path, body, {"Host": self.host, "Connection": "close", **headers})
                    answer = link.getresponse()
                    text = answer.read(1 << 20).decode("utf-8", "replace")
        except (OSError, OverflowError, http.client.HTTPException) as wrong:
            name = getattr(wrong, "strerror", None) or type(wrong).__name__
            raise DeskError(f"{self.host} is unreachable or not a Desk ({name})", REACH) from None
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
        if 300 <= answer.status < 400:
            target = self.clean(answer.getheader("Location", ""))
            raise DeskError(f"{self.host} redirects to '{target}'; refused, nothing was sent there", OTHER)
        return answer.status, text


class Desk:
    """A session with the arm's Desk, by the newer or the older interface."""

    def __init__(self, web: Web, newer: bool, user: str, password: str) -> None:
        self.web, self.newer, self.user, self.stranded = web, newer, user, False
        self.token = self.token_id = ""
        digest = hashlib.sha256(f"{password}#{user}@franka".encode()).digest()
        encoded = base64.b64encode(",".join(map(str, digest)).encode()).decode()
        basic = base64.b64encode(f"{user}:{password}".encode()).decode()
        self.web.secrets |= {password, encoded, basic}
        self.login = {"login": user, "password": encoded}
        self.session: dict[str, str] = {"Authorization": f"Basic {basic}"} if newer else {}
        if not newer:
            self.session = self.log_in()
        self.state()

    def log_in(self) -> dict[str, str]:
        """Begins a session of an older interface, which may expire."""
        self.session = {}
        return {"Cookie": f"authorization={self.secret(self.call(LOGIN, self.login))}"}

    def call(self, request: str, content: Any = None, limit_s: float = 0, optional: bool = False) -> Any:
        """Sends a request, a form if its content is text; the answer as JSON, or as text where it is not."""
        headers = {**self.session, **({"X-Control-Token": self.token} if self.token else {})}
        body = None if request.startswith("GET") else ""
        if content is not None:
            body = content if isinstance(content, str) else json.dumps(content)
            headers["Content-Type"] = "application/" + ("x-www-form-urlencoded" if body == content else "json")
        status, text = self.web.exchange(request, body, headers, limit_s or ANSWER_S)
        if status == 401 and not self.newer and request != LOGIN:
            self.session = self.log_in()
            status, text = self.web.exchange(request, body, headers | self.session, limit_s or ANSWER_S)
        try:
            answer = json.loads(text)
        except (ValueError, RecursionError):
            answer = text
        if 200 <= status < 300 or (optional and status == 404):
            return answer
        cause = f"{self.web.host} refused {request}: HTTP {status} {self.web.clean(text)}"
        raise DeskError(cause, ADVICE.get(status, STOPPED), status)

    def secret(self, value: Any) -> str:
        """A token of an answer, fit for a header; messages will not show it."""
        if not isinstance(value, str) or not re.fullmatch(r"[A-Za-z0-9!#$%&'()*+./:=?@^_`|~-]{4,4096}", value):
            raise DeskError(f"{self.web.host} is not a Desk: there is no token in its answer", OTHER)
        self.web.secrets |= {value, base64.b64encode(value.encode()).decode()}
        return value

    def state(self) -> dict[str, Any]:
        """Holder of control and id of its token, state of the joints, ...; None: no holder, or not reported."""
        token = self.call("GET /api/system/control-token" if self.newer else "GET /admin/api/control-token")
        if not isinstance(token, dict) or not (self.newer or "activeToken" in token):
            raise DeskError(f"{self.web.host} is not a Desk: it does not report who has control", OTHER)
        if self.newer:
            brakes, fci = self.call("GET /api/arm/joints"), self.call("GET /api/fci")
            owner, token_id = token.get("owner"), token.get("tokenId") or token.get("owner")
            held, fci = token_id not in (None, ""), dig(fci, "status") and dig(fci, "status") == "Active"
            mode = dig(self.call("GET /api/system/operating-mode"), "status")
            errors = dig(self.call("GET /api/safety/recovery", optional=True), "recovery", "type")
        else:
            told = self.call("GET /admin/api/system-status", optional=True)  # a Panda has none
            owner, token_id = (dig(token, "activeToken", key) for key in ("ownedBy", "id"))
            held, fci = token["activeToken"] is not None, token.get("fciActive")
            mode = dig(told, "derived", "operatingMode")
            brakes, errors = dig(told, "safety", "brakeState"), dig(told, "robot", "robotErrors")
        brakes = [dig(brake, "brakeStatus") or brake for brake in brakes] if isinstance(brakes, list) else []
        kinds = {brake.lower() if brake in ("Locked", "Unlocked") else "unknown" for brake in brakes}
        return {
            "holder": self.web.clean(owner or "somebody") if held else None,
            "token_id": None if token_id is None else str(token_id),
            "joints": None if not kinds else kinds.pop() if len(kinds) == 1 else "partly locked",
            **{"fci": fci, "mode": mode, "errors": self.web.clean(errors) if errors else ""},
        }

    def request_control(self, force: bool) -> None:
        if self.newer:
            content = {"owner": self.user, "timeout": TAKE_S if force else 1}
            answer = self.call("POST /api/system/control-token:take", content, TAKE_S + ANSWER_S)
        else:
            request = f"POST /admin/api/control-token/request{'?force' if force else ''}"
            answer = self.call(request, {"requestedBy": self.user})
        self.token_id = str(dig(answer, "tokenId" if self.newer else "id") or self.user)
        self.token = self.secret(dig(answer, "token"))

    def has_control(self, state: dict[str, Any]) -> bool:
        return state["token_id"] in (self.token_id, self.user)  # where no id is reported, the owner

    def give_back(self) -> None:
        """Gives control back, or withdraws a request for it that waits; tries twice."""
        for last in (False, True) if self.token else ():
            action = "give back"
            try:
                action = action if self.has_control(self.state()) else "withdraw"
                self.act(action)
                break
            except DeskError as error:
                if action == "withdraw" and error.status in (400, 404, 423):  # nothing waits
                    break
                self.stranded = last
                say(f"control of {self.web.host} was not given back: {error}\nIf this repeats: release it in Desk")
        self.token = ""

    def act(self, action: str) -> None:
        requests = ACTIONS[action][:1] if self.newer else ACTIONS[action][1:]
        for request in filter(None, requests):
            content: Any = {"token": self.token} if "admin/api/control-token" in request else None
            if request.endswith("system/fci"):
                content = urllib.parse.urlencode({"token": base64.b64encode(self.token.encode()).decode()})
            elif request.endswith("mode:change"):
                content = {"desiredOperatingMode": "Execution"}
            try:
                request_of_id = request.replace("{id}", urllib.parse.quote(self.token_id, ""))
                self.call(request_of_id, content, BRAKES_S if "lock" in action else ANSWER_S)
                return
            except DeskError as error:
                if error.status != 404 or request == requests[-1]:
                    raise

    def step(self, action: str, reached: Callable[[dict[str, Any]], bool], what: str, limit_s: float) -> None:
        """Does it, and waits for its result; nothing begins after a signal."""
        pause(0)
        if action:
            self.act(action)
        end = time.monotonic() + limit_s
        while not reached(state := self.state()):
            if time.monotonic() > end:
                raise DeskError(f"{self.web.host}: no {what} within {limit_s} s; errors: {state['errors']}", STOPPED)
            pause(POLL_S)


def first_look(web: Web) -> tuple[int, str]:
    """The interface's version, found without the password. The owner of the first certificate will get the password."""
    found = web.exchange("GET /api/system", None, {}, ANSWER_S)
    if web.unknown:
        say(f"first contact with {web.host}; its certificate's SHA-256 is {web.expected}")
        question = "Does a browser at the arm show this certificate? (yes) "
        if not sys.stdin.isatty() or input(question) != "yes":
            advice = "compare it with what a browser at the arm shows; confirm with yes"
            raise DeskError("the password was not sent", f"{advice}, or --certificate {web.expected}")
    return found


def logged_in(web: Web, user: str, password: str, status: int, text: str) -> Desk:
    """A session."""
    newer_too = status in (401, 403) or (status == 200 and text.lstrip().startswith("{"))
    for newer in (True, False) if newer_too else (False,):
        try:
            desk = Desk(web, newer, user, password)
            if web.new and web.expected:  # the password was accepted
                web.pin.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
                web.pin.write_text(web.expected, "utf-8")
                say(f"certificate of {web.host} pinned in {web.pin}: SHA-256 {web.expected}")
            return desk
        except DeskError as error:
            if error.status not in (401, 403, 404) or (error.status == 404 and not newer):
                raise
    raise DeskError(f"{web.host} refused user '{user}' with this password", ADVICE[401])


@contextlib.contextmanager
def control(desk: Desk, take: bool) -> Iterator[dict[str, Any]]:
    """Control of the arm, given back in every ending but SIGKILL; the state to begin with."""
    holder = desk.state()["holder"]
    if holder and not take:
        raise DeskError(f"'{holder}' has control of {desk.web.host}", HOLDER)
    if holder:
        say(f"'{holder}' has control: press the circle button ON THE ARM, or let that user confirm, within {TAKE_S} s")
    try:
        try:
            desk.request_control(bool(holder))
        except DeskError as error:
            if not error.status:  # the answer with the token was lost
                say(f"control of {desk.web.host} may have been granted: look in Desk, and release it there")
            raise
        desk.step("", desk.has_control, "control", TAKE_S if holder else ANSWER_S)
        yield desk.state()
    finally:
        desk.give_back()


def ready(desk: Desk, options: argparse.Namespace) -> None:
    with control(desk, options.take) as state:
        if state["mode"] == "Programming":
            desk.act("execute")
        if state["joints"] != "unlocked":
            say("unlocking the joints: the arm may sink a little as its brakes open")
            desk.step("unlock", lambda now: now["joints"] in (None, "unlocked"), "unlocked joints", BRAKES_S)
        if not state["fci"]:
            desk.step("fci on", lambda now: now["fci"] in (None, True), "active FCI", FCI_S)
        now = desk.state()
        told = "joints unlocked" if now["joints"] else "unlocking was requested, but the arm does not report it"
        told += ", FCI active" if now["fci"] else ", the FCI was requested, but the arm does not report it"
        print(f"{desk.web.host} is ready: {told}", flush=True)
        say("control is held until Ctrl-C or SIGTERM; the FCI may end with it")
        missed = 0
        with contextlib.suppress(SystemExit):
            while missed or desk.has_control(state):
                pause(WATCH_S)
                try:
                    state, missed = desk.state(), 0
                except DeskError as error:
                    missed += 1
                    if error.status or missed == MISSED:
                        raise
                    say(f"{error}\nControl is kept; trying again")
            raise DeskError(f"control was lost to '{state['holder'] or 'nobody'}'", "begin again once control is free")


def lock(desk: Desk, options: argparse.Namespace) -> None:
    def check(fci: bool | None) -> None:
        if (fci or (fci is None and desk.newer)) and not options.anyway:
            advice = "end that program first; --anyway ends the FCI, which stops the arm, and locks"
            found = "is active" if fci else "may be active: the arm does not report it"
            raise DeskError(f"the FCI {found}: a program may be moving the arm", advice)

    check(desk.state()["fci"])  # before control is taken from that program
    with control(desk, options.take) as state:
        check(state["fci"])
        if state["fci"]:
            desk.step("fci off", lambda now: not now["fci"], "end of the FCI", FCI_S)
        desk.step("lock", lambda now: now["joints"] in (None, "locked"), "locked joints", BRAKES_S)
        shown = desk.state()["joints"]
    told = "is locked" if shown else "was asked to lock its joints, but does not report it: check that they are locked"
    print(f"{desk.web.host} {told}", flush=True)


def password_of(options: argparse.Namespace) -> str:
    if given := os.environ.pop("MULTIPANDA_DESK_PASSWORD", ""):
        return given
    if options.keyring:
        service = f"multipanda {options.host}"
        with contextlib.suppress(Exception):  # errors of its stores, too
            import keyring

            if found := keyring.get_password(service, options.user):
                return str(found)
        raise DeskError("no password in the keyring", f"pip install keyring; keyring set '{service}' {options.user}")
    if not sys.stdin.isatty():
        raise DeskError("no terminal to ask for the password", "set MULTIPANDA_DESK_PASSWORD, or use --keyring")
    return getpass.getpass(f"Password of '{options.user}' for {options.host}: ")


def parsed() -> argparse.Namespace:
    program = argparse.ArgumentParser(
        prog="multipanda arm",
        description="Make an arm ready by the web interface of its Desk, or lock it. Untried on a real arm.\n"
        "The password comes from MULTIPANDA_DESK_PASSWORD, a keyring or a prompt.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog="Examples:\n  multipanda arm status 172.16.0.2\n  multipanda arm ready 172.16.0.2",
        allow_abbrev=False,
    )
    add = program.add_argument
    add("command", choices=["ready", "lock", "status"], help="ready: joints unlocked, FCI active, control held")
    add("host", metavar="HOST", help="Address of the arm's Desk")
    add("--user", default="admin", help="User of Desk (default: admin)")
    add("--keyring", action="store_true", help="Read the password from the keyring (package keyring)")
    add("--certificate", type=fingerprint, metavar="SHA256", help="Accept and pin this certificate")
    add("--take", action="store_true", help="Take control from another user; to be confirmed at the arm or in Desk")
    add("--cleared", action="store_true", help="ready: confirm that nobody is within the arm's reach")
    add("--anyway", action="store_true", help="lock: also while the FCI is active, which ends it")
    options, more = program.parse_known_args()
    if more:  # values are not repeated: one may be a password
        program.error(f"unexpected: {', '.join(w.partition('=')[0] if w[:1] == '-' else 'an argument' for w in more)}")
    return options


def main() -> int:
    options, desk, code = parsed(), None, 0
    say("untried on a real arm (docs/real_arms.md#ready-by-command)")
    try:
        web = Web(options.host, options.certificate)
        password = password_of(options)
        if options.command == "ready" and not options.cleared:
            if not sys.stdin.isatty() or input("Is nobody within the arm's reach? (yes) ") != "yes":
                raise DeskError("nothing was done", "see that nobody is in reach; confirm with yes or --cleared")
        found = first_look(web)
        signal.pthread_sigmask(signal.SIG_BLOCK, ENDINGS)
        desk = logged_in(web, options.user, password, *found)
        if options.command == "status":
            print(json.dumps({key: value for key, value in desk.state().items() if key != "token_id"}, indent=1))
        else:
            (ready if options.command == "ready" else lock)(desk, options)
    except (DeskError, OSError) as error:
        say(error)
        code = 1
    except (KeyboardInterrupt, EOFError):  # at a question
        code = 130
    return 1 if desk and desk.stranded else code


if __name__ == "__main__":
    sys.exit(main())
