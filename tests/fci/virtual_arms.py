"""Virtual arms for tests: `multipanda virtual-arm` in a separate process, at addresses that no other test uses."""

import json
import os
import pathlib
import queue
import subprocess
import threading

HERE = pathlib.Path(__file__).resolve().parent

# Waits that succeed early cost nothing; the whole machine may stand still for seconds.
PATIENCE_S = 30


def free_address(number):
    """A loopback address for this process only, because libfranka always uses the same ports."""
    assert number < 254
    pid = os.getpid()
    return f"127.{20 + pid // 256 % 40}.{pid % 256}.{number + 1}"


class VirtualArms:
    """with VirtualArms(program, scene) as arms: Robot(arms.address["left"])"""

    count = 0

    def __init__(self, program, scene, names, pace="lockstep", options=()):
        self.address = {}
        binds = []
        for name in names:
            self.address[name] = free_address(VirtualArms.count)
            VirtualArms.count += 1
            binds += ["--bind", f"{name}={self.address[name]}"]
        self.words = [program, "virtual-arm", str(scene), "--pace", pace, "--json", *binds, *options]
        self.lines = queue.Queue()

    def __enter__(self):
        self.process = subprocess.Popen(
            self.words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        self.reader = threading.Thread(target=self._read, daemon=True)
        self.reader.start()
        first = self.process.stdout.readline()
        if "listening" not in first:
            raise AssertionError(f"virtual-arm did not start: {first}{''.join(self.said())}")
        return self

    def _read(self):
        for line in self.process.stderr:
            self.lines.put(line)

    def said(self):
        lines = []
        while not self.lines.empty():
            lines.append(self.lines.get())
        return lines

    def control(self, words):
        """Sends one command line to the program; returns its answer."""
        self.said()
        self.process.stdin.write(words + "\n")
        self.process.stdin.flush()
        answer = self.lines.get(timeout=PATIENCE_S).strip()
        assert "ok" in answer.split(), f"{words}: {answer}"
        return answer

    def __exit__(self, *_):
        self.close()

    def close(self, expected=0):
        self.process.terminate()
        out = self.process.stdout.read()
        self.process.wait(PATIENCE_S)
        self.reader.join(PATIENCE_S)
        for stream in (self.process.stdin, self.process.stdout, self.process.stderr):
            stream.close()
        lines = [line for line in out.splitlines() if line.startswith("{")]
        self.ended = json.loads(lines[-1])["ended"] if lines else None
        assert self.process.returncode == expected, (
            f"virtual-arm ended with {self.process.returncode}: {''.join(self.said())}"
        )
