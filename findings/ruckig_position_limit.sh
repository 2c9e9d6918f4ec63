#!/bin/bash
# Guess: a trajectory that Ruckig returns for an input with max_position stays below it.
# So it is: the community version has the field, prints it, and has an error for it (ErrorPositionalLimits), but plans without:
# at 1 m/s, 0.1 m before the limit, it returns Working and runs 0.25 m past the limit before it comes back.
# The right number: braking as hard as acceleration a and jerk j allow covers v a / j - a^3 / 6 j^2 + (v - a^2 / 2 j)^2 / 2 a: no
# trajectory keeps the limit, so that only an error would be right.
# Seen with ruckig 0.19.4 on 2026-11-29.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder"
"$folder/bin/pip" install -q --disable-pip-version-check ruckig==0.19.4
"$folder/bin/python" - <<'END'
from ruckig import InputParameter, Result, Ruckig, Trajectory

V, A, J, START, TARGET, LIMIT = 1.0, 2.0, 10.0, 0.9, 0.95, 1.0
request = InputParameter(1)
request.current_position, request.current_velocity, request.target_position = [START], [V], [TARGET]
request.max_velocity, request.max_acceleration, request.max_jerk = [V], [A], [J]
request.min_position, request.max_position = [-LIMIT], [LIMIT]
trajectory = Trajectory(1)
result = Ruckig(1).calculate(request, trajectory)
furthest = max(trajectory.at_time(trajectory.duration * i / 1000)[0][0] for i in range(1001))
stop = START + V * A / J - A**3 / (6 * J**2) + (V - A**2 / (2 * J)) ** 2 / (2 * A)
print(f"result {result.name}, limit {LIMIT}, furthest position {furthest:.3f}, shortest stop at {stop:.3f}")
assert stop > LIMIT and abs(furthest - stop) < 1e-4
assert result == Result.Working and furthest > LIMIT + 0.1, "this has changed"
END
