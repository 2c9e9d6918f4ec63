#!/usr/bin/env python3
"""A SpaceMouse leads a hand: its reports through a pipe, and the real program behind."""

import contextlib
import math
import os
import pathlib
import tempfile
import threading
import time
import unittest

import harness  # first: it sets the paths
import multipanda as mp
import numpy as np
from harness import FOLDER, PATIENCE, ROOT, Silent, streaming, until
from multipanda.jog import force_limited, jogged, shaped
from multipanda.space_mouse import Grip, find_space_mouse
from space_mouse_device import Device, buttons, motion

AWAY = (0, -350, 0, 0, 0, 0)  # the device's y is towards the operator
DOWN = (0, 0, 350, 0, 0, 0)
FULL = np.array([1.0, 0, 0, 0, 0, 0])
NOTHING = np.zeros(6)


def scene():
    """one_arm without a timeline; silence of this computer may last 0.6 s, so what holds sooner is the device."""
    text = (ROOT / "config/scenes/one_arm.yaml").read_text(encoding="utf-8").partition("\ntimeline:")[0]
    text = text.replace("duration_s: 10", "duration_s: 0")
    changed = text.replace("pose: {max_speed", "pose: {timeout_s: 0.6, max_speed")
    assert changed != text
    path = FOLDER / "teleop.yaml"
    path.write_text(changed, encoding="utf-8")
    return path


class Mouse(mp.SpaceMouse):
    """Tells when jog() leads: what is down in the first 150 ms is old, and moves nothing."""

    def __init__(self, device):
        super().__init__(device)
        self.waits, self.begun_s = threading.Event(), None

    def read(self, timeout_s=0):
        if timeout_s > 0:
            self.begun_s = self.begun_s or time.monotonic()
            if time.monotonic() - self.begun_s > 0.2:
                self.waits.set()
        return super().read(timeout_s)


class Led:
    """A run whose hand a device leads, by a thread that ends with the device."""

    def __init__(self, run, device, **options):
        self.run, self.device, self.said, self.error = run, device, [], None
        self.arm, self.law = run.arms["arm"], run["cartesian"]
        self.mouse = Mouse(device.path)
        self.thread = threading.Thread(target=self._jog, args=(options,))
        self.thread.start()
        assert self.mouse.waits.wait(PATIENCE)

    def _jog(self, options):
        try:
            self.mouse.jog(self.law, say=self.said.append, **options)
        except mp.Error as error:
            self.error = error

    def wait_for(self, condition, what):
        """Waits for it, unless this computer was too busy to play a device."""

        def found():
            if self.device.was_late:
                raise Silent
            return condition()

        until(found, what)

    def wait_for_move(self, start, distance_m):
        def moved():
            return np.linalg.norm(self.arm.state.pose.position_m - start.position_m) > distance_m

        self.wait_for(moved, f"{distance_m} m")

    def wait_for_hold(self):
        until(lambda: self.arm.state.held, "hold")
        if self.arm.state.last_intervention == "reference_stale":
            raise Silent  # held by silence of the stream, not by the device


@contextlib.contextmanager
def led(device=None, **options):
    with mp.run(scene()) as run:
        device = device or Device()
        led = Led(run, device, **options)
        try:
            yield led
        finally:
            device.close()
            led.thread.join(PATIENCE)
            led.mouse.close()
            assert not led.thread.is_alive()


class Reports(unittest.TestCase):
    def setUp(self):
        self.device = Device()
        self.mouse = mp.SpaceMouse(self.device.path)

    def tearDown(self):
        self.mouse.close()
        self.device.close()

    def take(self, *reports):
        for report in reports:
            self.mouse._take(report)
        return self.mouse.deflection.tolist(), self.mouse.buttons

    def test_both_kinds_of_devices(self):
        for two in (False, True):
            at, _ = self.take(*motion((350, -175, 70, -350, 35, 700), two))
            self.assertEqual(at, [1, 0.5, -0.2, -1, -0.1, -1])
            self.take(*motion((0, 0, 0, 0, 0, 0), two))

    def test_translation_alone_leaves_the_rotation(self):
        self.take(*motion((0, 0, 0, 350, 0, 0), True))
        self.assertEqual(self.take(motion((350, 0, 0, 0, 0, 0), True)[0])[0], [1, 0, 0, 1, 0, 0])

    def test_what_is_not_understood_changes_nothing(self):
        before = self.take(*motion((350, 0, 0, 0, 0, 0)), buttons(3))
        self.assertEqual(before[1], 3)
        self.assertEqual(self.take(b"\x01\x02", b"\x02", b"\x03", b"\x17\x01\x02\x03\x04\x05\x06\x07"), before)

    def test_each_report_is_read_by_itself_until_it_is_unplugged(self):
        self.device.press(1)
        self.device.press(2)
        self.assertTrue(self.mouse.read(PATIENCE))
        self.assertEqual(self.mouse.buttons, 1)
        self.assertTrue(self.mouse.read(PATIENCE))
        self.assertEqual(self.mouse.buttons, 2)
        self.assertFalse(self.mouse.read(0.001))
        self.device.unplug()
        with self.assertRaisesRegex(mp.Disconnected, "gone"):
            self.mouse.read(PATIENCE)
        self.mouse.close()
        with self.assertRaises(mp.Disconnected):
            self.mouse.read()


