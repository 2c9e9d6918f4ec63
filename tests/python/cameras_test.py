#!/usr/bin/env python3
"""Cameras: where things are in their pictures by the pinhole's law, pairing with states, faults, logs, environments."""

import contextlib
import importlib.util
import pathlib
import sys
import threading
import time
import unittest
import warnings

import harness  # first: it sets the paths

if any(importlib.util.find_spec(name) is None for name in ("mujoco", "OpenGL", "mcap")):
    print("skipped: MuJoCo for Python, PyOpenGL or mcap is not installed")
    sys.exit(77)

import multipanda as mp
import numpy as np
from harness import FOLDER, until
from multipanda.scene_camera import SceneView
from ssh_server import MISSING, Sshd

BALL_M = np.array([0.306, 0.0, 0.35])  # below the hand at home
RADIUS_M = 0.012
SCENE = FOLDER / "ball.yaml"
SCENE.write_text(
    f"""name: ball
arms: [{{name: arm, model: fer, hand: false}}]
objects:
  - {{name: ball, shape: sphere, diameter_m: {2 * RADIUS_M}, position_m: {BALL_M.tolist()}, color_rgba: [1, 0, 0, 1]}}
controllets: [{{name: joint, type: joint_impedance, arms: arm}}]
active: [joint]
""",
    encoding="utf-8",
)
ON_FLANGE = mp.SceneCamera([0, 0, 0], look_at_m=[0, 0, 1], on="arm", fov_deg=40, depth=True)
STANDING = mp.SceneCamera([1.1, -0.7, 0.9], look_at_m=[0.3, 0, 0.3], width=200, height=160, fov_deg=25)


def red(rgb):
    """The middle of what is red, in pixels from the upper left corner."""
    r, g, b = (rgb[..., k].astype(float) for k in range(3))
    rows, columns = np.nonzero(r > 2.5 * np.maximum(g, b) + 20)
    assert len(rows) > 15, f"{len(rows)} red pixels"
    return np.array([columns.mean() + 0.5, rows.mean() + 0.5])


def projected(camera, eye, point_m):
    """Where a pinhole sees a point of the world, and the point in its axes."""
    x, y, z = (eye @ camera.pose).inverse() @ np.asarray(point_m)
    focal = camera.height / (2 * np.tan(np.radians(camera.fov_deg) / 2))
    return np.array([camera.width / 2 + focal * x / z, camera.height / 2 + focal * y / z]), np.array([x, y, z])


def flange(record):
    """By the loop's own model: without hand and end effector E is the flange."""
    return record.arm("arm").pose


class Drawn(unittest.TestCase):
    def test_the_pinhole_and_depth(self):
        arm = mp.model(SCENE, arm="arm")
        random = np.random.default_rng(3)
        view = SceneView(SCENE, {"hand": ON_FLANGE, "world": STANDING})
        seen = 0
        for _ in range(20):
            q = arm.home_rad + random.uniform(-0.08, 0.08, 7)
            view.place({"arm": q}, {})
            expected, inside = projected(ON_FLANGE, arm.pose(q), BALL_M)
            if not (20 < expected[0] < 300 and 20 < expected[1] < 220):
                continue
            seen += 1
            rgb, depth = view.shoot("hand")
            # A sphere's image is an ellipse about a point farther out: less than 0.2 pixels here. Edges: half a pixel.
            np.testing.assert_allclose(red(rgb), expected, atol=0.7)
            u, v = expected.astype(int)
            # The nearest point of the ball is on the ray to its center, its depth is along the axis.
            near = inside * (1 - RADIUS_M / np.linalg.norm(inside))
            self.assertAlmostEqual(float(depth[v, u]), near[2], delta=2e-3)
        self.assertGreaterEqual(seen, 6)
        rgb, depth = view.shoot("world")
        self.assertIsNone(depth)
        expected, _ = projected(STANDING, mp.Pose.at(), BALL_M)
        np.testing.assert_allclose(red(rgb), expected, atol=0.7)
        view.close()

    def test_what_is_refused(self):
        for fields, said in (
            ({}, "look_at_m or rpy_rad"),
            ({"look_at_m": [0, 0, 1], "rpy_rad": [0, 0, 0]}, "look_at_m or rpy_rad"),
            ({"look_at_m": [0, 0, 0]}, "away from position_m"),
            ({"look_at_m": [0, 0, 1], "width": 8}, "16 to 1920"),
            ({"look_at_m": [0, 0, 1], "fov_deg": 0}, "1 to 170"),
        ):
            with self.assertRaisesRegex(ValueError, said):
                mp.SceneCamera([0, 0, 0], **fields)
        with self.assertRaisesRegex(ValueError, "'lft'.*arm"):
            SceneView(SCENE, {"a": mp.SceneCamera([0, 0, 0], look_at_m=[0, 0, 1], on="lft")})


