#!/usr/bin/env python3
"""Holds a strict virtual FR3 at 1 kHz by one client after the other and prints what each costs, and the ratios.

    python benchmarks/side_by_side/clients.py BUILD [--rounds 10] [--seconds 20] [--keep FOLDER]

Installs pinned peers by pip and cargo into FOLDER (otherwise a temporary one) and says which do not install. Only the
model functions are timed by the clients. CPU time is the scheduler's of all their threads, memory the kernel's peak,
and the kernel's time stamps of all datagrams on the loopback interface give the time from the start of the process to
its first answer and from a state to its answer, which needs root. As an arm is another computer, the client has the
last core of this one and the virtual arm the others.
"""

import argparse
import ctypes
import json
import os
import pathlib
import shutil
import signal
import socket
import statistics
import struct
import subprocess
import sys
import tempfile
import time
import venv

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "tests" / "fci"))
from virtual_arms import PATIENCE_S, VirtualArms

SCENE = """name: side_by_side
arms:
  - {name: arm, model: fr3, hand: false, base: {position_m: [0, 0, 0]}, start_rad: ready}
"""
CRATE = """[package]
name = "hold"
version = "0.0.0"
edition = "2021"
[[bin]]
name = "hold"
path = "SOURCE"
[dependencies]
franka-rs = "=0.4.0"
"""
WHEEL = """import sys, time, franka
with franka.Robot(sys.argv[1]).joint_targets():
    while True:
        time.sleep(1)
"""
WHEEL_MODEL = """import sys, time, franka
robot = franka.Robot(sys.argv[1])
model, state, times = robot.model(), robot.read_once(), []
q, dq, at = state.q, state.dq, "ee"
for _ in range(5001):
    begin = time.perf_counter()
    model.pose(at, q), model.zero_jacobian(at, q), model.mass(q), model.coriolis(q, dq), model.gravity(q)
    times.append(time.perf_counter() - begin)
print(1e6 * sorted(times)[2500])
"""
AIOFRANKA = """import sys, time, aiofranka
with aiofranka.Controller(aiofranka.Robot(sys.argv[1])):
    while True:
        time.sleep(1)
"""
OURS, MODEL = "multipanda", "five model functions [us]"
QUANTITIES = ("CPU [s/min]", "state to answer [us]", "peak memory [MB]", "start to answer [ms]", "answered [%]")
SETTLING_S = 1.0


class Capture:
    """UDP datagrams from and to an address on the loopback interface, as (time [ns], from it, first eight bytes)."""

    SO_ATTACH_FILTER, SO_RCVBUFFORCE, SO_TIMESTAMPNS = 26, 33, 35
    SOL_PACKET, PACKET_STATISTICS = 263, 6
    HEADERS = 28  # IP and UDP

    def __init__(self, address):
        self.address = socket.inet_aton(address)
        (number,) = struct.unpack("!I", self.address)
        load_byte, load_word, equal, give = 0x30, 0x20, 0x15, 0x06
        lines = [(load_byte, 0, 0, 9), (equal, 0, 4, socket.IPPROTO_UDP), (load_word, 0, 0, 12), (equal, 3, 0, number)]
        lines += [(load_word, 0, 0, 16), (equal, 1, 0, number), (give, 0, 0, 0), (give, 0, 0, self.HEADERS + 8)]
        program = ctypes.create_string_buffer(b"".join(struct.pack("HBBI", *line) for line in lines))
        ipv4 = 0x0800
        self.socket = socket.socket(socket.AF_PACKET, socket.SOCK_DGRAM, 0)
        self.socket.setsockopt(
            socket.SOL_SOCKET, self.SO_ATTACH_FILTER, struct.pack("HP", len(lines), ctypes.addressof(program))
        )
        self.socket.setsockopt(socket.SOL_SOCKET, self.SO_RCVBUFFORCE, 1 << 26)
        self.socket.setsockopt(socket.SOL_SOCKET, self.SO_TIMESTAMPNS, 1)
        self.socket.bind(("lo", ipv4))
        # The kernel begins to stamp a moment later; until then a datagram has the time at which it is read.
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            stamped = False
            while not stamped:
                probe.sendto(bytes(8), (address, 9))
                sent = time.time_ns()
                stamped = any(at <= sent for at, _, _ in self.read())

    def read(self):
        packets = []
        while True:
            try:
                data, control, _, _ = self.socket.recvmsg(64, 64, socket.MSG_DONTWAIT)
            except BlockingIOError:
                return packets
            whole, part = struct.unpack("qq", control[0][2])
            sent = data[12:16] == self.address
            packets.append((whole * 10**9 + part, sent, int.from_bytes(data[self.HEADERS :], "little")))

    def close(self):
        """Returns how many datagrams it has lost."""
        _, lost = struct.unpack("II", self.socket.getsockopt(self.SOL_PACKET, self.PACKET_STATISTICS, 8))
        self.socket.close()
        return lost


