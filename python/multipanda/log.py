"""Logs as numpy arrays, each read when it is used first.

The program exports the log (docs/logs.md); this reads the export. There is no second reader of the log's format here.
"""

from __future__ import annotations

import hashlib
import json
import os
import pathlib
import struct
import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .episode import LoggedEpisode, logged_episodes
from .errors import Error, Refused
from .program import call, last_lines

if TYPE_CHECKING:
    import pandas
    import xarray

Values = NDArray[Any]
_TOPICS = ("state", "command", "wrench", "report", "model")  # in which a short name is looked for, in this order


def _archive_of(log: pathlib.Path) -> pathlib.Path:
    """The export of a log: beside it, or in the cache folder if that cannot be written. Made again if it is older."""
    beside = log.with_suffix(".npz")
    target = beside
    if not os.access(log.parent, os.W_OK):
        name = hashlib.sha256(os.fsencode(log.resolve())).hexdigest()[:16]
        folder = pathlib.Path(tempfile.gettempdir(), f"multipanda-logs-{os.getuid()}")
        folder.mkdir(mode=0o700, exist_ok=True)
        target = folder / f"{name}.npz"
    if target.exists() and target.stat().st_mtime_ns >= log.stat().st_mtime_ns:
        return target
    code, _, err = call(["export", log, "--npz", "--out", target])
    if code != 0:
        raise Error(f"{log} cannot be read: {last_lines(err)}", f"after a crash: multipanda repair {log}")
    return target


def _mapped(archive: pathlib.Path, member: zipfile.ZipInfo) -> Values:
    """A read-only view of an array that is stored without compression; otherwise a copy."""
    with open(archive, "rb") as file:
        file.seek(member.header_offset)
        header = file.read(30)
        if member.compress_type == zipfile.ZIP_STORED and header[:4] == b"PK\x03\x04":
            name, extra = struct.unpack_from("<HH", header, 26)
            file.seek(member.header_offset + 30 + name + extra)
            version = np.lib.format.read_magic(file)
            read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
            shape, fortran, kind = read(file)
            if not kind.hasobject and 0 not in shape:
                view: Values = np.memmap(archive, kind, "r", file.tell(), shape, "F" if fortran else "C")
                return view
    with np.load(archive, allow_pickle=False) as loaded:
        copy: Values = loaded[member.filename.removesuffix(".npy")]
        return copy


class Log(Mapping[str, Values]):
    """The arrays of a log by name, such as "left/state/q" or short "left/q"; times [s] are "left/state/t".

    Names of quantities may be written as in CONVENTIONS.md: "left/tau_J". `log["left/q"]` maps the file: nothing is
    read before it is used, and nothing can be written. Values are in SI units. A name that the log does not have raises
    KeyError.

    Attributes:
        path: The log.
        archive: Its export, which is read.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        given = pathlib.Path(path)
        log = given / "log.mcap" if given.is_dir() else given
        if not log.exists():
            raise Refused("no_log", f"there is no log at {given}", "name the folder of a run, or its log.mcap")
        self.path = log
        self.archive = log if log.suffix == ".npz" else _archive_of(log)
        with zipfile.ZipFile(self.archive) as archive:
            self._members = {entry.filename.removesuffix(".npy"): entry for entry in archive.infolist()}
        self._arrays: dict[str, Values] = {}

    def __repr__(self) -> str:
        return f"<log {self.path}: {', '.join(self.arms)}; {len(self)} arrays>"

    def _full(self, name: str) -> str:
        if name in self._members:
            return name
        arm, _, field = name.partition("/")
        for topic in _TOPICS:
            short = f"{arm}/{topic}/{field}"
            if short in self._members:
                return short
        lower = name.lower()  # fields of messages are in lower case: tau_J is tau_j
        if lower != name:
            return self._full(lower)
        raise KeyError(f"the log has no array '{name}'; list(log) has all names")

    def __getitem__(self, name: str) -> Values:
        full = self._full(name)
        if full not in self._arrays:
            self._arrays[full] = _mapped(self.archive, self._members[full])
        return self._arrays[full]

    def __contains__(self, name: object) -> bool:
        try:
            return isinstance(name, str) and bool(self._full(name))
        except KeyError:
            return False

    def __iter__(self) -> Iterator[str]:
        return iter(self._members)

    def __len__(self) -> int:
        return len(self._members)

    @property
    def arms(self) -> list[str]:
        """Names of the arms."""
        return [name.removesuffix("/state/t") for name in self._members if name.endswith("/state/t")]

    def t(self, name: str) -> Values:
        """The times of an array [s].

        Raises:
            KeyError: The log has no such array.
        """
        return self[self._full(name).rpartition("/")[0] + "/t"]

    def messages(self, topic: str) -> list[dict[str, Any]]:
        """All messages of a topic with occasional messages: "switches", "events", "interventions"."""
        name = f"{topic}/json"
        return [json.loads(str(text)) for text in self[name]] if name in self._members else []

    @property
    def switches(self) -> list[dict[str, Any]]:
        """Each answer to a switch, and each switch by the loop itself."""
        return self.messages("switches")

    @property
    def events(self) -> list[dict[str, Any]]:
        """Parameters, features, targets, stops, modes of arms, lost records."""
        return self.messages("events")

    @property
    def episodes(self) -> list[LoggedEpisode]:
        """The attempts at a task that were marked by run.episode()."""
        if "events/json" not in self._members:
            return []
        return logged_episodes([float(t) for t in self["events/t"]], self.events)

    @property
    def interventions(self) -> list[dict[str, Any]]:
        """The beginnings of interventions of the safety stage."""
        return self.messages("interventions")

    def fields(self, topic: str) -> dict[str, Values]:
        """The arrays of one topic, such as "left/state", by field.

        Raises:
            KeyError: The log has no such topic.
        """
        found = {
            name[len(topic) + 1 :]: self[name]
            for name in self._members
            if name.startswith(topic + "/") and "/" not in name[len(topic) + 1 :]
        }
        if not found:
            raise KeyError(f"the log has no topic '{topic}'; list(log) has all names")
        return found

    def to_pandas(self, topic: str) -> pandas.DataFrame:
        """One topic as a table with the time [s] as index; elements count from 1. Needs pandas."""
        import pandas

        columns: dict[str, Values] = {}
        fields = self.fields(topic)
        times = fields.pop("t")
        for name, values in fields.items():
            flat = values.reshape(len(values), -1)
            for k in range(flat.shape[1]):
                columns[name if values.ndim == 1 else f"{name}_{k + 1}"] = flat[:, k]
        return pandas.DataFrame(columns, index=pandas.Index(times, name="t_s"))

    def to_xarray(self, topic: str) -> xarray.Dataset:
        """One topic as a dataset over t_s [s]. Needs xarray."""
        import xarray

        fields = self.fields(topic)
        times = fields.pop("t")
        data = {
            name: (("t_s", *(f"{name}_{axis}" for axis in range(1, values.ndim))), values)
            for name, values in fields.items()
        }
        return xarray.Dataset(data, coords={"t_s": times})


def read_log(path: str | os.PathLike[str]) -> Log:
    """The log of a recorded run.

    Args:
        path: The run's folder, its log.mcap, or an export of it (.npz).

    Raises:
        Refused: There is no log.
        Error: The log cannot be read; `multipanda repair` helps after a crash.
        ProgramMissing: The log is not exported yet, and the program that does so was not found.
        VersionMismatch: That program is of another version.
    """
    return Log(path)
