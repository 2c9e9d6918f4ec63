#!/usr/bin/env python3
"""The Gymnasium environments: Gymnasium's checkers, seeds to the bit, ends, scripted policies that solve each."""

import importlib.util
import os
import sys
import unittest
import warnings

import harness  # first: it sets the paths

FULL = os.environ.get("MULTIPANDA_FULL") == "1"
if importlib.util.find_spec("gymnasium") is None:
    print("skipped: Gymnasium is not installed")
    sys.exit(77)

import gymnasium
import multipanda.gym  # noqa: F401 (registers the environments)
import numpy as np
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from multipanda.gym.worlds import Worlds
from multipanda.tasks import TASKS, Start
from multipanda.tasks.reach import READY_RAD
from multipanda.tasks.scripted import SCRIPTED, Observed


def make_vec(name, count, **options):
    return gymnasium.make_vec(
        f"multipanda/{name}-v0", num_envs=count, vectorization_mode="vector_entry_point", **options
    )


def rollout(envs, policy, seed):
    """Observations, rewards and successes of one episode in every world."""
    observation, _ = envs.reset(seed=seed)
    observations, rewards, successes = [observation], [], []
    for _ in range(envs.unwrapped.limit):
        observation, reward, terminated, truncated, info = envs.step(policy(observation.astype(np.float64)))
        observations.append(observation)
        rewards.append(reward)
        successes.append(info["is_success"])
        if np.any(terminated):
            raise AssertionError(f"ended early: {info.get('reason')} {info}")
    return np.array(observations), np.array(rewards), np.array(successes)


class Checkers(unittest.TestCase):
    def test_single_environments(self):
        for name, task in TASKS.items():
            for action in task.actions:
                with warnings.catch_warnings():
                    warnings.simplefilter("error")
                    # Observations have no bounds but those of physics, and there is nothing to render.
                    warnings.filterwarnings("ignore", ".*-infinity|.*infinity.*|.*render.*|.*spec.*")
                    env = gymnasium.make(f"multipanda/{name}-v0", action=action)
                    check_env(env.unwrapped, skip_render_check=True)
                    env.close()

    def test_vector_environments(self):
        for name, task in TASKS.items():
            envs = make_vec(name, 3, privileged=True)
            observation, info = envs.reset(seed=1)
            self.assertIn(observation, envs.observation_space)
            self.assertEqual(info, {})
            envs.action_space.seed(1)
            for _ in range(3):
                observation, reward, terminated, truncated, info = envs.step(envs.action_space.sample())
                self.assertIn(observation, envs.observation_space)
                self.assertEqual(observation.dtype, np.float32)
                for values in (reward, terminated, truncated):
                    self.assertEqual(values.shape, (3,))
                self.assertEqual(terminated.dtype, np.bool_)
                self.assertTrue(np.all(reward >= 0) and np.all(reward <= 1))
                for key in info:
                    if not key.startswith("_"):
                        self.assertEqual(info["_" + key].dtype, np.bool_)
            self.assertEqual(envs.metadata["autoreset_mode"], AutoresetMode.NEXT_STEP)
            self.assertEqual(
                observation.shape[1], len(task().observation_names) + len(task().privileged_names), task().name
            )
            envs.close()

    def test_in_gymnasiums_own_vector_environments(self):
        """The single environment within SyncVectorEnv gives what the native vector environment gives."""
        sync = gymnasium.make_vec("multipanda/Reach-v0", num_envs=2, vectorization_mode="sync")
        own = make_vec("Reach", 2)
        first, _ = sync.reset(seed=5)
        second, _ = own.reset(seed=5)
        np.testing.assert_array_equal(first, second)
        self.assertEqual(own.unwrapped.np_random_seed, sync.np_random_seed)
        sync.action_space.seed(5)
        for k in range(85):  # beyond the end of the episode, which both begin again in the next step
            action = sync.action_space.sample()
            a, b = sync.step(action), own.step(action)
            for one, other in zip(a[:4], b[:4]):
                np.testing.assert_array_equal(one, other, f"step {k}")
        self.assertTrue(k > 81)
        sync.close()
        own.close()

    def test_what_is_refused(self):
        for options, said in (
            ({"action": "torque"}, "pose, impedance, wrench, joints"),
            ({"render_mode": "human"}, "rgb_array or None"),
            ({"rate_hz": 30}, "divides 1000"),
            ({"autoreset_mode": AutoresetMode.SAME_STEP}, "SAME_STEP"),
        ):
            with self.assertRaisesRegex(Exception, said):
                make_vec("Reach", 2, **options)
        envs = make_vec("Reach", 2)
        with self.assertRaises(gymnasium.error.ResetNeeded):
            envs.step(np.zeros((2, 6)))
        with self.assertRaisesRegex(ValueError, "reset_mask"):
            envs.reset(options={"reset_mask": np.array([True, False])})
        envs.close()