class Swinging:
    """A run whose first joint swings, so that the hand's camera passes the ball."""

    def __enter__(self):
        self.run = mp.run(SCENE).__enter__()
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._swing, daemon=True)
        self._thread.start()
        return self.run

    def _swing(self):
        home = self.run.arms["arm"].home_rad
        side = 1
        while not self._end.is_set():
            side = -side
            try:
                self.run["joint"].goal("joints", home + np.r_[0.25 * side, np.zeros(6)], duration_s=1).wait()
            except mp.Error:
                if not self._end.is_set():
                    raise

    def __exit__(self, *_):
        self._end.set()
        self._thread.join()
        self.run.__exit__(None, None, None)


class Late(mp.Camera):
    """A camera of known delay: it draws the state of an instant between two cycles, and stamps it later.

    The instant, and so the pairing that is right, comes from the test's own interpolation of two records.
    """

    def __init__(self, run, delay_s, declared_s):
        super().__init__(declared_s)
        self._run, self._by_ns = run, round(1e9 * delay_s)

    def open(self):
        self._view = SceneView(SCENE, {"hand": ON_FLANGE})
        self._view.shoot("hand")

    def read(self):
        time.sleep(0.02)
        a, b = (mp.Record(self._run.shared().layout, row) for row in self._run.shared().block(2))
        q = 0.7 * a["arm/q_rad"] + 0.3 * b["arm/q_rad"]
        self._view.place({"arm": q}, {})
        t_ns = a.start_ns + round(0.3 * (b.start_ns - a.start_ns))
        return mp.Shot(*self._view.shoot("hand"), t_ns + self._by_ns)

    def close(self):
        self._view.close()


def errors_s(run, camera, count, client=None):
    """How far the paired state is from the picture, as time: pixels by the ball's speed in the picture."""
    found, number = [], 0
    with mp.Cameras(client or run, {"late": camera}) as see:
        for _ in range(1000):
            pair = see.pair(see.newer("late", number))
            number = pair.picture.number
            t_ns = pair.record.start_ns
            around = (flange(run.record_at(t_ns + side * 5_000_000)[0]) for side in (-1, 1))
            before, after = (projected(ON_FLANGE, eye, BALL_M)[0] for eye in around)
            speed = (after - before) / 0.01
            expected, _ = projected(ON_FLANGE, flange(pair.record), BALL_M)
            inside = np.all(expected > 30) and expected[0] < 290 and expected[1] < 210
            if np.linalg.norm(speed) > 100 and inside and pair.picture.age_s < 1:
                found.append((abs((red(pair.picture.rgb) - expected) @ speed / (speed @ speed)), pair.error_s))
                if len(found) == count:
                    return np.array(found)
    raise AssertionError(f"only {len(found)} pictures of a moving ball")


