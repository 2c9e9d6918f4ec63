#!/usr/bin/env python3
"""multipanda_native: worlds are the program's run to the bit; saving, restoring, batches, refusals, views."""

import gc
import pickle
import re
import subprocess
import sys
import threading
import unittest

import harness  # first: it sets the paths
import multipanda as mp
import multipanda_native as native
import numpy as np

sys.path.insert(0, str(harness.ROOT / "tools"))
import arm_fields

SCENES = harness.ROOT / "config/scenes"
ARMS = ("left", "right")
QUANTITIES = ("q_rad", "dq_rad_per_s", "tau_J_nm", "F_K_W_true", "F_K_W_est")


def noisy_scene():
    """Two arms, turned and off the origin, with noise, delay and friction."""
    text = (SCENES / "two_arms.yaml").read_text()
    text = text.replace("duration_s: 20", "duration_s: 20\nseed: 7\nplant: {fidelity: realistic}")
    path = harness.FOLDER / "noisy_arms.yaml"
    path.write_text(text)
    return path


def numbers(world):
    """All that a world shows, as one array."""
    arms = [getattr(arm, name) for arm in world.arms.values() for name in (*QUANTITIES, "X_WE", "gripper", "held")]
    return np.concatenate([np.ravel(part) for part in [*arms, *world.objects.values()]])


def told(world, random):
    """Random commands: set-points, parameters, switches, features, pushes, stop buttons."""
    side = ARMS[random.integers(2)]
    kind = random.integers(6)
    if kind == 0 and f"{side}_cartesian" in world.active:
        pose = world.arms[side].X_WE.copy()
        pose[:3] += random.uniform(-0.05, 0.05, 3)
        world.goal(f"{side}_cartesian", "pose", pose, duration_s=0.4)
    elif kind == 1:
        world.parameter(f"{side}_cartesian", "translational_stiffness_n_per_m", random.uniform(100, 400, 3))
    elif kind == 2:
        world.switch(
            [["dual"], ["left_cartesian", "right_cartesian"], ["left_guide", "right_joint"]][random.integers(3)]
        )
    elif kind == 3:
        world.feature(f"{side}_cartesian", "joint_limits", bool(random.integers(2)))
    elif kind == 4:
        world.push("box", random.uniform(-3, 3, 3), duration_s=0.1)
    else:
        world.user_stop(side, bool(random.integers(2)))


class Bits(unittest.TestCase):
    def test_a_world_is_the_run_of_the_program(self):
        """Five seconds with the scene's timeline: goals of both arms, a switch, noise. Every cycle, to the bit."""
        scene = noisy_scene()
        mp.play(scene, seconds=5, record=harness.FOLDER / "native_run")
        (folder,) = (harness.FOLDER / "native_run").iterdir()
        log = mp.read_log(folder)
        world = native.World(scene)
        logged = {
            one.name: f"{topic}/{one.message}"
            for one in arm_fields.fields((harness.ROOT / arm_fields.HEADER).read_text())
            for topic in [{"ArmState": "state", "ArmCommand": "command"}.get(one.log)]
            if topic and f"left/{topic}/{one.message}" in log
        }
        self.assertGreater(len(logged), 15)
        seen = {(arm, name): [] for arm in ARMS for name in logged}
        for cycle in range(5000):
            if cycle > 0:
                world.step()
            for (arm, name), values in seen.items():
                values.append(world.arms[arm][name].copy())
        self.assertEqual(world.cycles, 5000)
        self.assertEqual(sorted(world.active), ["left_cartesian", "right_joint"])
        for (arm, name), values in seen.items():
            of_log = np.asarray(log[f"{arm}/{logged[name]}"]).reshape(5000, -1)
            np.testing.assert_array_equal(np.array(values), of_log, f"{arm} {name}")
        self.assertGreater(np.abs(np.diff(seen["left", "q_rad"], axis=0)).max(), 1e-5)

    def test_a_batch_is_its_worlds(self):
        scene = noisy_scene()
        batch = native.Batch(scene, 3, threads=2)
        seeds = np.array([11, 12, 13])
        batch.reset(seeds, hidden=True)
        pose = np.tile([0.4, 0.2, 0.5, 0, 1, 0, 0], (3, 1))
        pose[:, 2] += [0, 0.02, 0.04]
        batch.goal("left_cartesian", "pose", pose, duration_s=0.3)
        batch.step(300)
        for k in range(3):
            world = native.World(scene, seed=int(seeds[k]), hidden=True)
            world.goal("left_cartesian", "pose", pose[k], duration_s=0.3)
            world.step(300)
            for arm in ARMS:
                np.testing.assert_array_equal(batch.arms[arm].q_rad[k], world.arms[arm].q_rad)
                np.testing.assert_array_equal(batch.arms[arm].tau_J_nm[k], world.arms[arm].tau_J_nm)
            np.testing.assert_array_equal(batch.objects["box"][k], world.objects["box"])
        self.assertEqual(len(np.unique(batch.arms["left"].q_rad[:, 0])), 3)


