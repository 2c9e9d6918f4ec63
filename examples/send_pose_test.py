"""Runs send_pose.py against a paced scene, with JSON lines and with the binary stream, and `ctl` on the same run.

send_pose_test.py PROGRAM        the built multipanda
"""

import json
import os
import pathlib
import subprocess
import sys
import tempfile
import time

SCENE = """\
name: send_pose_test
arms:
  - {name: arm, start_rad: ready}
controllets:
  # Long, because a busy machine may delay the publisher.
  - {name: cartesian, type: cartesian_impedance, arms: arm, inputs: {pose: {timeout_s: 0.5}}}
active: [cartesian]
"""


def main():
    program = sys.argv[1]
    example = pathlib.Path(__file__).with_name("send_pose.py")
    with tempfile.TemporaryDirectory() as folder:
        scene = os.path.join(folder, "scene.yaml")
        with open(scene, "w", encoding="utf-8") as file:
            file.write(SCENE)
        # A separate runtime folder, in which nothing else runs.
        os.environ["XDG_RUNTIME_DIR"] = folder
        path = os.path.join(folder, "multipanda", "send_pose_test.sock")
        ctl = [program, "ctl"]
        refused = subprocess.run([*ctl, "state"], capture_output=True, text=True, check=False)
        assert refused.returncode == 1 and "multipanda run" in refused.stderr, refused
        run = subprocess.Popen(
            [program, "run", scene, "--seconds", "120", "--json"],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        try:
            deadline = time.monotonic() + 60
            while subprocess.run([*ctl, "state"], capture_output=True, check=False).returncode != 0:
                assert run.poll() is None and time.monotonic() < deadline, "the run never listened"
                time.sleep(0.1)
            for mode in ([], ["--binary"]):
                sent = subprocess.run(
                    [sys.executable, str(example), "--check", "--seconds", "3", *mode],
                    capture_output=True,
                    text=True,
                    timeout=60,
                    check=False,
                )
                print(sent.stdout, sent.stderr)
                assert sent.returncode == 0, f"send_pose {mode} failed"
                # A lost publisher is not a stop: the next switch controls the arm again.
                back = subprocess.run(
                    [*ctl, "switch", "cartesian", "--json"], capture_output=True, text=True, check=True
                )
                assert json.loads(back.stdout)["started"] == ["cartesian"], back.stdout
            assert os.stat(path).st_mode & 0o777 == 0o600 and os.stat(os.path.dirname(path)).st_mode & 0o777 == 0o700
            taken = subprocess.run(
                [program, "run", scene, "--seconds", "1", "--socket", path],
                capture_output=True,
                text=True,
                timeout=60,
                check=False,
            )
            assert taken.returncode == 1 and "running process" in taken.stderr, taken
            words = [
                (["stop"], 0),
                (["switch", "cartesian"], 1),
                (["resume", "arm"], 0),
                (["switch", "cartesian"], 0),
                (["reference", "cartesian", "pose", "position_m=0.4,0.1,0.5", "rpy_rad=pi,0,-pi/4"], 0),
                (["reference", "cartesian", "pose", "position_mm=400,0,0"], 2),
                (["parameter", "cartesian", "translational_stiffness_n_per_m", "450"], 0),
                (["parameter", "cartesian", "translational_stiffness_n_per_m", "-1"], 1),
                (["feature", "cartesian", "joint_limits", "on"], 0),
                (["switch", "cartesien"], 2),
                (["load", "arm", "mass_kg=0.2", "com_m=0,0,0.1"], 0),
                (["watch", "--rate", "50", "--count", "5"], 0),
                (["list"], 0),
                (["send", '{"do":"state"}'], 0),
                (["send", "nonsense"], 2),
            ]
            for arguments, code in words:
                done = subprocess.run([*ctl, *arguments], capture_output=True, text=True, timeout=30, check=False)
                print(arguments, done.returncode, done.stdout, done.stderr)
                assert done.returncode == code, (arguments, done)
        finally:
            run.terminate()
            output, _ = run.communicate(timeout=60)
        summary = json.loads(output)
        stale = [i for i in summary["interventions"] if i["rule"] == "reference_stale"]
        assert sum(i["count"] for i in stale) == 2, summary["interventions"]
        assert not os.path.exists(path), "the socket was left behind"


main()
