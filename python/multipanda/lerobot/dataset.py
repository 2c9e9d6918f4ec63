"""Writes a LeRobot data set of version 3.0: parquet tables and JSON, without LeRobot."""

from __future__ import annotations

import io
import json
import pathlib
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..rotations import Array

VERSION = "v3.0"
ROBOT_TYPE = "multipanda"
IMAGES = "observation.images."
_SAMPLED, _STEP = 20, 4  # pictures of an episode, and every so many of their pixels, for the statistics
_FILE_MB = 100  # a larger file ends with the episode
_CHUNK = 1000  # files per folder
_PATH = "{}/chunk-{:03d}/file-{:03d}.parquet"
_QUANTILES = (0.01, 0.10, 0.50, 0.90, 0.99)


class ArrowMissing(Exception):
    """pyarrow is not installed."""


def _arrow() -> Any:
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError as missing:
        raise ArrowMissing(str(missing)) from None
    return pyarrow


@dataclass
class Frames:
    """One episode.

    Attributes:
        state: observation.state, a row per frame, in the order of the names.
        action: action, likewise.
        task: What was to be done.
        pictures: Files of pictures by camera, a frame each, JPEG or PNG.
        origin: Where it comes from, for meta/multipanda.json.
    """

    state: Array
    action: Array
    task: str
    origin: dict[str, Any] = field(default_factory=dict)
    pictures: dict[str, list[bytes]] = field(default_factory=dict)


def _pixels(file: bytes) -> NDArray[np.uint8]:
    from PIL import Image

    return np.array(Image.open(io.BytesIO(file)).convert("RGB"))


def _features(
    state_names: list[str], action_names: list[str], pictures: dict[str, list[bytes]]
) -> dict[str, dict[str, Any]]:
    def vector(names: list[str]) -> dict[str, Any]:
        return {"dtype": "float32", "shape": [len(names)], "names": names}

    def scalar(kind: str) -> dict[str, Any]:
        return {"dtype": kind, "shape": [1], "names": None}

    own = {"action": vector(action_names), "observation.state": vector(state_names), "timestamp": scalar("float32")}
    for name, files in pictures.items():
        axes = ["height", "width", "channels"]
        own[IMAGES + name] = {"dtype": "image", "shape": list(_pixels(files[0]).shape), "names": axes}
    return own | {name: scalar("int64") for name in ("frame_index", "episode_index", "index", "task_index")}


def _table(columns: dict[str, Any], features: dict[str, dict[str, Any]]) -> Any:
    """Vectors as lists of fixed size, as in LeRobot's own writer."""
    arrow = _arrow()
    arrays = {}
    for name, about in features.items():
        if about["dtype"] == "image":  # as in the library datasets: a file's contents, and its name
            rows = [{"bytes": file, "path": None} for file in columns[name]]
            kind = arrow.struct([("bytes", arrow.binary()), ("path", arrow.string())])
            arrays[name] = arrow.array(rows, kind)
            continue
        kind = arrow.float32() if about["dtype"] == "float32" else arrow.int64()
        flat = arrow.array(np.ascontiguousarray(columns[name]).ravel(), kind)
        vector = about["names"] is not None and about["shape"] != [1]
        arrays[name] = arrow.FixedSizeListArray.from_arrays(flat, about["shape"][0]) if vector else flat
    return arrow.table(arrays)


class _Shards:
    """Files of at most about _FILE_MB, one row group per episode."""

    def __init__(self, folder: pathlib.Path, what: str) -> None:
        self._folder, self._what = folder, what
        self._writer: Any = None
        self._bytes = 0
        self.number = -1

    def add(self, table: Any) -> None:
        if self._writer is None or self._bytes + table.nbytes > _FILE_MB * 1e6:
            self.close()
            self.number += 1
            path = self._folder / _PATH.format(self._what, *divmod(self.number, _CHUNK))
            path.parent.mkdir(parents=True, exist_ok=True)
            self._writer = _arrow().parquet.ParquetWriter(str(path), table.schema, compression="snappy")
            self._bytes = 0
        self._writer.write_table(table)
        self._bytes += table.nbytes

    @property
    def place(self) -> tuple[int, int]:
        """The last written chunk and file."""
        return divmod(self.number, _CHUNK)

    def close(self) -> None:
        if self._writer is not None:
            self._writer.close()
        self._writer = None


def _write_tasks(path: pathlib.Path, tasks: list[str]) -> None:
    """The table of tasks, with the remark by which pandas makes the texts its index."""
    arrow = _arrow()
    table = arrow.table({"task_index": arrow.array(range(len(tasks)), arrow.int64()), "task": tasks})

    def column(name: str, kind: str, of_numpy: str) -> dict[str, Any]:
        return {"name": name, "field_name": name, "pandas_type": kind, "numpy_type": of_numpy, "metadata": None}

    about = {
        "index_columns": ["task"],
        "column_indexes": [],
        "columns": [column("task_index", "int64", "int64"), column("task", "unicode", "object")],
        "creator": {"library": "pyarrow", "version": arrow.__version__},
        "pandas_version": "2.0.0",
    }
    arrow.parquet.write_table(table.replace_schema_metadata({"pandas": json.dumps(about)}), str(path))