class Seeds(unittest.TestCase):
    def test_same_seed_same_bits(self):
        for name in TASKS:
            action, _ = SCRIPTED[name]
            first = make_vec(name, 2, action=action, threads=1)
            second = make_vec(name, 2, action=action, threads=2)
            second.reset(seed=99)
            first.action_space.seed(3)
            a, b = first.reset(seed=7)[0], second.reset(seed=7)[0]
            for _ in range(10):
                np.testing.assert_array_equal(a, b, name)
                chosen = first.action_space.sample()
                a, b = first.step(chosen)[0], second.step(chosen)[0]
            np.testing.assert_array_equal(a, b, name)
            other = first.reset(seed=8)[0]
            self.assertFalse(np.array_equal(other, second.reset(seed=7)[0]))
            first.close()
            second.close()

    def test_a_world_is_the_single_environment(self):
        for name, plants in (("PressCircle", False), ("LiftBox", False), ("Reach", True)):
            envs = make_vec(name, 3, action="impedance", plants=plants)
            one = gymnasium.make(f"multipanda/{name}-v0", action="impedance", plants=plants)
            one.action_space.seed(4)
            batch, _ = envs.reset(seed=20)
            single, _ = one.reset(seed=22)
            np.testing.assert_array_equal(batch[2], single)
            for _ in range(12):
                action = np.stack([one.action_space.sample() for _ in range(3)])
                batch, rewards = envs.step(action)[:2]
                single, reward = one.step(action[2])[:2]
                np.testing.assert_array_equal(batch[2], single, name)
                self.assertEqual(rewards[2], reward)
            envs.close()
            one.close()

    def test_a_world_is_the_run_of_the_program(self):
        """500 cycles of a world and of `multipanda run`, with the noise of the seed: all joints, to the bit."""
        import multipanda as mp

        task = TASKS["PressCircle"]()
        mp.play(task.scene, seconds=0.5, record=harness.FOLDER / "gym_runs")
        (folder,) = (harness.FOLDER / "gym_runs").iterdir()
        logged = np.asarray(mp.read_log(folder)["arm/state/q"])
        worlds = Worlds(task, 1, ["cartesian"])
        start = Start(q_rad={"arm": READY_RAD})
        all_of_them = np.ones(1, dtype=np.bool_)
        worlds.reset(all_of_them, np.ones(1, dtype=np.uint64), {0: start})  # the scene's seed is 1
        seen = [worlds.states()["arm"].q_rad[0].copy()]
        for _ in range(499):
            worlds.step(1, all_of_them)
            seen.append(worlds.states()["arm"].q_rad[0].copy())
        self.assertEqual(len(logged), 500)
        np.testing.assert_array_equal(np.array(seen), logged)
        self.assertGreater(np.abs(np.diff(logged, axis=0)).max(), 1e-6)  # there is noise

    def test_plants_differ(self):
        plain, drawn = make_vec("Reach", 2), make_vec("Reach", 2, plants=True)
        zero = np.zeros((2, 6))
        for envs in (plain, drawn):
            envs.reset(seed=1)
        for _ in range(20):
            a, b = plain.step(zero)[0], drawn.step(zero)[0]
        z = TASKS["Reach"]().observation_names.index("arm_z [m]")
        sunk = np.abs(a[:, z] - b[:, z])
        self.assertTrue(np.all(sunk > 1e-4), sunk)  # an undeclared payload pulls the arm down
        self.assertNotEqual(sunk[0], sunk[1])
        plain.close()
        drawn.close()


