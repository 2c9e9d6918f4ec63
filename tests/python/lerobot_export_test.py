#!/usr/bin/env python3
"""Logs as LeRobot data sets: read back with pyarrow, and compared with the logs' CSV tables, number by number."""

import csv
import importlib.util
import json
import math
import subprocess
import sys
import unittest

import harness  # first: it sets the paths
import multipanda as mp
import numpy as np
from harness import FOLDER, until
from lerobot_environment import export
from lerobot_scenes import edited, two_arms
from multipanda.scene_camera import SceneView


def read_back(folder):
    """(info, frames by name, episodes)."""
    import pyarrow.parquet as pq

    info = json.loads((folder / "meta/info.json").read_text(encoding="utf-8"))
    table = pq.read_table(folder / "data/chunk-000/file-000.parquet")
    frames = {}
    for name, about in info["features"].items():
        column = table.column(name).combine_chunks()
        vector = about["names"] is not None
        frames[name] = column.flatten().to_numpy().reshape(len(table), -1) if vector else column.to_numpy()
        expected = about["shape"][0] if vector else None
        assert frames[name].shape == ((len(table), expected) if vector else (len(table),)), name
        assert str(frames[name].dtype) == about["dtype"], name
    return info, frames, pq.read_table(folder / "meta/episodes/chunk-000/file-000.parquet").to_pylist()


class Tables:
    """The CSV tables of a log: the other route."""

    def __init__(self, log):
        self._read = {}
        self.folder = FOLDER / f"csv_{len(list(FOLDER.glob('csv_*')))}"
        export(log, "--csv", "--out", self.folder, python=sys.executable)

    def rows(self, name, columns):
        """By cycle: (time, numbers)."""
        found = self._read.setdefault((name, columns), {})
        if found:
            return found
        with open(self.folder / f"{name}.csv", newline="", encoding="utf-8") as file:
            for row in csv.DictReader(file):
                keys = [key for key in row if any(key == c or key.startswith(f"{c}_") for c in columns)]
                found[int(row["cycle"])] = (float(row["t_s"]), [float(row[key]) for key in keys])
        return found

    def frames(self, mark, fps, *series):
        """For each frame of an episode: the newest cycle of which all series have a row, and their numbers."""
        start, end = mark
        cycles = sorted(set.intersection(*(set(rows) for rows in series)))
        found, k, at = [], 0, 0
        while start + k / fps < end - 1e-9:
            while at + 1 < len(cycles) and series[0][cycles[at + 1]][0] <= start + k / fps + 1e-9:
                at += 1
            found.append([rows[cycles[at]][1] for rows in series])
            k += 1
        return found


def record(name, scene, drive, fast=True):
    with mp.run(scene, record=FOLDER / name, fast=fast) as run:
        drive(run)
    return run.log


def wait(run, seconds):
    begin = run.state().t_s
    until(lambda: run.state().t_s > begin + seconds, f"{seconds} s")


def joints_then_poses(run):
    """Four episodes: joints; joints, discarded; poses; joints, but the left arm is held in the middle."""
    run.switch(["left_joint", "right_joint"])
    wait(run, 0.05)
    rest = {arm: run.arms[arm].state.q_rad for arm in ("left", "right")}
    with run.episode():
        run["left_joint"].goal("joints", rest["left"] + 0.2, duration_s=1)
        run["right_joint"].goal("joints", rest["right"] - 0.3, duration_s=1.5)
        wait(run, 1.6)
    with run.episode() as wrong:
        wait(run, 0.2)
    wrong.discard()
    run.switch(["left_cartesian", "right_cartesian"])
    wait(run, 0.05)
    with run.episode():
        for arm in ("left", "right"):
            run[f"{arm}_cartesian"].goal("pose", run.arms[arm].state.pose.moved(z=0.05), duration_s=1)
        wait(run, 1.2)
    run.switch(["left_joint", "right_joint"])
    wait(run, 0.05)
    with run.episode():
        run["left_joint"].goal("joints", rest["left"], duration_s=1)
        wait(run, 0.3)
        run.switch(deactivate="left_joint")
        wait(run, 0.3)
        run.switch("left_joint")
        wait(run, 0.3)
    run.episode()  # nobody judges it


def one_short_episode(run):
    run.switch(["left_joint", "right_joint"])
    wait(run, 0.02)
    with run.episode():
        wait(run, 0.4)


