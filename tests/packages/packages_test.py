#!/usr/bin/env python3
"""Makes the wheel and the .deb, and tests both without the source tree: packages_test.py BUILD [unittest options]."""

import pathlib
import subprocess
import sys
import time
import unittest

import made

MODULES = ("contents", "notices_complete", "installed", "own_plugin")


def main():
    if len(sys.argv) < 2:
        sys.exit(f"usage: {sys.argv[0]} BUILD [unittest options]")
    made.BUILD = pathlib.Path(sys.argv.pop(1)).resolve()
    begin = time.monotonic()
    done = subprocess.run(
        [sys.executable, "-B", made.ROOT / "packaging/make_packages.py", "--build", made.BUILD, "--out", made.OUT],
        capture_output=True,
        text=True,
    )
    if done.returncode != 0:
        sys.exit(done.stdout + done.stderr)
    print(f"made in {time.monotonic() - begin:.0f} s:\n{done.stdout}", flush=True)
    unittest.main(module=None, argv=[sys.argv[0], *(sys.argv[1:] or MODULES)], verbosity=2)


if __name__ == "__main__":
    main()
