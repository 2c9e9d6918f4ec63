#!/bin/bash
# Guess: position_extrema of a Ruckig trajectory are the least and the greatest position on the way, as a check against
# joint limits needs them.
# So it is: they can lie well inside the range that the trajectory covers. Here the axis runs to 1.247 m, and the extrema say
# 1.207 m; in a third of random one-axis moves they understate the range, by up to 15 cm.
# The right number: the path of the hardest braking in closed form, and 20,000 samples of the trajectory itself.
# Seen with ruckig 0.19.4 on 2026-11-29.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder"
"$folder/bin/pip" install -q --disable-pip-version-check ruckig==0.19.4
"$folder/bin/python" - <<'END'
import random

from ruckig import InputParameter, Result, Ruckig, Trajectory

V, A, J = 1.0, 2.0, 10.0


def plan(start, velocity, target, samples):
    request = InputParameter(1)
    request.current_position, request.current_velocity, request.target_position = [start], [velocity], [target]
    request.max_velocity, request.max_acceleration, request.max_jerk = [V], [A], [J]
    trajectory = Trajectory(1)
    assert Ruckig(1).calculate(request, trajectory) == Result.Working
    positions = [trajectory.at_time(trajectory.duration * i / samples)[0][0] for i in range(samples + 1)]
    said = trajectory.position_extrema[0]
    return said.min, said.max, min(positions), max(positions)


_, said, _, reached = plan(0.9, V, 0.95, 20000)
right = 0.9 + V * A / J - A**3 / (6 * J**2) + (V - A**2 / (2 * J)) ** 2 / (2 * A)
print(f"position_extrema.max {said:.4f}, greatest sample {reached:.4f}, right {right:.4f} m")
assert abs(reached - right) < 1e-6

random.seed(1)
moves = [plan(*(random.uniform(-1, 1) for _ in range(3)), 1000) for _ in range(300)]
short = [max(low_said - low, high - high_said) for low_said, high_said, low, high in moves]
wrong = sum(amount > 1e-3 for amount in short)
print(f"{wrong} of {len(moves)} moves leave their extrema by more than 1 mm, at most by {max(short) * 1e3:.0f} mm")
assert right - said > 0.03 and wrong > 50, "this has changed"
END