class Paired(unittest.TestCase):
    def test_a_moving_ball_and_a_known_delay(self):
        with Swinging() as run:
            found = errors_s(run, Late(run, 0.08, 0.08), 12)
            self.assertLess(found[:, 0].max(), 5e-3)
            self.assertLess(np.median(found[:, 1]), 5e-3)
            # The same measure finds an undeclared delay; less than 80 ms where the speed changes meanwhile.
            found = errors_s(run, Late(run, 0.08, 0.0), 8)
            self.assertGreater(np.median(found[:, 0]), 0.015)

    @unittest.skipIf(MISSING, MISSING)
    def test_a_moving_ball_over_ssh(self):
        """The far client has every 20th record; the delayed camera knows each of the loop's."""
        with contextlib.closing(Sshd(FOLDER / "ssh")) as sshd, Swinging() as run:
            url = f"ssh://127.0.0.1:{sshd.port}/{pathlib.Path(run.connection.path).stem}"
            ssh = ["ssh", "-F", str(sshd.config)]
            with mp.connect(url, program=mp.program_path(), ssh=ssh, silence_s=10) as far:
                found = errors_s(run, Late(run, 0.08, 0.08), 12, far)
                self.assertLess(found[:, 0].max(), 5e-3)
                self.assertLess(np.median(found[:, 1]), 5e-3)
                with mp.Cameras(far, {"hand": ON_FLANGE}, scene=str(SCENE)) as see:
                    pairs, number = [], 0
                    for _ in range(12):
                        pairs.append(see.pair(see.newer("hand", number)))
                        number = pairs[-1].picture.number
                # The scene's cameras know their cycle, whose record is asked for; objects may be newer.
                self.assertLess(np.median([pair.error_s - pair.picture.uncertainty_s for pair in pairs]), 1e-9)

    def test_pictures_of_a_run_are_those_of_their_states(self):
        with Swinging() as run, mp.Cameras(run, {"hand": ON_FLANGE, "world": STANDING}) as see:
            view, number = SceneView(SCENE, {"hand": ON_FLANGE, "world": STANDING}), 0
            equal = 0
            for _ in range(20):
                pair = see.pair(see.newer("hand", number))
                number = pair.picture.number
                if pair.picture.age_s > 1:  # a busy computer: the ring has lost its state
                    continue
                self.assertEqual(pair.picture.t_ns, pair.record.start_ns)
                self.assertEqual(pair.error_s, 0)
                view.place({"arm": pair.record["arm/q_rad"]}, {})
                rgb, depth = view.shoot("hand")
                np.testing.assert_array_equal(pair.picture.rgb, rgb)
                np.testing.assert_array_equal(pair.picture.depth_m, depth)
                equal += 1
            view.close()
            self.assertGreater(equal, 3)
            with self.assertRaisesRegex(KeyError, "hand, world"):
                see["hnad"]

    def test_between_two_records(self):
        with Swinging() as run:
            until(lambda: len(run.shared().block(40)) == 40, "records")
            rows = run.shared().block(40)
            records = [mp.Record(run.shared().layout, row) for row in rows]
            a, b = records[10], records[11]
            middle = a.start_ns + (b.start_ns - a.start_ns) // 4
            found, apart_s = run.record_at(middle)
            share = (middle - a.start_ns) / (b.start_ns - a.start_ns)
            expected = (1 - share) * a["arm/q_rad"] + share * b["arm/q_rad"]
            np.testing.assert_allclose(found["arm/q_rad"], expected, rtol=0, atol=1e-12)
            self.assertEqual((found.start_ns, found.cycle), (middle, a.cycle))
            self.assertAlmostEqual(found.t_s, (1 - share) * a.t_s + share * b.t_s, delta=1e-9)
            self.assertAlmostEqual(float(np.linalg.norm(found["arm/quaternion_wxyz"])), 1, delta=1e-12)
            self.assertAlmostEqual(apart_s, 1e-9 * (middle - a.start_ns), delta=1e-9)
            oldest, apart_s = run.record_at(a.start_ns - 60 * 10**9)
            self.assertGreater(apart_s, 50)
            self.assertLess(oldest.start_ns, b.start_ns)

    def test_another_clients_run(self):
        with mp.run(SCENE) as run, mp.connect(run.connection.path) as other:
            with self.assertRaisesRegex(mp.Refused, "does not know its scene's file"):
                mp.Cameras(other, {"world": STANDING})
            with mp.Cameras(other, {"world": STANDING}, scene=str(SCENE)) as see:
                self.assertEqual(see["world"].rgb.shape, (160, 200, 3))
            with self.assertRaisesRegex(mp.Refused, "name a file"):
                mp.Cameras(other, {}, log=True)
            with self.assertRaisesRegex(mp.Refused, "not recorded"):
                mp.Cameras(run, {}, log=True)


