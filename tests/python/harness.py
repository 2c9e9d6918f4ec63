"""What the tests of the Python package share: the program from the command line, a runtime folder of their own."""

import atexit
import contextlib
import functools
import os
import pathlib
import shutil
import sys
import tempfile
import time
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]
FOLDER = pathlib.Path(tempfile.mkdtemp(prefix="mp-py-"))  # short: a socket's path has at most 107 bytes
PATIENCE = 60  # [s]; only reached by a hang

sys.path.insert(0, str(ROOT / "python"))
os.environ["XDG_RUNTIME_DIR"] = str(FOLDER)
os.environ["PYTHONPATH"] = str(ROOT / "python")
os.environ["PYTHONDONTWRITEBYTECODE"] = "1"
OWNER = os.getpid()


@atexit.register
def _remove():
    if os.getpid() == OWNER:
        shutil.rmtree(FOLDER, ignore_errors=True)


def until(condition, what):
    """Waits until condition() is true."""
    deadline = time.monotonic() + PATIENCE
    while not condition():
        if time.monotonic() > deadline:
            raise AssertionError(f"did not happen within {PATIENCE} s: {what}")
        time.sleep(0.01)


def streaming(test):
    """For a test that streams in real time: begun again if this computer left the stream silent, which is held."""

    @functools.wraps(test)
    def patient(self):
        for _ in range(9):
            try:
                return test(self)
            except Silent:
                self.setUp()
        return test(self)

    return patient


class Silent(Exception):
    """The computer was too busy to stream: the program has held the arm, as it should."""


@contextlib.contextmanager
def unless_silent():
    """Raises Silent in place of the refusal of samples or goals after a silence."""
    import multipanda as mp

    try:
        yield
    except mp.Refused as refused:
        if refused.verdict != "not_active":
            raise
        raise Silent from refused


def ended(process_id):
    """Whether a process has ended; one that nobody has waited for yet counts."""
    try:
        return pathlib.Path(f"/proc/{process_id}/stat").read_text().rpartition(") ")[2][0] == "Z"
    except (FileNotFoundError, ProcessLookupError):
        return True


def sockets():
    folder = FOLDER / "multipanda"
    return sorted(path.name for path in folder.iterdir()) if folder.exists() else []


def main():
    if len(sys.argv) < 2:
        sys.exit(f"usage: {sys.argv[0]} PROGRAM [unittest options]")
    os.environ["MULTIPANDA_PROGRAM"] = os.path.abspath(sys.argv.pop(1))
    unittest.main(module="__main__", verbosity=1)
