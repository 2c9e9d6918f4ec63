"""The last line of a test run, from a log of ctest with every kind of result."""

import pathlib
import subprocess
import sys
import tempfile
import unittest

TOOL = pathlib.Path(__file__).resolve().parent.parent / "tools/test_summary.py"

LOG = """
1/5 Testing: core_test
1/5 Test: core_test
Output:
core/x_test.cpp:12: Skipped
no loop guard
here

[  SKIPPED ] Core.Guarded (0 ms)
[==========] 7 tests from 2 test suites ran. (5 ms total)
<end of output>
Test time =   0.64 sec
Test Passed.
2/5 Testing: modes_test
Output:
[  FAILED  ] Modes.Switch (3 ms)
[==========] 4 tests from 1 test suite ran. (5 ms total)
[  FAILED  ] Modes.Switch (3 ms)
Test Failed.
3/5 Testing: python_client
Output:
skipped: no mypy
Ran 5 tests in 1.2s
OK (skipped=2)
Test Passed.
4/5 Testing: cockpit_browser
Output:
skipped: no browser
Test Skipped.
5/5 Testing: layers
Output:
every file includes only what its layer may use
Test Passed.
"""


class Summary(unittest.TestCase):
    def summary(self, text):
        with tempfile.TemporaryDirectory() as folder:
            log = pathlib.Path(folder) / "LastTest.log"
            log.write_text(text)
            done = subprocess.run([sys.executable, TOOL, log], capture_output=True, text=True, check=False)
        return done.returncode, done.stdout.splitlines()

    def test_counts_cases_and_lists_what_was_skipped(self):
        code, lines = self.summary(LOG)
        self.assertEqual(code, 1)
        self.assertEqual(lines[-1], "13 passed, 1 failed, 4 skipped")  # 6 + 3 + 3 + 0 + 1
        self.assertEqual(
            lines[:-1],
            [
                "skipped: Core.Guarded: no loop guard here",
                "skipped: cockpit_browser: no browser",
                "skipped: python_client: no mypy",
                "skipped: python_client: see its output",
            ],
        )

    def test_a_second_try_is_named_and_few_of_them_are_allowed(self):
        def tried(number):
            name = f"5/5 Testing: script_{number}\nOutput:\n"
            return name + "FAILED (failures=1)\nTest Failed.\n" + name + "Ran 2 tests in 1.2s\nTest Passed.\n"

        self.assertEqual(
            self.summary(tried(1)), (0, ["only at the second try: script_1", "2 passed, 0 failed, 0 skipped"])
        )
        code, lines = self.summary("".join(map(tried, range(4))))
        self.assertEqual((code, lines[-1]), (1, "8 passed, 1 failed, 0 skipped"))

    def test_nothing_that_ran_is_no_success(self):
        self.assertEqual(self.summary(""), (1, ["0 passed, 0 failed, 0 skipped"]))


if __name__ == "__main__":
    unittest.main()
