#!/usr/bin/env python3
"""Leader arms of servos: an emulated chain on a pseudo-terminal, the servos' own SDK, and the real program behind."""

import contextlib
import dataclasses
import importlib.util
import json
import math
import os
import pathlib
import signal
import struct
import subprocess
import sys
import threading
import time
import unittest

if importlib.util.find_spec("dynamixel_sdk") is None:
    print("skipped: dynamixel-sdk is not installed (./multipanda setup, or pip install 'multipanda[leader]')")
    sys.exit(77)

import harness  # first: it sets the paths
import multipanda as mp
import numpy as np
from harness import FOLDER, PATIENCE, Silent, streaming, until
from lerobot_scenes import edited
from multipanda.leader import calibrate, drive
from multipanda.lerobot import ArmsRobot, RobotSettings, ServoLeader, ServoLeaderSettings
from multipanda.pedal import Marks, Pedal
from multipanda.servos import Angles, Calibration, LeaderArm, ServoChain, find_servos
from servo_device import PING, STATUS, TURN, Servos, packet

READY = np.array([0, -math.pi / 4, 0, -3 * math.pi / 4, 0, math.pi / 2, math.pi / 4])
LOW = [-2.7437, -1.7837, -2.9007, -3.0421, -2.8065, 0.5445, -3.0159]
HIGH = [2.7437, 1.7837, 2.9007, -0.1518, 2.8065, 4.5169, 3.0159]
SIGNS, QUARTERS = [1, -1, 1, 1, -1, 1, -1], [1, 2, 0, 3, 2, 1, 3]
FREE, SQUEEZED = 2300, 1800  # counts of the trigger
COUNT = 2 * math.pi / TURN
PATIENT_S = 3.0  # this computer may be busy: what holds sooner is what a test did
A, B, C = 30, 48, 46


