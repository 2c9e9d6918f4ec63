#!/usr/bin/env python3
"""Long series as studies: every series is listed, a case is what it is within the whole, failures are found.

series_test.py PROGRAM SAMPLE     SAMPLE is tests/series_sample.cpp, built
"""

import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[1]
TEST = re.compile(r"^TEST(?:_P|_F)?\((\w+), (\w+)\)(.*?)^}", re.M | re.S)


class Series(unittest.TestCase):
    def setUp(self):
        place = tempfile.TemporaryDirectory()
        self.addCleanup(place.cleanup)
        self.folder = pathlib.Path(place.name)

    def driver(self, *names, **environment):
        words = [sys.executable, "-B", ROOT / "tests/series.py", PROGRAM, SAMPLE, *names, "--out", self.folder]
        environment = {**os.environ, **environment}
        done = subprocess.run(words, env=environment, capture_output=True, text=True, timeout=120, check=False)
        return done.returncode, done.stdout + done.stderr

    def sample(self, name, **environment):
        done = subprocess.run(
            [SAMPLE, f"--gtest_filter={name}"], env={**os.environ, **environment}, capture_output=True, text=True
        )
        return done.returncode, done.stdout

    def test_every_series_is_listed(self):
        """Otherwise `test --full` would run a tenth of it and say nothing."""
        listed = set()
        for file in ROOT.rglob("CMakeLists.txt"):
            if file.relative_to(ROOT).parts[0].startswith(("build", ".")):
                continue
            for block in re.findall(r"multipanda_test\([^)]*\)", file.read_text()):
                if "SERIES" in block:
                    listed |= set(block.split("SERIES", 1)[1].rstrip(")").split())
        listed = {re.sub(r"^\w+/(.*)/\w+$", r"\1", name) for name in listed}
        used = set()
        for folder in ("core", "fci", "motion_generators", "runtime", "sysid", "tests"):
            for file in (ROOT / folder).rglob("*_test.cpp"):
                for suite, name, body in TEST.findall(file.read_text()):
                    if re.search(r"\btest::Series series;", body):
                        used.add(f"{suite}.{name}")
        self.assertEqual(used, listed)
        self.assertGreater(len(used), 12)

    def test_all_cases_run_and_a_second_call_has_nothing_to_do(self):
        code, said = self.driver("Sample.Passes")
        self.assertEqual(code, 0, said)
        self.assertIn("Sample.Passes: 30 cases, 0 of them done before", said)
        self.assertIn("the sum is 435", said)  # of 0 to 29: the summary has all cases
        results = [json.loads(path.read_text()) for path in self.folder.rglob("results/results/*/*.json")]
        self.assertEqual({r["figures"]["third"] for r in results}, {k / 3 for k in range(30)})  # to the bit
        code, said = self.driver("Sample.Passes")
        self.assertEqual(code, 0, said)
        self.assertIn("30 cases, 30 of them done before", said)

    def test_what_fails_is_named(self):
        code, said = self.driver("Sample.OneCaseFails")
        self.assertEqual(code, 1)
        self.assertRegex(said, r"(?s)FAILED: Sample.OneCaseFails, case 17: .*seventeen")
        self.assertEqual(said.count("FAILED"), 1)
        code, said = self.driver("Sample.TogetherTheyFail")
        self.assertEqual(code, 1)
        self.assertIn("all cases together", said)
        code, said = self.driver("Sample.OneCaseDies")
        self.assertEqual(code, 1)
        self.assertRegex(said, r"(?s)case 3 has no result: .*died twice, by signal 6")
        for name in ("Sample.IsNoSeries", "Sample.DoesNotExist"):
            code, said = self.driver(name)
            self.assertEqual(code, 1)
            self.assertIn("is no series", said)

    def test_by_default_a_tenth_runs_and_in_full_every_case(self):
        bare = {name: "" for name in ("MULTIPANDA_SERIES", "MULTIPANDA_FULL")}
        self.assertIn("3 cases", self.sample("Sample.Passes", **bare)[1])
        self.assertIn("30 cases", self.sample("Sample.Passes", **{**bare, "MULTIPANDA_FULL": "1"})[1])
        tenth = {"MULTIPANDA_SERIES": "tenth", "MULTIPANDA_FULL": "1"}  # what `./multipanda test --full` sets
        self.assertIn("3 cases", self.sample("Sample.Passes", **tenth)[1])
        for wrong in ("case:30", "nonsense", "figures:/no/such/file"):
            self.assertEqual(self.sample("Sample.Passes", MULTIPANDA_SERIES=wrong)[0], 1, wrong)


if __name__ == "__main__":
    PROGRAM, SAMPLE = sys.argv[1:3]
    os.environ["MULTIPANDA_PROGRAM"] = os.path.abspath(PROGRAM)
    unittest.main(argv=sys.argv[:1] + sys.argv[3:])
