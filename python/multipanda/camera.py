"""Cameras beside a run: the newest picture of each, stamped on the loop's clock, with the state of its instant.

Each real camera has a thread of its own, and so have the cameras of a scene together. None of them can delay the loop.
A camera that fails is reported and opened again; its last picture stays, with its age and the fault.
"""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .base_client import BaseClient
from .closing import Closing
from .connection import Json
from .errors import Error, Refused, Timeout
from .record import Record
from .scene_camera import SceneCamera, SceneView
from .started import Run

if TYPE_CHECKING:
    from .picture_log import PictureLog

_LOGGER = logging.getLogger("multipanda.cameras")
_AGAIN_S = 0.5  # until a failed camera is opened again
_FIRST_S = 10.0  # patience for a first picture
_END_S = 2.0  # patience for a thread that waits for its camera
_FRESH_S = 0.003  # a state whose objects may have moved longer than this is asked for again
_DRIVER_NS = 2_000_000_000  # a driver's stamp that differs more from now is not of the monotonic clock


class Shot(NamedTuple):
    """What a camera delivers.

    Attributes:
        rgb: Rows x columns x 3.
        depth_m: Distance along the view [m], 0: unknown; None: it measures none.
        t_ns: When it was taken, by time.monotonic_ns() [ns].
    """

    rgb: NDArray[np.uint8]
    depth_m: NDArray[np.float32] | None
    t_ns: int


class Camera:
    """A real camera. One of your own overrides read(); every exception of it is a fault, after which it opens again.

    Attributes:
        delay_s: How long before its stamp the light was caught: exposure and transfer [s]. Measure it.
    """

    def __init__(self, delay_s: float = 0) -> None:
        self.delay_s = delay_s

    def open(self) -> None:
        """Opens the device; again after a fault."""

    def read(self) -> Shot:
        """Waits for the next picture."""
        raise NotImplementedError

    def close(self) -> None:
        """Releases the device."""


class OpenCvCamera(Camera):
    """A camera that OpenCV opens: its number or file, such as /dev/video0. Its stamp is the driver's on Linux."""

    def __init__(
        self,
        index_or_path: int | str,
        *,
        width: int | None = None,
        height: int | None = None,
        fps: float | None = None,
        delay_s: float = 0,
    ) -> None:
        """
        Args:
            index_or_path: Number or file of the device.
            width: Columns that are asked for.
            height: Rows that are asked for.
            fps: Pictures per second that are asked for.
            delay_s: Of its stamps [s].
        """
        super().__init__(delay_s)
        self._device = index_or_path
        self._asked = {"FRAME_WIDTH": width, "FRAME_HEIGHT": height, "FPS": fps}
        self._capture: Any = None

    def open(self) -> None:
        """Opens the device. Raises OSError if it cannot, ModuleNotFoundError without OpenCV."""
        try:
            import cv2
        except ModuleNotFoundError as missing:
            raise ModuleNotFoundError("OpenCvCamera needs OpenCV: pip install opencv-python-headless") from missing
        self._capture = cv2.VideoCapture(self._device)
        if not self._capture.isOpened():
            raise OSError(f"{self._device} cannot be opened: is it plugged in, and free?")
        for name, value in self._asked.items():
            if value is not None:
                self._capture.set(getattr(cv2, f"CAP_PROP_{name}"), value)

    def read(self) -> Shot:
        """Waits for the next picture. Raises OSError if there is none."""
        if not self._capture.grab():
            raise OSError(f"{self._device} gives no picture: it is unplugged or at its end")
        now = time.monotonic_ns()
        driver = int(1e6 * self._capture.get(0))  # CAP_PROP_POS_MSEC: Video4Linux stamps with the monotonic clock
        whole, picture = self._capture.retrieve()
        if not whole:
            raise OSError(f"{self._device} gave a broken picture")
        rgb = np.ascontiguousarray(picture[:, :, ::-1])
        return Shot(rgb, None, driver if 0 <= now - driver < _DRIVER_NS else now)

    def close(self) -> None:
        """Releases the device."""
        if self._capture is not None:
            self._capture.release()


