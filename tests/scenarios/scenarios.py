#!/usr/bin/env python3
"""Scenarios in which a person beside an arm could be surprised, tried from outside on the program as it is.

One line of verdict each: scenarios.py PROGRAM [NUMBER ...]; without numbers three, with MULTIPANDA_FULL=1 all. What
needs a frozen computer, a page in a browser, two generations of arms or a thousand cases has tests of its own
(standstill_test.py, stop_soak_test.py, tests/cockpit, collision_throwing_test); here is one case of each kind, as a
user meets it.
"""

import contextlib
import json
import os
import pathlib
import re
import signal
import socket
import subprocess
import sys
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "tests/python"), str(ROOT / "tests/cockpit")]
import harness  # first: it sets the paths
import multipanda as mp
import numpy as np
from page_client import Page

until, FOLDER = harness.until, harness.FOLDER
PROGRAM = sys.argv[1] if len(sys.argv) > 1 else "build/multipanda"
HAND_M_PER_S, STILL_M = 0.25, 5e-3  # docs/contact.md
SLACK = 1.04  # of a bound on the set-point, for an arm that follows it softly
SCENARIOS = {}

ARM = """arms: [{name: arm, model: fer, hand: true, start_rad: ready}]
controllets:
  - {name: joint, type: joint_impedance, arms: arm}
  - {name: cartesian, type: cartesian_impedance, arms: arm}
  - {name: guide, type: gravity_compensation, arms: arm}
"""
TABLE = "objects: [{{name: table, shape: box, size_m: [0.5, 0.8, 0.2], position_m: [0.35, 0, {:.4f}]}}]\n"


def scenario(number):
    def add(function):
        SCENARIOS[number] = function
        return function

    return add


def scene(name, text):
    path = FOLDER / f"{name}.yaml"
    path.write_text(f"name: {name}\n{text}")
    return path


@contextlib.contextmanager
def paused(path, **options):
    with mp.run(path, fast=True, **options) as run:
        run.pause()
        try:
            yield run
        finally:
            run.pause(False)


def told(run, action):
    """A request to the loop, which answers in its next cycle, while the world is paused."""
    run.pause(False)
    try:
        return action()
    finally:
        run.pause()


class Motion:
    """What an arm did in a time: by finite differences of what the run shows."""

    def __init__(self, run, seconds, arm="arm"):
        rows = []
        for _ in range(round(seconds * 2)):
            run.step(500)
            history = run.history(0.52)
            rows.append(np.column_stack([history.t_s, history[f"{arm}/position_m"], history[f"{arm}/dq_rad_per_s"]]))
        table = np.concatenate(rows)
        table = table[np.unique(table[:, 0], return_index=True)[1]]
        t, hand = table[:, 0], table[:, 1:4]
        # Over 5 ms: a difference of two cycles would show the noise of encoders.
        self.speed = float(np.max(np.linalg.norm(hand[5:] - hand[:-5], axis=1) / (t[5:] - t[:-5])))
        self.moved = float(np.max(np.linalg.norm(hand - hand[0], axis=1)))
        self.joint_speed = float(np.max(np.abs(table[:, 4:])))
        self.hand = hand
        self.state = run.arms[arm].state

    def is_free_of_trips(self):
        assert not self.state.errors and self.state.mode == "move", (self.state.mode, self.state.errors)


def stopped(run):
    """By the shared records, which need no connection."""
    names = list(run.arms)
    until(lambda: all(run.shared().newest()[f"{name}/stopped"][0] for name in names), "stopped arms")


def ctl(*words, env=None):
    return subprocess.run([PROGRAM, "ctl", *words], capture_output=True, text=True, timeout=60, env=env)


def refused(action, *words):
    try:
        action()
    except mp.Refused as error:
        assert all(word in str(error) for word in words), error
        return
    raise AssertionError("it was accepted")


