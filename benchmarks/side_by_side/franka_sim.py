#!/usr/bin/env python3
"""Compares virtual arms with franka-sim by the same unmodified client: prints a table for docs/results/virtual_arms.md.

    franka_sim.py PROGRAM --franka-sim PYTHON [--seconds 10]

PYTHON is the interpreter of a separate environment with franka-sim, which needs another version of MuJoCo. It uses this
project's model of the FR3, because its package has none. It listens on every address of this computer, so use one
without other users. Both run in order; --turn reverses the order.
"""

import argparse
import os
import pathlib
import signal
import subprocess
import sys
import time

import numpy as np
import pylibfranka as franka

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "fci"))
from virtual_arms import VirtualArms

SCENE = """name: side_by_side
arms:
  - {name: arm, model: fr3, hand: false, base: {position_m: [0, 0, 0]}, start_rad: ready}
"""


def connect(address):
    return franka.Robot(address, franka.RealtimeConfig.kIgnore)


def bare_timer(seconds):
    """Periods of a Python thread that only sleeps on a 1 ms grid."""
    periods, last, due = [], time.perf_counter(), time.perf_counter()
    end = last + seconds
    while last < end:
        due += 0.001
        time.sleep(max(0.0, due - time.perf_counter()))
        now = time.perf_counter()
        periods.append(now - last)
        last = now
    return np.array(periods)


def loop(robot, cycles, tau=lambda n: 0.0, pause_at=None):
    """Runs a torque loop; returns its wall-clock periods and the reason of its end."""
    periods, last, control = [], time.perf_counter(), None
    try:
        control = robot.start_torque_control()
        for n in range(cycles):
            state, _ = control.readOnce()
            now = time.perf_counter()
            periods.append(now - last)
            last = now
            if n == pause_at:
                time.sleep(0.03)
            command = franka.Torques([tau(n)] + [0.0] * 6)
            command.motion_finished = n + 1 == cycles
            control.writeOnce(command)
        return np.array(periods[1:]), "ran to completion"
    except franka.ControlException as error:
        text = str(error)
        return np.array(periods[1:]), text[text.find("[") + 2 : text.find("]") - 1] if "[" in text else text
    finally:
        del control


def recovered(robot):
    if robot.read_once().robot_mode != franka.RobotMode.Idle:
        try:
            robot.automatic_error_recovery()
        except Exception as error:  # the message is part of the result
            return str(error)
    return ""


def trials(address, seconds, push):
    robot, result = connect(address), {}
    for _ in range(3):  # a loop that did not start is tried again
        periods, end = loop(robot, int(1000 * seconds))
        if len(periods) > 1000:
            break
        recovered(robot)
    if len(periods) == 0:
        periods = np.array([np.nan])
    result["period, mean"] = f"{1e6 * periods.mean():.1f} us"
    result["period, p50, p99"] = f"{1e6 * np.quantile(periods, 0.5):.0f}, {1e6 * np.quantile(periods, 0.99):.0f} us"
    result["the loop"] = end
    recovered(robot)
    result["a torque step of 5 N m"] = loop(robot, 300, lambda n: 5.0 if n >= 100 else 0.0)[1]
    recovered(robot)
    result["30 ms without a command"] = loop(robot, 300, pause_at=100)[1]
    recovered(robot)
    robot.set_load(1.0, [0.0] * 3, [0.0] * 9)  # declared but not mounted
    began = robot.read_once().time.to_sec()
    while (state := robot.read_once()).time.to_sec() < began + 1.0:
        pass
    result["O_F_ext_hat_K with a declared load of 1 kg that is not attached"] = f"{state.O_F_ext_hat_K[2]:.2f} N"
    robot.set_load(0.0, [0.0] * 3, [0.0] * 9)
    if push:
        push()
        began, force = robot.read_once().time.to_sec(), 0.0
        while (state := robot.read_once()).time.to_sec() < began + 1.0:
            force = min(force, state.O_F_ext_hat_K[2])
        result["pushed with 15 N upwards, the arm exerts"] = f"{force:.2f} N"
    else:
        result["pushed with 15 N upwards, the arm exerts"] = "pushing is not possible"
    return result


def ours(program, seconds):
    scene = pathlib.Path(os.environ.get("TMPDIR", "/tmp"), f"side_by_side_{os.getpid()}.yaml")
    scene.write_text(SCENE)
    try:
        with VirtualArms(program, scene, ["arm"], "realtime") as arms:
            result = trials(arms.address["arm"], seconds, lambda: arms.control("push arm 0 0 15 1"))
        with VirtualArms(program, scene, ["arm"], "lockstep") as arms:
            robot, began = connect(arms.address["arm"]), time.perf_counter()
            loop(robot, 20000)
            result["lock-step, this Python client"] = f"{20 / (time.perf_counter() - began):.1f} x real time"
    finally:
        scene.unlink()
    result["two arms in one world"] = "yes: any number, one address each"
    return result


def theirs(python, seconds):
    environment = {**os.environ, "FR3_MJCF": str(ROOT / "models" / "generated" / "fr3.xml")}
    program = str(pathlib.Path(python).parent / "run-franka-sim-server")
    # With --enforce-motion-limits the arm stops at the first torque, so the defaults are measured.
    words = [program, "--physics", "mujoco", "--no-gripper"]
    server = subprocess.Popen(words, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        for _ in range(100):
            time.sleep(0.2)
            try:
                connect("127.0.0.1").read_once()
                break
            except franka.NetworkException:
                pass
        time.sleep(1.5)  # it accepts the next program after a second
        result = trials("127.0.0.1", seconds, None)
    finally:
        server.send_signal(signal.SIGINT)
        server.wait(20)
    result["lock-step, this Python client"] = "none: real time only"
    result["two arms in one world"] = "its mobile duo only, without contacts between them"
    return result


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("--franka-sim", metavar="PYTHON", required=True)
    parser.add_argument("--seconds", type=float, default=10)
    parser.add_argument("--turn", action="store_true", help="franka-sim first")
    words = parser.parse_args()
    first = (lambda: theirs(words.franka_sim, words.seconds)), (lambda: ours(words.program, words.seconds))
    timer = bare_timer(3)
    if words.turn:
        b, a = first[0](), first[1]()
    else:
        a, b = first[1](), first[0]()
    print(
        f"a bare 1 ms timer in this Python: mean {1e6 * timer.mean():.1f}, "
        f"p99 {1e6 * np.quantile(timer, 0.99):.0f} us\n"
    )
    print("| | multipanda virtual-arm | franka-sim |\n|---|---|---|")
    for row in a:
        print(f"| {row} | {a[row]} | {b.get(row, '')} |")


if __name__ == "__main__":
    main()