class Export(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.first = record("first", two_arms(), joints_then_poses)
        cls.second = record("second", two_arms(), joints_then_poses)

    def marks(self, log, number):
        (found,) = [e for e in mp.read_log(log).episodes if e.number == number]
        return found.start_s, found.end_s

    def test_joints_of_two_arms_and_two_logs(self):
        out, fps = FOLDER / "joints", 25
        said = export(
            self.first,
            self.second,
            "--lerobot",
            out,
            "--fps",
            fps,
            "--task",
            "Move both",
            "--observe",
            "joints,velocities",
        )
        self.assertIn("action: joints", said)
        for expected in (
            self.first.parent.name,
            "episode 3 is left out: it has no set-point (joints) of 'left'",
            "episode 4 is left out",
            "1 of 5 episodes left out by their outcome: discard",
            "not judged",
        ):
            self.assertIn(expected, said)
        info, frames, episodes = read_back(out)
        self.assertEqual((info["codebase_version"], info["fps"], info["total_episodes"]), ("v3.0", fps, 2))
        joints = [f"{arm}_joint{k}.pos" for arm in ("left", "right") for k in range(1, 8)]
        self.assertEqual(info["features"]["action"]["names"], joints)
        self.assertEqual(len(info["features"]["observation.state"]["names"]), 28)
        begin, differ, moves = 0, 0, 0
        for number, log in enumerate((self.first, self.second)):
            tables = Tables(log)
            q = [tables.rows(f"{arm}_state", ("q",)) for arm in ("left", "right")]
            dq = [tables.rows(f"{arm}_state", ("dq",)) for arm in ("left", "right")]
            goal = [tables.rows(f"{arm}_joint_joints", ("value",)) for arm in ("left", "right")]
            expected = tables.frames(self.marks(log, 1), fps, q[0], dq[0], q[1], dq[1], goal[0], goal[1])
            rows = slice(begin, begin + len(expected))
            state = np.array([np.concatenate(frame[:4]) for frame in expected], dtype=np.float32)
            action = np.array([np.concatenate(frame[4:]) for frame in expected], dtype=np.float32)
            np.testing.assert_array_equal(frames["observation.state"][rows], state)
            np.testing.assert_array_equal(frames["action"][rows], action)
            np.testing.assert_array_equal(frames["frame_index"][rows], np.arange(len(expected)))
            np.testing.assert_array_equal(frames["episode_index"][rows], number)
            np.testing.assert_allclose(frames["timestamp"][rows], np.arange(len(expected)) / fps, atol=1e-6)
            about = episodes[number]
            self.assertEqual((about["dataset_from_index"], about["dataset_to_index"]), (begin, begin + len(expected)))
            self.assertEqual((about["length"], about["tasks"]), (len(expected), ["Move both"]))
            begin += len(expected)
            # The arms move, and a pairing that is off by a frame or by the command's lag would be seen.
            moves += np.count_nonzero(np.abs(np.diff(action[:, 0])) > 1e-4)
            differ += np.count_nonzero(np.abs(action[:, 0] - state[:, 0]) > 1e-5)
        self.assertEqual(begin, info["total_frames"])
        np.testing.assert_array_equal(frames["index"], np.arange(begin))
        self.assertGreater(moves, 30)
        self.assertGreater(differ, 30)
        self.statistics_of(out, frames, episodes)
        origin = json.loads((out / "meta/multipanda.json").read_text(encoding="utf-8"))["episodes"]
        self.assertEqual([(o["episode"], o["outcome"]) for o in origin], [(1, "success")] * 2)
        self.assertNotIn(str(FOLDER), json.dumps(origin))

    def statistics_of(self, out, frames, episodes):
        """By their definitions: sums, and the mean of two neighbors in order."""
        whole = json.loads((out / "meta/stats.json").read_text(encoding="utf-8"))
        self.assertEqual(set(whole), set(frames))
        for name, values in frames.items():
            self.compare(whole[name], values.reshape(len(values), -1), name)
            for k, episode in enumerate(episodes):
                found = {key.rpartition("/")[2]: v for key, v in episode.items() if key.startswith(f"stats/{name}/")}
                rows = values[frames["episode_index"] == k]
                self.compare(found, rows.reshape(len(rows), -1), name)

    def compare(self, found, rows, name):
        count = len(rows)
        self.assertEqual(found["count"], [count])
        for j in range(rows.shape[1]):
            column = sorted(float(x) for x in rows[:, j])
            mean = math.fsum(column) / count
            std = math.sqrt(math.fsum((x - mean) ** 2 for x in column) / count)
            expected = {"min": column[0], "max": column[-1], "mean": mean, "std": std}
            for share in (1, 10, 50, 90, 99):
                at = share / 100 * (count - 1)
                low = math.floor(at)
                expected[f"q{share:02d}"] = column[low] + (at - low) * (column[min(low + 1, count - 1)] - column[low])
            for key, value in expected.items():
                self.assertAlmostEqual(found[key][j], value, delta=1e-9 * max(1, abs(value)), msg=f"{name} {key}")

    def test_poses_are_in_the_frame_of_each_base(self):
        out, fps = FOLDER / "poses", 20
        export(
            self.first, "--lerobot", out, "--fps", fps, "--action", "pose", "--observe", "pose", "--arms", "right,left"
        )
        info, frames, _ = read_back(out)
        self.assertEqual(info["features"]["action"]["names"][0], "right_ee.x")
        tables = Tables(self.first)
        position = [tables.rows(f"{arm}_model", ("pose_position",)) for arm in ("right", "left")]
        turned = [tables.rows(f"{arm}_model", ("pose_orientation",)) for arm in ("right", "left")]
        goal = [tables.rows(f"{arm}_cartesian_pose", ("value",)) for arm in ("right", "left")]
        expected = tables.frames(self.marks(self.first, 3), fps, *position, *turned, *goal)
        self.assertEqual(len(expected), info["total_frames"])
        with mp.run(two_arms()) as run:
            bases = [run.arms[arm].base.matrix for arm in ("right", "left")]
        for k, frame in enumerate(expected):
            for j, base in enumerate(bases):
                x, y, z, w = frame[2 + j]
                measured = mp.Pose.of(np.array([*frame[j], w, x, y, z])).matrix
                commanded = mp.Pose.of(np.array(frame[4 + j])).matrix
                for name, pose in (("observation.state", measured), ("action", commanded)):
                    found = frames[name][k][7 * j : 7 * j + 7].astype(float)
                    np.testing.assert_allclose(base @ mp.Pose.of(found).matrix, pose, atol=2e-6)
        for columns in (slice(3, 7), slice(10, 14)):
            q = frames["action"][:, columns]
            self.assertGreater(np.sum(q[1:] * q[:-1], axis=1).min(), 0.99)  # no jump of the sign

    def test_the_motion_of_a_leader_is_the_action(self):
        out = FOLDER / "led"
        export(
            self.first, "--lerobot", out, "--arms", "left", "--leader", "left=right", "--outcomes", "success,discard"
        )
        info, frames, episodes = read_back(out)
        self.assertEqual(info["total_episodes"], 4)
        self.assertEqual(episodes[0]["tasks"], ["two_arms_lerobot"])
        tables = Tables(self.first)
        rows = [tables.rows(f"{arm}_state", ("q",)) for arm in ("left", "right")]
        for number in range(4):
            expected = tables.frames(self.marks(self.first, number + 1), 30, *rows)
            of_episode = frames["episode_index"] == number
            np.testing.assert_array_equal(
                frames["action"][of_episode], np.array([f[1] for f in expected], dtype=np.float32)
            )

    def test_frames_before_and_behind_the_commands_are_dropped(self):
        def drive(run):
            with run.episode():
                wait(run, 0.2)
                run.switch("left_joint")
                wait(run, 0.5)
                run.switch(deactivate="left_joint")
                wait(run, 0.3)

        log, out, fps = record("late", two_arms(), drive), FOLDER / "late_set", 25
        said = export(log, "--lerobot", out, "--arms", "left", "--fps", fps)
        _, frames, _ = read_back(out)
        (origin,) = json.loads((out / "meta/multipanda.json").read_text(encoding="utf-8"))["episodes"]
        start, end = self.marks(log, 1)
        with_goal = [t for t, _ in Tables(log).rows("left_joint_joints", ("value",)).values()]
        due = start + np.arange(math.ceil((end - start) * fps)) / fps
        first = int(np.argmax(due >= with_goal[0] - 1e-9))
        self.assertGreaterEqual(first, 5)
        last = int(np.flatnonzero(due < with_goal[-1] + 1 / fps)[-1])
        self.assertLess(last, len(due) - 5)
        self.assertEqual(origin["frames_dropped"][0], first)
        self.assertLessEqual(abs(len(frames["index"]) - (last + 1 - first)), 1)
        self.assertIn(f"without its first {first} and last", said)

    def test_what_cannot_be_exported_is_refused_and_leaves_nothing_behind(self):
        other = record("other", "one_arm", lambda run: run.episode().success(), fast=False)
        brief = record("brief", two_arms(), one_short_episode)
        plain = record("plain", "one_arm", lambda run: wait(run, 0.1))
        thin = FOLDER / "thin"
        with mp.run(two_arms(), record=thin, fast=True, log_every={"state": 100}) as run:
            one_short_episode(run)
        existing = FOLDER / "existing"
        existing.mkdir()
        out = FOLDER / "never"
        for words, code, expected in (
            ((brief, "--lerobot", existing), 1, "exists already"),
            ((plain, "--lerobot", out), 1, "no marked episodes"),
            ((other, "--lerobot", out, "--action", "pose", "--fps", 1), 1, "shorter than two frames"),
            ((brief, other, "--lerobot", out), 1, "has no arm left, right, it has arm"),
            ((run.log, "--lerobot", out), 1, "has no joints of 'left' at"),
            ((brief, "--lerobot", out, "--arms", "left,top"), 1, "has no arm top"),
            ((brief, "--lerobot", out, "--observe", "force"), 1, "found force"),
            ((brief, "--lerobot", out, "--grippers", "left"), 1, "'left' has no gripper"),
            ((brief, "--lerobot", out, "--leader", "top=left"), 1, "not among the arms"),
            ((brief, "--lerobot", out, "--leader", "left"), 2, "ARM=LEADER"),
            ((brief, "--lerobot", out, "--action", "twist"), 2, "twist"),
            ((brief, "--lerobot", out, "--fps", "0"), 2, "fps"),
            ((brief, "--lerobot", out, "--fps", "29.97"), 2, "expected a whole number of frames per second"),
            ((brief, plain, "--csv"), 2, "only --lerobot takes several"),
            ((brief, "--csv", "--fps", "30"), 2, "--lerobot"),
        ):
            with self.subTest(expected):
                self.assertIn(expected, export(*words, code=code))
        self.assertFalse(out.exists())
        self.assertEqual(list(FOLDER.glob("*.part*")), [])
        self.assertEqual(list(existing.iterdir()), [])

    def test_without_pyarrow_it_says_how_to_get_it(self):
        done = subprocess.run([sys.executable, "-c", "import pyarrow"], capture_output=True)
        if done.returncode == 0:
            self.skipTest("this Python has pyarrow")
        log = record("no_arrow", two_arms(), one_short_episode)
        said = export(log, "--lerobot", FOLDER / "never", python=sys.executable, code=1)
        self.assertIn(f"{sys.executable} -m pip install pyarrow", said)
        self.assertFalse((FOLDER / "never").exists())


class Grippers(unittest.TestCase):
    def test_fingers_go_to_where_their_motion_ends(self):
        def drive(run):
            with run.episode():
                wait(run, 0.3)
                run.arms["left"].gripper.move(0.06)
                wait(run, 0.2)
                run.arms["left"].gripper.grasp(0.04, force_n=20, tolerance_m=0.01)
                wait(run, 0.2)

        scene = edited("grippers", "grippers_export", ("active: [left_pose, right_pose]", "active: [left_pose]"))
        log, out = record("fingers", scene, drive), FOLDER / "fingers_set"
        export(log, "--lerobot", out, "--arms", "left", "--grippers", "left", "--fps", 50)
        info, frames, _ = read_back(out)
        self.assertEqual(info["features"]["action"]["names"][-1], "left_gripper.pos")
        self.assertEqual(info["features"]["observation.state"]["names"][-1], "left_gripper.pos")
        width, aim = frames["observation.state"][:, -1], frames["action"][:, -1]
        np.testing.assert_allclose(aim[:10], width[:10], atol=1e-6)
        to_width = np.flatnonzero((width < 0.078) & (width > 0.062))
        self.assertGreater(len(to_width), 5)
        np.testing.assert_allclose(aim[to_width], 0.06, atol=1e-3)
        to_grasp = np.flatnonzero((width < 0.058) & (width > 0.042))
        self.assertGreater(len(to_grasp), 5)
        np.testing.assert_array_equal(aim[to_grasp], 0)
        self.assertEqual(aim[-1], 0)  # it holds the box
        self.assertAlmostEqual(width[-1], 0.04, delta=2e-3)


@unittest.skipIf(importlib.util.find_spec("OpenGL") is None, "PyOpenGL is not installed")
class Pictures(unittest.TestCase):
    FPS = 10

    def test_pictures_are_those_that_were_drawn_with_the_state_of_their_instant(self):
        camera = mp.SceneCamera([1.4, -1, 1], look_at_m=[0.4, 0, 0.3], width=64, height=48)
        with mp.run(two_arms(), record=FOLDER / "seen") as run:
            with mp.Cameras(run, {"top": camera}, log=True, lossless=True) as see:
                run.switch(["left_joint", "right_joint"])
                see.newer("top", 2)
                rest = run.arms["left"].state.q_rad
                for attempt in range(20):  # until this computer draws in time: older pictures leave an episode out
                    episode, oldest_s = run.episode(), 0.0
                    run["left_joint"].goal("joints", rest + 0.2 * (-1) ** attempt, duration_s=1)
                    end_s = run.state().t_s + 1
                    picture = see["top"]
                    while run.state().t_s < end_s:
                        following = see.newer("top", picture.number)
                        oldest_s, picture = max(oldest_s, picture.age_s), following
                    if oldest_s < 0.45:
                        episode.success()
                        break
                    episode.failure()
        out = FOLDER / "seen_set"
        said = export(run.log, "--lerobot", out, "--fps", self.FPS, "--arms", "left", "--action", "joints")
        info = json.loads((out / "meta/info.json").read_text(encoding="utf-8"))
        about = info["features"]["observation.images.top"]
        self.assertEqual(about, {"dtype": "image", "shape": [48, 64, 3], "names": ["height", "width", "channels"]})
        import pyarrow.parquet as pq

        table = pq.read_table(out / "data/chunk-000/file-000.parquet")
        files = table.column("observation.images.top").to_pylist()
        states = np.array(table.column("observation.state").to_pylist())
        self.assertGreater(len(files), 5, said)
        start = next(each.start_s for each in mp.read_log(run.log).episodes if each.outcome == "success")
        logged = mp.read_pictures(run.log.parent / "pictures.mcap")["top"]
        rows = Tables(run.log).rows("left_state", ("q",))
        both = Tables(run.log).rows("right_state", ("q",))
        times = np.array([t for t, _ in rows.values()])
        angles = np.array([q for _, q in rows.values()])
        view = SceneView(two_arms(), {"top": camera})
        origin = json.loads((out / "meta/multipanda.json").read_text(encoding="utf-8"))["episodes"][0]
        first = origin["frames_dropped"][0]
        used = []
        for k, file in enumerate(files):
            due = start + (k + first) / self.FPS
            shown = max((each for each in logged if each.t_s <= due + 1e-9), key=lambda each: each.t_s)
            used.append(shown)
            self.assertEqual(file["bytes"], shown.data)
            by_joint = [np.interp(shown.t_s, times, angles[:, j]) for j in range(7)]
            np.testing.assert_allclose(states[k], by_joint, rtol=0, atol=1e-6)
            cycle = int(np.argmin(np.abs(times - shown.t_s)))
            q = {"left": angles[cycle], "right": list(both.values())[cycle][1]}
            view.place({name: np.array(values) for name, values in q.items()}, {})
            drawn = view.shoot("top")[0].astype(int)
            # A box that has settled by micrometers, and angles of a table with nine digits, may change a pixel's edge.
            different = np.abs(drawn - shown.pixels).max(axis=2) > 8
            self.assertLess(different.mean(), 0.005)
        self.assertGreater(np.abs(states[-1] - states[0]).max(), 0.1)
        self.assertEqual(origin["pairing_error_s"]["top"], max(each.error_s for each in used))
        self.assertLessEqual(origin["picture_age_s"]["top"], 0.5)
        stats = json.loads((out / "meta/stats.json").read_text(encoding="utf-8"))["observation.images.top"]
        self.assertEqual(np.shape(stats["mean"]), (3, 1, 1))
        everything = np.concatenate([each.pixels.reshape(-1, 3) / 255 for each in logged])
        np.testing.assert_allclose(np.ravel(stats["mean"]), everything.mean(axis=0), atol=0.02)


if __name__ == "__main__":
    harness.main()
