#!/usr/bin/env python3
"""Both ways of measuring the command delay find known delays, also if stamps do not coincide."""

import pathlib
import sys
import unittest

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))

from experiments.pages import torque_delay


class Signal:
    """A smooth torque of seven joints: a sum of sines, in closed form."""

    def __init__(self, seed):
        random = np.random.default_rng(seed)
        self.amplitude = random.uniform(0.2, 5, (7, 6))
        self.rate = 2 * np.pi * random.uniform(0.2, 15, (7, 6))
        self.phase = random.uniform(0, 2 * np.pi, (7, 6))

    def __call__(self, t):
        return np.sum(self.amplitude * np.sin(self.rate * np.asarray(t)[:, None, None] + self.phase), axis=2)


class Correlation(unittest.TestCase):
    def test_whole_periods_on_one_grid(self):
        for seed, periods in enumerate([0, 1, 2, 3, 7]):
            t = np.arange(5000) * 1e-3
            sent = Signal(seed)(t)
            used = np.vstack([np.zeros((periods, 7)), sent[: len(sent) - periods]])
            for window in (None, (1.0, 2.0)):
                found = torque_delay.by_correlation(t, sent, t, used, window)
                self.assertAlmostEqual(found, periods * 1e-3, delta=2e-6, msg=f"{periods} periods, {window}")

    def test_parts_of_a_period_between_two_clocks(self):
        # The other loop samples the true signal at its own times, half a period off and with jitter.
        random = np.random.default_rng(5)
        for delay in (0.0003, 0.0005, 0.00125, 0.0042):
            signal = Signal(int(delay * 1e6))
            t_sent = np.arange(4000) * 1e-3
            t_used = t_sent + 0.00037 + random.uniform(-1e-4, 1e-4, 4000)
            found = torque_delay.by_correlation(t_sent, signal(t_sent), t_used, signal(t_used - delay))
            self.assertAlmostEqual(found, delay, delta=2e-5, msg=str(delay))

    def test_under_noise_and_offset(self):
        random = np.random.default_rng(6)
        signal, t = Signal(9), np.arange(6000) * 1e-3
        sent = signal(t) + random.normal(0, 0.05, (6000, 7))
        used = np.vstack([np.zeros((2, 7)), sent[:-2]]) + random.normal(0, 0.05, (6000, 7)) + 3
        self.assertAlmostEqual(torque_delay.by_correlation(t, sent, t, used), 0.002, delta=2e-5)

    def test_windows_show_a_delay_that_changes(self):
        t = np.arange(6000) * 1e-3
        sent = Signal(3)(t)
        used = np.vstack([np.zeros((1, 7)), sent[:-1]])
        used[3000:] = np.vstack([np.zeros((4, 7)), sent[:-4]])[3000:]
        found = torque_delay.by_correlation_in_windows(t, sent, t, used)
        self.assertEqual(len(found), 6)
        np.testing.assert_allclose(found, [0.001] * 3 + [0.004] * 3, atol=2e-6)

    def test_nothing_moves(self):
        t = np.arange(1000) * 1e-3
        self.assertIsNone(torque_delay.by_correlation(t, np.ones((1000, 7)), t, np.ones((1000, 7))))
        self.assertEqual(len(torque_delay.by_correlation_in_windows(t, np.ones((1000, 7)), t, np.ones((1000, 7)))), 0)


class Sequence(unittest.TestCase):
    def setUp(self):
        self.sent = np.random.default_rng(1).normal(size=(400, 7))

    def used_after(self, periods):
        """What packets report: a torque is in use for a whole period before the next packet reports it."""
        used = np.zeros_like(self.sent)
        used[1 + periods :] = self.sent[: len(self.sent) - 1 - periods]
        return used

    def test_known_delays(self):
        for periods in (0, 1, 2, 3, 11):
            found = torque_delay.by_sequence(np.arange(400) + 77, self.sent, self.used_after(periods), 1e-3)
            self.assertEqual(len(found), 400 - 21)
            np.testing.assert_array_equal(found, np.full(len(found), periods * 1e-3))

    def test_lost_torques_and_lost_packets(self):
        used = self.used_after(1)
        used[50] = used[49]  # sent[48] was never in use
        found = torque_delay.by_sequence(np.arange(400), self.sent, used, 1e-3)
        self.assertTrue(np.isnan(found[48]))
        self.assertEqual(np.count_nonzero(np.isnan(found)), 1)
        rows = np.delete(np.arange(400), [100, 101])  # two packets did not arrive
        found = torque_delay.by_sequence(rows, self.sent[rows], used[rows], 1e-3)
        self.assertEqual(np.count_nonzero(np.isnan(found)), 3)  # 48; 98 and 99 would have come with them
        np.testing.assert_array_equal(found[np.isfinite(found)], 1e-3)

    def test_a_constant_torque_gives_no_delay(self):
        self.sent[200] = self.sent[199]
        found = torque_delay.by_sequence(np.arange(400), self.sent, self.used_after(2), 1e-3)
        self.assertTrue(np.isnan(found[200]))
        self.assertEqual(np.count_nonzero(np.isnan(found)), 1)

    def test_a_torque_sent_within_its_tolerance_matches(self):
        used = self.used_after(1)
        used[50:53] -= 1e-5  # rows 48 to 50
        tolerance = np.zeros(400)
        tolerance[48:50] = 2e-5
        found = torque_delay.by_sequence(np.arange(400), self.sent, used, 1e-3, tolerance=tolerance)
        self.assertEqual(list(np.flatnonzero(np.isnan(found))), [50])
        np.testing.assert_allclose(found[[47, 48, 49, 51]], 1e-3)

    def test_shorter_than_the_longest_delay(self):
        self.assertEqual(len(torque_delay.by_sequence(np.arange(5), self.sent[:5], self.sent[:5], 1e-3)), 0)


if __name__ == "__main__":
    unittest.main()