@scenario(1)
def a_stop_beside_connections_that_leak():
    with mp.run("one_arm") as one, mp.run("two_arms") as two:
        one.shared(), two.shared()
        leaked = []
        for run in (one, two):
            for _ in range(200):
                leaked.append(socket.socket(socket.AF_UNIX))
                leaked[-1].connect(str(run.connection.path))
        said = ctl("stop")
        assert said.returncode == 0, said
        stopped(one)
        stopped(two)
        assert ctl("resume", "--socket", str(two.connection.path)).returncode == 0
        said = ctl("stop", "lft", "--socket", str(two.connection.path))
        stopped(two)
        assert "lft" in said.stdout + said.stderr, said
        for each in leaked:
            each.close()
    return "both runs stopped beside 200 open connections each; a wrong name stops all"


@scenario(2)
def a_publisher_that_does_not_read():
    with paused(scene("unread", ARM)) as run:
        client = socket.socket(socket.AF_UNIX)
        client.connect(str(run.connection.path))
        sample = {"do": "reference", "controllet": "cartesian", "input": "pose", "position_m": [0.4, 0, 0.5]}
        line = json.dumps(sample | {"rpy_rad": [np.pi, 0, 0], "id": 1}).encode() + b"\n"
        client.setblocking(False)
        with contextlib.suppress(BlockingIOError):
            for _ in range(20000):
                client.send(line)
        client.setblocking(True)
        run.pause(False)
        client.sendall(b'\n{"do": "stop"}\n')
        stopped(run)
        run.resume()
        run.switch("cartesian")
        client.close()
        run.pause()
        motion = Motion(run, 1)
    assert motion.moved < 1e-3, motion.moved
    return f"its stop counts, its end moves the arm by {1e3 * motion.moved:.2f} mm"


@scenario(3)
def a_request_whose_asker_was_told_no_answer():
    path = FOLDER / "frozen.sock"
    words = [PROGRAM, "run", str(scene("frozen", ARM)), "--no-timeline", "--socket", str(path)]
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        until(path.exists, "the socket")
        run = mp.connect(path)
        run.switch("cartesian")
        before = run.arms["arm"].state.pose.position_m
        process.send_signal(signal.SIGSTOP)
        asked = ["reference", "cartesian", "pose", "position_m=[0.4,0.1,0.5]", "rpy_rad=[3.1416,0,0]"]
        clients = [
            subprocess.Popen(
                [PROGRAM, "ctl", *asked, "--socket", str(path)], stderr=subprocess.PIPE, stdout=subprocess.PIPE
            )
            for _ in range(4)
        ]
        time.sleep(3)
        for client in clients[:2]:
            client.kill()
        process.send_signal(signal.SIGCONT)
        codes = [client.wait(60) for client in clients]
        time.sleep(2)
        moved = np.linalg.norm(run.arms["arm"].state.pose.position_m - before)
    finally:
        process.send_signal(signal.SIGCONT)
        process.send_signal(signal.SIGINT)
        process.wait(60)
    assert moved < 1e-3 and 0 not in codes, (moved, codes)
    return f"frozen for 3 s: moved by {1e3 * moved:.2f} mm, every asker was told"


@scenario(4)
def collision_avoidance_that_begins_beside_a_table():
    worst = 0.0
    for gap in (0.017, 0.02, 0.05):
        # The lowest point of the hand at `ready` is 0.4869 m above the base.
        with paused(scene("table", ARM + TABLE.format(0.4869 - gap - 0.1))) as run:
            law = run["cartesian"]
            told(run, lambda law=law: law.feature("collision_avoidance"))
            told(run, law.activate)
            motions = [Motion(run, 1.5)]
            for range_m in (0.15, 0.3):
                told(run, lambda law=law, range_m=range_m: law.set("collision_avoidance.range_m", range_m))
                motions.append(Motion(run, 1.5))
            motions[-1].is_free_of_trips()
            worst = max(worst, *(motion.speed for motion in motions))
    assert worst <= HAND_M_PER_S * SLACK, worst
    return f"hand at most {worst:.3f} m/s"


