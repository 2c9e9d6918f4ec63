"""A virtual arm for pytest. Copy this file next to your tests; it only needs the built program.

    MULTIPANDA=/path/to/multipanda/multipanda pytest

The fixture `arm` gives each test an address that pylibfranka (or any libfranka program) can connect to, in a new
world. The world waits for the program (lock-step), so a busy CI machine loses no packet and every run gives the same
numbers.
"""

import json
import os
import subprocess

import pytest

PROGRAM = os.environ.get("MULTIPANDA", "multipanda")


class VirtualArm:
    """A running `multipanda virtual-arm`; `address` is where the arm listens."""

    def __init__(self, scene, *words):
        # libfranka uses one port only, so every arm has its own address. All of 127.0.0.0/8 is this computer: an
        # address made from the process number lets several jobs run at the same time.
        number = os.getpid()
        self.address = f"127.{64 + number // 62500 % 64}.{number // 250 % 250}.{number % 250 + 2}"
        self.process = subprocess.Popen(
            [PROGRAM, "virtual-arm", scene, "--bind", f"arm={self.address}", "--pace", "lockstep", "--json", *words],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        line = self.process.stdout.readline()  # printed as soon as it listens; empty after a failure
        if not line:
            raise RuntimeError(f"the virtual arm did not start: exit code {self.process.wait()}")
        assert json.loads(line)["listening"]["arm"]["address"] == self.address

    def tell(self, words):
        """Sends a command such as "push arm 0 0 -30 0.5" or "user-stop arm on"; `help` lists all."""
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
    # To use another scene: @pytest.mark.parametrize("arm", ["my/scene.yaml"], indirect=True).
    virtual_arm = VirtualArm(getattr(request, "param", os.path.join(os.path.dirname(__file__), "arm.yaml")))
    yield virtual_arm
    assert virtual_arm.close() == 0