class LeRobotCamera(Camera):
    """One of LeRobot's cameras: LeRobotCamera(RealSenseCamera(RealSenseCameraConfig(...))).

    Attributes:
        camera: LeRobot's.
    """

    def __init__(self, camera: Any, delay_s: float = 0) -> None:
        super().__init__(delay_s)
        self.camera = camera

    def open(self) -> None:
        """Connects it."""
        if not self.camera.is_connected:
            self.camera.connect()

    def read(self) -> Shot:
        """Waits for the next picture."""
        rgb = self.camera.async_read()
        # LeRobot stamps with time.perf_counter(), which is the monotonic clock on Linux.
        stamp = getattr(self.camera, "latest_timestamp", None)
        return Shot(rgb, None, time.monotonic_ns() if stamp is None else int(1e9 * stamp))

    def close(self) -> None:
        """Disconnects it."""
        if self.camera.is_connected:
            self.camera.disconnect()


@dataclass(frozen=True)
class Picture:
    """A picture.

    Attributes:
        camera: Name of the camera.
        rgb: Rows x columns x 3.
        depth_m: Distance along the view [m], 0: unknown; None: the camera measures none.
        t_ns: When it was taken, by time.monotonic_ns() [ns].
        number: Of the camera's pictures, from 1.
        fault: Why there is no newer one; empty while the camera works.
        uncertainty_s: How far from t_ns parts of it may be [s]: objects of a simulation; over ssh, the clocks' offset.
    """

    camera: str
    rgb: NDArray[np.uint8]
    depth_m: NDArray[np.float32] | None
    t_ns: int
    number: int
    fault: str = ""
    uncertainty_s: float = 0

    @property
    def age_s(self) -> float:
        """Time since it was taken."""
        return 1e-9 * (time.monotonic_ns() - self.t_ns)


@dataclass(frozen=True)
class PairedPicture:
    """A picture and the state of its instant.

    Attributes:
        picture: The picture.
        record: The state, interpolated between the two cycles around the instant.
        error_s: Pairing error, at most [s]: from the instant to the nearest recorded cycle, and the picture's own.
    """

    picture: Picture
    record: Record
    error_s: float


class _SceneCameras:
    """All cameras of a scene, drawn from the run's newest state."""

    def __init__(self, client: BaseClient, scene: str, settings: Mapping[str, Any], cameras: Mapping[str, SceneCamera]):
        self._client, self._scene, self._settings, self._cameras = client, scene, settings, cameras
        self._view: SceneView | None = None
        self.delay_s = 0.0

    def open(self) -> None:
        self._view = SceneView(self._scene, self._cameras, self._settings)
        for name in self._cameras:  # OpenGL begins with the first picture, for which a state would become too old
            self._view.shoot(name)

    def read(self) -> dict[str, tuple[Shot, float]]:
        assert self._view is not None
        for _ in range(10):
            answer = self._client.ask({"do": "state"})
            state = answer["state"]
            if not state["objects"] or state["since_cycle_s"] < _FRESH_S:
                break
        t_ns = self._start_ns(answer)
        joints = {arm["arm"]: np.array(arm["q_rad"]) for arm in state["arms"]}
        widths = {arm["arm"]: arm["gripper"]["width_m"] for arm in state["arms"] if arm.get("gripper")}
        poses = {name: np.r_[at["position_m"], at["quaternion_wxyz"]] for name, at in state["objects"].items()}
        self._view.place(joints, poses, widths)
        spread = state["since_cycle_s"] if poses else 0.0
        return {name: (Shot(*self._view.shoot(name), t_ns), spread) for name in self._cameras}

    def _start_ns(self, answer: Json) -> int:
        """When the cycle of a state began: from its record, since the answer's own times include delays here."""
        cycle, since_s = answer["state"]["cycle"], answer["state"]["since_cycle_s"]
        shared, far = self._client.shared(), self._client.connection.link is not None
        about_ns: int = self._client.connection.answered_ns(answer) - round(1e9 * since_s)
        if far:  # its record is asked for
            self._client.record_at(about_ns)
        deadline = time.monotonic() + _END_S
        while (start_ns := shared.start_of(cycle)) is None:
            if far:
                return about_ns
            if time.monotonic() > deadline:
                raise Timeout(f"the run's records lack cycle {cycle}", "see its messages")
            time.sleep(0.001)
        return start_ns

    def close(self) -> None:
        if self._view is not None:
            self._view.close()