@scenario(5)
def the_stiffest_wrist_that_is_allowed():
    worst = 0.0
    with paused(scene("stiff", ARM + "plant: {fidelity: realistic}\n")) as run:
        law = run["joint"]
        told(run, law.activate)
        most = law.descriptors["stiffness_nm_per_rad"].high
        told(run, lambda: law.set("stiffness_nm_per_rad", [most] * 7))
        q = run.arms["arm"].state.q_rad
        for step in (0.05, -0.05):
            told(run, lambda step=step: law.goal("joints", q + step))
            motion = Motion(run, 2)
            motion.is_free_of_trips()
            worst = max(worst, motion.joint_speed)
    assert worst < 1, worst
    return f"joints at most {worst:.2f} rad/s at K = {most:.0f} N m/rad"


@scenario(6)
def a_page_that_nobody_holds():
    with mp.run("two_arms", arguments=("--cockpit", "0")) as run:
        page = Page(re.search(r"http://\S+", run.process.output + run.process.messages)[0])
        page.ask("control", take=True)
        dual, hand = {"controllet": "dual"}, lambda: run.arms["left"].state.pose.position_m
        begun = hand()
        asked = [("switch", {"activate": "dual"}), ("parameter", dual | {"name": "offset_m", "value": [0, 0.4, 0]})]
        asked += [("parameter", {"controllet": "left_cartesian", "name": "nullspace_posture", "value": "given"})]
        asked += [
            ("feature", dual | {"name": "joint_limits", "on": False}),
            ("set_load", {"arm": "left", "mass_kg": 0.5}),
        ]
        left = {"controllet": "left_cartesian", "value": 4000}
        asked += [("parameter", left | {"name": "translational_stiffness_n_per_m"})]
        for word, keys in asked:
            answer = page.ask(word, **keys)
            assert answer["verdict"] == "not_held", (word, keys, answer)
        time.sleep(0.5)
        moved = np.linalg.norm(hand() - begun)

        def held(done, word, **keys):  # without subscription, so that every beat counts
            page.send({"beat": 1})
            page.send({"do": word, "id": word, **keys})
            end = time.monotonic() + 10
            while not done() and time.monotonic() < end:
                page.send({"beat": 1})
                time.sleep(0.03)
            answer = page.answer(word)
            assert answer["ok"] and done(), answer

        rest = time.monotonic() + 2
        held(lambda: time.monotonic() > rest, "switch", **asked[0][1])
        begun = hand()
        held(lambda: np.linalg.norm(hand() - begun) > 0.02, "parameter", **asked[1][1])
        died = hand()
        assert run.active == ["dual"], run.active
        page.close()  # it dies with its button pressed, far from the goal
        until(lambda: run.arms["left"].state.held, "hold")
        time.sleep(1.5)
        went_on = np.linalg.norm(hand() - died)
    assert moved < 1e-3 and went_on < 0.08, (moved, went_on)
    return f"refused without a hold; after the page died with its button pressed, {1e3 * went_on:.1f} mm of 120"


@scenario(7)
def a_load_that_is_declared_beside_a_stopped_or_guided_arm():
    with paused(scene("load", ARM)) as run:
        arm = run.arms["arm"]
        told(run, run["guide"].activate)
        refused(lambda: told(run, lambda: arm.set_load(2.2, [0, 0, 0.1])))
        told(run, run.stop)
        refused(lambda: told(run, lambda: arm.set_load(2.2, [0, 0, 0.1])))
        motion = Motion(run, 1)
        told(run, run.resume)
        told(run, run["joint"].activate)
        told(run, lambda: arm.set_load(0.5, [0, 0, 0.1]))
        with_load = Motion(run, 2)
    assert motion.moved < 1e-3 and with_load.speed < HAND_M_PER_S, (motion.moved, with_load.speed)
    return f"refused; under a law of 0.5 kg too much the hand drifts at {with_load.speed:.3f} m/s"


