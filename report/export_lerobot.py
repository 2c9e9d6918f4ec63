#!/usr/bin/env python3
"""What `multipanda export --lerobot` starts: the Python package of this tree, or the one that is installed."""

import pathlib
import sys

TREE = pathlib.Path(__file__).resolve().parent.parent / "python"
if TREE.exists():
    sys.path.insert(0, str(TREE))

from multipanda.lerobot.export import main  # noqa: E402  the path comes first

if __name__ == "__main__":
    sys.exit(main())