class Finding(unittest.TestCase):
    def tree(self, *devices):
        root = pathlib.Path(tempfile.mkdtemp(dir=FOLDER))
        for k, (identity, name, descriptor) in enumerate(devices):
            folder = root / f"hidraw{k}" / "device"
            folder.mkdir(parents=True)
            (folder / "uevent").write_text(f"DRIVER=hid-generic\nHID_ID={identity}\nHID_NAME={name}\n")
            (folder / "report_descriptor").write_bytes(bytes.fromhex(descriptor))
        return root

    def test_the_axes_of_a_space_mouse_and_of_nothing_else(self):
        axes, keys = "05010908a101", "05010906a101"
        mouse = ("0003:0000046D:0000C077", "Logitech USB Optical Mouse", axes)
        keyboard = ("0003:0000256F:0000C652", "3Dconnexion Universal Receiver", keys)
        receiver = ("0003:0000256F:0000C652", "3Dconnexion Universal Receiver", axes)
        older = ("0003:0000046D:0000C626", "3Dconnexion SpaceNavigator", axes)
        self.assertEqual(str(find_space_mouse(self.tree(mouse, keyboard, receiver))), "/dev/hidraw2")
        self.assertEqual(str(find_space_mouse(self.tree(mouse, older))), "/dev/hidraw1")
        for none in (self.tree(mouse, keyboard), self.tree()):
            with self.assertRaisesRegex(mp.Disconnected, "plugged in"):
                find_space_mouse(none)
        with self.assertRaisesRegex(mp.Disconnected, "udev"):
            mp.SpaceMouse(FOLDER / "missing")


class Holding(unittest.TestCase):
    def test_by_the_button_while_the_cap_may_rest(self):
        grip = Grip(False)
        grip.take(FULL, 0, 0)
        self.assertFalse(grip.held)
        grip.take(NOTHING, 1, 1)
        grip.look(5)
        self.assertTrue(grip.held)
        grip.take(NOTHING, 0, 6)
        self.assertFalse(grip.held)

    def test_silence_of_a_deflected_cap_needs_a_new_press(self):
        grip = Grip(False)
        grip.take(FULL, 1, 0)
        grip.look(0.149)
        self.assertTrue(grip.held)
        grip.look(0.151)
        self.assertFalse(grip.held)
        grip.take(FULL, 1, 0.2)  # it is there again, with the button still down
        self.assertFalse(grip.held)
        grip.take(FULL, 0, 0.3)
        grip.take(FULL, 1, 0.4)
        self.assertTrue(grip.held)

    def test_a_button_of_which_nothing_is_heard_is_not_believed_for_long(self):
        grip = Grip(False)
        grip.take(NOTHING, 1, 0)
        grip.look(11)
        grip.take(FULL, 1, 11)
        self.assertFalse(grip.held)

    def test_by_the_cap(self):
        grip = Grip(True)
        grip.take(FULL, 0, 0)
        self.assertTrue(grip.held)
        grip.take(NOTHING, 0, 0.1)
        self.assertFalse(grip.held)

    def test_a_button_that_was_down_before_holds_nothing(self):
        grip = Grip(False, 1)
        grip.take(FULL, 1, 0)
        self.assertFalse(grip.held)


class Reading(unittest.TestCase):
    def test_a_release_behind_many_reports_is_read_before_the_next_step(self):
        device = Device()
        self.addCleanup(device.unplug)
        with mp.SpaceMouse(device.path) as mouse:
            grip = Grip(False)
            grip.take(FULL, 1, time.monotonic())
            self.assertTrue(grip.held)
            for report in [*motion(AWAY) * 12, buttons(0)]:
                os.write(device._writer, report)
            grip.read(mouse)
            self.assertFalse(grip.held)

    def test_who_has_not_looked_for_long_needs_a_new_press(self):
        grip = Grip(False)
        grip.take(FULL, 1, 0.0)
        grip.lose()
        grip.take(FULL, 1, 0.1)
        self.assertFalse(grip.held)
        grip.take(FULL, 0, 0.2)
        grip.take(FULL, 1, 0.3)
        self.assertTrue(grip.held)


