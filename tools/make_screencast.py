#!/usr/bin/env python3
"""Joins the frames of the cockpit's browser tests into the README's screencast.

cockpit/page/page.sh browser build 8_screencast --pictures build/cockpit_pictures
.venv/bin/python tools/make_screencast.py build/cockpit_pictures/screencast docs/images/cockpit.webp
"""

import argparse
import json
import pathlib

from PIL import Image

WIDTH = 880  # pixels, as wide as a README is shown
SHORTEST = 0.12  # s that a frame is shown
MOST_BYTES = 1_500_000


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("frames", type=pathlib.Path, help="folder with 0000.jpg, ... and times.json")
    parser.add_argument("out", type=pathlib.Path)
    arguments = parser.parse_args()
    times = json.loads((arguments.frames / "times.json").read_text())
    chosen = []
    for k, time in enumerate(times):
        if not chosen or time - times[chosen[-1]] >= SHORTEST:
            chosen.append(k)
    images = []
    for k in chosen:
        image = Image.open(arguments.frames / f"{k:04d}.jpg")
        images.append(image.resize((WIDTH, round(image.height * WIDTH / image.width)), Image.Resampling.LANCZOS))
    ends = [times[k] for k in chosen[1:]] + [times[chosen[-1]] + 1]
    shown = [round(1000 * (end - times[k])) for k, end in zip(chosen, ends, strict=True)]
    images[0].save(arguments.out, save_all=True, append_images=images[1:], duration=shown, loop=0, quality=60, method=6)
    size = arguments.out.stat().st_size
    print(f"{arguments.out}: {len(images)} frames, {sum(shown) / 1000:.1f} s, {size / 1e6:.2f} MB")
    if size > MOST_BYTES:
        raise SystemExit(f"expected at most {MOST_BYTES / 1e6} MB: make it shorter or coarser")


if __name__ == "__main__":
    main()
