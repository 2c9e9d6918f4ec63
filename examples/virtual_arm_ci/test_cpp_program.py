"""A C++ program against the virtual arm: started as a process and checked by its exit code."""

import os
import subprocess

import pytest


@pytest.mark.skipif("HOLD" not in os.environ, reason="HOLD is not set to the built program")
def test_the_program_holds_the_arm(arm):
    run = subprocess.run(
        [os.environ["HOLD"], arm.address, "2"], capture_output=True, text=True, timeout=120, check=False
    )
    assert run.returncode == 0, run.stderr
    assert "protocol version 10" in run.stdout