def mounted(**options):
    """Servos whose horns are a multiple of 90 degrees off, some turned around; the last is a trigger."""
    return Servos(offsets=[TURN // 4 * n for n in QUARTERS] + [0], signs=[*SIGNS, 1], **options)


def pose(servos, q_rad, trigger=FREE):
    servos.set(*(np.asarray(q_rad) / COUNT), trigger)


def calibration(servos, **changes):
    found = Calibration(
        port=servos.port, baud=servos.baud, arm="fr3", ids=list(servos.tables)[:7], signs=SIGNS,
        offsets_rad=[math.pi / 2 * n for n in QUARTERS], q_min_rad=LOW, q_max_rad=HIGH,
        trigger=[list(servos.tables)[7], FREE, SQUEEZED],
    )  # fmt: skip
    path = FOLDER / f"{os.path.basename(servos.port)}.json"
    dataclasses.replace(found, **changes).save(path)
    return str(path)


def event(code, value, at_s):
    """input_event of a 64-bit computer, and the end of its report."""
    return struct.pack("<qqHHi", at_s, 0, 1, code, value) + struct.pack("<qqHHi", at_s, 0, 0, 0, 0)


class Emulated(unittest.TestCase):
    def servos(self, make=mounted, **options):
        found = make(**options)
        self.addCleanup(found.close)
        return found

    def file(self, text):
        path = FOLDER / "leader.json"
        path.write_text(text, encoding="utf-8")
        return path


class Chain(Emulated):
    def chain(self, servos, silence_s=PATIENT_S):
        found = ServoChain(servos.port, servos.baud, list(servos.tables), silence_s)
        self.addCleanup(found.close)
        return found

    def test_the_emulator_speaks_as_the_description_s_examples(self):
        self.assertEqual(packet(1, PING).hex(), "fffffd00010300" + "01" + "194e")
        self.assertEqual(packet(1, STATUS, bytes([0, 6, 4, 0x26])).hex(), "fffffd00010700" + "5500060426" + "655d")

    def test_positions_of_all_at_once_without_torque(self):
        servos = self.servos(make=Servos)
        chain = self.chain(servos)
        self.assertEqual([table[64] for table in servos.tables.values()], [0] * 8)
        counts = [0, 4095, -1, 2**31 - 1, -(2**31), 0xFDFFFF, 7, 8]  # the sixth one's bytes look like a header
        servos.set(*counts)
        before = servos.reads
        self.assertEqual(chain.read(), counts)
        self.assertEqual(servos.reads, before + 1)

    def test_speed_and_numbers_are_found(self):
        servos = self.servos(make=Servos, baud=1_000_000, order=[3, 1, 8])
        self.assertEqual(find_servos(servos.port), (1_000_000, [1, 3, 8]))
        servos.silent |= {1, 3, 8}
        with self.assertRaisesRegex(mp.Disconnected, "no servo answers at /dev/pts/.*57600"):
            find_servos(servos.port)

    def test_what_is_not_a_leader_is_refused(self):
        servos = self.servos(make=Servos, model=350)
        with self.assertRaisesRegex(mp.Disconnected, "servo 1 .* is of model 350. Next: .* X series"):
            self.chain(servos)
        with self.assertRaisesRegex(mp.Disconnected, "cannot be read .*Next: name its port"):
            ServoChain(FOLDER / "nothing", 57600, [1])
        good = self.servos()
        with self.assertRaisesRegex(mp.Disconnected, "servo 9 of the leader .* does not answer"):
            ServoChain(good.port, 57600, [9])
        self.chain(good)
        with self.assertRaisesRegex(mp.Disconnected, "lock"):
            ServoChain(good.port, 57600, [1])  # two programs would take each other's answers

    def test_one_damaged_answer_is_asked_for_again(self):
        servos = self.servos()
        chain = self.chain(servos)
        for garbage in (b"", b"\xff\xff\xfd\x00\x02", bytes(range(256))):
            servos.damaged, servos.babble, before = 1, garbage, servos.reads
            self.assertEqual(len(chain.read()), 8)
            self.assertGreater(servos.reads, before + 1)
            servos.babble = b""

    def test_a_fault_ends_in_its_name(self):
        def fails(pattern):
            with self.assertRaisesRegex(mp.Disconnected, pattern):
                chain.read()

        servos = self.servos()
        chain = self.chain(servos, 0.2)
        servos.silent = {3}
        fails("servo 3 of the leader at /dev/pts/.* does not answer. Next: check its cable")
        servos.silent = set(servos.tables)
        # Without end, and in pieces that look like answers.
        for babble in (os.urandom(300), b"\xff" * 4000, b"\xff\xff\xfd\x00\x01\x07\x00\x55", packet(9, STATUS, b"\0")):
            servos.babble = babble
            fails("servo 1 .* (answers garbage|does not answer)")
        servos.babble, servos.silent, servos.corrupt = b"", set(), {2}
        fails("servo 2 .* answers garbage")
        servos.corrupt, servos.alerts = set(), {5: 0x24}
        fails("servo 5 .* reports a hardware error: overheating, overload. Next: remove the cause")
        servos.unplug()
        for _ in range(2):
            fails("the leader at /dev/pts/.* is gone .* Next: plug it in")


class Joints(Emulated):
    def test_angles_are_those_of_the_arm_wherever_a_servo_begins_to_count(self):
        servos = self.servos()
        with LeaderArm(calibration(servos), PATIENT_S) as leader:
            for turns in (0, 3, -2):
                for q in (READY, np.array(LOW) + 0.06, np.array(HIGH) - 0.06):
                    servos.set(*(np.asarray(q) / COUNT + turns * TURN), FREE)
                    leader._angles = Angles(leader.calibration)  # as after a start
                    read, squeezed = leader.read()
                    self.assertLess(np.max(np.abs(read - q)), 0.51 * COUNT)
                    self.assertEqual(squeezed, 0)
            pose(servos, READY, (FREE + SQUEEZED) / 2)
            leader._angles = Angles(leader.calibration)
            self.assertEqual(leader.read()[1], 0.5)
            pose(servos, READY, SQUEEZED - 100)
            leader._angles = Angles(leader.calibration)
            self.assertEqual(leader.read()[1], 1)

    def test_a_joint_is_followed_beyond_half_a_turn_and_stays_at_the_end_of_its_range(self):
        servos = self.servos()
        c = Calibration.load(calibration(servos))
        angles = Angles(c)
        rest = [servos.tables[number][132:136] for number in c.servos[1:]]
        rest = [int.from_bytes(each, "little", signed=True) for each in rest]
        for k in range(60):  # 5.9 rad in 0.6 s; the servo's own count begins again on the way
            counts = np.round((c.offsets_rad[0] + 0.1 * k) / COUNT) % TURN
            at = angles.take([int(counts), *rest], 0.01 * k)[0]
        self.assertLess(abs(at - 5.9), COUNT)
        with LeaderArm(calibration(servos), PATIENT_S) as leader:
            leader._angles = angles
            servos.set(-0.3 / COUNT, *[0] * 7)  # 5.98 rad, a turn less
            leader._angles._then_s = time.monotonic()
            self.assertAlmostEqual(leader.read()[0][0], HIGH[0] - 0.05)

    def test_no_joint_jumps(self):
        c = Calibration.load(calibration(self.servos()))
        for step_rad, elapsed_s, jumps in ((0.2, 0.01, False), (0.3, 0.01, True), (-0.3, 0.01, True), (3, 0.3, False)):
            angles = Angles(c)
            first = angles.take([0] * 8, 10.0)
            counts = [0, 0, round(step_rad / COUNT), 0, 0, 0, 0, 0]
            if jumps:
                with self.assertRaisesRegex(mp.Disconnected, "servo 3 of the leader jumped by 0.30 rad within 10 ms"):
                    angles.take(counts, 10.0 + elapsed_s)
            else:
                turned = angles.take(counts, 10.0 + elapsed_s) - first
                self.assertAlmostEqual(turned[2], step_rad, delta=COUNT)

    def test_wrong_calibrations_are_refused(self):
        good = json.loads(pathlib.Path(calibration(self.servos())).read_text())
        for wrong, pattern in (
            ({"offsets_rad": [math.nan] * 7}, "finite"),
            ({"signs": [1, 1, 1, 1, 1, 1, 0]}, "1 or -1"),
            ({"ids": [1, 2, 3]}, "one number per joint"),
            ({"ids": [1, 2, 3, 4, 5, 6, 6]}, "twice"),
            ({"trigger": [8, 5, 5]}, "two different"),
            ({"q_min_rad": HIGH}, "below"),
            ({"baud": None}, "whole"),
            ({"extra": 1}, "extra"),
        ):
            with self.assertRaisesRegex(mp.Refused, f"leader.json is not a calibration of a leader: .*{pattern}"):
                Calibration.load(self.file(json.dumps(good | wrong)))
        for text in ("", "[]", "{", "{}"):
            with self.assertRaisesRegex(mp.Refused, "Next: python -m multipanda.leader calibrate"):
                Calibration.load(self.file(text))


class Person:
    """Turns the joints as the dialogue asks; `deviation_rad` is how badly the pose is held."""

    def __init__(self, servos, deviation_rad=0.0, order=range(7)):
        self.servos, self.order, self.said = servos, list(order), []
        shown = np.radians([0, 0, 0, -90, 0, 90, 0]) + deviation_rad * np.array([1, -1, 1, -1, 1, -1, 1])
        pose(servos, shown[np.argsort(self.order)])
        self.slips = 1  # a first attempt that turns two joints

    def __call__(self, instruction):
        self.said.append(instruction)
        words = instruction.split()
        if words[0] == "Joint":
            k = self.order[int(words[1].rstrip(":")) - 1]
            self.servos.turn(k, 300)
            if self.slips and words[1] == "3:":
                self.slips = 0
                self.servos.turn(0, 290)
        elif words[0] == "Squeeze":
            self.servos.turn(7, SQUEEZED - FREE)


class Calibrating(Emulated):
    def check(self, found, servos):
        self.assertEqual(found.ids, list(range(1, 8)))
        self.assertEqual(found.signs, SIGNS)
        self.assertEqual(found.trigger, [8, FREE, SQUEEZED])
        self.assertLess(np.max(np.abs(np.array(found.q_min_rad) - LOW)), 1e-3)
        path = FOLDER / "found.json"
        found.save(path)
        pose(servos, READY)
        with LeaderArm(path, PATIENT_S) as leader:
            self.assertLess(np.max(np.abs(leader.read()[0] - READY)), 0.51 * COUNT)

    def test_a_pose_held_badly_gives_offsets_that_are_exact(self):
        servos, said = self.servos(), []
        person = Person(servos, 0.2)
        found = calibrate(servos.port, prompt=person, say=said.append)
        self.check(found, servos)
        self.assertIn("found servos 1, 2, 3, 4, 5, 6, 7, 8 at 57600 baud", said)
        self.assertTrue(any("turn this joint alone, once more" in line for line in said), said)  # it was
        self.assertEqual(len([line for line in person.said if line.startswith("Joint 3")]), 2)
        self.assertIn("the pose was held to 11 degrees of multiples of 90", said)

    def test_another_pose_is_refused_and_exact_takes_it(self):
        servos = self.servos()
        with self.assertRaisesRegex(mp.Refused, r"joint \d was 29 degrees from a multiple of 90"):
            calibrate(servos.port, prompt=Person(servos, 0.5), say=[].append)
        servos.offsets[1] += 500  # a horn between two teeth
        found = calibrate(servos.port, exact=True, prompt=Person(servos), say=[].append)
        self.check(found, servos)

    def test_the_numbers_of_the_servos_need_no_order(self):
        servos = self.servos()
        order = [2, 0, 1, 3, 6, 5, 4]
        found = calibrate(servos.port, prompt=Person(servos, order=order), say=[].append)
        self.assertEqual(found.ids, [k + 1 for k in order])
        self.assertEqual(found.signs, [SIGNS[k] for k in order])

    def test_too_few_servos(self):
        with self.assertRaisesRegex(mp.Refused, "found 5 servos, expected 7"):
            calibrate(self.servos(make=Servos, count=5).port, prompt=self.fail, say=[].append)

    def test_the_command(self):
        servos, path = self.servos(), FOLDER / "by_command.json"
        program = subprocess.Popen(
            [sys.executable, "-u", "-m", "multipanda.leader", "calibrate", servos.port, path],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        person, said = Person(servos), ""
        while letter := program.stdout.read(1):
            said += letter
            if said.endswith("Then press Enter."):
                person(said.rpartition("\n")[2].split("once more")[-1])
                said += "\n"
                program.stdin.write("\n")
                program.stdin.flush()
        program.stdin.close()
        program.stdout.close()
        self.assertEqual(program.wait(PATIENCE), 0, said)
        self.check(Calibration.load(path), servos)


class Pedals(unittest.TestCase):
    def pedal(self, keys=None):
        reader, self.writer = os.pipe2(os.O_DIRECT | os.O_CLOEXEC)
        pedal = Pedal(f"/proc/self/fd/{reader}", keys)
        os.close(reader)
        self.addCleanup(pedal.close)
        return pedal

    def test_presses_are_heard_once(self):
        pedal = self.pedal()
        self.assertEqual(pedal.read(), [])
        os.write(self.writer, event(A, 1, 10) + event(A, 2, 11) + event(A, 0, 12))  # pressed, repeats, let go
        os.write(self.writer, event(99, 1, 12) + event(C, 1, 13) + event(C, 1, 13) + event(B, 1, 13))
        self.assertEqual(pedal.read(), ["start", "discard", "failure"])
        os.write(self.writer, b"\xff" * 5)
        self.assertEqual(pedal.read(), [])
        os.close(self.writer)
        with self.assertRaisesRegex(mp.Disconnected, "the pedal .* is gone"):
            pedal.read()

    def test_a_keyboard_that_was_taken_for_a_pedal_still_ends_the_program(self):
        for key in (29, 97, 1):  # Ctrl, right Ctrl, Esc; the C of Ctrl-C would only discard an episode
            pedal = self.pedal()
            os.write(self.writer, event(key, 1, 1) + event(C, 1, 1))
            with self.assertRaisesRegex(mp.Disconnected, "is a keyboard, not a pedal"):
                pedal.read()
            os.close(self.writer)

    def test_keys_of_ones_own(self):
        pedal = self.pedal({2: "success"})
        os.write(self.writer, event(A, 1, 1) + event(2, 1, 2))
        self.assertEqual(pedal.read(), ["success"])
        os.close(self.writer)
        with self.assertRaisesRegex(ValueError, "expected start, success"):
            Pedal("/dev/null", {2: "begin"})
        with self.assertRaisesRegex(mp.Disconnected, "Next: let users read it"):
            Pedal(FOLDER / "nothing")

    def test_marks(self):
        said = []
        with mp.run("one_arm", timeline=False, record=FOLDER / "episodes") as run:
            marks = Marks(run, said.append)
            for mark in ("failure", "start", "start", "start", "failure", "start", "discard", "start", "start",
                         "discard", "discard", "start"):  # fmt: skip
                marks.take(mark)
            marks.end()
        outcomes = [(each.number, each.outcome) for each in mp.read_log(run.log).episodes]
        self.assertEqual(outcomes, [(1, "success"), (2, "failure"), (3, "discard"), (4, "discard"), (5, "discard")])
        self.assertIn("no episode is under way: failure is ignored", said)
        self.assertEqual(said[1:3], ["episode 1 begins", "episode 1: success"])


def scene():
    """Two FR3 that are held; the left one's fingers move. Streams may be silent for longer than any test is late."""
    text = [
        ("active: [left_cartesian, right_cartesian]\n", ""),
        ("duration_s: 12", "duration_s: 0"),
        ("    hand: true\n    base: {position_m: [0, 0.26", "    fingers: movable\n    base: {position_m: [0, 0.26"),
    ]
    for arm in ("left", "right"):
        line = f"{arm}_joint, type: joint_impedance, arms: {arm}"
        text.append((line, f"{line}, inputs: {{joints: {{timeout_s: {PATIENT_S}}}}}"))
    return edited("two_fr3", "led", *text)


class Driven:
    """A run whose arms follow emulated leaders, by a thread."""

    def __init__(self, run, leaders, pedal=None):
        self.run, self.said, self.error = run, [], None
        arms, files = list(leaders), {arm: calibration(servos) for arm, servos in leaders.items()}
        hands = [arm for arm in arms if arm == "left"]
        self.robot = ArmsRobot(
            RobotSettings(socket=str(run.connection.path), arms=arms, grippers=hands, max_jump_rad=0.6)
        )
        self.leader = ServoLeader(ServoLeaderSettings(arms=arms, files=files, grippers=hands, silence_s=PATIENT_S / 2))
        self.robot.connect()
        self.leader.connect()
        self.thread = threading.Thread(target=self._drive, args=(pedal,))
        self.thread.start()

    def _drive(self, pedal):
        try:
            drive(self.robot, self.leader, pedal, say=self.said.append)
        except Exception as error:
            self.error = error

    def wait_for(self, condition, what):
        def found():
            if self.robot.silences:
                raise Silent
            return condition() or self.error

        until(found, what)
        if self.error is not None:
            if "within" in str(self.error) and "jumped" not in what:
                raise Silent  # nobody served the emulator for a while
            raise self.error

    def follows(self, times=1):
        self.wait_for(lambda: self.said.count("the arms follow") >= times, f"{times} beginnings: {self.said}")

    def ended(self):
        until(lambda: not self.thread.is_alive(), "the end")
        return self.error

    def close(self):
        self.leader.disconnect()  # ends the thread
        self.thread.join(PATIENCE)
        assert not self.thread.is_alive()
        self.robot.disconnect()


class Driving(Emulated):
    @contextlib.contextmanager
    def driven(self, *arms, at=READY, trigger=FREE, pedal=None, record=None):
        leaders = {arm: self.servos() for arm in arms}
        for servos in leaders.values():
            pose(servos, at, trigger)
        with mp.run(scene(), timeline=False, record=record) as run:
            driven = Driven(run, leaders, pedal)
            try:
                yield driven, *leaders.values()
            finally:
                driven.close()

    def apart(self, driven, arm, q_rad):
        return np.max(np.abs(driven.run.arms[arm].state.q_rad - q_rad))

    def guide(self, driven, servos, start, goal):
        """Moves a leader as fast as it is read: 4 rad/s and more, without jumps."""
        for share in np.linspace(0, 1, 41):
            pose(servos, start + share * (goal - start))
            reads = servos.reads
            driven.wait_for(lambda: servos.reads > reads + 1, "a reading")

    def assert_held(self, driven, *arms):
        for arm in arms:
            until(lambda: driven.run.arms[arm].state.held, "hold")
            if driven.run.arms[arm].state.last_intervention == "reference_stale":
                raise Silent  # held by the run, not by the leader's client

    @streaming
    def test_two_arms_go_to_their_leaders_and_the_trigger_closes_the_fingers(self):
        with self.driven("left", "right") as (driven, left, right):
            driven.follows()
            one = READY + np.array([0.3, 0.2, -0.2, 0.3, 0.2, -0.3, 0.4])
            other = READY - np.array([0.2, 0.1, 0.1, 0.2, 0.3, 0.2, -0.3])
            for share in np.linspace(0.1, 1, 10):  # a hand moves it: no jumps
                pose(left, READY + share * (one - READY), FREE + share * (SQUEEZED - FREE) / 2)
                pose(right, READY + share * (other - READY))
                driven.wait_for(lambda: self.apart(driven, "left", READY + share * (one - READY)) < 0.05, "left")
                driven.wait_for(lambda: self.apart(driven, "right", READY + share * (other - READY)) < 0.05, "right")
            driven.wait_for(lambda: self.apart(driven, "left", one) < 0.01, "the left arm arrives")
            driven.wait_for(lambda: self.apart(driven, "right", other) < 0.01, "the right arm arrives")
            driven.wait_for(lambda: abs(driven.run.arms["left"].state.gripper.width_m - 0.04) < 3e-3, "fingers at half")
            self.assertFalse(driven.run.arms["left"].state.held)
            driven.close()
            self.assert_held(driven, "left", "right")
            self.assertLess(np.max(np.abs(driven.run.arms["left"].state.q_rad - one)), 0.02)

    @streaming
    def test_nothing_moves_until_the_leader_is_near_and_still(self):
        away = READY + np.array([0, 0, 0, 0.6, 0, 0, 0])
        with self.driven("left", at=away) as (driven, servos):
            driven.wait_for(lambda: driven.said, "a line about the joint")
            self.assertRegex(driven.said[0], r"left: joint 4 of the leader is \+0.60 rad from the arm's: bring it")
            start = driven.run.arms["left"].state.q_rad
            reads = servos.reads
            driven.wait_for(lambda: servos.reads > reads + 300, "two seconds and more")
            self.assertTrue(driven.run.arms["left"].state.held)
            self.assertLess(np.max(np.abs(driven.run.arms["left"].state.q_rad - start)), 1e-3)
            near = READY + np.array([0, 0, 0, 0.25, 0, 0, 0])
            began = driven.run.state().t_s
            fastest = 0.0
            self.guide(driven, servos, away, near)

            def there():
                nonlocal fastest
                fastest = max(fastest, np.max(np.abs(driven.run.arms["left"].state.dq_rad_per_s)))
                return self.apart(driven, "left", near) < 0.01

            driven.wait_for(there, "the arm goes to the leader")
            self.assertGreater(driven.run.state().t_s - began, 1.0)
            self.assertLess(fastest, 0.6)  # the input's 0.5 rad/s and the spring's overshoot
            self.assertGreater(fastest, 0.05)

    @streaming
    def test_fingers_do_not_move_as_following_begins(self):
        with self.driven("left", trigger=SQUEEZED) as (driven, servos):
            driven.wait_for(
                lambda: any("the trigger is -80 mm from the fingers' 80 mm" in s for s in driven.said), "why"
            )
            reads = servos.reads
            driven.wait_for(lambda: servos.reads > reads + 300, "two seconds and more")
            self.assertTrue(driven.run.arms["left"].state.held)
            self.assertAlmostEqual(driven.run.arms["left"].state.gripper.width_m, 0.08, delta=1e-3)
            for share in np.linspace(0, 1, 41):
                pose(servos, READY, SQUEEZED + share * (FREE - SQUEEZED))
                reads = servos.reads
                driven.wait_for(lambda: servos.reads > reads + 1, "a reading")
            driven.follows()

    @streaming
    def test_a_leader_far_ahead_holds_the_arm_until_it_is_near_again(self):
        with self.driven("left") as (driven, servos):
            driven.follows()
            far = READY + np.array([1.2, 0, 0, 0, 0, 0, 0])
            self.guide(driven, servos, READY, far)
            driven.wait_for(lambda: any("are held: joint 1 of 'left'" in line for line in driven.said), "hold")
            self.assert_held(driven, "left")
            self.guide(driven, servos, far, driven.run.arms["left"].state.q_rad)
            driven.follows(2)

    def fault(self, make, pattern, arms=("left",), kind=mp.Disconnected):
        """Something happens to the first leader while arms follow: they are held at once, with a message."""

        @streaming
        def tried(self):
            with self.driven(*arms) as (driven, servos, *_):
                driven.follows()
                self.assertFalse(driven.run.arms["left"].state.held)
                make(driven, servos)
                error = driven.ended()
                if "within" in str(error) and "within" not in pattern:
                    raise Silent
                self.assertIsInstance(error, kind)
                self.assertRegex(str(error), pattern)
                self.assert_held(driven, *arms)
                for arm in arms:
                    self.assertLess(self.apart(driven, arm, READY), 0.05)

        tried(self)

    def test_unplugged(self):
        self.fault(lambda driven, servos: servos.unplug(), "is gone", arms=("left", "right"))

    def test_garbage(self):
        def babbles(driven, servos):
            servos.silent, servos.babble = set(servos.tables), os.urandom(200)

        self.fault(babbles, "servo 1 .* (answers garbage|does not answer)")

    def test_a_servo_that_does_not_answer(self):
        self.fault(lambda driven, servos: servos.silent.add(6), "servo 6 .* does not answer")

    def test_a_hardware_error(self):
        self.fault(lambda driven, servos: servos.alerts.update({4: 0x20}), "servo 4 .* hardware error: overload")

    def test_a_jump(self):
        def jumps(driven, servos):
            servos.turn(1, TURN // 2)

        self.fault(jumps, "servo 2 of the leader jumped by .* within|joint 2 of 'left'")

    def test_a_stop(self):
        self.fault(lambda driven, servos: driven.run.stop(), "'left' is stopped", kind=mp.Refused)

    @streaming
    def test_a_joint_that_rests_while_others_move_is_no_fault(self):
        with self.driven("left") as (driven, servos):
            driven.follows()
            goal = READY + np.array([0, 0, 0, 0, 0, 0.2, 0.2])
            pose(servos, goal)
            driven.wait_for(lambda: self.apart(driven, "left", goal) < 0.01, "the arm arrives")

    @streaming
    def test_pedals_mark_what_was_driven(self):
        reader, writer = os.pipe2(os.O_DIRECT | os.O_CLOEXEC)
        with contextlib.ExitStack() as stack:
            pedal = stack.enter_context(Pedal(f"/proc/self/fd/{reader}"))
            os.close(reader)
            with self.driven("left", pedal=pedal, record=FOLDER / "pedal") as (driven, servos):
                driven.follows()
                for at_s, (key, line) in enumerate(((A, "1 begins"), (A, "1: success"), (A, "2 begins"))):
                    os.write(writer, event(key, 1, at_s))
                    driven.wait_for(lambda: f"episode {line}" in driven.said, line)
                os.close(writer)  # unplugged
                self.assertRegex(str(driven.ended()), "the pedal .* is gone")
                self.assert_held(driven, "left")
        outcomes = [each.outcome for each in mp.read_log(driven.run.log).episodes]
        self.assertEqual(outcomes, ["success", "discard"])  # what nobody has judged does not count

    @contextlib.contextmanager
    def command(self, run, servos):
        program = subprocess.Popen(
            [sys.executable, "-u", "-m", "multipanda.leader", "drive", calibration(servos), "--arms", "left"],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        try:
            said = ""
            while "the arms follow" not in said:
                line = program.stdout.readline()
                if not line:
                    raise Silent if "does not answer" in (why := program.stderr.read()) else AssertionError(said + why)
                said += line
            until(lambda: not run.arms["left"].state.held, "following")
            yield program
        finally:
            program.kill()
            program.communicate()

    @streaming
    def test_the_command_and_its_end_by_every_signal(self):
        for number in (signal.SIGKILL, signal.SIGINT):
            servos = self.servos()
            pose(servos, READY)
            with mp.run(scene(), timeline=False) as run, self.command(run, servos) as program:
                program.send_signal(number)
                until(lambda: run.arms["left"].state.held, "hold")
                self.assertEqual(program.wait(PATIENCE), 130 if number == signal.SIGINT else -number)
                self.assertLess(np.max(np.abs(run.arms["left"].state.q_rad - READY)), 0.02)

    @streaming
    def test_the_command_s_message(self):
        servos = self.servos()
        pose(servos, READY)
        with mp.run(scene(), timeline=False) as run, self.command(run, servos) as program:
            servos.unplug()
            self.assertEqual(program.wait(PATIENCE), 1)
            said = program.stderr.read()
            self.assertRegex(said, r"the arms are held: the leader at /dev/pts/\d+ is gone")
            self.assertNotIn("Traceback", said)
            until(lambda: run.arms["left"].state.held, "hold")


if __name__ == "__main__":
    harness.main()
