#!/usr/bin/env python3
"""Others' tools with the project's files: MuJoCo reads the URDF, mink the MJCF, Stable-Baselines3 makes the worlds."""

import importlib.util
import itertools
import pathlib
import sys
import types
import unittest
import unittest.mock

import harness  # first: it sets the paths
import numpy as np
from harness import ROOT

ENVIRONMENT = pathlib.Path(sys.argv.pop(2)).absolute() if len(sys.argv) > 2 else ROOT / "build" / "tools-env"
if any(importlib.util.find_spec(name) is None for name in ("gymnasium", "mujoco")):
    print("skipped: Gymnasium or MuJoCo's Python module is not installed")
    sys.exit(77)
sys.path.insert(0, str(ROOT / "tools"))

import build_site
import gymnasium
import mujoco
import multipanda.gym  # noqa: F401 (registers the environments)

HOME = [0, -0.785398163, 0, -2.35619449, 0, 1.57079633, 0.785398163]
MODELS = [f"{arm}{hand}" for arm in ("fer", "fr3", "fr3v2") for hand in ("", "_hand")]


def loaded(file):
    model = mujoco.MjModel.from_xml_path(str(ROOT / "models/generated" / file))
    return model, mujoco.MjData(model)


def distance(model, data, ones, others):
    """The smallest distance of two sets of geoms [m]; negative inside each other."""
    return min(mujoco.mj_geomDistance(model, data, a, b, 1.0, None) for a, b in itertools.product(ones, others))


class UrdfInMuJoCo(unittest.TestCase):
    def test_joint_1_turns_as_without_contacts(self):
        for name in MODELS:
            turned = []
            for contacts in (True, False):
                model, data = loaded(name + ".urdf")
                model.opt.gravity[:] = 0
                if not contacts:
                    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
                data.qpos[:7] = HOME
                mujoco.mj_forward(model, data)
                self.assertEqual(data.ncon, 0, name)
                data.qfrc_applied[0] = 20
                mujoco.mj_step(model, data, round(0.2 / model.opt.timestep))
                turned.append(data.qpos[0])
            self.assertGreater(turned[0], 1, name)
            self.assertEqual(*turned, name)

    def test_the_arm_fills_the_same_space_as_in_the_mjcf(self):
        """What is near the base and link1 is as near as the capsules of the MJCF say, but for the slit of 1 mm."""
        (urdf, a), (mjcf, b) = loaded("fer_hand.urdf"), loaded("fer_hand.xml")

        def of(model, *bodies):
            ids = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name) for name in bodies]
            return [g for g in range(model.ngeom) if model.geom_bodyid[g] in ids and model.geom_contype[g] > 0]

        random, near = np.random.default_rng(1), 0
        for _ in range(200):
            q = random.uniform(mjcf.jnt_range[:7, 0], mjcf.jnt_range[:7, 1])
            for model, data in ((urdf, a), (mjcf, b)):
                data.qpos[:7] = q
                mujoco.mj_forward(model, data)
            for link in ("link5", "link6", "link7"):
                theirs = distance(urdf, a, of(urdf, "world", "link1"), of(urdf, link))
                ours = distance(mjcf, b, of(mjcf, "link0", "link1"), of(mjcf, link, *["hand"] * (link == "link7")))
                if ours > 0:  # depths inside each other are another matter
                    self.assertAlmostEqual(theirs, ours, delta=1e-3, msg=f"{link} at {q}")
                    near += ours < 0.1
        self.assertGreater(near, 20)


class WithInstalledTools(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        try:
            build_site.environment(ENVIRONMENT, ROOT / "requirements-tools.txt", "--no-deps")
        except build_site.SiteError as wrong:
            raise unittest.SkipTest(str(wrong)) from None
        (own,) = ENVIRONMENT.glob("lib/python3*/site-packages")
        sys.path.append(str(own))

    def test_minks_limits_take_geoms_by_name(self):
        """A wrist that mink leads down to the shoulder stops where the limit says, and does not without it."""
        import mink

        model, _ = loaded("fer.xml")
        limit = mink.CollisionAvoidanceLimit(
            model,
            [(["link7", "link7_2"], ["link0", "link1"])],
            minimum_distance_from_collisions=0.05,
            collision_detection_distance=0.3,
        )
        task = mink.FrameTask("flange", "site", position_cost=1, orientation_cost=0, gain=0.02)
        task.set_target(mink.SE3.from_translation(np.array([0.05, 0, 0.1])))
        nearest = {}
        for limits in ((limit,), ()):
            configuration = mink.Configuration(model)
            configuration.update(np.array(HOME))
            for _ in range(600):
                every = [mink.ConfigurationLimit(model), *limits]
                velocity = mink.solve_ik(configuration, [task], 0.02, "daqp", 1e-3, limits=every)
                configuration.integrate_inplace(velocity, 0.02)
            ids = [model.geom(name).id for name in ("link7", "link7_2", "link0", "link1")]
            nearest[limits] = distance(model, configuration.data, ids[:2], ids[2:])
        self.assertAlmostEqual(nearest[(limit,)], 0.05, delta=2e-3)
        self.assertLess(nearest[()], 0.03)

    def test_stable_baselines_makes_the_worlds_as_usual(self):
        """`make_vec_env` and its worlds use no PyTorch: without the algorithms and with stand-ins they are imported."""
        package = types.ModuleType("stable_baselines3")
        package.__path__ = [str(next(ENVIRONMENT.glob("lib/python3*/site-packages/stable_baselines3")))]
        absent = {name: unittest.mock.MagicMock() for name in ("torch", "torch.nn", "torch.utils.tensorboard")}
        with unittest.mock.patch.dict(sys.modules, {"stable_baselines3": package, **absent}):
            from stable_baselines3.common.env_util import make_vec_env

            envs = make_vec_env("multipanda/Reach-v0", n_envs=2, seed=5)
            own = gymnasium.make_vec("multipanda/Reach-v0", num_envs=2, vectorization_mode="vector_entry_point")
            np.testing.assert_array_equal(envs.reset(), own.reset(seed=5)[0])
            own.action_space.seed(5)
            for _ in range(79):
                action = own.action_space.sample()
                a, b = envs.step(action), own.step(action)
                np.testing.assert_array_equal(a[0], b[0])
                np.testing.assert_array_equal(a[1], b[1].astype(np.float32))
            envs.close()
            own.close()


if __name__ == "__main__":
    harness.main()