def _sampled(files: list[bytes]) -> NDArray[Any]:
    """Pixels of some pictures, red, green and blue from 0 to 1: every one would take minutes."""
    chosen = np.unique(np.linspace(0, len(files) - 1, _SAMPLED).round().astype(int))
    return np.concatenate([_pixels(files[k])[::_STEP, ::_STEP].reshape(-1, 3) / 255 for k in chosen])


def _statistics(name: str, parts: list[Any]) -> dict[str, Any]:
    """Figures of each column of a feature, the deviation of the whole and not of a sample; for pictures 3 x 1 x 1."""
    values = np.concatenate(parts)
    rows = np.asarray(values, dtype=np.float64).reshape(len(values), -1)
    columns = {"min": rows.min(axis=0), "max": rows.max(axis=0), "mean": rows.mean(axis=0), "std": rows.std(axis=0)}
    for share, row in zip(_QUANTILES, np.quantile(rows, _QUANTILES, axis=0)):
        columns[f"q{round(100 * share):02d}"] = row
    shape = (3, 1, 1) if name.startswith(IMAGES) else (-1,)
    return {"count": [len(rows)], **{key: column.reshape(shape).tolist() for key, column in columns.items()}}


def write_dataset(
    folder: pathlib.Path, episodes: list[Frames], fps: int, state_names: list[str], action_names: list[str]
) -> dict[str, Any]:
    """Writes the data set.

    Args:
        folder: A new or empty folder.
        episodes: The episodes, one or more.
        fps: Frames per second.
        state_names: Names of observation.state.
        action_names: Names of action.

    Returns:
        The contents of meta/info.json.

    Raises:
        ArrowMissing: pyarrow is not installed.
    """
    arrow = _arrow()
    features = _features(state_names, action_names, episodes[0].pictures)
    tasks = list(dict.fromkeys(episode.task for episode in episodes))
    data = _Shards(folder, "data")
    rows: list[dict[str, Any]] = []
    everything: dict[str, list[Any]] = {name: [] for name in features}
    begin = 0
    for number, episode in enumerate(episodes):
        count = len(episode.state)
        columns: dict[str, Any] = {
            "action": episode.action.astype(np.float32),
            "observation.state": episode.state.astype(np.float32),
            "timestamp": (np.arange(count) / fps).astype(np.float32),
            "frame_index": np.arange(count),
            "episode_index": np.full(count, number),
            "index": np.arange(begin, begin + count),
            "task_index": np.full(count, tasks.index(episode.task)),
        }
        columns |= {IMAGES + name: files for name, files in episode.pictures.items()}
        data.add(_table(columns, features))
        for name, files in episode.pictures.items():
            columns[IMAGES + name] = _sampled(files)
        for name in features:
            everything[name].append(columns[name])
        chunk, file = data.place
        row: dict[str, Any] = {
            "episode_index": number,
            "tasks": [episode.task],
            "length": count,
            "data/chunk_index": chunk,
            "data/file_index": file,
            "dataset_from_index": begin,
            "dataset_to_index": begin + count,
        }
        for name in features:
            row |= {f"stats/{name}/{key}": value for key, value in _statistics(name, [columns[name]]).items()}
        rows.append(row | {"meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0})
        begin += count
    data.close()
    about = _Shards(folder, "meta/episodes")
    about.add(arrow.Table.from_pylist(rows))
    about.close()
    _write_tasks(folder / "meta/tasks.parquet", tasks)
    info = {
        "codebase_version": VERSION,
        "fps": fps,
        "features": features,
        "total_episodes": len(episodes),
        "total_frames": begin,
        "total_tasks": len(tasks),
        "chunks_size": _CHUNK,
        "data_files_size_in_mb": _FILE_MB,
        "video_files_size_in_mb": 200,
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": None,
        "robot_type": ROBOT_TYPE,
        "splits": {"train": f"0:{len(episodes)}"},
    }
    whole = {name: _statistics(name, parts) for name, parts in everything.items()}
    origins = [{"episode_index": k, **episode.origin} for k, episode in enumerate(episodes)]
    for name, contents in (("info", info), ("stats", whole), ("multipanda", {"episodes": origins})):
        text = json.dumps(contents, indent=2, ensure_ascii=False, allow_nan=False)
        (folder / "meta" / f"{name}.json").write_text(text + "\n", encoding="utf-8")
    return info