def answer_times(packets):
    """{message_id: (time of the state [ns], time until its first answer [ns])} of the answered states."""
    states, answers = {}, {}
    for at, from_arm, message in packets:
        if from_arm:
            states.setdefault(message, at)
        elif message in states:
            answers.setdefault(message, (states[message], at - states[message]))
    return answers


def tree(process):
    yield process
    for file in pathlib.Path(f"/proc/{process}/task").glob("*/children"):
        for child in file.read_text().split():
            yield from tree(child)


def cpu_s(process):
    """Time on a processor of each thread of a process and its children."""
    files = [f for each in tree(process) for f in pathlib.Path(f"/proc/{each}/task").glob("*/schedstat")]
    return {file: int(file.read_text().split()[0]) / 1e9 for file in files}


def peak_mb(process):
    statuses = [pathlib.Path(f"/proc/{each}/status").read_text() for each in tree(process)]
    return sum(int(text.split("VmHWM:")[1].split()[0]) for text in statuses) / 1000


def measure(words, address, core, seconds):
    capture, packets, words = Capture(address), [], ["taskset", "-c", str(core), *words]
    began = time.time_ns()
    process = subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)

    def watch(until):
        while not until():
            if process.poll() is not None:
                said = process.stderr.read().decode(errors="replace").strip()
                raise RuntimeError(f"ended with {process.returncode} while it should hold the arm: {said[-300:]}")
            time.sleep(0.05)
            packets.extend(capture.read())

    try:
        end = time.monotonic() + PATIENCE_S
        watch(lambda: answer_times(packets) or time.monotonic() > end)
        if not answer_times(packets):
            raise RuntimeError(f"answered no state within {PATIENCE_S} s")
        end = time.monotonic() + SETTLING_S
        watch(lambda: time.monotonic() > end)
        first, end, before = time.time_ns(), time.monotonic() + seconds, cpu_s(process.pid)
        watch(lambda: time.monotonic() > end)
        after, last, peak = cpu_s(process.pid), time.time_ns(), peak_mb(process.pid)
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        process.stderr.close()
        lost = capture.close()
    if lost:
        raise RuntimeError(f"the capture lost {lost} datagrams: the computer is too busy")
    answers = answer_times(packets)
    times = [took for at, took in answers.values() if first <= at < last]
    states = len({message for at, sent, message in packets if sent and first <= at < last})
    cpu = sum(spent - before.get(thread, 0) for thread, spent in after.items())
    start = min(at + took for at, took in answers.values()) - began
    figures = 60_000 * cpu / len(times), statistics.median(times) / 1e3, peak, start / 1e6, 100 * len(times) / states
    return dict(zip(QUANTITIES, figures))


def said(words):
    return float(subprocess.run(words, capture_output=True, text=True, check=True, timeout=300).stdout)


def our_model_us(build):
    """Pose, Jacobian, mass, Coriolis and gravity, and the task-space terms, which the others lack."""
    words = [build / "multipanda_bench", "--filter", "^model/(all|update_only)$", "--", "--benchmark_format=json"]
    found = json.loads(subprocess.run(words, capture_output=True, text=True, check=True).stdout)["benchmarks"]
    time_of = {each["name"]: each["cpu_time"] for each in found}
    return time_of["model/all"] - time_of["model/update_only"]


def installed(folder, package):
    """The Python of an environment with this package."""
    home = folder / package.split("==")[0]
    python = home / "bin" / "python"
    if not python.exists():
        venv.create(home, with_pip=True)
    subprocess.run([python, "-m", "pip", "install", "-q", package], check=True, stdout=sys.stderr)
    return python


