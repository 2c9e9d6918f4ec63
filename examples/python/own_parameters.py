#!/usr/bin/env python3
"""A controllet of your own, from a library (examples/own_controllet): its parameters change while it runs.

PYTHONPATH=python .venv/bin/python examples/python/own_parameters.py
"""

import argparse
import pathlib
import time

import multipanda as mp

SCENE = pathlib.Path(__file__).resolve().parents[1] / "own_controllet" / "scene.yaml"


def hand_height(arm):
    return arm.state.pose.position_m[2]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", default=SCENE, help="a scene that loads the library of virtual_wall")
    with mp.run(parser.parse_args().scene) as run:
        arm, wall = run.arms["arm"], run["wall"]
        for name, parameter in wall.descriptors.items():
            if "." not in name:  # its own, as the library declares them; those of features are feature.parameter
                print(f"{name}: {parameter.describe()}")

        # The hand floats; a wall that rises from below pushes it up. Numbers approach a new value within 0.2 s.
        wall.speed_damping.speed_rad_per_s = 0.05  # a feature, from the same library
        start = hand_height(arm)
        wall.height_m = start
        for _ in range(12):
            wall.height_m += 0.005
            time.sleep(0.1)
        time.sleep(0.5)
        print(
            f"wall {1e3 * (wall.height_m - start):.0f} mm higher, hand {1e3 * (hand_height(arm) - start):.0f} mm higher"
        )

        try:
            wall.height_m = 5  # beyond the bounds that the library declares
        except mp.Refused as refused:
            print("refused:", refused.reason)
        wall.speed_damping.switch(False)
        print("speed_damping on:", wall.features["speed_damping"])
    print(run.summary)


if __name__ == "__main__":
    main()