class Saved(unittest.TestCase):
    def test_restored_worlds_go_on_to_the_bit(self):
        """Random commands, saved in the middle; the continuation in the same world, in another one, in a batch, and in
        another process."""
        scene = noisy_scene()
        for seed in range(1, 4 if harness.os.environ.get("MULTIPANDA_FULL") != "1" else 31):
            random = np.random.default_rng(seed)
            world = native.World(scene, seed=seed, hidden=bool(seed % 2))
            for _ in range(12):
                told(world, random)
                try:
                    world.step(int(random.integers(1, 90)))
                except mp.Refused:
                    pass  # such as a feature that is already so: a part of what happened
            told(world, random)  # waits for the next cycle
            saved, here = world.save(), numbers(world)
            again = np.random.default_rng(99)
            state = again.bit_generator.state

            def continued(one, again=again, state=state):
                again.bit_generator.state = state
                for _ in range(3):
                    told(one, again)
                    try:
                        one.step(60)
                    except mp.Refused:
                        pass
                return numbers(one)

            first = continued(world)
            self.assertFalse(np.array_equal(first, here))
            world.restore(saved)
            np.testing.assert_array_equal(numbers(world), here)
            np.testing.assert_array_equal(continued(world), first)
            other = native.World(scene, seed=77)
            other.restore(pickle.loads(pickle.dumps(saved)))
            self.assertEqual(other.cycles + 180, world.cycles)
            np.testing.assert_array_equal(continued(other), first)
            batch = native.Batch(scene, 2)
            batch.reset([5, 6])
            batch.restore(1, saved)
            np.testing.assert_array_equal(batch.arms["right"].q_rad[1], here_of(here, world, "right"))
        path = harness.FOLDER / "saved.bin"
        path.write_bytes(saved)
        program = (
            "import sys, pathlib, multipanda_native as n; w = n.World(sys.argv[1]);"
            "w.restore(pathlib.Path(sys.argv[2]).read_bytes()); print(w.arms['left'].q_rad.tobytes().hex())"
        )
        told_by = subprocess.run(
            [sys.executable, "-c", program, scene, path], capture_output=True, text=True, check=True, timeout=120
        )
        world.restore(saved)
        self.assertEqual(told_by.stdout.strip(), world.arms["left"].q_rad.tobytes().hex())

    def test_what_is_not_restored(self):
        world = native.World(noisy_scene(), seed=3)
        world.parameter("left_cartesian", "translational_stiffness_n_per_m", 123.25)
        world.step(50)
        saved = world.save()
        with self.assertRaisesRegex(ValueError, "expected what save"):
            world.restore(b"something else")
        with self.assertRaisesRegex(ValueError, "expected what save"):
            world.restore(saved[:-20])
        other = native.World("one_arm")
        with self.assertRaisesRegex(ValueError, "another scene"):
            other.restore(saved)
        # A changed number is another world: its bits tell.
        number = np.array([123.25], dtype=">f4").tobytes()  # CBOR stores what fits as a float of 4 bytes
        self.assertEqual(saved.count(number), 1)
        with self.assertRaisesRegex(ValueError, "last bits"):
            world.restore(saved.replace(number, np.array([321.5], dtype=">f4").tobytes()))


def here_of(here, world, arm):
    """The joint angles of an arm within what numbers() returned."""
    parts = [
        getattr(one, name).size for one in world.arms.values() for name in (*QUANTITIES, "X_WE", "gripper", "held")
    ]
    index = list(world.arms).index(arm) * (len(QUANTITIES) + 3)
    first = sum(parts[:index])
    return here[first : first + parts[index]]