class Scripted(mp.Camera):
    """Delivers, raises, or stands still, as told; it is plugged in as long as `there`."""

    def __init__(self):
        super().__init__()
        self.there, self.still, self.opened = True, threading.Event(), 0
        self.still.set()

    def open(self):
        if not self.there:
            raise OSError("no such device")
        self.opened += 1

    def read(self):
        self.still.wait()
        if not self.there:
            raise OSError("unplugged")
        time.sleep(0.005)
        return mp.Shot(np.full((16, 16, 3), 7, np.uint8), None, time.monotonic_ns())


class Faults(unittest.TestCase):
    def test_a_failing_camera_ends_nothing(self):
        camera = Scripted()
        with mp.run(SCENE) as run, mp.Cameras(run, {"usb": camera, "world": STANDING}, stalled_s=0.3) as see:
            until(lambda: see["usb"].number > 3 and not see["usb"].fault, "pictures")
            cycle = run.state().cycle
            with self.assertLogs("multipanda.cameras", "WARNING") as said:
                camera.there = False
                until(lambda: "unplugged" in see["usb"].fault or "no such device" in see["usb"].fault, "the fault")
                last = see["usb"]
                age_s = last.age_s
                until(lambda: see["usb"].age_s > age_s + 0.1, "its age")
                self.assertEqual(see["usb"].number, last.number)
                world = see["world"].number
                see.newer("world", world + 1)  # the others go on
                self.assertEqual(run.state().arms["arm"].controllet, "joint")
                with self.assertRaisesRegex(mp.Timeout, "no such device|unplugged"):
                    see.newer("usb", last.number, timeout_s=0.1)
                camera.there = True
                until(lambda: see["usb"].number > last.number and not see["usb"].fault, "the camera again")
            self.assertIn("unplugged", said.output[0])
            self.assertIn("works again", said.output[-1])
            self.assertLess(len(said.output), 6)  # said once, not every time
            camera.still.clear()
            until(lambda: see["usb"].fault.startswith("no picture for"), "a stall")
            self.assertGreater(run.state().cycle, cycle)
            camera.still.set()
            until(lambda: not see["usb"].fault, "the stall's end")
        self.assertTrue(run.summary.success)

    def test_a_camera_that_never_comes(self):
        camera = Scripted()
        camera.still.clear()  # also does not end when it is closed
        with mp.run(SCENE) as run:
            with mp.Cameras(run, {"usb": camera}) as see:
                with self.assertRaisesRegex(mp.Timeout, "'usb' has given no picture yet"):
                    see["usb"]
            self.assertEqual(run.state().arms["arm"].controllet, "joint")
        camera.still.set()

    @unittest.skipIf(importlib.util.find_spec("cv2") is None, "OpenCV is not installed")
    def test_opencv(self):
        import cv2

        film = str(FOLDER / "film.avi")
        writer = cv2.VideoWriter(film, cv2.VideoWriter.fourcc(*"MJPG"), 30, (64, 48))
        for _ in range(5):
            writer.write(np.full((48, 64, 3), (200, 100, 50), np.uint8))  # blue, green, red
        writer.release()
        camera = mp.OpenCvCamera(film)
        camera.open()
        before = time.monotonic_ns()
        shot = camera.read()
        self.assertEqual(shot.rgb.shape, (48, 64, 3))
        np.testing.assert_allclose(shot.rgb.mean((0, 1)), [50, 100, 200], atol=4)
        self.assertTrue(before <= shot.t_ns <= time.monotonic_ns())
        for _ in range(4):
            camera.read()
        with self.assertRaisesRegex(OSError, "no picture"):
            camera.read()
        camera.close()
        with self.assertRaisesRegex(OSError, "cannot be opened"):
            mp.OpenCvCamera(str(FOLDER / "nothing")).open()

    @unittest.skipUnless(importlib.util.find_spec("cv2") is None, "OpenCV is installed")
    def test_without_opencv(self):
        with self.assertRaisesRegex(ModuleNotFoundError, "pip install opencv"):
            mp.OpenCvCamera(0).open()


