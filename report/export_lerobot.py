#!/usr/bin/env python3
"""Entry point of `multipanda export --lerobot`: uses the Python package of this tree, or the installed one."""

import pathlib
import sys

TREE = pathlib.Path(__file__).resolve().parent.parent / "python"
if TREE.exists():
    sys.path.insert(0, str(TREE))

from multipanda.lerobot.export import main

if __name__ == "__main__":
    sys.exit(main())
