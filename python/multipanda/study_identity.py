"""The program and the machine that compute a study's results. With the same ones results agree bit for bit."""

from __future__ import annotations

import functools
import hashlib
import os
import pathlib
import platform
from typing import Any

from ._version import __version__
from .errors import Error
from .program import checked_program
from .study_plan import canonical, file_digest, sha256

Json = dict[str, Any]


@functools.lru_cache(maxsize=8)
def _sorted_out(program: str, _size: int, _changed_ns: int, mapped: tuple[str, ...]) -> tuple[Json, Json]:
    own: dict[str, str] = {}
    libraries: dict[str, str] = {}
    for path in mapped:
        name = pathlib.PurePath(path).name
        ours = path == program or name.startswith("libmultipanda")
        (own if ours else libraries)[name] = file_digest(path)
    identity = {"version": __version__, "sha256": sha256(canonical(own))}
    return identity, {name: digest[:16] for name, digest in sorted(libraries.items())}


def _processor() -> Json:
    model, flags = "unknown", ""
    for line in pathlib.Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
        name, _, value = line.partition(":")
        if name.strip() == "model name":
            model = value.strip()
        elif name.strip() == "flags":  # the C library chooses variants of its mathematical functions by them
            flags = hashlib.sha256(" ".join(sorted(value.split())).encode()).hexdigest()[:16]
        if flags and model != "unknown":
            break
    return {"processor": model, "instructions": flags}


def identity(process: int) -> tuple[Json, Json]:
    """(program, machine) of a running worker process: versions and digests of all that it has mapped."""
    known = os.path.realpath(checked_program())
    # The process may have become another program of the same folder, such as multipanda-lab.
    program = os.path.realpath(f"/proc/{process}/exe") if os.path.exists(f"/proc/{process}/exe") else known
    if os.path.dirname(program) != os.path.dirname(known):
        program = known
    mapped = set()
    for line in pathlib.Path(f"/proc/{process}/maps").read_text(encoding="utf-8").splitlines():
        path = line[line.index("/") :] if "/" in line else ""
        if path and (path == program or ".so" in pathlib.PurePath(path).name):
            mapped.add(path)
    if program not in mapped:
        raise Error(f"process {process} of {program} has ended", "see what ended it; runs are tried again")
    found = os.stat(program)
    ours, libraries = _sorted_out(program, found.st_size, found.st_mtime_ns, tuple(sorted(mapped)))
    machine = {**_processor(), "libraries": libraries, "kernel": platform.release()}
    return ours, machine


def same_machine(a: Json, b: Json) -> bool:
    """Whether results agree bit for bit: processor and libraries are the same; the kernel does not matter."""
    return {**a, "kernel": ""} == {**b, "kernel": ""}


def difference(a: Json, b: Json) -> str:
    """The difference of two identities, as text."""
    words = []
    for name in sorted(set(a) | set(b)):
        x, y = a.get(name), b.get(name)
        if x == y or name == "kernel":
            continue
        if isinstance(x, dict) and isinstance(y, dict):
            differing = sorted(key for key in set(x) | set(y) if x.get(key) != y.get(key))
            words.append(f"{name}: {', '.join(differing)}")
        else:
            words.append(f"{name}: {x} and {y}")
    return "; ".join(words)