class Logged(unittest.TestCase):
    def test_pictures_beside_a_log(self):
        cameras = {"hand": ON_FLANGE}
        with mp.run(SCENE, record=FOLDER / "logged") as run:
            with mp.Cameras(run, cameras, log=True, lossless=True) as see:
                folder, kept = run.folder, {}
                while len(kept) < 4:
                    picture = see.newer("hand", max(kept, default=0))
                    kept[picture.number] = picture
        self.assertEqual(folder, run.log.parent)
        found = mp.read_pictures(folder / "pictures.mcap")
        self.assertEqual(set(found), {"hand", "hand/depth"})
        log = mp.read_log(run.log)
        for picture in kept.values():
            each, depth = (found[name][picture.number - 1] for name in ("hand", "hand/depth"))
            np.testing.assert_array_equal(each.pixels, picture.rgb)
            self.assertIn(round(each.t_s, 6), np.round(log["arm/state/t"], 6))  # the instant of a cycle
            np.testing.assert_allclose(depth.pixels, 1000 * picture.depth_m, atol=1)
            self.assertGreater(each.age_s, 0)
            if each.age_s < 1:  # otherwise a busy computer: the ring may have lost its state
                self.assertEqual(each.error_s, 0)


@unittest.skipIf(importlib.util.find_spec("gymnasium") is None, "Gymnasium is not installed")
class Observed(unittest.TestCase):
    FRONT = mp.SceneCamera([1.2, -0.8, 0.8], look_at_m=[0.45, 0, 0.2], width=48, height=32, depth=True)

    def test_pixels_in_observations(self):
        import gymnasium
        import multipanda.gym  # noqa: F401 (registers the environments)
        from gymnasium.utils.env_checker import check_env

        for name in ("Reach", "LiftBox"):
            cameras = {"front": self.FRONT}
            env = gymnasium.make(f"multipanda/{name}-v0", cameras=cameras, render_mode="rgb_array")
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                warnings.filterwarnings("ignore", ".*infinity.*|.*spec.*")
                check_env(env.unwrapped)
            plain = gymnasium.make(f"multipanda/{name}-v0")
            observation, _ = env.reset(seed=5)
            np.testing.assert_array_equal(observation["state"], plain.reset(seed=5)[0])
            self.assertEqual(observation["front"].shape, (32, 48, 3))
            self.assertEqual(observation["front_depth"].shape, (32, 48, 1))
            np.testing.assert_array_equal(env.render(), observation["front"])
            action = np.full(env.action_space.shape, 0.7, np.float32)
            later = observation
            for _ in range(10):
                later, *_ = env.step(action)
            self.assertFalse(np.array_equal(later["front"], observation["front"]))  # the arm has moved
            env.close()
            plain.close()

    def test_worlds_have_pictures_of_their_own(self):
        import gymnasium
        import multipanda.gym  # noqa: F401 (registers the environments)

        options = {"cameras": {"front": self.FRONT}}
        envs = gymnasium.make_vec(
            "multipanda/LiftBox-v0", num_envs=2, vectorization_mode="vector_entry_point", **options
        )
        observation, _ = envs.reset(seed=5)
        self.assertIn(observation, envs.observation_space)
        env = gymnasium.make("multipanda/LiftBox-v0", **options)
        for k in range(2):
            own, _ = env.reset(seed=5 + k)
            np.testing.assert_array_equal(observation["front"][k], own["front"])
        self.assertFalse(np.array_equal(observation["front"][0], observation["front"][1]))  # the box lies elsewhere
        self.assertIsNone(env.render())
        with self.assertRaisesRegex(ValueError, "the name 'state'"):
            gymnasium.make("multipanda/Reach-v0", cameras={"state": self.FRONT})
        envs.close()
        env.close()


if __name__ == "__main__":
    harness.main()
