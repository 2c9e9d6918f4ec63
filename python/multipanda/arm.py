"""One arm of a run: state, stop, gripper, load, frames, recovery."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from concurrent.futures import Future
from typing import Any

import numpy as np

from .base_client import BaseClient
from .connection import Json, accepted
from .errors import Refused
from .model import ArmModel
from .pose import Pose
from .state import ArmState, GripperState

_GRIPPER_PATIENCE_S = 620  # the run gives up after 600 s
_FOLLOWED_S, _MOST_FOLLOWED = 0.2, 16  # silence of a width; unanswered ones


def _pose(values: Any) -> dict[str, list[float]]:
    pose = Pose.of(values)
    return {"position_m": pose.position_m.tolist(), "quaternion_wxyz": pose.quaternion_wxyz.tolist()}


class _Device:
    """An end effector that executes actions."""

    _kind: str

    def __init__(self, arm: Arm) -> None:
        self._arm = arm

    def _ask(self, action: str, **values: float | None) -> None:
        given = {key: value for key, value in values.items() if value is not None}
        request = {"do": self._kind, "arm": self._arm.name, "action": action, **given}
        self._arm.client.ask(request, _GRIPPER_PATIENCE_S)

    def stop(self) -> None:
        """Ends an action."""
        self._ask("stop")


class Gripper(_Device):
    """The hand of an arm. Each call returns when the motion has ended, but follow() and hold() at once.

    Every call raises `Refused` if the arm has no hand or the motion failed, `Timeout` without an answer in 620 s,
    `Disconnected` once the run has ended.
    """

    _kind = "gripper"

    def __init__(self, arm: Arm) -> None:
        super().__init__(arm)
        self._followed: deque[Future[Json]] = deque()

    @property
    def state(self) -> GripperState:
        """Width [m], and whether an object is held."""
        state = self._arm.state.gripper
        if state is None:
            raise Refused("no_gripper", f"arm '{self._arm.name}' has no gripper")
        return state

    def homing(self) -> None:
        """Closes and opens the fingers to find their range."""
        self._ask("homing")

    def move(self, width_m: float, speed_m_per_s: float | None = None) -> None:
        """Moves the fingers to a distance [m]; the hand's own speed by default."""
        self._ask("move", width_m=width_m, speed_m_per_s=speed_m_per_s)

    def grasp(
        self,
        width_m: float,
        speed_m_per_s: float | None = None,
        force_n: float | None = None,
        tolerance_m: float | None = None,
    ) -> None:
        """Closes until an object of this width is held.

        Args:
            width_m: Width of the object [m].
            speed_m_per_s: Speed of the fingers [m/s].
            force_n: Force to hold it with [N].
            tolerance_m: Largest difference to the width [m], to either side.

        Raises:
            Refused: What is between the fingers has another width, or there is nothing.
        """
        self._ask("grasp", width_m=width_m, speed_m_per_s=speed_m_per_s, force_n=force_n, tolerance_m=tolerance_m)

    def follow(
        self,
        width_m: float,
        speed_m_per_s: float | None = None,
        force_n: float | None = None,
        silence_s: float | None = None,
    ) -> bool:
        """Sends the newest of a stream of widths, 20 to 50 per second; never waits.

        What the fingers close on is held, until a width above its own. Without the next width for `silence_s`, after a
        stop of the arm and at the end of this process they stay where they are, and hold what they hold.

        Args:
            width_m: Distance of the fingers [m]; beyond their range they go to its end.
            speed_m_per_s: Speed at which they approach it [m/s]; 0.1 by default.
            force_n: Force on what is between them [N]; 40 by default.
            silence_s: How long it counts without a newer one [s], at most 1; 0.2 by default.

        Returns:
            False if the run has not answered earlier ones yet, and this one was dropped.

        Raises:
            Refused: An earlier one was: the arm is stopped, has no hand, another client's widths are followed, or this
                stream was ended and has to pause for `silence_s` first.
            ValueError: The width is not a finite number.
        """
        if not np.isfinite(width_m):
            raise ValueError(f"expected a finite width [m], found {width_m}")
        while self._followed and self._followed[0].done():
            answer = self._followed.popleft().result()
            if not answer.get("ok"):
                self._followed.clear()
                accepted(answer)
        if len(self._followed) >= _MOST_FOLLOWED:
            return False
        given = {"width_m": float(width_m), "speed_m_per_s": speed_m_per_s, "force_n": force_n, "silence_s": silence_s}
        request: Json = {"do": self._kind, "arm": self._arm.name, "action": "follow"}
        request |= {key: value for key, value in given.items() if value is not None}
        patience_s = _FOLLOWED_S if silence_s is None else silence_s
        self._followed.append(self._arm.client.connection.post(request, patience_s))
        return True

    def hold(self) -> None:
        """Ends follow(): the fingers stay where they are, and hold what they hold."""
        self._followed.clear()
        self._ask("follow")


