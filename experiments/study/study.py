#!/usr/bin/env python3
"""Entry point of `multipanda study`: uses the Python package of this tree, or the installed one."""

import pathlib
import sys

TREE = pathlib.Path(__file__).resolve().parents[2] / "python"
if TREE.exists():
    sys.path.insert(0, str(TREE))
    import os

    os.environ["PYTHONPATH"] = str(TREE)  # for worker processes

from multipanda.study_command import main

if __name__ == "__main__":
    sys.exit(main())
