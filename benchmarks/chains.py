#!/usr/bin/env python3
"""Delays of the chains around a run: from a leader's joint to set-point and arm, from a workstation to torque, from a
picture to the log; over a real sshd on loopback, and the first two without it. The leader's servos are emulated.

PYTHONPATH=python .venv/bin/python benchmarks/chains.py build     # needs a computer that does nothing else, and sshd
"""

import argparse
import contextlib
import os
import pathlib
import shutil
import subprocess
import sys
import time

ROOT = pathlib.Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "python"))

import multipanda as mp
import numpy as np
from harness import FOLDER, until
from leader_test import calibration, mounted, pose
from multipanda.picture_log import read_pictures
from ssh_server import Sshd

SCENE = ROOT / "examples" / "afternoon" / "scene.yaml"
STEP_RAD, MOVED_RAD = 0.01, 1e-4  # of a joint; of its set-point that has begun to follow
SWING_RAD, SWING_HZ, LONGEST_S = 0.08, 0.5, 0.4  # of a leader that swings; the longest lag that can be found


def spread(what, seconds):
    median, p99 = 1e3 * np.quantile(seconds, [0.5, 0.99])
    print(f"{what}: median {median:.1f} ms, p99 {p99:.1f} ms ({len(seconds)} times)", flush=True)


def until_it_moves(run, step, rounds, random):
    """From step(k) until the cycle whose set-point begins to follow has sent its torque [s]."""
    found = []
    for k in range(rounds):
        time.sleep(random.uniform(0.3, 0.4))  # it has arrived
        with run.records() as records:
            begun = next(records)["left_joint/joints"][0]
            sent_ns = step(k)
            moved = next(r for r in records if abs(r["left_joint/joints"][0] - begun) > MOVED_RAD)
            found.append(1e-9 * (moved.start_ns + int(moved["total_ns"][0]) - sent_ns))
    return np.array(found)


def lag_s(turned, moved):
    """The shift of a motion behind its leader's with the least squares. Both: (times [s], angles [rad])."""
    shifts = np.arange(0, LONGEST_S, 0.001)
    inside = (turned[0] > moved[0][0]) & (turned[0] < moved[0][-1] - shifts[-1])
    times, angles = turned[0][inside], turned[1][inside]
    return shifts[np.argmin([np.var(np.interp(times + shift, *moved) - angles) for shift in shifts])]


def swing(run, lead, start, periods):
    """How far set-point and arm are behind a leader that swings, for each period [s]."""
    lags, begin = [], time.monotonic()
    for _ in range(periods):
        turned, end = [], time.monotonic() + 1 / SWING_HZ + LONGEST_S
        while (now := time.monotonic()) < end:
            angle = SWING_RAD * np.sin(2 * np.pi * SWING_HZ * (now - begin))
            lead(start + np.eye(7)[0] * angle)
            turned.append((1e-9 * time.monotonic_ns(), start[0] + angle))
            time.sleep(0.004)
        moved = run.history(1 / SWING_HZ + LONGEST_S)
        times = 1e-9 * moved["start_ns"].ravel()
        lags.append([lag_s(np.array(turned).T, (times, moved[k][:, 0])) for k in ("left_joint/joints", "left/q_rad")])
    return np.array(lags).T


def of_leaders(where, address, rounds, random, environment):
    servos = mounted()
    with contextlib.closing(servos), mp.run(str(SCENE)) as run:
        start = run.arms["left"].state.q_rad
        pose(servos, start)
        words = ["-m", "multipanda.leader", "drive", calibration(servos), "--arms", "left", "--run", address(run)]
        with subprocess.Popen([sys.executable, "-u", *words], env=environment, stdout=subprocess.DEVNULL) as program:
            try:
                until(lambda: run.arms["left"].state.controllet == "left_joint", "the arm follows")
                time.sleep(2)

                def step(k):
                    pose(servos, start + np.eye(7)[0] * STEP_RAD * ((k + 1) % 2))
                    return time.monotonic_ns()

                spread(f"from a leader's joint to torque, {where}", until_it_moves(run, step, rounds, random))
                setpoint, arm = swing(run, lambda q: pose(servos, q), start, rounds // 10)
                if program.poll() is not None:
                    sys.exit("the leader's program has ended: this computer is too busy")
                spread(f"lag of the set-point behind a swinging leader, {where}", setpoint)
                spread(f"and the arm, {where}", arm)
            finally:
                program.terminate()


def of_workstations(where, address, rounds, random):
    with mp.run(str(SCENE)) as run, mp.connect(address(run)) as far:
        start = run.arms["left"].state.q_rad
        far.switch("left_joint")
        with far["left_joint"].stream("joints") as stream:

            def step(k):
                now = time.monotonic_ns()
                stream.send(start + np.eye(7)[0] * STEP_RAD * ((k + 1) % 2))
                return now

            spread(f"from a workstation's sample to torque, {where}", until_it_moves(run, step, rounds, random))


def of_pictures(where, address, seconds):
    cameras = {"top": mp.SceneCamera([0.62, 0, 1.5], look_at_m=[0.62, 0, 0.3], width=96, height=72)}
    log = FOLDER / "pictures.mcap"
    with mp.run(str(SCENE)) as run, mp.connect(address(run), silence_s=5) as far:  # OpenGL begins slowly
        with mp.Cameras(far, cameras, rate_hz=10, log=str(log), scene=str(SCENE)) as see:
            see.newer("top")
            time.sleep(seconds)
        pictures = read_pictures(log)["top"]
    spread(f"from a picture to the log, {where}", [picture.age_s for picture in pictures])
    spread(f"pairing error, {where}", [picture.error_s for picture in pictures])


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("build", type=pathlib.Path)
    parser.add_argument("--rounds", type=int, default=200)
    options = parser.parse_args()
    program = (options.build / "multipanda").resolve()
    os.environ["MULTIPANDA_PROGRAM"] = str(program)
    (FOLDER / "bin").mkdir()
    (FOLDER / "bin" / "multipanda").symlink_to(program)
    random = np.random.default_rng(1)
    with contextlib.closing(Sshd(FOLDER / "sshd", {"PATH": f"{FOLDER / 'bin'}:/usr/bin:/bin"})) as sshd:
        ssh = FOLDER / "bin" / "ssh"
        ssh.write_text(f'#!/bin/sh\nexec {shutil.which("ssh")} -F {sshd.config} "$@"\n')
        ssh.chmod(0o755)
        os.environ["PATH"] = f"{ssh.parent}:{os.environ['PATH']}"
        by_ssh = lambda run: f"ssh://127.0.0.1:{sshd.port}/{pathlib.Path(run.connection.path).stem}"  # noqa: E731
        for where, address in (("here", lambda run: str(run.connection.path)), ("over ssh", by_ssh)):
            of_workstations(where, address, options.rounds, random)
            of_leaders(where, address, options.rounds, random, os.environ)
        of_pictures("over ssh", by_ssh, options.rounds / 5)
    print(f"load: {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