@scenario(8)
def a_torso_that_goes_on_without_its_arm():
    moved = []
    for what in ("user stop", "stop", "end of its motion"):
        with paused(ROOT / "examples/carried_arm/scene.yaml") as run:
            right, turn, keep = run.arms["right"], run["turn"], run["keep"]
            told(run, lambda turn=turn, keep=keep: run.switch([turn.name, keep.name]))
            q = run.arms["left"].state.q_rad
            told(run, lambda turn=turn, q=q: turn.goal("joints", q + np.eye(8)[0], duration_s=4))
            turning = Motion(run, 1.5, "right")
            act = {"user stop": lambda right=right: right.user_stop(True), "stop": right.stop}
            told(run, act.get(what, right.stop_motion))
            torso = run.arms["left"].state.q_rad[0]
            motion = Motion(run, 3, "right")
            moved.append(abs(run.arms["left"].state.q_rad[0] - torso))
            assert turning.joint_speed > 0.05, "the torso did not turn before"
            assert motion.speed < HAND_M_PER_S * 1.5, (what, motion.speed)
    assert max(moved) < 0.05, moved
    return f"a stop of the carried arm holds its torso: it turns by {max(moved):.3f} rad more, of 0.8"


@scenario(9)
def a_fence_that_is_crept_through():
    text = ARM.replace(
        "start_rad: ready",
        "start_rad: ready, safety: {workspace_min_m: [0.2, -0.5, 0.2], workspace_max_m: [0.36, 0.5, 1]}",
    )
    with paused(scene("fence", text)) as run:
        farthest = 0.0
        for _ in range(25):
            for law in (run["joint"], run["cartesian"]):
                with contextlib.suppress(mp.Refused):
                    told(run, law.activate)
            pose = run.arms["arm"].state.pose
            with contextlib.suppress(mp.Refused):
                told(run, lambda pose=pose: run["cartesian"].goal("pose", pose.moved(x=0.1)))
            farthest = max(farthest, Motion(run, 0.5).hand[:, 0].max())
    assert farthest < 0.36 + 0.03, farthest  # the tool's own extent inside, braking outside
    return f"after 25 tries {1e3 * (farthest - 0.36):+.1f} mm beyond the fence"


@scenario(10)
def a_stopped_arm_beside_an_obstacle():
    with paused(scene("stopped", ARM + TABLE.format(0.4869 - 0.017 - 0.1))) as run:
        hold = run["arm_hold"]
        told(run, run.stop)
        moved = [Motion(run, 1).moved]
        with contextlib.suppress(mp.Refused):
            told(run, lambda: hold.feature("collision_avoidance"))
            told(run, lambda: hold.set("collision_avoidance.range_m", 0.3))
        moved.append(Motion(run, 2).moved)
    assert max(moved) <= STILL_M, moved
    return f"moved by {1e3 * max(moved):.1f} mm"


@scenario(11)
def an_end_effector_that_is_far_away():
    worst = 0.0
    with paused(scene("far", ARM)) as run:
        arm, law = run.arms["arm"], run["cartesian"]
        refused(lambda: told(run, lambda: arm.set_frames(end_effector=mp.Pose([0, 0, 10], [1, 0, 0, 0]))))
        told(run, lambda: arm.set_frames(end_effector=mp.Pose([0, 0, -0.45], [1, 0, 0, 0])))
        told(run, law.activate)
        pose = arm.state.pose
        told(run, lambda: law.goal("pose", pose.turned([0.4, 0, 0])))
        # The flange, not the end effector, from what the joints say.
        speeds, model = [], mp.model("fer")
        for _ in range(40):
            run.step(100)
            history = run.history(0.1)
            q = history["arm/q_rad"]
            points = np.array([model.pose(q[k]).position_m for k in (5, 85)])
            speeds.append(np.linalg.norm(points[1] - points[0]) / 0.08)
        worst = max(speeds)
    assert worst <= HAND_M_PER_S * SLACK, worst
    return f"10 m refused; at 0.45 m the flange at most {worst:.3f} m/s"


@scenario(12)
def axes_without_stiffness():
    worst, joints = 0.0, 0.0
    for name in ("translational_stiffness_n_per_m", "rotational_stiffness_nm_per_rad"):
        with paused(scene("loose", ARM)) as run:
            law = run["cartesian"]
            told(run, lambda law=law, name=name: law.set(name, 0.0))
            told(run, law.activate)
            pose = run.arms["arm"].state.pose
            told(run, lambda law=law, pose=pose: law.goal("pose", pose.moved(x=0.1, z=0.1).turned([0, 0, 0.5])))
            motion = Motion(run, 3)
            motion.is_free_of_trips()
            worst, joints = max(worst, motion.speed), max(joints, motion.joint_speed)
    assert worst <= HAND_M_PER_S * SLACK and joints < 1.5, (worst, joints)
    return f"hand at most {worst:.3f} m/s, joints {joints:.2f} rad/s"


