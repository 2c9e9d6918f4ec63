#!/usr/bin/env python3
"""Sends poses at 100 Hz to a running scene: a small circle around the current pose of the hand.

    ./multipanda run one_arm &          # a scene whose arm runs a Cartesian controllet
    python3 examples/send_pose.py       # JSON lines
    python3 examples/send_pose.py --binary

It needs only the standard library; docs/live_input.md describes the protocol. When it ends, the stream stops and the
arm is held. With --check it verifies that the arm followed the circle and is held afterwards.
"""

import argparse
import glob
import json
import math
import os
import socket
import struct
import sys
import time


class Connection:
    """JSON lines over the socket of a run."""

    def __init__(self, path):
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self.socket.connect(path)
        self.socket.settimeout(10)
        self.lines = self.socket.makefile("r", encoding="utf-8")
        self.last_id = 0

    def tell(self, request):
        self.socket.sendall(json.dumps(request).encode() + b"\n")

    def ask(self, **request):
        self.last_id += 1
        self.tell({"id": self.last_id, **request})
        while True:
            text = self.lines.readline()
            if not text:
                raise SystemExit("send_pose: the run has ended")
            answer = json.loads(text)
            if answer.get("id") == self.last_id:
                break
            if answer.get("ok") is False:  # a pose that was refused
                raise SystemExit(f"send_pose: {answer['reason']}")
        if not answer["ok"]:
            raise SystemExit(f"send_pose: {answer['reason']}")
        return answer


class BinaryStream:
    """Poses as packets: header and seven doubles, little-endian."""

    def __init__(self, connection, controllet, input_name):
        opened = connection.ask(do="stream", controllet=controllet, input=input_name)
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.socket.connect(opened["path"])
        self.socket.setblocking(False)
        self.channel, self.sequence = opened["channel"], 0

    def send(self, position, quaternion):
        self.sequence += 1
        values = [*position, *quaternion]
        packet = struct.pack(
            "<4sHHIIQq7d", b"MPRS", 1, len(values), self.channel, 0, self.sequence, time.monotonic_ns(), *values
        )
        try:
            self.socket.send(packet)
        except BlockingIOError:
            pass  # no room: drop it, the next pose is newer


class JsonStream:
    """Poses as JSON lines. Without an "id" only refusals are answered."""

    def __init__(self, connection, controllet, input_name):
        self.connection = connection
        self.request = {
            "do": "reference",
            "controllet": controllet,
            "input": input_name,
            "frame": "world",
            "stream": True,
        }

    def send(self, position, quaternion):
        self.connection.tell({**self.request, "position_m": position, "quaternion_wxyz": quaternion})


def only_socket():
    runtime = os.environ.get("XDG_RUNTIME_DIR", "")
    folder = os.path.join(runtime, "multipanda") if runtime.startswith("/") else f"/tmp/multipanda-{os.getuid()}"
    found = []
    for path in glob.glob(os.path.join(folder, "*.sock")):
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
            if probe.connect_ex(path) == 0:
                found.append(path)
    if len(found) != 1:
        raise SystemExit(
            f"send_pose: {len(found)} scenes are running; start one with `multipanda run one_arm`, "
            "or name its socket with --socket"
        )
    return found[0]


def pose_input(connection, name):
    """Name, input and arm of a running controllet that takes a pose."""
    for controllet in connection.ask(do="list")["controllets"]:
        if not controllet["active"] or (name and controllet["name"] != name):
            continue
        for entry in controllet["inputs"]:
            if entry["quantity"] == "pose" and len(controllet["arms"]) == 1:
                return controllet["name"], entry["name"], entry["arm"]
    raise SystemExit(
        f"send_pose: found no running controllet {name or 'of one arm'} that takes a pose; "
        "`multipanda ctl list` shows all controllets"
    )


def arm_state(connection, name):
    arms = connection.ask(do="state")["state"]["arms"]
    return next((arm for arm in arms if arm["arm"] == name), None)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--socket", help="socket of the run (default: that of the only running scene)")
    parser.add_argument("--controllet", help="controllet to use (default: the first running one that takes a pose)")
    parser.add_argument("--binary", action="store_true", help="send the binary stream instead of JSON lines")
    parser.add_argument("--radius-m", type=float, default=0.03)
    parser.add_argument("--seconds", type=float, default=4, help="duration of the circle")
    parser.add_argument("--rate-hz", type=float, default=100)
    parser.add_argument("--check", action="store_true", help="fail unless the arm follows and is held afterwards")
    options = parser.parse_args()

    connection = Connection(options.socket or only_socket())
    controllet, input_name, arm = pose_input(connection, options.controllet)
    begin = arm_state(connection, arm)
    while begin is None:  # before the first cycle
        time.sleep(0.01)
        begin = arm_state(connection, arm)
    center, quaternion = begin["position_m"], begin["quaternion_wxyz"]
    print(f"{controllet}.{input_name}: a circle of {options.radius_m} m at {[round(x, 3) for x in center]}")
    stream = (BinaryStream if options.binary else JsonStream)(connection, controllet, input_name)

    farthest = 0.0
    samples = max(2, round(options.seconds * options.rate_hz))
    start = time.monotonic()
    for k in range(samples + 1):
        # The circle begins and ends at rest at the current pose.
        s = k / samples
        angle = 2 * math.pi * (s - math.sin(2 * math.pi * s) / (2 * math.pi))
        position = [
            center[0],
            center[1] + options.radius_m * math.sin(angle),
            center[2] + options.radius_m * (1 - math.cos(angle)),
        ]
        stream.send(position, quaternion)
        if k % 20 == 0:
            farthest = max(farthest, math.dist(arm_state(connection, arm)["position_m"], center))
        time.sleep(max(0.0, start + (k + 1) / options.rate_hz - time.monotonic()))
    if options.binary:
        print("sent:", [c for c in connection.ask(do="channels")["channels"] if c["channel"] == stream.channel])
    print(f"farthest from the start: {farthest:.4f} m")
    if not options.check:
        return 0

    if not 1.5 * options.radius_m < farthest < 2.5 * options.radius_m:
        print(f"send_pose: the hand was at most {farthest:.4f} m away; expected about {2 * options.radius_m} m")
        return 1
    deadline = time.monotonic() + 10
    while True:  # after the input's timeout the arm is held
        state = arm_state(connection, arm)
        if state["controllet"] == f"{arm}_hold":
            break
        if time.monotonic() > deadline:
            print(f"send_pose: the stream has stopped, but {arm} is still controlled by {state['controllet']}")
            return 1
        time.sleep(0.02)
    print(f"held: {state['removed_by']}")
    return 0 if state["removed_by"] == "reference_stale" else 1


if __name__ == "__main__":
    sys.exit(main())
