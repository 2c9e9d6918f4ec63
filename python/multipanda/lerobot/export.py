"""The command `multipanda export LOG... --lerobot DIR`: the program exports the logs' numbers, this makes the data set.

It reads material.json, which the program has written, and writes result.json beside it.
"""

from __future__ import annotations

import json
import pathlib
import sys
from dataclasses import replace
from typing import Any

import numpy as np

from ..episode import LoggedEpisode
from ..log import read_log
from .dataset import ArrowMissing, Frames, write_dataset
from .names import ACTIONS, OBSERVED, action_names, state_names
from .sampling import Choice, LeftOut, RecordedRun, Sampler


class Nothing(Exception):
    """No data set can be made; the text names the reason and the remedy."""


def _choice(material: dict[str, Any]) -> Choice:
    arms = material["arms"] or list(material["logs"][0]["arms"])
    for what, names in (("--grippers", material["grippers"]), ("--leader", list(material["leaders"]))):
        unknown = [name for name in names if name not in arms]
        if unknown:
            raise Nothing(f"{what} names {', '.join(unknown)}, which is not among the arms {', '.join(arms)}")
    for name in material["observe"]:
        if name not in OBSERVED:
            raise Nothing(f"--observe: expected some of {', '.join(OBSERVED)}, found {name}")
    return Choice(
        arms,
        material["action"],
        material["observe"],
        material["grippers"],
        material["leaders"],
        material["fps"],
        material["task"] or material["logs"][0]["scene"],
    )


def _runs(material: dict[str, Any], arms: list[str]) -> list[tuple[RecordedRun, list[LoggedEpisode]]]:
    found = []
    for about in material["logs"]:
        missing = [arm for arm in arms if arm not in about["arms"]]
        if missing:
            raise Nothing(
                f"{about['name']} has no arm {', '.join(missing)}, it has {', '.join(about['arms'])}: a data set has "
                "the same arms in every episode; choose them by --arms, or export the logs separately"
            )
        log = read_log(about["npz"])
        found.append((RecordedRun(log, about), log.episodes))
    joints = {tuple(run.joints(arm) for arm in arms) for run, _ in found}
    if len(joints) > 1:
        raise Nothing("the arms of the logs have different numbers of joints: export the logs separately")
    return found


def _with_action(choice: Choice, runs: list[tuple[RecordedRun, list[LoggedEpisode]]], outcomes: list[str]) -> Choice:
    """The first kind of action with which an episode can be used; joints if there is none."""
    for kind in ACTIONS:
        for run, episodes in runs:
            for episode in episodes:
                if episode.outcome in outcomes:
                    try:
                        Sampler(run, replace(choice, action=kind)).frames(episode)
                    except LeftOut:
                        continue
                    return replace(choice, action=kind)
    return replace(choice, action=ACTIONS[0])


def _episodes(
    choice: Choice, runs: list[tuple[RecordedRun, list[LoggedEpisode]]], outcomes: list[str], notes: list[str]
) -> list[Frames]:
    found = []
    for run, episodes in runs:
        if not episodes:
            notes.append(f"{run.name} has no marked episodes: mark them with run.episode() (docs/logs.md)")
            continue
        counts: dict[str, int] = {}
        sampler: Sampler | None = None
        for episode in episodes:
            if episode.outcome not in outcomes:
                word = episode.outcome or "not judged"
                counts[word] = counts.get(word, 0) + 1
                continue
            try:
                sampler = sampler or Sampler(run, choice)
                frames = sampler.frames(episode)
                found.append(frames)
                head, tail = frames.origin["frames_dropped"]
                if head or tail:
                    notes.append(
                        f"{run.name}: episode {episode.number} is without its first {head} and last {tail} frames: "
                        "an arm was not commanded"
                    )
            except LeftOut as why:
                notes.append(f"{run.name}: episode {episode.number} is left out: it {why}")
        for word, count in counts.items():
            notes.append(f"{run.name}: {count} of {len(episodes)} episodes left out by their outcome: {word}")
    shown = [sorted(frames.pictures) for frames in found]
    if any(names != shown[0] for names in shown):
        raise Nothing(
            "the logs have pictures of different cameras: "
            + "; ".join(sorted({", ".join(names) or "none" for names in shown}))
            + ": export them separately"
        )
    if not found:
        raise Nothing("no episode is left for a data set:\n  " + "\n  ".join(notes))
    return found


def make(material: dict[str, Any], folder: pathlib.Path) -> dict[str, Any]:
    """Makes the data set of material.json in a folder.

    Raises:
        Nothing: There is nothing to make it of.
        ArrowMissing: pyarrow is not installed.
    """
    choice = _choice(material)
    runs = _runs(material, choice.arms)
    notes: list[str] = []
    if not choice.action:
        choice = _with_action(choice, runs, material["outcomes"])
    episodes = _episodes(choice, runs, material["outcomes"], notes)
    names: tuple[list[str], list[str]] = ([], [])
    for arm in choice.arms:
        joints, hands = runs[0][0].joints(arm), [arm] if arm in choice.grippers else []
        names[0].extend(state_names([arm], choice.observe, hands, joints))
        names[1].extend(action_names([arm], choice.action, hands, joints))
    info = write_dataset(folder, episodes, choice.fps, *names)
    seconds = float(np.sum([len(episode.state) for episode in episodes])) / choice.fps
    size = f"{info['total_episodes']} episodes, {info['total_frames']} frames ({seconds:.1f} s) at {choice.fps} Hz"
    return {"notes": notes, "said": f"{size}; action: {choice.action}"}


def main() -> int:
    """export_lerobot.py MATERIAL FOLDER"""
    material, folder = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])
    try:
        result = make(json.loads(material.read_text(encoding="utf-8")), folder)
    except ArrowMissing:
        install = f"{sys.executable} -m pip install pyarrow"
        result = {"error": f"the data set needs the Python package pyarrow, which is not installed: {install}"}
    except (Nothing, LeftOut) as why:
        result = {"error": str(why)}
    material.with_name("result.json").write_text(json.dumps(result), encoding="utf-8")
    return 0