@scenario(13)
def the_reason_of_an_eviction():
    fence = "start_rad: ready, safety: {workspace_min_m: [-1, -1, 0], workspace_max_m: [1, 1, 0.55]}"
    with paused(scene("reason", ARM.replace("start_rad: ready", fence))) as run:
        law, arm = run["cartesian"], run.arms["arm"]
        told(run, lambda: law.set("translational_stiffness_n_per_m", 0.0))
        told(run, law.activate)
        told(run, lambda: arm.set_load(1.0, [0, 0, 0.1]))  # which it does not carry: it rises
        for _ in range(100):
            run.step(50)
            state = arm.state
            if state.held:
                break
        run.step(500)  # later clamps
        later = arm.state
        said = run.lost_by("cartesian", later)
        try:
            told(run, law.activate)
            refused_with = "accepted"
        except mp.Refused as error:
            refused_with = str(error)
    assert state.removed_by == later.removed_by == "workspace_limit", (state.removed_by, later.removed_by)
    assert "recover" not in refused_with, refused_with
    return f"removed by {later.removed_by} ({said}), then: {refused_with[:60]}"


@scenario(14)
def torques_after_a_gap_of_the_program():
    with contextlib.ExitStack() as stack:
        arms = stack.enter_context(mp.virtual_arms(scene("gaps", ARM), lockstep=False, arm_names=("arm",)))
        run = stack.enter_context(mp.run(scene("gaps", ARM), backend="fci", address=arms.addresses))
        law, arm = run["joint"], run.arms["arm"]
        gaps = errors = 0
        q = arm.state.q_rad
        for number in range(60):
            patience = time.monotonic() + 30
            while not law.active:  # refused while its state is still old; on a busy computer the arm is lost again
                assert time.monotonic() < patience, (arm.state.mode, arm.state.errors)
                with contextlib.suppress(mp.Refused):
                    if arm.state.errors:
                        arm.recover()
                    law.activate()
            law.goal("joints", q + (0.15 if number % 2 else -0.15))
            time.sleep(0.3)
            os.kill(run.process.child.pid, signal.SIGSTOP)
            time.sleep(0.012 + 0.0005 * number)
            os.kill(run.process.child.pid, signal.SIGCONT)
            gaps += 1
            time.sleep(0.05)
            names = arm.state.errors
            assert "controller_torque_discontinuity" not in names, names
            errors += bool(names)
    return f"{gaps} gaps of 12 to 42 ms in motion: no step of the torque, {errors} times lost for the gap itself"


@scenario(15)
def a_nervous_second_ctrl_c():
    words = [PROGRAM, "run", str(scene("nervous", ARM)), "--no-timeline", "--socket", str(FOLDER / "nervous.sock")]
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    until((FOLDER / "nervous.sock").exists, "the socket")
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    time.sleep(0.02)
    with contextlib.suppress(ProcessLookupError):
        process.send_signal(signal.SIGINT)
    code = process.wait(60)
    assert code != 130, code
    return f"exit code {code}: it ended in hold"


@scenario(16)
def numbers_beyond_all_bounds():
    text = ARM + "  - {name: force, type: force, arms: arm}\n"
    with paused(scene("bounds", text)) as run:
        told(run, run["force"].activate)
        for value in (1e300, 1e6):
            refused(lambda value=value: told(run, lambda: run["force"].goal("wrench", [0, 0, value, 0, 0, 0])))
        motion = Motion(run, 1)
        motion.is_free_of_trips()
    return "a force of 1e300 N is refused, the law goes on"


