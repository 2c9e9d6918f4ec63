"""A run with a cockpit, and a page of it, for the tests of this folder. The first argument is the program."""

import contextlib
import functools
import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import threading
import time

from page_client import Page

PROGRAM = sys.argv.pop(1) if len(sys.argv) > 1 else "build/multipanda"
FOLDER = tempfile.mkdtemp(prefix="mp-cockpit-")
PATIENCE = 120  # [s]; only reached by a hang


class Run:
    """A scene that waits for commands, or another command with a cockpit."""

    def __init__(self, *arguments, command=None, by_signal=False, environment=()):
        """`by_signal`: the command ends by SIGTERM, not with its standard input. `environment`: more variables."""
        self.by_signal = by_signal
        command = command or [PROGRAM, "run", *arguments, "--no-timeline", "--cockpit", "0"]
        command = [*command] if by_signal else [*command, "--until-input-ends"]
        self.lines = []
        self.process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env=os.environ | {"XDG_RUNTIME_DIR": FOLDER} | dict(environment),
        )
        self.address = None
        for line in self.process.stdout:
            self.lines.append(line.rstrip("\n"))
            if line.startswith("http://127.0.0.1:"):
                self.address = line.strip()
                break
        assert self.address, "".join(self.lines)
        self._drained = threading.Thread(target=self._drain, daemon=True)
        self._drained.start()

    def _drain(self):
        for line in self.process.stdout:
            self.lines.append(line.rstrip("\n"))

    def wait(self):
        """Until it ends by itself. Returns its exit code; `lines` is complete then."""
        code = self.process.wait(PATIENCE)
        self._drained.join(PATIENCE)
        return code

    def page(self, **options):
        return Page(self.address, timeout=PATIENCE, **options)

    def end(self):
        self.process.stdin.close()
        self.process.wait(PATIENCE)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if self.by_signal:
            self.process.terminate()
        with contextlib.suppress(OSError):
            self.process.stdin.close()
        try:
            self.process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self.process.kill()
            raise


class Late(Exception):
    """This computer was too busy to beat in time: the run has held the arm, as it should."""


def patient(test):
    """For a test that holds a button in real time: begun again if this computer came too late."""

    @functools.wraps(test)
    def wrapped(self):
        for _ in range(20):
            try:
                return test(self)
            except Late:
                pass
        return test(self)

    return wrapped


def controlling(run):
    page = run.page()
    assert page.ask("control", take=True)["control"] == "taken"
    page.ask("subscribe", rate_hz=60)
    page.until(lambda p: p.states, "state")
    return page


def ask_held(page, word, **keys):
    """Asks for what may move an arm, and holds the button until the arm has stood still long enough."""

    def beat():  # beats count from pages that see new states
        known = len(page.states)
        page.until(lambda p: len(p.states) > known, "state")
        page.send({"beat": 1})

    news = len(page.news)
    beat()
    page.send({"do": word, "id": "held", **keys})
    asked = time.monotonic()
    while "held" not in page.answers or time.monotonic() < asked + 0.5:
        beat()
    page.send({"release": True})
    answer = page.answers.pop("held")
    if answer.get("verdict") == "not_held" or any("released" in message for message in page.news[news:]):
        raise Late(answer)
    return answer


def until_owned(page, name):
    """Until the arm has its controllet; a busy computer may let it go before."""
    end = time.monotonic() + 5  # [s]; a virtual arm that missed its periods has a reflex
    page.until(lambda p: owner(p) == name or p.newest("released") or time.monotonic() > end, "owner")
    if owner(page) != name:
        raise Late(page.newest("released"))


def stand_still(pid):
    """Stops a program, until none of its threads goes on: on a busy computer some do for a while."""
    os.kill(pid, signal.SIGSTOP)
    threads = pathlib.Path(f"/proc/{pid}/task")
    while any(file.read_text().rpartition(") ")[2][0] != "T" for file in threads.glob("*/stat")):
        time.sleep(0.01)


def settle(page, name="arm"):
    """The joints' speeds of an arm at rest."""
    page.states.clear()
    page.until(lambda p: p.states and max(abs(v) for v in p.value(f"{name}/dq_rad_per_s")) < 0.02, "rest")


def owner(page, name="arm"):
    return page.hello["names"]["controllets"][int(page.value(f"{name}/owner")[0])]
