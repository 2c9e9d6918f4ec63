#!/usr/bin/env python3
"""Demonstrations: two leader arms drive the arms of a run, a pedal marks episodes, pictures go beside the run's log.

python record.py --run ssh://user@control/afternoon --leaders left.json right.json --pedal /dev/input/... pictures.mcap
"""

import argparse
import contextlib
import pathlib

import multipanda as mp
from multipanda.leader import lead
from multipanda.pedal import Pedal

ARMS = ("left", "right")
BOX_M = (0.62, 0, 0.3)  # where it stands, in the middle
SCENE = str(pathlib.Path(__file__).with_name("scene.yaml"))
CAMERAS = {  # real ones: mp.OpenCvCamera(0), mp.OpenCvCamera(1)
    "top": mp.SceneCamera([0.62, 0, 1.5], look_at_m=[0.62, 0, 0.3], width=96, height=72),
    "front": mp.SceneCamera([1.5, 0, 0.8], look_at_m=[0.62, 0, 0.3], width=96, height=72),
}


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("pictures", help="where they are written; move them beside the run's log.mcap")
    parser.add_argument("--run", help="name or ssh:// of the run (default: the only one)")
    parser.add_argument("--leaders", nargs=2, metavar=("LEFT", "RIGHT"), required=True, help="their calibrations")
    parser.add_argument("--pedal", required=True, help="its input device")
    options = parser.parse_args()
    with mp.connect(options.run) as far, Pedal(options.pedal) as pedal:
        with mp.Cameras(far, CAMERAS, rate_hz=10, log=options.pictures, scene=SCENE) as see:
            for name in CAMERAS:
                see.newer(name)  # waits for the first picture
            with contextlib.suppress(KeyboardInterrupt):
                lead(options.run, dict(zip(ARMS, options.leaders)), pedal)


if __name__ == "__main__":
    main()