@scenario(17)
def fingers_when_their_client_dies_or_their_arm_stops():
    asked = {"do": "gripper", "arm": "left", "action": "move", "width_m": 0, "speed_m_per_s": 0.01, "id": 1}
    on = []
    for what in ("death", "stop"):
        with paused(ROOT / "config/scenes/grippers.yaml") as run:
            hand = run.arms["left"].gripper
            client = socket.socket(socket.AF_UNIX)
            client.connect(str(run.connection.path))
            client.sendall(json.dumps(asked).encode() + b"\n")
            while hand.state.width_m > 0.078:
                run.step(100)
            if what == "death":
                client.close()
                run.connection.ask({"do": "state"})  # the next turn of the server
            else:
                told(run, run.stop)
                refused(lambda hand=hand: told(run, lambda: hand.move(0.07)), "stopped")
            run.step(100)
            width = hand.state.width_m
            run.step(1000)
            on.append(abs(hand.state.width_m - width))
    assert max(on) < 2e-4, on
    return f"they go on by {1e3 * max(on):.2f} mm of 70; a stopped arm's fingers do not begin"


def fastest(history, arm="arm"):
    """The hand's largest speed, over 5 ms as in Motion."""
    rows = np.unique(history.t_s, return_index=True)[1]
    t, hand = history.t_s[rows], history[f"{arm}/position_m"][rows]
    speeds = np.linalg.norm(hand[5:] - hand[:-5], axis=1) / (t[5:] - t[:-5])
    return float(np.max(speeds, initial=0))


@scenario(18)
def goals_that_replace_each_other():
    worst, dice = 0.0, np.random.default_rng(1)
    for every, count in ((20, 200), (100, 40), (200, 30)):
        with paused(scene("goals", ARM)) as run:
            law = run["cartesian"]
            told(run, law.activate)
            pose = run.arms["arm"].state.pose
            for number in range(count):
                y = dice.uniform(-0.3, 0.3) if every < 200 else 0.3 * (-1) ** number
                goal = {"do": "reference", "controllet": "cartesian", "input": "pose", "duration_s": 0.01}
                goal |= {"position_m": [*(pose.position_m + [0, y, 0])], "quaternion_wxyz": [*pose.quaternion_wxyz]}
                run.connection.post(goal)
                run.step(every)
                worst = max(worst, fastest(run.history(0.25)))
    assert 0.1 < worst <= HAND_M_PER_S * SLACK, worst
    return f"hand at most {worst:.3f} m/s"


@scenario(19)
def two_clients_that_stream_to_one_arm():
    with paused(scene("streams", ARM)) as run, mp.connect(run.connection.path) as other:
        told(run, run["cartesian"].activate)
        pose, speeds = run.arms["arm"].state.pose, []
        for number in range(400):
            client, y = ((run, 0.15), (other, -0.15))[number % 2]
            sample = {"do": "reference", "controllet": "cartesian", "input": "pose", "stream": True, "id": 1}
            sample |= {"position_m": [*(pose.position_m + [0, y, 0])], "quaternion_wxyz": [*pose.quaternion_wxyz]}
            client.connection.ask(sample)
            run.step(5)
            if number % 80 == 79:
                speeds.append(fastest(run.history(0.4)))
    assert max(speeds) <= HAND_M_PER_S * SLACK, speeds
    return f"hand at most {max(speeds):.3f} m/s"


def held_motion(run, seconds):
    """A page that keeps its button pressed, and a way to go on with that."""
    page = Page(re.search(r"http://\S+", run.process.output + run.process.messages)[0])
    page.ask("control", take=True)
    pose = run.arms["arm"].state.pose

    def beat(for_s):
        end = time.monotonic() + for_s
        with contextlib.suppress(OSError):  # a server that stands still
            while time.monotonic() < end:
                page.send({"beat": 1})
                time.sleep(0.03)

    beat(0.1)
    page.send({"do": "switch", "id": "switch", "activate": ["cartesian"]})
    beat(0.5)
    goal = {"do": "reference", "id": "goal", "controllet": "cartesian", "input": "pose", "duration_s": 6}
    goal |= {"position_m": [*(pose.position_m + [0, 0.3, 0])], "quaternion_wxyz": [*pose.quaternion_wxyz]}
    page.send(goal)
    beat(seconds)
    assert page.answer("switch")["ok"] and page.answer("goal")["ok"]
    return page, beat