class Ends(unittest.TestCase):
    def test_next_step(self):
        envs = make_vec("Reach", 2, max_episode_steps=3)
        first, _ = envs.reset(seed=1)
        zero = np.zeros((2, 6))
        for k in range(3):
            _, _, _, truncated, _ = envs.step(zero)
            self.assertEqual(truncated.all(), k == 2)
        observation, reward, terminated, truncated, _ = envs.step(zero)
        self.assertFalse(np.array_equal(observation, first))  # another episode of the same series
        time = TASKS["Reach"]().observation_names.index("time of the episode, 0 to 1")
        np.testing.assert_array_equal(observation[:, time], 0)
        np.testing.assert_array_equal(reward, 0)
        self.assertFalse(terminated.any() or truncated.any())
        envs.close()

    def test_reset_mask(self):
        envs = make_vec("Reach", 3, max_episode_steps=4, autoreset_mode=AutoresetMode.DISABLED)
        envs.reset(seed=1)
        zero = np.zeros((3, 6))
        for _ in range(2):
            before = envs.step(zero)[0]
        mask = np.array([False, True, False])
        after, _ = envs.reset(options={"reset_mask": mask})
        np.testing.assert_array_equal(after[~mask], before[~mask])
        self.assertFalse(np.array_equal(after[1], before[1]))
        envs.step(zero)
        _, _, _, truncated, _ = envs.step(zero)
        np.testing.assert_array_equal(truncated, [True, False, True])
        with self.assertRaises(gymnasium.error.ResetNeeded):
            envs.step(zero)
        envs.reset(options={"reset_mask": truncated})
        envs.step(zero)
        seeds = [7, None, 9]
        envs.reset(seed=seeds)
        self.assertEqual(envs.unwrapped.np_random_seed, (7, 2, 9))  # the second goes on with its own
        envs.close()

    def test_a_stopped_arm_ends_the_episode(self):
        """Somebody presses an arm's stop button: the episode ends with the reason, in that world only."""
        envs = make_vec("PressCircle", 2, action="wrench", max_episode_steps=80)
        envs.reset(seed=1)
        envs.unwrapped.worlds.user_stop(1)
        action = np.zeros((2, 6))
        action[:, 5] = 1
        _, reward, terminated, truncated, info = envs.step(action)
        np.testing.assert_array_equal(terminated, [False, True])
        self.assertEqual(reward[1], 0)
        np.testing.assert_array_equal(info["stopped"], [False, True])
        self.assertIn("arm", info["reason"][1])
        _, _, terminated, _, _ = envs.step(action)  # begins again
        self.assertFalse(terminated.any())
        envs.close()


class Solvable(unittest.TestCase):
    """Scripted policies solve every task from what a real arm knows."""

    def solved(self, name, count=4, **options):
        action, policy = SCRIPTED[name]
        envs = make_vec(name, 16 if FULL else count, action=action, **options)
        observations, rewards, successes = rollout(envs, policy, seed=100)
        envs.close()
        return observations, rewards, successes

    def test_reach(self):
        _, rewards, successes = self.solved("Reach")
        self.assertTrue(successes[-10:].all())
        self.assertGreater(rewards[-10:].min(), 0.85)

    def test_reach_with_other_plants(self):
        _, _, successes = self.solved("Reach", plants=True)
        self.assertTrue(successes[-10:].all())

    def test_press(self):
        """The estimated force controls the true one: within 0.5 N of the desired force in the middle of the press."""
        action, policy = SCRIPTED["PressCircle"]
        envs = make_vec("PressCircle", 4, action=action, privileged=True)
        task = TASKS["PressCircle"]()
        width = len(task.observation_names)
        observations, _, _ = rollout(envs, lambda seen: policy(seen[:, :width]), seed=100)
        envs.close()
        force = -10 * observations[:, :, width + task.privileged_names.index("arm_true_fz [10 N]")]
        desired = np.array(
            [10 * Observed(task, o[:, :width])["desired force [10 N], 0 for hovering"] for o in observations]
        )
        middle = slice(32, 48)  # from 1.1 s after the press begins to 0.1 s before its end
        error = np.sqrt(np.mean((force - desired)[middle] ** 2, axis=0))
        self.assertTrue(np.all(error < 0.5), error)
        self.assertTrue(np.all(desired[middle] > 5))

    def test_insert(self):
        _, _, successes = self.solved("Insert")
        self.assertTrue(successes[-5:].all(), successes[-5:])

    def test_lift(self):
        _, rewards, successes = self.solved("LiftBox")
        self.assertTrue(successes[-10:].all(), rewards[-1])

    def test_handover(self):
        _, rewards, successes = self.solved("Handover", count=2)
        self.assertTrue(successes[-5:].all(), rewards[-1])


