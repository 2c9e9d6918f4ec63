"""`multipanda new scene`: asks six questions and writes a commented scene that runs. A program of its own."""

from __future__ import annotations

import argparse
import os
import pathlib
import re
import subprocess
import sys
from collections.abc import Callable
from typing import NamedTuple

SPACING_M = 0.52  # between arms side by side
MOST_ARMS = 8
GRAY, WOOD = [0.5, 0.52, 0.55, 1], [0.62, 0.5, 0.38, 1]


class Mount(NamedTuple):
    """How arms are mounted: the base of arm i of n, what is around them, and where simulated arms start."""

    doc: str
    base: Callable[[int, int], str]
    objects: Callable[[int], list[str]]
    remark: str
    start_rad: str = "ready"


def side_by_side(at: str, rpy_rad: str = "") -> Callable[[int, int], str]:
    """The bases of arms along y, the first one on the left."""
    turned = f", rpy_rad: {rpy_rad}" if rpy_rad else ""
    return lambda i, n: f"{{position_m: {at.replace('y', f'{SPACING_M * ((n - 1) / 2 - i):g}')}{turned}}}"


def duo(x: float, z: float) -> Callable[[int, int], str]:
    """The bases of an FR3 Duo whose mount has its lower side at x, z [m]."""

    def base(i: int, _: int) -> str:
        side, at = 1 - 2 * i, f"{x + 0.037:g}, {0.05018 - 0.10036 * i:g}, {z + 0.05:g}"
        return f"{{position_m: [{at}], rpy_rad: [{-0.89 * side}, -0.17, {-0.46 * side}]}}"

    return base


def box(name: str, size_m: list[float], position_m: list[float], color: list[float] = GRAY) -> str:
    return f"{{name: {name}, shape: box, size_m: {size_m}, position_m: {position_m}, color_rgba: {color}}}"


def beside(n: int) -> float:
    """Width of a support for so many arms side by side [m]."""
    return round(0.6 + SPACING_M * n, 2)


PUBLISHED = "Mount as in Franka's franka_description 2.7.0"
GRAVITY = "Real arms compensate gravity themselves: set the same mounting in their web interface."
MOUNTS = {
    "table": Mount(
        "on one table",
        side_by_side("[0, y, 0]"),
        lambda n: [box("table", [1.2, beside(n), 0.05], [0.4, 0, -0.026], WOOD)],
        "The table's top is at z = 0.",
    ),
    "wall": Mount(
        "on a wall",
        side_by_side("[0, y, 1.2]", "[0, pi/2, 0]"),
        lambda n: [box("wall", [0.1, beside(n), 2], [-0.051, 0, 1])],
        GRAVITY,
        "[0, -pi/4, 0, -3*pi/4, 0, pi, pi/4]",
    ),
    "ceiling": Mount(
        "under a ceiling",
        side_by_side("[0, y, 1.7]", "[pi, 0, pi]"),
        lambda n: [box("ceiling", [1.2, beside(n), 0.1], [0, 0, 1.751])],
        GRAVITY,
        "[0, -1.1, 0, -pi/2, 0, 3.5, pi/4]",
    ),
    "duo": Mount(
        "as FR3 Duo on one mount",
        duo(0, 0.6),
        lambda _: [
            box("stand", [0.2, 0.28, 0.58], [-0.02, 0, 0.29]),
            box("table", [0.6, 1.2, 0.7], [0.75, 0, 0.35], WOOD),
        ],
        f"{PUBLISHED}; the stand is assumed.",
    ),
    "mobile_duo": Mount(
        "as Mobile FR3 Duo that stands still",
        duo(0.405, 0.65),
        lambda _: [
            box("platform", [0.8, 0.58, 0.32], [0, 0, 0.19]),
            box("column", [0.272, 0.3, 1.11], [0.151, 0, 0.906]),
            box("table", [0.6, 1.2, 0.75], [1.15, 0, 0.375], WOOD),
        ],
        f"{PUBLISHED}; so are\n# platform and column (lifted by 0.2 of 0.85 m), boxes that do not move.",
    ),
}
HANDS = {
    "franka": ["hand: true"],
    "none": ["hand: false"],
    "other": [
        "hand: false                                    # drive yours from your own program",
        "tool: {mass_kg: 0.9, com_m: [0, 0, 0.06]}      # weigh it; in the frame of the flange",
        "end_effector: {position_m: [0, 0, 0.16]}       # its tip",
    ],
}
MODELS = {"fer": "Panda", "fr3": "FR3", "fr3v2": "FR3v2"}
USES = {
    "poses": "goals and streams of poses and joint angles",
    "force": "the same, and pressing with a force",
    "both": "the same, and one law for two arms: carrying, squeezing",
    "lead": "the same, and the first arm, guided by hand, leads the second",
}
FOR_TWO = ("duo", "mobile_duo", "both", "lead")


