"""Third-party readers on multipanda's files: mcap, mcap-ros2-support, rosbags, numpy, csv.

Usage: read_back_test.py TOOL NAMES   (TOOL: the test_tool program; NAMES: the messages that logs contain, with commas)
The messages' values follow the rule of CountingLeaf in test_messages.hpp.
"""

import csv
import dataclasses
import json
import pathlib
import random
import subprocess
import sys
import tempfile
import unittest

import numpy
from mcap.reader import NonSeekingReader, make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

TOOL = pathlib.Path(sys.argv.pop(1))
MESSAGES = pathlib.Path(__file__).parent.parent / "ros/multipanda_msgs/msg"
TYPES = sorted(sys.argv.pop(1).split(","))
COUNT = 200


def tool(*words, code=0):
    done = subprocess.run([TOOL, *map(str, words)], capture_output=True, text=True, timeout=120)
    if done.returncode != code:
        raise AssertionError(f"{words}: exit code {done.returncode}, {done.stderr}")
    return done


def leaves(value):
    """Primitives of a decoded message in the order of its definition, whichever library decoded it."""
    if isinstance(value, (bool, int, float, str, numpy.generic)):
        yield value
    elif isinstance(value, (list, tuple, numpy.ndarray)) or hasattr(value, "typecode"):
        for element in value:
            yield from leaves(element)
    elif dataclasses.is_dataclass(value):
        for field in dataclasses.fields(value):
            if field.name.islower() and not field.name.startswith("__"):  # neither constants nor the type
                yield from leaves(getattr(value, field.name))
    else:
        for name in value.__slots__:
            yield from leaves(getattr(value, name))


def expected_leaf(k, value):
    if isinstance(value, str):
        return f"t{k}"
    if isinstance(value, (bool, numpy.bool_)):
        return k % 2 != 0
    if isinstance(value, (float, numpy.floating)):
        return k + 0.25
    return k % 100


class Counted(unittest.TestCase):
    def check(self, first, message):
        found = list(leaves(message))
        self.assertGreater(len(found), 3)
        for k, value in enumerate(found, first):
            self.assertEqual(value, expected_leaf(k, value), f"{message} at {k - first}")


