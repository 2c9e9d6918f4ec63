#!/usr/bin/env python3
"""Logs as arrays: the same numbers as another reader's, mapped and not copied."""

import importlib.util
import os
import shutil
import unittest

import harness  # first: it sets the paths
import multipanda as mp
import numpy as np
from harness import FOLDER

SECONDS = 5


class Logs(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.path = mp.play("two_arms", seconds=SECONDS, record=FOLDER / "runs").log
        cls.log = mp.read_log(cls.path)

    def test_the_numbers_are_those_of_another_reader(self):
        try:
            from mcap.reader import make_reader
            from mcap_ros2.decoder import DecoderFactory
        except ImportError as missing:
            self.skipTest(f"the other reader is not installed: {missing}")
        with open(self.path, "rb") as stream:
            reader = make_reader(stream, decoder_factories=[DecoderFactory()])
            messages = [m for _, _, _, m in reader.iter_decoded_messages(topics=["/right/state"])]
        self.assertEqual(len(messages), 1000 * SECONDS)
        np.testing.assert_array_equal(self.log["right/state/tau_j"], [m.tau_j for m in messages])
        np.testing.assert_array_equal(self.log["right/q"], [m.q for m in messages])

    def test_names(self):
        self.assertEqual(self.log.arms, ["left", "right"])
        self.assertEqual(self.log["left/tau_J"].shape, (1000 * SECONDS, 7))
        self.assertIs(self.log["left/tau_J"], self.log["left/state/tau_j"])
        self.assertIn("left/owner", self.log)  # of the command
        self.assertNotIn("left/nothing", self.log)
        with self.assertRaisesRegex(KeyError, "left/nothing"):
            self.log["left/nothing"]
        t = self.log.t("left/q")
        np.testing.assert_allclose(np.diff(t), 1e-3, atol=1e-9)
        self.assertEqual(len(list(self.log)), len(self.log))

    def test_arrays_are_mapped_and_cannot_be_written(self):
        q = self.log["left/q"]
        self.assertIsInstance(q, np.memmap)
        self.assertFalse(q.flags.writeable)
        with self.assertRaises(ValueError):
            q[0] = 1

    def test_messages(self):
        started = [switch["started"] for switch in self.log.switches]
        self.assertIn(["right_joint"], started)  # the timeline's, at 4 s
        self.assertTrue(self.log.events)
        self.assertIsInstance(self.log.interventions, list)

    def test_by_folder_and_export(self):
        by_folder = mp.read_log(self.path.parent)
        np.testing.assert_array_equal(by_folder["left/q"], self.log["left/q"])
        by_export = mp.read_log(self.log.archive)
        np.testing.assert_array_equal(by_export["left/q"], self.log["left/q"])

    def test_an_older_export_is_made_again(self):
        folder = FOLDER / "again"
        folder.mkdir()
        log = shutil.copy(self.path, folder / "log.mcap")
        (folder / "log.npz").write_bytes(b"old")
        os.utime(folder / "log.npz", (1, 1))
        self.assertEqual(mp.read_log(log)["left/q"].shape, (1000 * SECONDS, 7))

    def test_no_log(self):
        with self.assertRaises(mp.Refused):
            mp.read_log(FOLDER / "nothing")
        (FOLDER / "broken.mcap").write_bytes(b"\x89MCAP0\r\nbroken")
        with self.assertRaises(mp.Error):
            mp.read_log(FOLDER / "broken.mcap")["left/q"]

    def test_pandas(self):
        if importlib.util.find_spec("pandas") is None:
            self.skipTest("pandas is not installed")
        table = self.log.to_pandas("left/state")
        np.testing.assert_array_equal(table["q_7"], self.log["left/q"][:, 6])
        self.assertEqual(table.index.name, "t_s")

    def test_xarray(self):
        if importlib.util.find_spec("xarray") is None:
            self.skipTest("xarray is not installed")
        data = self.log.to_xarray("left/state")
        np.testing.assert_array_equal(data["q"].values, self.log["left/q"])

    def test_a_difference_of_a_log_to_itself_is_none(self):
        result = mp.compare(self.path, self.path, arm="left", out=FOLDER / "compared")
        self.assertIsInstance(result, dict)
        self.assertTrue(result)
        with self.assertRaises(mp.Refused):
            mp.compare(self.path, self.path, arm="lefd", out=FOLDER / "compared")


if __name__ == "__main__":
    harness.main()