class Limits(unittest.TestCase):
    def test_shape(self):
        self.assertEqual(shaped([0.1, -0.12, 1, -1, 2, 0]).tolist(), [0, 0, 1, -1, 1, 0])
        self.assertLess(shaped([0.5])[0], 0.5)

    def test_force(self):
        down = np.array([0, 0, -0.1])
        for pressed, left in ((4, 1), (5, 1), (7.5, 0.5), (10, 0), (40, 0)):
            got = force_limited(down + [0.1, 0, 0], np.array([0, 0, -pressed]), 10)
            np.testing.assert_allclose(got, [0.1, 0, -0.1 * left], atol=1e-12)
        np.testing.assert_allclose(force_limited(-down, np.array([0, 0, -40]), 10), -down)  # away is free

    def test_speed_and_lead(self):
        hand = mp.Pose(np.array([0.4, 0, 0.5]), np.array([0.0, 1, 0, 0]))
        limits = mp.JogLimits(speed_m_per_s=0.2, turn_rad_per_s=0.5, lead_m=0.03, lead_rad=0.1)
        twist = np.array([1.0, 1, 0, 0, 0, 1])  # more than full along the diagonal
        target = jogged(hand, twist, 0.05, hand, np.zeros(3), limits)
        self.assertAlmostEqual(np.linalg.norm(target.position_m - hand.position_m), 0.01)
        turned = target.rotation @ hand.rotation.T
        self.assertAlmostEqual(math.atan2(turned[1, 0], turned[0, 0]), 0.025)
        self.assertEqual(jogged(hand, twist, 5, hand, np.zeros(3), limits).values.tolist(), target.values.tolist())
        for _ in range(20):
            target = jogged(target, twist, 0.05, hand, np.zeros(3), limits)
        self.assertAlmostEqual(np.linalg.norm(target.position_m - hand.position_m), 0.03)
        self.assertAlmostEqual(target.angle_to(hand), 0.1)
        with self.assertRaisesRegex(ValueError, "force_n"):
            mp.JogLimits(force_n=0)


