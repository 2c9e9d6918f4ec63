#!/usr/bin/env python3
"""The model of an arm: against the loop's own log, against sums over the links of the URDF, and its inverse."""

import tempfile
import unittest
import xml.etree.ElementTree as ET

import harness  # first: it sets the paths
import multipanda as mp
import numpy as np
from harness import PATIENCE, ROOT
from poses import homogeneous, rodrigues

GRAVITY = np.array([0, 0, -9.81])


def vector(element, name):
    return np.array([float(x) for x in element.get(name, "0 0 0").split()])


def placed(origin):
    roll, pitch, yaw = vector(origin, "rpy")
    rotation = np.linalg.multi_dot([rodrigues(np.array(v)) for v in ([0, 0, yaw], [0, pitch, 0.0], [roll, 0.0, 0])])
    return homogeneous(rotation, vector(origin, "xyz"))


def mass_and_gravity(urdf, q):
    """M and g by the velocity of each link's center of mass in the joints' axes."""
    root = ET.parse(urdf).getroot()
    links, axes, poses, moved = {e.get("name"): e for e in root.findall("link")}, [], {}, {}
    poses["link0"], moved["link0"] = np.eye(4), 0
    angles = iter(q)
    for joint in root.findall("joint"):  # in the order of the chain
        parent, child = joint.find("parent").get("link"), joint.find("child").get("link")
        pose = poses[parent] @ placed(joint.find("origin"))
        moved[child] = moved[parent]
        if joint.get("type") == "revolute":
            axes.append((pose[:3, 2], pose[:3, 3]))
            pose = pose @ homogeneous(rodrigues(np.array([0, 0, next(angles)])), np.zeros(3))
            moved[child] += 1
        poses[child] = pose
    M, g = np.zeros((len(q), len(q))), np.zeros(len(q))
    for name, link in links.items():
        inertial = link.find("inertial")
        if inertial is None or name == "link0":
            continue
        center = poses[name] @ placed(inertial.find("origin"))
        mass, entry = float(inertial.find("mass").get("value")), inertial.find("inertia")
        xx, yy, zz, xy, xz, yz = (float(entry.get(key)) for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"))
        inertia = center[:3, :3] @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ center[:3, :3].T
        v, w = np.zeros((3, len(q))), np.zeros((3, len(q)))
        for i, (axis, point) in enumerate(axes[: moved[name]]):
            v[:, i], w[:, i] = np.cross(axis, center[:3, 3] - point), axis
        M += mass * v.T @ v + w.T @ inertia @ w
        g -= mass * v.T @ GRAVITY
    return M, g


class Model(unittest.TestCase):
    def setUp(self):
        self.random = np.random.default_rng(4)

    def angles(self, model):
        return self.random.uniform(model.q_min_rad, model.q_max_rad)

    def test_the_numbers_of_the_loop(self):
        declared = {"mass_kg": 0.5, "com_m": [0, 0.01, 0.1]}
        settings = {f"arms.left.load_{what}": declared for what in ("present", "declared")}
        settings["arms.left.end_effector"] = {"position_m": [0, 0, 0.2]}
        with tempfile.TemporaryDirectory(dir=harness.FOLDER) as folder:
            with mp.run("two_arms", record=folder, settings=settings) as run:
                arm, law = run.arms["left"], run["left_cartesian"]
                law.goal("pose", law.set_point("pose").moved(y=0.1)).wait(PATIENCE)
                before, end_effector = arm.model, mp.Pose.at([0, 0, 0.1], rpy_rad=[0, 0, 0.3])
                cycle = run.record().cycle
                arm.set_load(0.45, [0.01, 0, 0.08], np.diag([1e-3, 1e-3, 2e-3]))
                arm.set_frames(end_effector=end_effector)
                run.switch("left_joint")
                q = arm.state.q_rad + 0.1
                run["left_joint"].goal("joints", q).wait(PATIENCE)
                after, last = arm.model, run.record().cycle
                with mp.connect(run.connection.path) as other, self.assertRaisesRegex(mp.Refused, 'SCENE, arm="left"'):
                    other.arms["left"].model  # noqa: B018
            log = mp.read_log(run.log)
            np.testing.assert_array_equal(
                before.gravity(q), mp.model("two_arms", arm="left", settings=settings).gravity(q)
            )
            cycles, changed = log["left/model/cycle"], int(log["left/config/cycle"].max())
            state_at = {int(c): k for k, c in enumerate(log["left/state/cycle"])}
            compared = [0, 0]
            for k, number in enumerate(cycles):
                model = before if number < cycle else after if changed < number <= last else None
                if model is None:
                    continue
                at = state_at[int(number)]
                q, dq = log["left/q"][at], log["left/dq"][at]
                close = dict(rtol=0, atol=1e-12)
                np.testing.assert_allclose(model.gravity(q), log["left/model/tau_gravity"][k], **close)
                np.testing.assert_allclose(model.coriolis(q, dq), log["left/model/tau_coriolis"][k], **close)
                np.testing.assert_allclose(model.pose(q).position_m, log["left/model/pose_position"][k], **close)
                twist = [log[f"left/model/twist_{part}"][k] for part in ("linear", "angular")]
                np.testing.assert_allclose(model.jacobian(q) @ dq, np.concatenate(twist), **close)
                compared[model is after] += 1
            self.assertGreater(min(compared), 10)

    def test_sums_over_the_links(self):
        for name, hand in (("fr3", True), ("fer", True), ("fr3v2", False)):
            model = mp.model(name, hand=hand)
            urdf = ROOT / f"models/generated/{name}{'_hand' if hand else ''}.urdf"
            for _ in range(20):
                q, dq = self.angles(model), self.random.normal(size=7)
                M, g = mass_and_gravity(urdf, q)
                np.testing.assert_allclose(model.mass(q), M, atol=1e-9)
                np.testing.assert_allclose(model.gravity(q), g, atol=1e-9)
                # C dq = dM/dt dq - grad(dq' M dq) / 2, by differences.
                h, steps = 1e-6, 1e-6 * np.eye(7)
                slopes = [(model.mass(q + step) - model.mass(q - step)) / (2 * h) for step in steps]
                c = sum(x * s for x, s in zip(dq, slopes, strict=True)) @ dq - [dq @ s @ dq / 2 for s in slopes]
                np.testing.assert_allclose(model.coriolis(q, dq), c, atol=1e-6)
                for joint, step in enumerate(steps):
                    a, b = model.pose(q - step), model.pose(q + step)
                    v = (b.position_m - a.position_m) / (2 * h)
                    np.testing.assert_allclose(model.jacobian(q)[:3, joint], v, atol=1e-8)

    def test_a_base_and_a_load(self):
        q = mp.model("fr3").home_rad
        wall = mp.Pose.at([0, 0, 1], rpy_rad=[0, np.pi / 2, 0])
        self.assertTrue(mp.model("fr3", base=wall).pose(q).is_close(wall @ mp.model("fr3").pose(q)))
        model = mp.model("fr3", hand=False)  # the flange is the end effector
        bare, J = model.gravity(q), model.jacobian(q)
        model.set_load(2, [0, 0, 0])
        np.testing.assert_allclose(model.gravity(q) - bare, J[:3].T @ [0, 0, 2 * 9.81], atol=1e-9)

    def test_inverse(self):
        for name in ("fr3", "fer"):
            model = mp.model(name)
            for _ in range(100):
                q = self.angles(model)
                found = model.inverse(model.pose(q))
                self.assertTrue(model.pose(found).is_close(model.pose(q), 2e-9, 2e-9))
                self.assertTrue(np.all(found >= model.q_min_rad) and np.all(found <= model.q_max_rad))
        near = model.home_rad + 0.05
        np.testing.assert_allclose(model.inverse(model.pose(near), near), near)
        with self.assertRaisesRegex(ValueError, "'two_arms'.*of a scene, name one: .*arm="):
            mp.model("two_arms")
        with self.assertRaisesRegex(mp.Refused, "no joint angles .* are left"):
            model.inverse(mp.Pose.at([2, 0, 0]))

    def test_what_is_refused(self):
        model = mp.model("fr3")
        for call, message in (
            (lambda: model.pose([1, 2]), "q_rad: expected 7 finite numbers"),
            (lambda: model.coriolis(model.home_rad, [np.nan] * 7), "dq_rad_per_s: expected 7 finite"),
            (lambda: mp.model("fr4"), "no robot model 'fr4'; did you mean 'fr3'"),
            (lambda: mp.model("two_arms", arm="lft"), "scene 'two_arms' has no arm 'lft'; did you mean 'left'"),
        ):
            with self.assertRaises(ValueError) as caught:
                call()
            self.assertIn(message, str(caught.exception))


if __name__ == "__main__":
    harness.main()
