#!/bin/bash
# Guess: with Synchronization.Phase Ruckig moves along a straight line, and says so where it cannot.
# So it is: as soon as the start velocity is not exactly along the line it falls back to time synchronization without a word:
# the result is Working as before. A start 2 % off in one axis, as a measured velocity always is, bends a path of 1 m by
# 28 mm, where the velocity across the line could be stopped within 0.02 mm.
# The right number: distances from the line of 201 samples; a straight start and its fall-back side by side.
# Seen with ruckig 0.19.4 on 2026-11-29.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder"
"$folder/bin/pip" install -q --disable-pip-version-check ruckig==0.19.4 numpy==2.4.6
"$folder/bin/python" - <<'END'
import numpy as np
from ruckig import InputParameter, Ruckig, Synchronization, Trajectory

GOAL = np.array([1.0, 0.3])


def plan(velocity, synchronization):
    request = InputParameter(2)
    request.current_position, request.target_position = [0, 0], GOAL.tolist()
    request.current_velocity = velocity
    request.max_velocity, request.max_acceleration, request.max_jerk = [1, 1], [2, 2], [10, 10]
    request.synchronization = synchronization
    trajectory = Trajectory(2)
    result = Ruckig(2).calculate(request, trajectory)
    path = np.array([trajectory.at_time(t)[0] for t in np.linspace(0, trajectory.duration, 201)])
    normal = np.array([-GOAL[1], GOAL[0]]) / np.linalg.norm(GOAL)
    return result.name, abs(path @ normal).max()


straight = plan([0.2, 0.06], Synchronization.Phase)
measured = plan([0.2, 0.06 * 0.98], Synchronization.Phase)
by_time = plan([0.2, 0.06 * 0.98], Synchronization.Time)
print(f"along the line: {straight[0]}, {straight[1] * 1e3:.1f} mm off; 2 % beside: {measured[0]}, {measured[1] * 1e3:.1f} mm off")
print(f"2 % beside with Synchronization.Time: {by_time[1] * 1e3:.1f} mm off")
# The shortest stop of a velocity v by jerk j: v sqrt(v / j).
across = 0.06 * 0.02
print(f"the velocity across the line, below {across * 1e3:.1f} mm/s, can be stopped within {across * (across / 10) ** 0.5 * 1e3:.3f} mm")
assert straight[1] < 1e-9
assert measured == by_time and measured[0] == straight[0] and measured[1] > 0.02, "this has changed"
END