class Leading(unittest.TestCase):
    def setUp(self):
        pass

    @streaming
    def test_moves_while_the_button_is_held_and_not_otherwise(self):
        with led() as jog:
            start = jog.arm.state.pose
            jog.device.push(*AWAY)
            time.sleep(0.4)  # without the button
            self.assertLess(np.linalg.norm(jog.arm.state.pose.position_m - start.position_m), 1e-3)
            self.assertEqual(jog.run.ask({"do": "channels"})["channels"], [])
            jog.device.press(1)
            jog.wait_for_move(start, 0.06)
            jog.device.press(0)
            jog.wait_for_hold()
            rows = jog.run.history(2)
            way, t_ns = rows["arm/position_m"], rows["t_ns"].ravel()
            moved = way[-1] - start.position_m
            self.assertLess(np.linalg.norm(moved[1:]), 5e-3, "away is the base's x")
            # From the 5th to the 50th millimeter: 0.1 m/s, and what the hand makes up for the lag of its set-point.
            far = np.linalg.norm(way - start.position_m, axis=1)
            speed = 0.045e9 / float(t_ns[np.argmax(far > 0.05)] - t_ns[np.argmax(far > 0.005)])
            self.assertLess(speed, 0.12)
            self.assertGreater(speed, 0.06)
            at_hold = jog.arm.state.pose
            time.sleep(0.4)  # the cap is still deflected
            self.assertLess(np.linalg.norm(jog.arm.state.pose.position_m - at_hold.position_m), 0.01)
            self.assertTrue(jog.arm.state.held)
            # The next press goes on from there.
            jog.device.push(350, 0, 0, 0, 0, 0)  # right
            jog.device.press(1)
            before = jog.arm.state.pose
            jog.wait_for_move(before, 0.03)
            self.assertLess(jog.arm.state.pose.position_m[1], before.position_m[1] - 0.02)
            jog.device.press(0)
            jog.wait_for_hold()
            self.assertEqual(jog.said, [])

    @streaming
    def test_turns_by_an_older_device(self):
        with led(Device(two_reports=True)) as jog:
            start = jog.arm.state.pose
            jog.device.press(1)
            jog.device.push(0, 0, 0, 0, 0, -350)  # the device's z is down: counterclockwise seen from above
            jog.wait_for(lambda: jog.arm.state.pose.angle_to(start) > 0.2, "turn")
            turned = jog.arm.state.pose.rotation @ start.rotation.T
            self.assertGreater(math.atan2(turned[1, 0], turned[0, 0]), 0.15)
            self.assertLess(np.linalg.norm(jog.arm.state.pose.position_m - start.position_m), 0.01)
            jog.device.press(0)
            jog.wait_for_hold()

    @streaming
    def test_the_cap_alone_if_it_was_chosen(self):
        with led(cap_holds=True) as jog:
            start = jog.arm.state.pose
            jog.device.push(*AWAY)
            jog.wait_for_move(start, 0.03)
            jog.device.let_cap_go()
            jog.wait_for_hold()

    @streaming
    def test_silence_and_unplugging_hold(self):
        with led() as jog:
            start = jog.arm.state.pose
            jog.device.push(*AWAY)
            jog.device.press(1)
            jog.wait_for_move(start, 0.02)
            jog.device.silent = True
            jog.wait_for_hold()
            jog.device.silent = False  # the button is still down
            time.sleep(0.3)
            self.assertTrue(jog.arm.state.held)
            jog.device.press(0)
            jog.device.press(1)
            jog.wait_for(lambda: not jog.arm.state.held, "a new press")
            jog.device.unplug()
            jog.wait_for_hold()
            jog.thread.join(PATIENCE)
            self.assertIsInstance(jog.error, mp.Disconnected)
            self.assertIn("gone", str(jog.error))

    @streaming
    def test_the_other_button_stops_until_somebody_resumes(self):
        with led() as jog:
            start = jog.arm.state.pose
            jog.device.push(*AWAY)
            jog.device.press(1)
            jog.wait_for_move(start, 0.02)
            jog.device.press(3)
            until(lambda: jog.arm.state.stopped, "stop")
            jog.device.press(0)
            jog.device.press(1)
            until(lambda: jog.said, "refusal")
            self.assertIn("resume", jog.said[0])
            jog.device.press(0)
            self.assertTrue(jog.arm.state.held)
            jog.arm.resume()
            jog.device.press(1)
            jog.wait_for(lambda: not jog.arm.state.held, "motion after resume()")
            jog.device.press(0)
            jog.wait_for_hold()

    @streaming
    def test_another_owner_keeps_its_arm(self):
        with led() as jog:
            jog.run.switch("joint")
            jog.device.push(*AWAY)
            jog.device.press(1)
            until(lambda: jog.said, "refusal")
            self.assertIn("joint", jog.said[0])
            self.assertEqual(jog.arm.state.controllet, "joint")

    @streaming
    def test_presses_no_harder_than_it_may(self):
        limit = 10  # [N]; the lead alone would let the spring press with 0.04 m * 600 N/m = 24 N
        with led(limits=mp.JogLimits(force_n=limit)) as jog:
            start = jog.arm.state.pose
            over_table = mp.Pose(np.array([0.5, 0.25, 0.26]), start.quaternion_wxyz)
            jog.law.goal("pose", over_table).wait()
            jog.device.push(*DOWN)
            jog.device.press(1)
            jog.wait_for(lambda: np.linalg.norm(jog.arm.state.wrench_n_nm[:3]) > limit / 2, "contact")
            begin = jog.run.state().t_s
            jog.wait_for(lambda: jog.run.state().t_s > begin + 2, "2 s in contact")
            self.assertFalse(jog.arm.state.held)
            force = np.linalg.norm(jog.run.history(1)["arm/wrench_n_nm"][:, :3], axis=1)
            self.assertLess(force.max(), 1.3 * limit)
            self.assertGreater(force.min(), 0.4 * limit)
            jog.device.press(0)
            jog.wait_for_hold()

    def test_arguments_are_checked(self):
        device = Device()
        with mp.run(scene()) as run, mp.SpaceMouse(device.path) as mouse:
            for law, options, expected in (
                ("cartesian", {"axes": "camera"}, "base or hand"),
                ("cartesian", {"rate_hz": 5}, "20 to 200"),
                ("joint", {"name": "joints"}, "commands a pose"),
            ):
                with self.assertRaisesRegex(ValueError, expected):
                    mouse.jog(run[law], **options)
            with self.assertRaises(mp.Refused):
                mouse.jog(run["cartesian"], "nowhere")
            mouse.jog(run["cartesian"], seconds=0.1)
        device.close()


if __name__ == "__main__":
    harness.main()