class Commands(unittest.TestCase):
    def setUp(self):
        self.world = native.World(noisy_scene(), seed=2)

    def test_a_switch_and_what_it_refuses(self):
        self.world.switch(["dual"])
        self.world.step()
        self.assertEqual(self.world.active, ["dual"])
        with self.assertRaisesRegex(mp.Refused, "both own arm"):
            self.world.switch(["dual", "coupled"])
        self.world.switch(["left_joint"], only=True)
        self.world.step()
        self.assertEqual(sorted(self.world.active), ["left_joint", "right_hold"])
        self.assertEqual([float(self.world.arms[arm].held[0]) for arm in ARMS], [0, 1])
        self.assertIn("arm 'right' is held", self.world.held)

    def test_what_is_refused_at_once(self):
        for call, error, said in (
            (lambda: self.world.target("left_cartesain", "pose", np.zeros(7)), ValueError, "left_cartesian"),
            (lambda: self.world.target("left_cartesian", "poze", np.zeros(7)), ValueError, "did you mean 'pose'"),
            (lambda: self.world.target("left_cartesian", "pose", [0.4]), ValueError, "expected 7 numbers, found 1"),
            (lambda: self.world.target("dual", "common_pose", [0.4, 0, 0.5, 0, 1, 0, 0]), mp.Refused, "not active"),
            (lambda: self.world.goal("left_cartesian", "pose", [4, 0, 0.5, 0, 1, 0, 0]), mp.Refused, "out of reach"),
            (lambda: self.world.target("left_cartesian", "pose", [np.nan] * 7), mp.Refused, ""),
            (lambda: self.world.parameter("left_cartesian", "damping", 1), ValueError, "no parameter"),
            (lambda: self.world.parameter("left_cartesian", "damping_ratio", -5), mp.Refused, "must be"),
            (lambda: self.world.feature("left_cartesian", "manipulabilty", True), ValueError, "no feature"),
            (lambda: self.world.stop("middle"), ValueError, "no arm"),
            (lambda: native.World("one_arm", q_start_rad={"arm": [0, 0]}), ValueError, "expected 7 numbers, found 2"),
            (lambda: native.World("one_arm", active=["nothing"]), ValueError, "nothing"),
            (lambda: native.World("one_arm", objects={"table": [0] * 7}), ValueError, "no free object"),
            (lambda: native.World("no_such_scene"), ValueError, "no_such_scene"),
            (lambda: native.World("one_arm", seed=-1), ValueError, "seed"),
            (lambda: native.Batch("one_arm", 0), ValueError, "at least one world"),
        ):
            with self.assertRaisesRegex(error, said, msg=said):
                call()
        before = numbers(self.world)
        self.world.step(0)
        np.testing.assert_array_equal(numbers(self.world), before)

    def test_what_the_next_cycle_refuses_raises_there(self):
        self.world.place("table", [0.6, 0, 0.5, 1, 0, 0, 0])
        with self.assertRaisesRegex(mp.Refused, "table"):
            self.world.step(5)
        self.assertEqual(self.world.cycles, 6)
        self.world.step(5)  # said once

    def test_grippers(self):
        with self.assertRaisesRegex(mp.Refused, "fingers: movable"):
            self.world.gripper_move("left", 0.02)
        path = harness.FOLDER / "fingers.yaml"
        path.write_text(noisy_scene().read_text().replace("model: fer", "model: fer\n    fingers: movable"))
        self.world = native.World(path)
        for arm, width in (("left", 0.03), ("right", 0.06)):
            self.world.gripper_move(arm, width)
        self.world.step(100)  # grippers report at their own rate
        self.assertEqual(self.world.gripper_answer("left"), "")
        self.assertEqual(self.world.arms["left"].gripper[2], 1)  # moves
        self.world.step(2000)
        self.assertEqual(self.world.gripper_answer("left"), "done")
        widths = [self.world.arms[arm].gripper[0] for arm in ARMS]
        np.testing.assert_allclose(widths, [0.03, 0.06], atol=1e-3)
        self.world.gripper_grasp("left", 0.01, 20)  # there is nothing
        self.world.step(2000)
        self.assertNotIn(self.world.gripper_answer("left"), ("", "done"))
        for arm, stop, again in (
            ("left", lambda: self.world.stop("left"), lambda: self.world.resume("left")),
            ("right", lambda: self.world.user_stop("right"), lambda: self.world.user_stop("right", False)),
        ):
            self.world.gripper_move(arm, 0.07)
            self.world.step(2000)
            self.world.gripper_move(arm, 0.01, speed_m_per_s=0.02)  # 3 s
            self.world.step(500)
            stop()
            self.world.step(500)
            width_m = self.world.arms[arm].gripper[0]
            self.assertGreater(width_m, 0.05, arm)
            self.world.gripper_move(arm, 0.01)
            self.world.step(1000)
            self.assertIn("is stopped", self.world.gripper_answer(arm))
            self.assertAlmostEqual(self.world.arms[arm].gripper[0], width_m, delta=2e-4)
            again()
            self.world.step(500)
            self.world.gripper_move(arm, 0.03)
            self.world.step(2000)
            self.assertEqual(self.world.gripper_answer(arm), "done")

    def test_what_a_stopped_arm_holds_stays_held(self):
        world = native.World("grippers")
        world.gripper_grasp("left", 0.04, 30)
        world.step(2000)
        self.assertEqual(world.arms["left"].gripper[1], 1)
        world.stop("left")
        world.step(100)
        world.gripper_move("left", 0.07)
        world.step(1000)
        self.assertIn("is stopped", world.gripper_answer("left"))
        self.assertEqual(world.arms["left"].gripper[1], 1)

    def test_stop_and_resume(self):
        self.world.stop("left")
        self.world.step()
        with self.assertRaisesRegex(mp.Refused, "resume"):
            self.world.switch(["left_joint"])
        self.world.resume("left")
        self.world.step()
        self.world.switch(["left_joint"])
        self.world.step()
        self.assertIn("left_joint", self.world.active)

    def test_the_stop_button_holds_one_world_of_a_batch(self):
        batch = native.Batch(noisy_scene(), 3)
        batch.reset([1, 2, 3])
        batch.user_stop("right", mask=np.array([False, True, False]))
        batch.step(20)
        np.testing.assert_array_equal(batch.stopped(), [False, True, False])
        self.assertIn("user stop", batch.held(1))
        self.assertEqual(batch.held(0), "")

    def test_a_refusal_in_one_world_of_a_batch(self):
        batch = native.Batch(noisy_scene(), 2)
        batch.reset([1, 2])
        poses = np.tile([0.4, 0.2, 0.5, 0, 1, 0, 0], (2, 1))
        poses[1, 0] = np.inf
        batch.target("left_cartesian", "pose", poses)
        batch.step(10)
        self.assertEqual(batch.refusal(0), "")
        self.assertIn("left_cartesian", batch.refusal(1))
        np.testing.assert_array_equal(batch.stopped(), [False, True])
        with self.assertRaisesRegex(ValueError, "expected 2 rows"):
            batch.target("left_cartesian", "pose", poses[:1])
        with self.assertRaisesRegex(ValueError, "expected 2 seeds"):
            batch.reset([1])

    def test_masked_worlds_stand_still(self):
        batch = native.Batch("one_arm", 2)
        batch.reset([1, 2])
        still = batch.arms["arm"].q_rad[0].copy()
        batch.step(30, np.array([False, True]))
        np.testing.assert_array_equal(batch.arms["arm"].q_rad[0], still)
        self.assertEqual([batch.cycles(0), batch.cycles(1)], [1, 31])


