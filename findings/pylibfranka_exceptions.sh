#!/bin/bash
# Guess: `except pylibfranka.FrankaException` catches what the library raises, as franka::Exception does in C++.
# So it is: none of its exceptions derives from it. A program that parks its other arms in that branch never gets there when
# the network or the control of one arm fails; RuntimeError is what they share.
# The right number: franka/exception.h derives all of them from franka::Exception.
# Seen with pylibfranka 0.21.3 on 2026-11-29; nothing listens at the address, so that connecting is refused.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder"
"$folder/bin/pip" install -q --disable-pip-version-check pylibfranka==0.21.3 numpy==2.4.6
"$folder/bin/python" - <<'END'
import pylibfranka

names = [name for name in dir(pylibfranka) if name.endswith("Exception") and name != "FrankaException"]
caught = [name for name in names if issubclass(getattr(pylibfranka, name), pylibfranka.FrankaException)]
try:
    pylibfranka.Robot("127.0.0.79", pylibfranka.RealtimeConfig.kIgnore)
except pylibfranka.FrankaException:
    branch = "FrankaException"
except RuntimeError as error:
    branch = f"RuntimeError, by a {type(error).__name__}"
print(f"caught by FrankaException: {len(caught)} of {len(names)} ({', '.join(names)}); right: all")
print(f"a refused connection lands in the branch of {branch}")
assert not caught and branch.startswith("RuntimeError"), "this has changed"
END