class _Feed:
    """A thread that reads one source until the end, whatever the source raises."""

    def __init__(self, source: Any, names: list[str], owner: Cameras, period_s: float) -> None:
        self.fault = ""
        self._source, self._names, self._owner, self._period_s = source, names, owner, period_s
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"camera {names[0]}", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._end.is_set():
            try:
                self._source.open()
                while not self._end.is_set():
                    begin = time.monotonic()
                    self._take(self._source.read())
                    self._end.wait(begin + self._period_s - time.monotonic())
            except Exception as wrong:  # a driver may raise anything
                if not self._end.is_set():
                    self._failed(f"{type(wrong).__name__}: {wrong}")
            finally:
                with contextlib.suppress(Exception):
                    self._source.close()
            self._end.wait(_AGAIN_S)

    def _take(self, found: Any) -> None:
        shots = found if isinstance(found, dict) else {self._names[0]: (found, self._owner.clock_s)}
        if self.fault:
            _LOGGER.warning("camera %s works again", ", ".join(self._names))
            self.fault = ""
        for name, (shot, spread) in shots.items():
            self._owner.take(name, shot, round(1e9 * self._source.delay_s), spread)

    def _failed(self, fault: str) -> None:
        if fault != self.fault:
            _LOGGER.warning("camera %s: %s; the run continues, the camera is reopened", ", ".join(self._names), fault)
        self.fault = fault

    def close(self) -> None:
        self._end.set()

    def join(self) -> None:
        self._thread.join(_END_S)


