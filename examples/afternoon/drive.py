#!/usr/bin/env python3
"""The policy drives the arms, trial by trial; prints its successes with their 95 % interval.

python drive.py policy.npz --run ssh://user@control/afternoon --trials 20
"""

import argparse
import math
import time

import multipanda as mp
import numpy as np
from record import ARMS, BOX_M, CAMERAS, SCENE
from train import FPS, Policy

SECONDS = 8
LIFTED_M, UPRIGHT_RAD = 0.05, 0.2


def wilson(successes, trials, z=1.96):
    """The 95 % interval of a share."""
    share, rest = successes / trials, z**2 / trials
    half = z * math.sqrt(share * (1 - share) / trials + rest / (4 * trials))
    return (share + rest / 2 - half) / (1 + rest), (share + rest / 2 + half) / (1 + rest)


def go(far, angles_rad):
    """Both arms go somewhere and rest."""
    laws = [far[f"{arm}_joint"] for arm in ARMS]
    far.switch([law.name for law in laws])
    for goal in [law.goal("joints", q, duration_s=1.5) for law, q in zip(laws, angles_rad)]:
        goal.wait(30)


def episode(far, see, policy, seconds, ages):
    """Appends the ages of the pictures when their chunks are sent [s]."""
    numbers = dict.fromkeys(CAMERAS, 0)
    far.switch([f"{arm}_joint" for arm in ARMS])
    with far["left_joint"].stream("joints") as left, far["right_joint"].stream("joints") as right:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            pictures = {name: see.newer(name, numbers[name]) for name in sorted(CAMERAS)}
            numbers = {name: picture.number for name, picture in pictures.items()}
            record = see.pair(pictures[next(iter(CAMERAS))]).record  # as in the data set: the first camera's instant
            state = [x for arm in map(record.arm, ARMS) for x in (arm.q_rad, arm.tau_J_nm)]
            chunk = policy([picture.rgb for picture in pictures.values()], np.concatenate(state))
            for stream, actions in ((left, chunk[:, :7]), (right, chunk[:, 7:])):
                stream.follow(actions, 1 / FPS, since_s=record.t_s)  # late ones are left out by the run
            ages.append(pictures[next(iter(CAMERAS))].age_s)


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("policy", help="file written by train.py")
    parser.add_argument("--run", help="name or ssh:// of the run (default: the only one)")
    parser.add_argument("--trials", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1000, help="seed of the places of the simulated box")
    options = parser.parse_args()
    policy, random = Policy(np.load(options.policy)), np.random.default_rng(options.seed)
    successes, ages = 0, []
    with mp.connect(options.run) as far, mp.Cameras(far, CAMERAS, rate_hz=10, scene=SCENE) as see:
        simulated = "box" in far.objects()
        for trial in range(1, options.trials + 1):
            go(far, policy.w["start_rad"])
            if simulated:
                away_m = [random.uniform(-0.08, 0.08), random.uniform(-0.02, 0.02), 0.0005]
                far.place("box", np.add(BOX_M, away_m))
                time.sleep(0.3)
            else:
                input("Place the box, step back, press Enter. ")
            try:
                episode(far, see, policy, SECONDS, ages)
            except mp.Refused as why:  # a pause of this program or of the network: the arms are held
                print(why)
            if simulated:
                box = far.objects()["box"]
                tilt_rad = math.acos(min(1, box.rotation[2, 2]))
                success = box.position_m[2] > BOX_M[2] + LIFTED_M and tilt_rad < UPRIGHT_RAD
            else:
                success = input("Lifted? y/n ") == "y"
            successes += success
            print(f"trial {trial}: {'success' if success else 'failure'}", flush=True)
    low, high = wilson(successes, options.trials)
    print(f"{successes} of {options.trials} succeeded: {low:.0%} to {high:.0%} (95 %, Wilson)")
    print(f"from a picture to its chunk: median {np.median(ages):.3f} s, p99 {np.quantile(ages, 0.99):.3f} s")


if __name__ == "__main__":
    main()