class ReadBack(Counted):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.path = pathlib.Path(cls.folder.name)
        cls.log = cls.path / "log.mcap"
        tool("write", cls.log, COUNT)

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def test_types_are_there(self):
        self.assertGreaterEqual(len(TYPES), 10)

    def test_mcap_ros2_support(self):
        self.read_with_mcap_ros2(self.log, COUNT * len(TYPES))

    def read_with_mcap_ros2(self, log, total):
        seen = {}
        with open(log, "rb") as stream:
            reader = make_reader(stream, decoder_factories=[DecoderFactory()], validate_crcs=True)
            summary = reader.get_summary()
            self.assertEqual(summary.statistics.message_count, total)
            for schema, channel, message, decoded in reader.iter_decoded_messages():
                self.assertEqual(schema.name, "multipanda_msgs/msg/" + channel.topic.split("/")[-1])
                first = seen.setdefault(channel.topic, 0)
                seen[channel.topic] += 1
                self.assertEqual(message.log_time, 1_000_000 * first)
                self.assertEqual(message.sequence, first)
                if first % 10 in (0, 1, 3):  # lengths 0, 1, 3 of sequences, without waiting for all
                    self.check(first, decoded)
        self.assertEqual(sum(seen.values()), total)
        return seen

    def test_rosbags(self):
        self.read_with_rosbags(self.log, COUNT * len(TYPES))

    def read_with_rosbags(self, log, total):
        seen = {}
        with AnyReader([log]) as reader:
            self.assertEqual(reader.message_count, total)
            for connection, time, raw in reader.messages():
                first = seen.setdefault(connection.topic, 0)
                seen[connection.topic] += 1
                self.assertEqual(time, 1_000_000 * first)
                if first % 10 in (0, 1, 3):
                    decoded = reader.deserialize(raw, connection.msgtype)
                    self.check(first, decoded)
        self.assertEqual(sum(seen.values()), total)

    def test_metadata_and_attachment(self):
        with open(self.log, "rb") as stream:
            reader = make_reader(stream)
            self.assertEqual(
                [m.metadata for m in reader.iter_metadata() if m.name == "run"], [{"scene": "test", "version": "0"}]
            )
            self.assertEqual([(a.name, a.data) for a in reader.iter_attachments()], [("scene.yaml", b"arms: []\n")])

    def test_one_topic_by_index(self):
        with open(self.log, "rb") as stream:
            found = list(make_reader(stream).iter_messages(topics=["/test/Event"]))
        self.assertEqual(len(found), COUNT)

    def test_killed(self):
        killed = self.path / "killed.mcap"
        tool("open", killed, COUNT)
        with self.assertRaises(Exception):  # noqa: B017 (a file without footer)
            with AnyReader([killed]):
                pass
        streamed = self.stream(killed)
        self.assertGreater(streamed, 0)
        self.assertEqual(int(tool("repair", killed).stdout), streamed)
        self.read_with_mcap_ros2(killed, streamed)
        self.read_with_rosbags(killed, streamed)
        self.assertEqual(int(tool("repair", killed).stdout), streamed)  # nothing left to do

    @staticmethod
    def stream(log):
        count = 0
        try:
            with open(log, "rb") as stream:
                for _ in NonSeekingReader(stream).iter_messages(log_time_order=False):
                    count += 1
        except Exception:  # what the library raises at the end of a cut file differs by version and place
            pass
        return count

    def test_cut_anywhere(self):
        whole = self.log.read_bytes()
        dice = random.Random(5)
        for _ in range(12):
            cut = self.path / "cut.mcap"
            cut.write_bytes(whole[: dice.randrange(20, len(whole) - 1)])
            streamed = self.stream(cut)
            self.assertEqual(int(tool("repair", cut).stdout), streamed)
            self.read_with_mcap_ros2(cut, streamed)
            with AnyReader([cut]) as reader:
                self.assertEqual(reader.message_count, streamed)

    def test_npz(self):
        npz = self.path / "log.npz"
        tool("npz", self.log, npz)
        with numpy.load(npz, allow_pickle=False) as arrays:
            first = numpy.arange(COUNT)
            # ArmState: stamp (2 leaves), cycle, arm, sequence, robot_time_ns, ...
            numpy.testing.assert_allclose(arrays["test/ArmState/t"], first % 100 + 1e-9 * ((first + 1) % 100))
            numpy.testing.assert_array_equal(arrays["test/ArmState/cycle"], (first + 2) % 100)
            numpy.testing.assert_array_equal(arrays["test/ArmState/arm"], [f"t{i + 3}" for i in first])
            q, dq = arrays["test/ArmState/q"], arrays["test/ArmState/dq"]
            self.assertEqual(q.shape, (COUNT, 3))
            self.assertEqual(q.dtype, numpy.float64)
            fields = [line.split("#")[0].split() for line in (MESSAGES / "ArmState.msg").read_text().splitlines()]
            names = [words[1] for words in fields if len(words) == 2 and "=" not in words[1]]
            at_q = names.index("q") + 1  # the stamp has two leaves
            numpy.testing.assert_array_equal(q[3], [3 + at_q + k + 0.25 for k in range(3)])
            numpy.testing.assert_array_equal(dq[3], [3 + at_q + 3 + k + 0.25 for k in range(3)])
            self.assertTrue(numpy.isnan(q[4]).all())  # an empty sequence
            self.assertEqual(arrays["test/ModelSummary/pose_position"].shape, (COUNT, 3))
            self.assertEqual(arrays["test/ModelSummary/pose_orientation"].shape, (COUNT, 4))
            event = json.loads(str(arrays["test/Event/json"][1]))
            self.assertEqual(event["arms"], ["t7"])  # behind stamp (2), cycle, kind, verdict, request
            self.assertEqual(event["cycle"], 3)
            for name in arrays.files:
                if not name.startswith("test/ControlletOutputs/"):
                    self.assertEqual(len(arrays[name]), COUNT, name)
            # The only output "t5" is in message 1, behind stamp (2), cycle and instance.
            output = {name: arrays[f"test/ControlletOutputs/t5/{name}"].tolist() for name in ("t", "cycle", "values")}
            self.assertEqual(output, {"t": [1 + 2e-9], "cycle": [3], "values": [[6.25]]})

    def test_csv(self):
        folder = self.path / "csv"
        tool("csv", self.log, folder)
        tables = {p.stem for p in folder.iterdir()}
        outputs = {name for name in tables if name.startswith("test_ControlletOutputs_")}
        self.assertEqual(tables - outputs, {"test_" + t for t in TYPES} - {"test_ControlletOutputs"})
        self.assertEqual(
            (folder / "test_ControlletOutputs_t5.csv").read_text(), "t_s,cycle,values_1\n1.000000002,3,6.25\n"
        )
        with open(folder / "test_ArmState.csv", newline="") as stream:
            rows = list(csv.DictReader(stream))
        self.assertEqual(len(rows), COUNT)
        self.assertEqual(rows[5]["arm"], "t8")
        self.assertAlmostEqual(float(rows[5]["t_s"]), 5 + 6e-9, places=12)
        self.assertEqual(rows[4]["q_1_rad"], "")
        self.assertEqual(float(rows[3]["q_2_rad"]) - float(rows[3]["q_1_rad"]), 1)
        for name in ("cycle", "robot_time_ns", "age_s", "dq_3_rad_per_s", "tau_j_1_nm", "gripper_width_m"):
            self.assertIn(name, rows[0])
        with open(folder / "test_ArmWrench.csv", newline="") as stream:
            names = next(csv.reader(stream))
        self.assertIn("estimated_force_x_n", names)
        self.assertIn("contact_torque_z_nm", names)
        with open(folder / "test_ArmConfig.csv", newline="") as stream:
            names = next(csv.reader(stream))
        for name in ("end_effector_position_z_m", "end_effector_orientation_w", "tool_inertia_6_kg_m2"):
            self.assertIn(name, names)
        for row in rows:
            self.assertNotIn(None, row, "more cells than columns")
            self.assertNotIn(None, row.values(), "fewer cells than columns")

    def test_refusals(self):
        self.assertIn("cannot open", tool("npz", self.path / "none.mcap", self.path / "x.npz", code=1).stderr)
        other = self.path / "other.mcap"
        other.write_text("not a log at all")
        self.assertIn("not an MCAP file", tool("repair", other, code=1).stderr)
        self.assertEqual(other.read_text(), "not a log at all")


if __name__ == "__main__":
    unittest.main(verbosity=2)