class Question(NamedTuple):
    text: str
    default: str
    words: dict[str, str]  # that may answer it, with what they mean; none: it is free
    pattern: str = r"\w+"


QUESTIONS = {
    "arms": Question(f"How many arms, 1 to {MOST_ARMS}?", "1", {}, f"[1-{MOST_ARMS}]"),
    "model": Question("Which arms?", "fr3", MODELS),
    "hand": Question("What is on their flanges?", "franka", dict.fromkeys(HANDS, "")),
    "mount": Question("How are they mounted?", "table", {word: mount.doc for word, mount in MOUNTS.items()}),
    "use": Question("What for?", "poses", USES),
    "name": Question("Name of the scene, letters, digits and _?", "my_scene", {}, r"[A-Za-z]\w*"),
}


def answered(key: str, option: str | None, arms: int) -> str:
    """The option, or the answer of a person. Raises ValueError if there is none, or a wrong one as option."""
    question = QUESTIONS[key]
    words = {word: doc for word, doc in question.words.items() if arms == 2 or word not in FOR_TWO}
    expected = f"expected one of {', '.join(words)}" if words else f"'{question.text}'"
    if option is None:
        print(f"\n{question.text}", *(f"\n  {word:<11} {doc}" for word, doc in words.items()), sep="", file=sys.stderr)
    while True:
        answer = option
        if answer is None:
            print(f"[{question.default}] ", end="", file=sys.stderr, flush=True)
            if not (line := sys.stdin.readline()):
                raise ValueError(f"no answer; give --{key}")
            answer = line.strip() or question.default
        if answer in words or (not words and re.fullmatch(question.pattern, answer, re.ASCII)):
            return answer
        wrong = f"{expected}, found '{answer}'" + (f"; with {arms} arms" if words and arms != 2 else "")
        if option is not None:
            raise ValueError(f"--{key}: {wrong}")
        print(wrong, file=sys.stderr)


def laws(names: list[str], use: str) -> list[str]:
    lines = []
    for name in names:
        of = f"{name}_" if len(names) > 1 else ""
        lines += [
            f"- {{name: {of}joint, type: joint_impedance, arms: {name}}}",
            f"- {{name: {of}cartesian, type: cartesian_impedance, arms: {name}, features: [joint_limits]}}",
            f"- {{name: {of}guide, type: gravity_compensation, arms: {name}}}   # led by hand",
        ]
        if use == "force":
            lines.append(f"- {{name: {of}press, type: force, arms: {name}}}   # input: wrench, force_n: [0, 0, -10]")
    pair = f"arms: [{', '.join(names)}]"
    if use == "both":
        lines += [
            f"- {{name: dual, type: dual_cartesian_impedance, {pair}, features: [joint_limits],",
            "   parameters: {goals: separate}}   # inputs: first_pose, second_pose",
            f"- {{name: coupled, type: coupled_dual_cartesian_impedance, {pair}, features: [joint_limits]}}",
            f"- {{name: squeeze, type: coupled_ufic, {pair}}}   # inputs: pose, squeeze [N]",
        ]
    if use == "lead":
        lines.append(f"- {{name: lead, type: teleoperation, {pair}}}")
    return lines


def motion(at_s: float, controllet: str, way: str) -> str:
    way = f"{{controllet: {controllet}, input: pose, {way}, period_s: 4, ramp_s: 1}}"
    return f"- {{at_s: {at_s:g}, motion: {way}}}"