class OtherKinds(unittest.TestCase):
    """Kinds of actions that no scripted policy uses do what they say."""

    def test_reach_by_wrenches(self):
        """The law that takes wrenches follows poses, too, as long as no force is asked for: 1 is 0 N along z."""
        envs = make_vec("Reach", 4, action="wrench")
        policy, none = SCRIPTED["Reach"][1], np.tile([0.0, 0.0, 1.0], (4, 1))
        _, _, successes = rollout(envs, lambda seen: np.hstack([policy(seen), none]), seed=100)
        envs.close()
        self.assertTrue(successes[-10:].all())

    def test_each_arm_presses_on_the_box(self):
        """With a law per arm both pads press with the 20 N that an action of 0 asks for, by the simulation's forces."""
        task = TASKS["LiftBox"]()
        width = len(task.observation_names)
        envs = make_vec("LiftBox", 2, action="wrench", privileged=True)

        def press(seen):
            action = np.zeros((len(seen), 12))
            approaching = Observed(task, seen[:, :width]).seconds < 1  # the poses go 2 cm into the box
            action[:, 1], action[:, 7] = np.where(approaching, -0.25, 0), np.where(approaching, 0.25, 0)
            return action

        rows, _, _ = rollout(envs, press, seed=100)
        envs.close()
        for arm, force in (("left", -20.0), ("right", 20.0)):
            true = 10 * rows[-20:, :, width + task.privileged_names.index(f"{arm}_true_fy [10 N]")]
            np.testing.assert_allclose(true, force, atol=0.5, err_msg=arm)

    def test_joints_lift_what_a_gripper_holds(self):
        """A hand grasps the bar, then its shoulder leans back: the bar moves with the hand as one body."""
        task = TASKS["Handover"]()
        envs = make_vec("Handover", 2, action="joints", privileged=True, max_episode_steps=70)
        width = len(task.observation_names)

        def lean(seen):
            action = np.zeros((len(seen), 16))
            action[:, 7], action[:, 15] = 1, -1
            action[:, 1] = np.where(Observed(task, seen[:, :width]).seconds > 1.5, -0.3, 0)
            return action

        rows, _, _ = rollout(envs, lean, seed=100)
        envs.close()
        at = task.observation_names.index("left_x [m]")
        hand, x, y = rows[:, :, at : at + 3], rows[:, :, at + 3 : at + 6], rows[:, :, at + 6 : at + 9]
        axes = np.stack([x, y, np.cross(x, y)], axis=-1)
        place = width + task.privileged_names.index("bar_x [m]")
        bar = rows[:, :, place : place + 3]
        for world in range(2):
            before, after = 25, -1
            in_hand = axes[before, world].T @ (bar[before, world] - hand[before, world])
            expected = hand[after, world] + axes[after, world] @ in_hand
            self.assertGreater(hand[after, world, 2] - hand[before, world, 2], 0.05)
            np.testing.assert_allclose(bar[after, world], expected, atol=0.004)


if __name__ == "__main__":
    harness.main()
