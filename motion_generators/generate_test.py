"""Runs `generate circular-field` with a paced scene of two arms: poses arrive, hands follow, nothing is lost.

generate_test.py PROGRAM        the built multipanda
"""

import json
import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import time

SCENE = """\
name: generate_test
arms:
  - {name: left, start_rad: ready, base: {position_m: [0, 0.26, 0]}}
  - {name: right, start_rad: ready, base: {position_m: [0, -0.26, 0]}}
controllets:
  # Generous: a loaded machine may delay the publisher.
  - {name: dual, type: dual_cartesian_impedance, arms: [left, right], parameters: {goals: separate},
     inputs: {first_pose: {timeout_s: 0.5}, second_pose: {timeout_s: 0.5}, common_pose: {timeout_s: 0.5}}}
  - {name: coupled, type: coupled_dual_cartesian_impedance, arms: [left, right]}
active: [dual]
"""


def main():
    program = sys.argv[1]
    with tempfile.TemporaryDirectory() as folder:
        scene = pathlib.Path(folder, "scene.yaml")
        scene.write_text(SCENE, encoding="utf-8")
        path = os.path.join(folder, "run.sock")
        generate = [program, "generate", "circular-field"]

        rehearsed = subprocess.run(
            [*generate, "two_hands", "--rehearse", "--seconds", "30", "--json"],
            capture_output=True,
            text=True,
            check=True,
        )
        plan = json.loads(rehearsed.stdout)
        assert plan["samples"] == 30000 and min(plan["goals_reached"].values()) >= 3, plan
        for words, code in [
            (["two_hans"], 2),
            (["two_hands", "--to", "middle=dual.common_pose"], 2),
            (["two_hands", "--rehearse"], 2),
            (["two_hands", "--socket", path], 1),
        ]:
            refused = subprocess.run([*generate, *words], capture_output=True, text=True, check=False)
            assert refused.returncode == code and refused.stderr.strip(), (words, refused)

        run = subprocess.Popen(
            [program, "run", str(scene), "--seconds", "120", "--socket", path, "--json"],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )

        def ask(*words):
            return subprocess.run(
                [program, "ctl", "--socket", path, "--json", *words], capture_output=True, text=True, check=False
            )

        try:
            deadline = time.monotonic() + 60
            while ask("state").returncode != 0:
                assert run.poll() is None and time.monotonic() < deadline, "the run never listened"
                time.sleep(0.1)
            on = [*generate, "two_hands", "--socket", path, "--json"]
            refused = subprocess.run([*on, "--to", "left=duel.first_pose"], capture_output=True, text=True, check=False)
            assert refused.returncode == 2 and "dual" in refused.stderr, refused

            before = json.loads(ask("state").stdout)["state"]
            done = subprocess.run([*on, "--seconds", "4"], capture_output=True, text=True, timeout=60, check=False)
            print(done.stdout, done.stderr)
            assert done.returncode == 0, done
            report = json.loads(done.stdout)
            assert report["ended_by"] == "duration", report
            # The timing of this machine is not checked; only that every period was counted, as published or missed.
            assert report["samples"] + report["missed"] >= 4000, report
            assert report["clearance_m"] >= 0.02 and report["speed_m_per_s"] <= 0.5, report
            channels = {c["input"]: c for c in report["channels"]}
            for name in ("first_pose", "second_pose"):
                channel = channels[name]
                # Each pose arrived or was counted as lost; a lost last pose cannot be detected.
                assert channel["received"] + channel["lost"] >= report["samples"] - 10, (channel, report)
                assert channel["received"] >= 0.5 * report["samples"] and channel["verdict"] == "accepted", channel
                assert channel["late"] == channel["refused"] == 0 and channel["lost"] <= report["unsent"], channel

            # The publisher has ended; its last pose is a goal, so that the controllet still runs after the timeout.
            time.sleep(1.0)
            after = json.loads(ask("state").stdout)["state"]
            for one, other in zip(before["arms"], after["arms"]):
                moved = sum((a - b) ** 2 for a, b in zip(one["position_m"], other["position_m"])) ** 0.5
                assert moved > 0.05, (one["arm"], moved)
                assert other["controllet"] == "dual", other["controllet"]

            # Ctrl-C ends it cleanly; an inactive controllet refuses samples, and this is reported.
            idle = subprocess.Popen(
                [*generate, "common_target", "--to", "pair=coupled.pose", "--socket", path, "--json"],
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
            )
            time.sleep(1.5)
            idle.send_signal(signal.SIGINT)
            output, errors = idle.communicate(timeout=60)
            assert idle.returncode == 0, (output, errors)
            report = json.loads(output)
            assert report["ended_by"] == "stopped", report
            assert report["channels"][0]["refused"] > 0 and report["channels"][0]["verdict"] == "not_active", report
        finally:
            run.terminate()
            output, _ = run.communicate(timeout=60)
        summary = json.loads(output)
        assert not [i for i in summary["interventions"] if i["rule"] == "reference_stale"], summary["interventions"]


main()