class Vacuum(_Device):
    """The vacuum gripper of an arm. Each call returns when it has finished, and raises the errors of Gripper."""

    _kind = "vacuum"

    def on(self, vacuum_mbar: float | None = None, timeout_s: float | None = None) -> None:
        """Applies suction until an object is held.

        Args:
            vacuum_mbar: Pressure below that of the air [mbar].
            timeout_s: How long to try [s].

        Raises:
            Refused: Nothing is held in time.
        """
        self._ask("on", vacuum_mbar=vacuum_mbar, timeout_s=timeout_s)

    def drop(self, timeout_s: float | None = None) -> None:
        """Releases what is held, within timeout_s [s]."""
        self._ask("drop", timeout_s=timeout_s)


class Arm:
    """One arm of a run: `run.arms["left"]`.

    Every call asks the run, and raises `Refused` with the reason if it is not accepted, `Timeout` without an answer,
    `Disconnected` once the run has ended.

    Attributes:
        name: Its name in the scene.
        joints: Number of joints.
        home_rad: The model's comfortable joint angles [rad]: run["joint"].goal("joints", arm.home_rad).
        gripper: Its hand.
        vacuum: Its vacuum gripper.
        client: The run.
    """

    def __init__(self, client: BaseClient, entry: dict[str, Any]) -> None:
        self.client = client
        self.name: str = entry["name"]
        self.joints: int = entry["joints"]
        self.home_rad = np.array(entry["home_rad"], dtype=np.float64)
        self.gripper = Gripper(self)
        self.vacuum = Vacuum(self)
        self._load: tuple[Any, ...] | None = None  # as this client has set it
        self._frames: dict[str, Any] = {}
        self._model: ArmModel | None = None

    def __repr__(self) -> str:
        return f"<arm {self.name}: {self.joints} joints>"

    @property
    def base(self) -> Pose:
        """Pose of its base in the world [m].

        Raises:
            Refused: It stands on another arm, which moves it.
        """
        return self.client.base(self.name)

    @property
    def model(self) -> ArmModel:
        """The loop's model, with the scene's load and frames or those that this client has set: read it again then.

        Raises:
            Refused: The run was not started by this process; mp.model(SCENE, arm=NAME) names its scene.
        """
        if self._model is None:
            self._model = self.client.arm_model(self.name)
            if self._load is not None:
                self._model.set_load(*self._load)
            if self._frames:
                self._model.set_frames(**self._frames)
        return self._model

    def _ask(self, request: str, **values: Any) -> None:
        given = {key: value for key, value in values.items() if value is not None}
        self.client.ask({"do": request, "arm": self.name, **given})

    @property
    def state(self) -> ArmState:
        """The newest state, as from `Client.state()`. Raises Timeout if the run does not answer."""
        return self.client.arm_state(self.name)

    def stop(self) -> None:
        """Holds this arm from the next cycle on until resume(). Not a safety-rated stop."""
        self.client.stop(self.name)

    def resume(self) -> None:
        """Allows switches again after stop(). The arm stays in hold until the next switch."""
        self.client.resume(self.name)

    def recover(self) -> None:
        """Clears the arm's error once its cause is removed; never done automatically. The arm is held afterwards."""
        self._ask("recover")

    def reconnect(self) -> None:
        """Connects to a real arm again whose connection was lost. The arm is held afterwards."""
        self._ask("reconnect")

    def stop_motion(self) -> None:
        """Ends the arm's motion; recover() starts it again."""
        self._ask("stop_motion")

    def user_stop(self, pressed: bool) -> None:
        """Simulation: presses or releases the arm's stop button."""
        self._ask("user_stop", pressed=pressed)

    def set_load(
        self, mass_kg: float, com_m: Sequence[float], inertia_kg_m2: Sequence[Sequence[float]] | None = None
    ) -> None:
        """Declares the payload.

        Its weight comes in within 1 s, so the arm moves by what is declared and not there, over its stiffness.

        Args:
            mass_kg: Mass [kg]; 0 for none.
            com_m: Center of mass in the flange frame [m].
            inertia_kg_m2: Inertia about the center of mass, 3 x 3 [kg m^2].

        Raises:
            Refused: The arm may not carry it (`largest_load_kg` in the scene).
            ValueError: The inertia is not a symmetric 3 x 3 matrix.
        """
        inertia = None
        if inertia_kg_m2 is not None:
            m = np.asarray(inertia_kg_m2, dtype=np.float64)
            if m.shape != (3, 3) or not np.allclose(m, m.T):
                raise ValueError("inertia_kg_m2: expected a symmetric 3 x 3 matrix")
            keys = {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}
            inertia = {key: float(m[at]) for key, at in keys.items()}
        self._ask("set_load", mass_kg=mass_kg, com_m=[float(x) for x in com_m], inertia_kg_m2=inertia)
        self._load, self._model = (mass_kg, com_m, inertia_kg_m2), None

    def set_frames(self, end_effector: Any = None, stiffness_frame: Any = None) -> None:
        """Redefines frames; the arm does not move.

        Args:
            end_effector: Pose of the end effector in the flange frame [m].
            stiffness_frame: Pose of the stiffness frame in that of the end effector [m].

        Raises:
            ValueError: Neither is given, or one is not a valid pose.
            Refused: The end effector is farther from the flange than `farthest_end_effector_m` of the scene.
        """
        if end_effector is None and stiffness_frame is None:
            raise ValueError("set_frames: expected end_effector, stiffness_frame, or both")
        self._ask(
            "set_frames",
            end_effector=None if end_effector is None else _pose(end_effector),
            stiffness_frame=None if stiffness_frame is None else _pose(stiffness_frame),
        )
        named = {"end_effector": end_effector, "stiffness_frame": stiffness_frame}
        self._frames |= {name: pose for name, pose in named.items() if pose is not None}
        self._model = None

    def set_joint_stiffness(self, joint_stiffness_nm_per_rad: Sequence[float]) -> None:
        """Stiffness of the arm's own joint controller [N m/rad], one number per joint."""
        self._ask("set_joint_stiffness", joint_stiffness_nm_per_rad=[float(x) for x in joint_stiffness_nm_per_rad])

    def set_cartesian_stiffness(self, cartesian_stiffness: Sequence[float]) -> None:
        """Stiffness of the arm's own Cartesian controller: three translations [N/m], three rotations [N m/rad]."""
        self._ask("set_cartesian_stiffness", cartesian_stiffness=[float(x) for x in cartesian_stiffness])

    def set_guiding_mode(self, axes: Sequence[bool], elbow: bool) -> None:
        """Axes that can be guided by hand (x, y, z, roll, pitch, yaw), and whether the elbow can."""
        self._ask("set_guiding_mode", axes=[bool(x) for x in axes], elbow=elbow)