def clients(build, folder, scene):
    """Name of each client, its program and the one that prints MODEL; both get the arm's address."""
    run = [build / "multipanda", "run", scene, "--backend", "fci", "--no-timeline", "--full-speed"]
    run += ["--socket", folder / "socket", "--address"]
    ours = lambda *more: lambda address: [*run, f"arm={address}", *more]
    named = {
        OURS: (ours(), lambda address: our_model_us(build)),
        "multipanda, recording": (ours("--record", folder / "runs"), None),
        "bare client": (lambda address: [build / "multipanda_bare_client", address], None),
    }

    def crate():
        source = str(HERE / "franka_rs.rs")
        (folder / "Cargo.toml").write_text(CRATE.replace("SOURCE", source))
        subprocess.run(["cargo", "build", "-q", "--release"], cwd=folder, check=True)
        program = folder / "target" / "release" / "hold"
        timed = lambda address: said([program, address, "time"])
        named["franka-rs 0.4.0"] = (lambda address: [program, address, "hold"], None)
        named["franka-rs, five model calls"] = (lambda address: [program, address, "model"], timed)

    def wheel():
        python = installed(folder, "franka-rs==0.4.0")
        timed = lambda address: said([python, "-c", WHEEL_MODEL, address])
        named["franka-rs, Python"] = (lambda address: [python, "-c", WHEEL, address], timed)

    def aiofranka():
        python = installed(folder, "aiofranka==0.9.0")
        named["aiofranka 0.9.0"] = (lambda address: [python, "-c", AIOFRANKA, address], None)

    for install in (crate, wheel, aiofranka):
        try:
            install()
        except (OSError, subprocess.CalledProcessError) as error:
            print(f"skipped, it cannot be installed: {install.__name__}: {error}", file=sys.stderr)
    return named


def spread(values):
    if not values:
        return "–"
    return f"{statistics.median(values):.3g} ({min(values):.3g} to {max(values):.3g})"


def tables(rounds):
    """Markdown: each client's median (lowest to highest); ours over each other's, always of the same round."""
    names = list(dict.fromkeys(name for each in rounds for name in each))
    head = lambda first, some: [f"| {first} | {' | '.join(some)} |", "|---" * (len(some) + 1) + "|"]
    lines = head("median (lowest to highest)", names)
    for quantity in (*QUANTITIES, MODEL):
        cells = [spread([r[name][quantity] for r in rounds if quantity in r.get(name, {})]) for name in names]
        lines.append(f"| {quantity} | {' | '.join(cells)} |")
    others = [name for name in names if name != OURS]
    lines += ["", *head(f"{OURS} over", others)]
    for quantity in (*QUANTITIES[:-1], MODEL):
        pairs = lambda other: [
            r[OURS][quantity] / r[other][quantity]
            for r in rounds
            if quantity in r.get(OURS, {}) and quantity in r.get(other, {})
        ]
        lines.append(f"| {quantity} | {' | '.join(spread(pairs(other)) for other in others)} |")
    return "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("build", type=lambda text: pathlib.Path(text).resolve())
    parser.add_argument("--rounds", type=int, default=10)
    parser.add_argument("--seconds", type=float, default=20, help="measured per client and round")
    parser.add_argument("--keep", type=pathlib.Path, metavar="FOLDER", help="where the peers are installed and stay")
    words = parser.parse_args()
    os.environ["FRANKA_REALTIME"] = "ignore"  # franka-rs: on any kernel, like the others
    try:
        Capture("127.0.0.1").close()
    except PermissionError:
        sys.exit("packets cannot be captured: run it as root")
    *others, core = sorted(os.sched_getaffinity(0))
    with tempfile.TemporaryDirectory(prefix="side_by_side_") as temporary:
        folder = (words.keep or pathlib.Path(temporary)).resolve()
        folder.mkdir(parents=True, exist_ok=True)
        scene = folder / "side_by_side.yaml"
        scene.write_text(SCENE)
        programs, rounds = list(clients(words.build, folder, scene).items()), []
        os.sched_setaffinity(0, others or [core])
        print(f"load before {os.getloadavg()[0]:.1f}, {os.cpu_count()} cores", file=sys.stderr)
        for k in range(words.rounds):
            rounds.append({})
            turn = k % len(programs)
            for name, (hold, model) in programs[turn:] + programs[:turn]:
                VirtualArms.count = 0
                options = ["--strict", "--no-gripper"]
                with VirtualArms(words.build / "multipanda", scene, ["arm"], "realtime", options) as arms:
                    address = arms.address["arm"]
                    try:
                        figures = {MODEL: model(address)} if model else {}
                        rounds[-1][name] = measure(hold(address), address, core, words.seconds) | figures
                    except (RuntimeError, subprocess.SubprocessError) as error:
                        print(f"{name}: {getattr(error, 'stderr', None) or error}", file=sys.stderr)
                print(f"round {k + 1}, {name}: {rounds[-1].get(name)}", file=sys.stderr)
            shutil.rmtree(folder / "runs", ignore_errors=True)
        print(f"load after {os.getloadavg()[0]:.1f}\n", file=sys.stderr)
        print(tables(rounds))


if __name__ == "__main__":
    main()
