"""Compressed pictures in an MCAP file beside a run's log: its times are those of the log, and Foxglove opens both."""

from __future__ import annotations

import base64
import io
import json
import os
import pathlib
import threading
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from .camera import PairedPicture

_QUALITY = 90  # of JPEG
_MILLIMETERS = 1000  # of a depth picture's numbers per meter
_IMAGE = "foxglove.CompressedImage"
_TIME = {"type": "object", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}}
_PICTURE = {
    "timestamp": _TIME,
    "frame_id": {"type": "string"},
    "data": {"type": "string", "contentEncoding": "base64"},
    "format": {"type": "string"},
}
_PAIRING = {
    "picture": {"type": "integer"},
    "cycle": {"type": "integer"},
    "age_s": {"type": "number"},
    "error_s": {"type": "number"},
    "q_rad": {"type": "object"},
}


def _mcap() -> Any:
    try:
        import mcap.reader
        import mcap.writer
    except ModuleNotFoundError as missing:
        raise ModuleNotFoundError(
            f"logs of pictures need the package mcap ({missing}): pip install 'multipanda[cameras]'"
        ) from missing
    return mcap


def _packed(pixels: NDArray[Any], format: str) -> bytes:
    from PIL import Image

    out = io.BytesIO()
    Image.fromarray(pixels).save(out, format, **({"quality": _QUALITY} if format == "jpeg" else {"compress_level": 1}))
    return out.getvalue()


@dataclass(frozen=True)
class LoggedPicture:
    """A picture of a log.

    Attributes:
        t_s: When it was taken, in loop time.
        data: The file in it.
        format: `jpeg` or `png`.
        age_s: How old it was when it was logged [s].
        error_s: Its pairing error [s].
    """

    t_s: float
    data: bytes
    format: str
    age_s: float
    error_s: float

    @property
    def pixels(self) -> NDArray[Any]:
        """Rows x columns x 3; of depth: rows x columns [mm]."""
        from PIL import Image

        return np.array(Image.open(io.BytesIO(self.data)))


class PictureLog:
    """Writes pictures: topic /cameras/NAME, its depth /cameras/NAME/depth (PNG [mm]), /cameras/NAME/pairing."""

    def __init__(self, path: str | os.PathLike[str], lossless: bool = False) -> None:
        mcap = _mcap()
        self._format = "png" if lossless else "jpeg"
        self._lock = threading.Lock()
        self._file = open(path, "wb")  # noqa: SIM115 (closed by close())
        self._writer: Any = mcap.writer.Writer(self._file)
        self._writer.start("", "multipanda")
        self._schemas = {
            name: self._writer.register_schema(
                name, "jsonschema", json.dumps({"type": "object", "properties": properties}).encode()
            )
            for name, properties in ((_IMAGE, _PICTURE), ("multipanda.PicturePairing", _PAIRING))
        }
        self._channels: dict[str, int] = {}

    def _write(self, topic: str, schema: str, t_ns: int, message: dict[str, Any]) -> None:
        if topic not in self._channels:
            self._channels[topic] = self._writer.register_channel(topic, "json", self._schemas[schema])
        self._writer.add_message(self._channels[topic], max(0, t_ns), json.dumps(message).encode(), max(0, t_ns))

    def write(self, paired: PairedPicture) -> None:
        """Appends a picture and its pairing; after close() it does nothing."""
        picture, record = paired.picture, paired.record
        t_ns = int(record["t_ns"][0])
        topic = f"/cameras/{picture.camera}"
        layers = {topic: (picture.rgb, self._format)}
        if picture.depth_m is not None:
            layers[f"{topic}/depth"] = (np.clip(_MILLIMETERS * picture.depth_m, 0, 65535).astype(np.uint16), "png")
        packed = {name: (_packed(*layer), layer[1]) for name, layer in layers.items()}
        stamp = {"sec": t_ns // 10**9, "nsec": t_ns % 10**9}
        pairing = {"picture": picture.number, "cycle": record.cycle, "age_s": picture.age_s, "error_s": paired.error_s}
        state = record.state()
        with self._lock:
            if self._writer is None:
                return
            self._write(
                f"{topic}/pairing",
                "multipanda.PicturePairing",
                t_ns,
                {**pairing, "q_rad": {name: arm.q_rad.tolist() for name, arm in state.arms.items()}},
            )
            for name, (data, form) in packed.items():
                text = base64.b64encode(data).decode()
                message = {"timestamp": stamp, "frame_id": picture.camera, "data": text, "format": form}
                self._write(name, _IMAGE, t_ns, message)

    def close(self) -> None:
        """Completes the file."""
        with self._lock:
            writer, self._writer = self._writer, None
            if writer is not None:
                writer.finish()
                self._file.close()


def read_pictures(path: str | os.PathLike[str]) -> dict[str, list[LoggedPicture]]:
    """The pictures of a log by camera, and by `NAME/depth`, in the order of their instants.

    Raises:
        ModuleNotFoundError: The package mcap is not installed.
    """
    mcap = _mcap()
    found: dict[str, list[LoggedPicture]] = {}
    about: dict[str, dict[str, Any]] = {}
    with pathlib.Path(path).open("rb") as file:
        for schema, channel, message in mcap.reader.make_reader(file).iter_messages(log_time_order=False):
            name = channel.topic.removeprefix("/cameras/")
            content = json.loads(message.data)
            if schema.name != _IMAGE:  # precedes its picture
                about[name.removesuffix("/pairing")] = content
                continue
            pair = about[name.removesuffix("/depth")]
            data = base64.b64decode(content["data"])
            picture = LoggedPicture(1e-9 * message.log_time, data, content["format"], pair["age_s"], pair["error_s"])
            found.setdefault(name, []).append(picture)
    return {name: sorted(pictures, key=lambda picture: picture.t_s) for name, pictures in found.items()}
