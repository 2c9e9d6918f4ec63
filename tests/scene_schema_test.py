"""The JSON Schema that editors use accepts every shipped scene, which names it, and refuses broken ones."""

import functools
import json
import pathlib
import re
import unittest

import jsonschema
from ruamel.yaml import YAML

ROOT = pathlib.Path(__file__).resolve().parent.parent
SCHEMA = ROOT / "config/schemas/scene.json"
MODELINE = re.compile(r"^# yaml-language-server: \$schema=(\S+)$", re.MULTILINE)
SMALLEST = "arms: [{name: left}]\n"


def shipped_scenes():
    folders = ("config", "experiments", "examples", "python", "tests")
    files = [f for folder in folders for f in (ROOT / folder).rglob("*.yaml")]
    return sorted(f for f in files if re.search(r"^arms:", f.read_text(encoding="utf-8"), re.MULTILINE))


@functools.cache
def validator():
    return jsonschema.Draft7Validator(json.loads(SCHEMA.read_text(encoding="utf-8")))


def faults(text):
    """Paths of the values that the schema refuses."""
    return [error.json_path for error in validator().iter_errors(YAML(typ="safe", pure=True).load(text))]


class SceneSchema(unittest.TestCase):
    def test_is_a_schema(self):
        jsonschema.Draft7Validator.check_schema(json.loads(SCHEMA.read_text(encoding="utf-8")))

    def test_accepts_every_shipped_scene(self):
        self.assertGreater(len(shipped_scenes()), 15)
        for file in shipped_scenes():
            with self.subTest(file.relative_to(ROOT)):
                self.assertEqual(faults(file.read_text(encoding="utf-8")), [])

    def test_is_named_by_every_shipped_scene(self):
        for file in shipped_scenes():
            with self.subTest(file.relative_to(ROOT)):
                named = MODELINE.search(file.read_text(encoding="utf-8"))
                self.assertIsNotNone(named, "no line '# yaml-language-server: $schema=...'")
                self.assertEqual((file.parent / named.group(1)).resolve(), SCHEMA)

    def test_accepts_what_the_reader_accepts(self):
        for text in (
            SMALLEST,
            "arms: {left: {}, right: {base: {position_m: [0, 1, 0], rpy_rad: [0, 0, -pi/2]}}}\n",
            "arms: [{name: a, fci: 172.16.0.2}, {name: b, fci: {version: 5}, start_rad: ready}]\n",
            SMALLEST + "controllets: [{name: a, type: my_own, arms: left, parameters: {anything: 1}}]\n",
        ):
            with self.subTest(text):
                self.assertEqual(faults(text), [])

    def test_refuses_broken_scenes(self):
        for text, path in (
            ("objects: []\n", "$"),
            (SMALLEST + "objcts: []\n", "$"),
            (SMALLEST + "seed: one\n", "$.seed"),
            (SMALLEST + "plant: {fidelity: real}\n", "$.plant.fidelity"),
            (SMALLEST + "plant: {stiction_nm: -1}\n", "$.plant.stiction_nm"),
            (SMALLEST + "timeline: [{stop: all}]\n", "$.timeline[0]"),
            (SMALLEST + "controllets: [{name: a, type: hold, arms: left, parameters: {stif: 1}}]\n", None),
            ("arms: [{name: left, base: {position_mm: [0, 0, 0]}}]\n", None),
            ("arms: [{name: left, base: {position_m: [0, 0]}}]\n", None),
            ("arms: [{model: fer}]\n", None),
        ):
            with self.subTest(text):
                found = faults(text)
                self.assertTrue(found, "accepted")
                if path:
                    self.assertIn(path, found)


if __name__ == "__main__":
    unittest.main()
