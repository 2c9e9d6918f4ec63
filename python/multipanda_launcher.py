"""The command `multipanda` of an installed wheel: the native program, with this Python for the pages.

Next to the package, not in it: importing the package loads numpy, which takes longer than the program's start.
"""

import os
import sys


def main() -> None:
    program = os.path.join(os.path.dirname(os.path.abspath(__file__)), "multipanda", "bin", "multipanda")
    os.environ.setdefault("MULTIPANDA_PYTHON", sys.executable)
    os.execv(program, ["multipanda", *sys.argv[1:]])