class Cameras(Mapping[str, Picture], Closing):
    """The newest pictures of a run's cameras: `cameras["top"]` with its age and fault, `cameras.paired("top")`.

    with mp.run("two_arms") as run, mp.Cameras(run, {"top": mp.SceneCamera([1, 0, 1], look_at_m=[0.5, 0, 0])}) as see:
        see["top"].rgb
    """

    def __init__(
        self,
        run: BaseClient,
        cameras: Mapping[str, SceneCamera | Camera],
        *,
        rate_hz: float = 30,
        log: bool | str = False,
        lossless: bool = False,
        stalled_s: float = 0.5,
        scene: str | None = None,
    ) -> None:
        """
        Args:
            run: The run.
            cameras: Its cameras by name.
            rate_hz: Pictures per second of cameras of the scene, at most; real cameras have their own rate.
            log: True: writes every picture beside the run's log (pictures.mcap); or a file of your choice.
            lossless: Whether the log's pictures are PNG; otherwise they are JPEG.
            stalled_s: A camera without a new picture for longer has a fault [s].
            scene: Name or file of the scene; known if `run` comes from mp.run().

        Raises:
            Refused: A camera of the scene without the scene's file, or a log beside a run without one.
            ModuleNotFoundError: A package for the log is not installed.
        """
        self._client, self._stalled_s = run, stalled_s
        self._lock = threading.Condition()
        self._newest: dict[str, Picture] = {}
        self._log: PictureLog | None = None
        simulated = {name: camera for name, camera in cameras.items() if isinstance(camera, SceneCamera)}
        settings: Mapping[str, Any] = {}
        if isinstance(run, Run) and scene is None:
            scene, settings = run.scene_file, run.settings
        if simulated and scene is None:
            raise Refused(
                "unknown_scene",
                "a client that has connected to a run does not know its scene's file",
                "name it: Cameras(..., scene=...)",
            )
        if log:
            from .picture_log import PictureLog

            if log is True and not isinstance(run, Run):
                raise Refused(
                    "no_log", "only mp.run() knows where the run's log is", 'name a file: log="pictures.mcap"'
                )
            self._log = PictureLog(
                run.folder / "pictures.mcap" if isinstance(run, Run) and log is True else str(log), lossless
            )
        self._feeds: dict[str, _Feed] = {}
        if simulated:
            feed = _Feed(_SceneCameras(run, str(scene), settings, simulated), list(simulated), self, 1 / rate_hz)
            self._feeds.update(dict.fromkeys(simulated, feed))
        for name, camera in cameras.items():
            if isinstance(camera, Camera):
                self._feeds[name] = _Feed(camera, [name], self, 0)

    @property
    def clock_s(self) -> float:
        """How well the clock of this computer is known on the run's [s]."""
        return self._client.connection.delay_s / 2

    def take(self, name: str, shot: Shot, delay_ns: int, uncertainty_s: float = 0) -> None:
        """A camera's next picture, from its thread."""
        with self._lock:
            before = self._newest.get(name)
            number = 1 if before is None else before.number + 1
            picture = Picture(name, shot.rgb, shot.depth_m, shot.t_ns - delay_ns, number, "", uncertainty_s)
            self._newest[name] = picture
            self._lock.notify_all()
            log = self._log
        if log is not None:
            try:
                log.write(self.pair(picture))
            except (Error, OSError) as why:  # the run has ended, the disk is full: no fault of the camera
                _LOGGER.warning("a picture of camera %s is not logged: %s", name, why)

    def _fault(self, picture: Picture) -> str:
        if fault := self._feeds[picture.camera].fault:
            return fault
        return f"no picture for {picture.age_s:.1f} s" if picture.age_s > self._stalled_s else ""

    def __getitem__(self, name: str) -> Picture:
        """The newest picture. Waits for the first one: Timeout if there is none within 10 s, with the reason."""
        if name not in self._feeds:
            raise KeyError(f"there is no camera '{name}'; there are: {', '.join(self._feeds)}")
        with self._lock:
            if not self._lock.wait_for(lambda: name in self._newest, _FIRST_S):
                fault = self._feeds[name].fault or "it delivers nothing"
                raise Timeout(f"camera '{name}' has given no picture yet: {fault}", "check the camera")
            picture = self._newest[name]
        return replace(picture, fault=self._fault(picture))

    def newer(self, name: str, than: int = 0, timeout_s: float = 10) -> Picture:
        """Waits for a picture whose number is above `than`.

        Raises:
            Timeout: There is none within timeout_s [s].
        """
        picture = self[name]
        with self._lock:
            if not self._lock.wait_for(lambda: self._newest[name].number > than, timeout_s):
                why = self._feeds[name].fault or "it delivers nothing new"
                raise Timeout(
                    f"camera '{name}' has given no picture for {picture.age_s:.1f} s: {why}", "check the camera"
                )
            return self._newest[name]

    def pair(self, picture: Picture) -> PairedPicture:
        """A picture of the last 2 s with the state of its instant.

        Raises:
            Timeout: The run has made no cycle.
            Refused: The run shares no records.
            Disconnected: The run has ended.
        """
        record, apart_s = self._client.record_at(picture.t_ns)
        return PairedPicture(picture, record, apart_s + picture.uncertainty_s)

    def paired(self, name: str) -> PairedPicture:
        """The newest picture with the state of its instant. Errors are those of pair() and of `cameras[name]`."""
        return self.pair(self[name])

    def __iter__(self) -> Iterator[str]:
        return iter(self._feeds)

    def __len__(self) -> int:
        return len(self._feeds)

    def close(self) -> None:
        """Ends the threads and the log. A thread that is blocked in its camera is left behind."""
        feeds = set(self._feeds.values())
        for feed in feeds:
            feed.close()
        for feed in feeds:
            feed.join()
        with self._lock:
            log, self._log = self._log, None
        if log is not None:
            log.close()
