"""The runs of a study: every combination of choices with every seed, and the name of each one's result."""

from __future__ import annotations

import functools
import hashlib
import json
import os
import pathlib
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from .errors import Refused
from .program import call_json

Json = dict[str, Any]


def canonical(value: Any) -> bytes:
    """One text for equal values."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=False).encode()


def sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


@functools.lru_cache(maxsize=4096)
def _digest(path: str, _size: int, _changed_ns: int) -> str:
    return sha256(pathlib.Path(path).read_bytes())


def file_digest(path: str | os.PathLike[str]) -> str:
    """SHA-256 of a file; read again only when it has changed.

    Raises:
        Refused: It cannot be read.
    """
    try:
        found = os.stat(path)
        return _digest(os.fspath(path), found.st_size, found.st_mtime_ns)
    except OSError as wrong:
        raise Refused(
            "no_file",
            f"{os.fspath(path)} cannot be read here: {wrong.strerror}",
            "all computers need the study's files",
        ) from None


def _filled(word: str, values: dict[str, str]) -> str:
    """The argument with the values of its {NAME}s; {out} is for the worker."""
    return re.sub(r"\{([a-z][a-z0-9_]*)\}", lambda found: values.get(found[1], found[0]), word)


@dataclass(frozen=True)
class StudyRun:
    """One run.

    Attributes:
        key: Name of its result: a hash of everything that determines it.
        row: Its choices by axis, and its seed.
        inputs: The hashed inputs, besides the program. job: The task for a worker.
    """

    key: str
    row: Json
    inputs: Json
    job: Json


class Plan:
    """A study's checked file, and its runs, which are made one by one when they are needed."""

    def __init__(self, plan: Json) -> None:
        self.plan = plan
        self.title: str = plan["title"]
        self.kind: str = plan["kind"]
        self.axes: list[Json] = plan["axes"]
        self.files: dict[str, str] = {path: file_digest(path) for path in plan["files"]}
        # The folder of a file does not matter, only its name and contents.
        named = sorted((pathlib.PurePath(path).name, digest) for path, digest in self.files.items())
        self._shared: Json = {
            "kind": self.kind,
            "base": pathlib.PurePath(plan["base"]).name,
            "program": [
                pathlib.PurePath(word).name if os.path.isabs(word) else word for word in plan.get("program", [])
            ],
            "files": sha256(canonical(named)),
            **{name: plan.get(name) for name in ("vary", "seconds", "hidden", "logs", "repeats", "only")},
        }
        seeds = plan["seeds"]
        self.seeds = seeds if isinstance(seeds, list) else range(seeds["first"], seeds["first"] + seeds["count"])

    @classmethod
    def of(cls, file: str | os.PathLike[str]) -> Plan:
        """From a study file, checked by the program.

        Raises:
            Refused: The file is not accepted.
        """
        return cls(call_json(["study", os.fspath(file), "--plan"], add_json=False))

    def __len__(self) -> int:
        count = len(self.seeds)
        for axis in self.axes:
            count *= len(axis["choices"])
        return count

    def _combinations(self, axes: list[Json]) -> Iterator[tuple[Json, list[list[str]]]]:
        if not axes:
            yield {}, []
            return
        for row, changes in self._combinations(axes[:-1]):
            for choice in axes[-1]["choices"]:
                yield {**row, axes[-1]["name"]: choice["name"]}, changes + choice["set"]

    def runs(self, program: Json) -> Iterator[StudyRun]:
        """All runs in order: seeds within combinations. `program` is the identity of the program."""
        for choices, changes in self._combinations(self.axes):
            values = self.plan["set"] + changes
            for seed in self.seeds:
                inputs = {**self._shared, "set": values, "seed": seed}
                key = sha256(canonical({"inputs": inputs, "program": program}))
                yield StudyRun(key, {**choices, "seed": seed}, inputs, self._job(values, seed))

    def _job(self, values: list[list[str]], seed: int) -> Json:
        plan = self.plan
        if self.kind == "scene":
            job: Json = {"scene": plan["base"], "set": values, "vary": plan["vary"], "seed": seed}
            return {**job, "seconds": plan.get("seconds"), "hidden": plan["hidden"], "logs": plan["logs"]}
        if self.kind == "experiment":
            words = ["experiment", plan["base"], "--fast", "--seed", str(seed), "--repeats", str(plan["repeats"])]
            only = [value for key, value in values if key == "only"][-1:] or plan["only"]
            words += ["--only", ",".join(only)] if only else []
            for key, value in values:
                words += ["--set", f"{key}={value}"] if key != "only" else []
            return {"command": words}
        if self.kind == "program":
            return {"program": [_filled(word, {**dict(values), "seed": str(seed)}) for word in plan["program"]]}
        options = dict(values)  # options of refine; later choices replace earlier values
        words = ["refine", options.pop("refine", plan["base"]), "--hidden", str(seed), "--no-page"]
        for name, value in options.items():
            if value == "false":
                continue
            words += ["--" + name.replace("_", "-"), *([] if value == "true" else [value])]
        return {"command": words}