class Page(unittest.TestCase):
    def test_the_lines_of_the_page(self):
        page = (harness.ROOT / "docs/learning.md").read_text(encoding="utf-8")
        _, first, second = re.findall(r"```python\n(.*?)```", page, re.S)
        names = {}
        exec(first, names)
        np.testing.assert_allclose(names["left"].X_WE[:3], names["goal"][:3], atol=0.01)
        exec(second, names)
        self.assertEqual(names["batch"].cycles(63), 501)


class Views(unittest.TestCase):
    def test_views_are_live_read_only_and_outlive_their_world(self):
        world = native.World("one_arm")
        q = world.arms["arm"].q_rad
        before = q.copy()
        world.step(1500)  # the scene's timeline moves the arm
        self.assertFalse(np.array_equal(q, before))
        with self.assertRaises(ValueError):
            q[0] = 1
        last = q.copy()
        del world
        gc.collect()
        np.testing.assert_array_equal(q, last)

    def test_no_copy(self):
        batch = native.Batch("one_arm", 4)
        self.assertFalse(batch.arms["arm"].q_rad.flags.owndata)
        self.assertEqual(batch.arms["arm"].q_rad.shape, (4, 7))
        self.assertEqual(batch.arms["arm"].X_WE.strides, batch.arms["arm"].q_rad.strides)

    def test_the_lock_is_released(self):
        """Another thread of Python counts while a batch steps for a while."""
        batch = native.Batch("one_arm", 2, threads=1)
        batch.reset([1, 2])
        counted, end = [0], threading.Event()

        def count():
            while not end.is_set():
                counted[0] += 1

        thread = threading.Thread(target=count)
        thread.start()
        before = counted[0]
        batch.step(4000)
        after = counted[0]
        end.set()
        thread.join()
        self.assertGreater(after - before, 1000)


class Forces(unittest.TestCase):
    def test_a_pushed_box_follows_newton(self):
        """An arm without contact exerts nothing; a box of 0.5 kg that is pushed up by its weight and 1 N rises by
        f t^2 / (2 m)."""
        world = native.World(noisy_scene(), seed=4)
        world.step(200)
        for arm in ARMS:
            np.testing.assert_array_equal(world.arms[arm].F_K_W_true, np.zeros(6))
        start = world.objects["box"].copy()
        world.push("box", [0, 0, 0.5 * 9.81 + 1.0], duration_s=0.2)
        world.step(200)
        rise = world.objects["box"][2] - start[2]
        self.assertAlmostEqual(rise, 0.5 * (1.0 / 0.5) * 0.2**2, delta=1e-3)  # what lies there has sunk in a little


if __name__ == "__main__":
    harness.main()