def scene(arms: int, model: str, hand: str, mount: str, use: str, name: str, file: pathlib.Path) -> str:
    """The text of the scene in this file."""
    place = MOUNTS[mount]
    names = ["arm"] if arms == 1 else ["left", "right"] if arms == 2 else [f"arm_{i + 1}" for i in range(arms)]
    share = pathlib.Path(__file__).resolve().parents[2]  # the source tree; in a package beside this file
    if not (share / "config/schemas").exists():
        share = pathlib.Path(__file__).resolve().parent / "share/multipanda"
    schema = os.path.relpath(share / "config/schemas/scene.json", file.resolve().parent)
    title = f"{arms} {MODELS[model]} {place.doc}"
    lines = [
        f"# yaml-language-server: $schema={schema}",
        f"# {title}. {place.remark}",
        "# Written by `multipanda new scene`. Every key, its unit and its default: docs/scene_reference.md.",
        f"name: {name}",
        f"description: {title}",
        "duration_s: 12   # 0: until stopped",
        "",
        "# Poses are in the world: x forward, y to the left, z up. Angles are in radians.",
        "arms:",
    ]
    for i, arm in enumerate(names):
        lines += [f"  - name: {arm}", f"    model: {model}", *(f"    {line}" for line in HANDS[hand])]
        lines += [f"    base: {place.base(i, arms)}", f"    start_rad: {place.start_rad}   # of the simulated arm"]
        lines.append(f"    # fci: 172.16.{i}.2   # makes it a real arm; read docs/real_arms.md first")
    around = ["{name: floor, shape: plane, position_m: [0, 0, %g]}" % (-0.75 if mount == "table" else 0)]
    lines += ["", "objects:", *(f"  - {line}" for line in around + place.objects(arms)), ""]
    lines.append("# All are ready from the start; switches decide which ones run. An arm without one is held.")
    lines += ["controllets:", *(f"  {line}" for line in laws(names, use)), ""]
    first = ["lead"] if use == "lead" else ["cartesian"] if arms == 1 else [f"{arm}_cartesian" for arm in names]
    lines.append(f"active: [{', '.join(first)}]")
    if use != "lead":
        lines += ["", "# Hands go down by 10 cm and back. `multipanda run --no-timeline` waits for commands instead."]
        lines += ["timeline:", *(f"  {motion(1, law, 'rise: [0, 0, -0.1]')}" for law in first)]
    if use == "both":
        lines += ["  - {at_s: 6.5, switch: {activate: [coupled]}}", f"  {motion(7, 'coupled', 'sine: [0, 0.04, 0]')}"]
    return "\n".join(lines) + "\n"


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="multipanda new",
        description="Write a commented scene that runs, by six questions. An option answers one of them.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog="Examples:\n  multipanda new scene\n"
        "  multipanda new scene --arms 2 --model fr3v2 --hand franka --mount duo --use both --name my_duo",
    )
    parser.add_argument("what", choices=["scene"], help="What to write")
    for key, question in QUESTIONS.items():
        parser.add_argument(f"--{key}", help=f"{question.text} {', '.join(question.words)}")
    parser.add_argument("--out", metavar="FILE", help="File to write (default: NAME.yaml)")
    parser.add_argument("--force", action="store_true", help="Replace a file that exists")
    options = parser.parse_args()
    try:
        arms = int(answered("arms", options.arms, 0))
        keys = [key for key in QUESTIONS if key != "arms"]
        given = {key: answered(key, getattr(options, key), arms) for key in keys}
        file = pathlib.Path(options.out or f"{given['name']}.yaml")
        if file.exists() and not options.force:
            raise ValueError(f"{file} exists; --out names another file, --force replaces it")
        file.write_text(scene(arms, **given, file=file), encoding="utf-8")
    except (ValueError, OSError) as wrong:
        print(f"multipanda new: {wrong}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("\nmultipanda new: nothing was written", file=sys.stderr)
        return 130
    code = subprocess.call([os.environ.get("MULTIPANDA_PROGRAM", "multipanda"), "check", str(file)])
    if code == 0:
        print(f"wrote {file}; next: multipanda run {file}")
    return code


if __name__ == "__main__":
    sys.exit(main())
