#!/usr/bin/env python3
"""Compares a run with everything published at 1 kHz and a listener in another process to the same run without ROS.

    ros_side_by_side.py BUILD [--seconds 10] [--repeats 3] [--scene two_arms]

BUILD is the folder with the programs `multipanda` and `ros_listener`. The two kinds of run alternate, so that other
load on the computer affects both. Prints a table for docs/results/benchmarks.md; --json prints the figures.
"""

import argparse
import json
import os
import pathlib
import re
import signal
import statistics
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent
RATES = "joint_states robot_state model wrench tf references outputs gripper object_poses clock".split()


def scene_with_rates(name, folder):
    """Returns the scene with everything published every cycle."""
    text = (ROOT / "config" / "scenes" / f"{name}.yaml").read_text()
    if re.search(r"^ros:", text, re.MULTILINE):
        raise SystemExit(f"scene {name} has a section 'ros' of its own; choose another")
    rates = ", ".join(f"{rate}: 1000" for rate in RATES)
    path = pathlib.Path(folder) / f"{name}.yaml"
    path.write_text(f"{text}\nros:\n  rates_hz: {{{rates}}}\n")
    return str(path)


def environment():
    """Keeps ROS on this machine, in a domain of its own."""
    return {
        **os.environ,
        "ROS_DOMAIN_ID": str(1 + os.getpid() % 100),
        "FASTDDS_BUILTIN_TRANSPORTS": "SHM",
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT",
        "MULTIPANDA_SHARE": str(ROOT),
    }


def publisher_seconds(pid):
    """Returns the CPU time so far of the thread that publishes."""
    for task in pathlib.Path(f"/proc/{pid}/task").iterdir():
        if (task / "comm").read_text().strip() == "ros_publisher":
            fields = (task / "stat").read_text().rsplit(")", 1)[1].split()
            return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    raise RuntimeError("the run has no publishing thread")


def run(build, scene, seconds, ros):
    words = [str(build / "multipanda"), "run", scene, "--seconds", str(seconds), "--json"] + (["--ros"] if ros else [])
    program = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env=environment())
    received, publishing_us = None, None
    try:
        if ros:
            # The listener waits for the run, then 2 s, and must finish before the end.
            listening_for = max(1.0, seconds - 5.0)
            listener = subprocess.run(
                [str(build / "benchmarks" / "ros_listener"), str(listening_for)],
                stdout=subprocess.PIPE,
                text=True,
                env=environment(),
                check=True,
            )
            received = json.loads(listener.stdout)
            # Nearly all of it was spent while the listener was running; each cycle is 1 ms.
            publishing_us = 1e6 * publisher_seconds(program.pid) / ((listening_for + 2) * 1000)
        out, _ = program.communicate(timeout=seconds + 60)
    finally:
        if program.poll() is None:
            program.send_signal(signal.SIGINT)
            program.wait(20)
    return {**json.loads(out), "received": received, "publishing_us": publishing_us}


def summed_up(runs):
    figures = {"overruns": [r["overruns"] for r in runs], "cycles": runs[0]["cycles"]}
    for key in ("median", "p99", "p999", "worst"):
        figures[key] = [round(r["cycle_us"][key], 1) for r in runs]
    return figures


def text(values):
    return (
        f"{statistics.median(values):g} ({min(values):g} to {max(values):g})" if len(values) > 1 else f"{values[0]:g}"
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("build", type=pathlib.Path)
    parser.add_argument("--seconds", type=float, default=10)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--scene", default="two_arms")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    runs = {False: [], True: []}
    with tempfile.TemporaryDirectory() as folder:
        scene = scene_with_rates(arguments.scene, folder)
        for turn in range(arguments.repeats):
            for ros in (False, True) if turn % 2 == 0 else (True, False):
                runs[ros].append(run(arguments.build.resolve(), scene, arguments.seconds, ros))
    without, with_ros = summed_up(runs[False]), summed_up(runs[True])
    received = [topics for topics in (r["received"] for r in runs[True]) if topics]
    per_topic = {
        name: [round(topics[name]["rate_hz"], 1) for topics in received if name in topics]
        for name in sorted({n for topics in received for n in topics})
    }
    if arguments.json:
        figures = {"seconds": arguments.seconds, "without_ros": without, "with_ros": with_ros, "rates_hz": per_topic}
        print(json.dumps(figures | {"publishing_us": [r["publishing_us"] for r in runs[True]]}))
        return
    print(
        f"| {arguments.scene}, {arguments.seconds:g} s, {arguments.repeats} runs each: median (range) "
        "| without ROS | everything at 1 kHz |"
    )
    print("|---|---|---|")
    print(f"| overruns of {without['cycles']} cycles | {text(without['overruns'])} | {text(with_ros['overruns'])} |")
    for key, name in (("median", "median"), ("p99", "99 %"), ("p999", "99.9 %"), ("worst", "worst")):
        print(f"| cycle time, {name} [us] | {text(without[key])} | {text(with_ros[key])} |")
    active = {name: rates for name, rates in per_topic.items() if statistics.median(rates) > 0}
    total = sum(statistics.median(rates) for rates in active.values())
    publishing = statistics.median(r["publishing_us"] for r in runs[True])
    print(
        f"\nReceived in another process: {len(active)} topics, {total:.0f} messages per second; "
        f"the publishing thread computes {publishing:.0f} us per cycle."
    )
    print("\n| topic | received [Hz] |\n|---|---|")
    for name, rates in active.items():
        if not name.startswith("/multipanda/"):  # the scene's timeline switches controllets
            print(f"| `{name}` | {text(rates)} |")


if __name__ == "__main__":
    sys.exit(main())