@scenario(20)
def a_recovery_while_a_page_holds_its_button():
    moved = []
    for what in ("user stop", "stop", "end of its motion"):
        with mp.run("one_arm", arguments=("--cockpit", "0")) as run:
            arm = run.arms["arm"]
            page, beat = held_motion(run, 1.5)
            {"user stop": lambda arm=arm: arm.user_stop(True), "stop": run.stop}.get(what, arm.stop_motion)()
            beat(1)
            place = arm.state.pose.position_m
            {"user stop": lambda arm=arm: arm.user_stop(False), "stop": run.resume}.get(what, arm.recover)()
            beat(2)
            moved.append(np.linalg.norm(arm.state.pose.position_m - place))
            assert arm.state.held, what
            page.close()
    assert max(moved) < STILL_M, moved
    return f"held; moved by {1e3 * max(moved):.1f} mm"


@scenario(21)
def a_page_server_that_stands_still():
    with mp.run("one_arm", arguments=("--cockpit", "0")) as run:
        arm = run.arms["arm"]
        page, beat = held_motion(run, 1.5)
        program = run.process.child.pid
        servers = [int(n) for n in pathlib.Path(f"/proc/{program}/task/{program}/children").read_text().split()]
        servers = [n for n in servers if b"page_server" in pathlib.Path(f"/proc/{n}/cmdline").read_bytes()]
        assert servers, "no page server"
        for each in servers:
            os.kill(each, signal.SIGSTOP)
        try:
            until(lambda: arm.state.held, "hold")
            time.sleep(0.5)
            place = arm.state.pose.position_m
            for number, asked in enumerate(({"do": "resume"}, {"do": "switch", "activate": ["joint"]})):
                page.send({"id": number, **asked})
            beat(1)
        finally:
            for each in servers:
                os.kill(each, signal.SIGCONT)
        beat(1.5)
        moved = np.linalg.norm(arm.state.pose.position_m - place)
        assert arm.state.held and moved < STILL_M, (run.active, moved)
    return f"held while it stands; moved by {1e3 * moved:.1f} mm when it goes on"


@scenario(22)
def floods_of_requests_to_a_stopped_arm():
    with paused(scene("flood", ARM + TABLE.format(0.4869 - 0.03 - 0.1))) as run:
        told(run, run["cartesian"].activate)
        told(run, run.stop)
        before, count = run.arms["arm"].state.q_rad, 0
        for turn in range(10):
            for law in (run[name] for name in ("joint", "cartesian", "guide", "arm_hold")):
                asked = [{"do": "feature", "name": "collision_avoidance", "on": turn % 2 == 0}]
                for name, described in law.descriptors.items():
                    bounds = (getattr(described, "low", None), getattr(described, "high", None))
                    asked += [{"do": "parameter", "name": name, "value": float(x)} for x in bounds if x is not None]
                for each in asked:
                    run.connection.post({"controllet": law.name, **each})
                count += len(asked)
            tool = {"position_m": [0, 0, 0.4 * (turn % 2)], "rpy_rad": [0, 0, 0]}
            run.connection.post({"do": "set_load", "arm": "arm", "mass_kg": 2.0})
            run.connection.post({"do": "set_frames", "arm": "arm", "end_effector": tool})
            run.step(300)
        state = run.arms["arm"].state
        moved = float(np.max(np.abs(state.q_rad - before)))
        assert state.stopped and moved < 5e-3 and count > 300, (moved, count)
    return f"{count} requests: joints move by {1e3 * moved:.2f} mrad"


def main():
    all_of_them = os.environ.get("MULTIPANDA_FULL") == "1"
    numbers = [int(word) for word in sys.argv[2:]] or (list(SCENARIOS) if all_of_them else [1, 2, 16])
    failed = 0
    for number in numbers:
        function = SCENARIOS[number]
        name = function.__name__.replace("_", " ")
        try:
            print(f"passed {number:2} {name}: {function()}", flush=True)
        except Exception as error:  # each has its line
            failed += 1
            print(f"FAILED {number:2} {name}: {type(error).__name__}: {str(error)[:300]}", flush=True)
    print(f"{len(numbers) - failed} passed, {failed} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    os.environ["MULTIPANDA_PROGRAM"] = str(pathlib.Path(PROGRAM).resolve())
    sys.exit(main())
