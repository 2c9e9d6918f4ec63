"""A virtual arm for pytest. Copy this file beside your tests; it needs the built multipanda and nothing else of it.

    MULTIPANDA=/path/to/multipanda/multipanda pytest

The fixture `arm` gives each test an address that pylibfranka (or any libfranka program) can connect to, in a world of
its own that begins anew. The world waits for the program (lock-step): no real time is needed, nothing is lost on a busy
CI machine, and every run gives the same numbers.
"""
import json
import os
import subprocess

import pytest

PROGRAM = os.environ.get("MULTIPANDA", "multipanda")


class VirtualArm:
    """A running `multipanda virtual-arm`; `address` is where the arm listens."""

    def __init__(self, scene, *words):
        # libfranka knows one port only, so every arm has an address of its own. The whole net 127.0.0.0/8 is this
        # computer: an address made of the process number lets several jobs run beside each other.
        number = os.getpid()
        self.address = f"127.{64 + number // 62500 % 64}.{number // 250 % 250}.{number % 250 + 2}"
        self.process = subprocess.Popen(
            [PROGRAM, "virtual-arm", scene, "--bind", f"arm={self.address}", "--pace", "lockstep", "--json", *words],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        line = self.process.stdout.readline()  # printed as soon as it listens; empty if it could not
        if not line:
            raise RuntimeError(f"the virtual arm did not start: exit code {self.process.wait()}")
        assert json.loads(line)["listening"]["arm"]["address"] == self.address

    def tell(self, words):
        """Something happens to the arm: "push arm 0 0 -30 0.5", "userstop arm on"; `help` lists all."""
        self.process.stdin.write(words + "\n")
        self.process.stdin.flush()

    def close(self):
        self.process.terminate()
        try:
            self.process.communicate(timeout=10)
        except subprocess.TimeoutExpired:
            self.process.kill()
            raise
        return self.process.returncode


@pytest.fixture
def arm(request):
    # A test names another scene by @pytest.mark.parametrize("arm", ["my/scene.yaml"], indirect=True).
    virtual_arm = VirtualArm(getattr(request, "param", os.path.join(os.path.dirname(__file__), "arm.yaml")))
    yield virtual_arm
    assert virtual_arm.close() == 0
