#!/bin/bash
# Guess: read_once of libfranka waits for the next state of the arm, so that a program that looks once a second sees it as it is.
# So it is: it takes what waits in the socket, where the system keeps the first 92 or so states of 1 ms each and drops the rest.
# After a pause of 5 s the state shows the arm 4.9 s ago: a program that asks, computes or waits for a person, and then
# moves from there, starts from where the arm was. Read twice after a pause; the second state is new.
# The right number: two reads one after the other are as far apart on the arm's clock as on the computer's.
# Seen with pylibfranka 0.21.3 (libfranka) on 2026-11-29, against the simulated FR3 of franky-sim 1.0.4 on loopback.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder"
"$folder/bin/pip" install -q --disable-pip-version-check pylibfranka==0.21.3 franky-sim==1.0.4 numpy==2.4.6
"$folder/bin/python" - <<'END'
import pathlib
import subprocess
import sys
import time

import pylibfranka

ADDRESS, PAUSE = "127.0.0.77", 5.0
command = [str(pathlib.Path(sys.executable).parent / "franky-sim"), "-s", "mujoco", "--hostname", ADDRESS]
server = subprocess.Popen(command, stdout=subprocess.DEVNULL)
try:
    for attempt in range(60):
        try:
            robot = pylibfranka.Robot(ADDRESS, pylibfranka.RealtimeConfig.kIgnore)
            break
        except pylibfranka.NetworkException:
            time.sleep(0.5)
    for _ in range(1000):  # catch up
        before = robot.read_once().time.to_sec()
    time.sleep(PAUSE)
    first = robot.read_once().time.to_sec()
    here = time.monotonic()
    second = robot.read_once().time.to_sec()
    here = time.monotonic() - here
    print(f"arm's clock since the pause began: first read {(first - before) * 1e3:.0f} ms, second read {(second - before) * 1e3:.0f} ms")
    print(f"between the reads: {(second - first) * 1e3:.0f} ms on the arm's clock, {here * 1e3:.0f} ms on ours; right: the same")
    assert second - first > here + 0.1, "this has changed"
finally:
    server.terminate()
    server.wait()
END
