"""Configuration of a robot and its leaders.

LeRobot reads these fields from its command line and from files. No postponed annotations here: LeRobot's parser needs
the types themselves.
"""

import math
from dataclasses import dataclass, field

from .names import action_names, state_names


def _distinct(what: str, names: list[str]) -> None:
    if not names or any(not name for name in names) or len(set(names)) != len(names):
        raise ValueError(f"{what}: expected one name or more, each once, found {names}")


def _known(what: str, names: list[str], arms: list[str]) -> None:
    unknown = [name for name in names if name not in arms]
    if unknown:
        raise ValueError(f"{what}: {', '.join(unknown)} is not among the arms {', '.join(arms)}")


def _within(what: str, value: float, most: float) -> None:
    if not (math.isfinite(value) and 0 < value <= most):
        raise ValueError(f"{what}: expected a number above 0, at most {most:g}, found {value}")


@dataclass(kw_only=True)
class RunSettings:
    """Which run.

    Attributes:
        scene: Name or file of a scene to start, which ends with the connection; None: `socket`.
        socket: Name or socket of a scene that runs already; None: the only one.
        addresses: With `scene`: the real arms' addresses by name.
        backend: With `scene`: whose arms, `mujoco`, `virtual`, `fci`; None: as in the scene.
        record: With `scene`: folder for the log.
        arguments: With `scene`: more options of `multipanda run`.
    """

    scene: str | None = None
    socket: str | None = None
    addresses: dict[str, str] = field(default_factory=dict)
    backend: str | None = None
    record: str | None = None
    arguments: list[str] = field(default_factory=list)

    def check(self) -> None:
        """Raises ValueError for settings that contradict each other."""
        if self.scene is not None and self.socket is not None:
            raise ValueError("expected scene (to start it) or socket (of one that runs), found both")
        if self.scene is None and (self.addresses or self.backend or self.record or self.arguments):
            raise ValueError("addresses, backend, record and arguments need a scene to start: name it")


@dataclass(kw_only=True)
class RobotSettings(RunSettings):
    """Any number of arms as one robot.

    Attributes:
        arms: Their names in the scene, in the order of the features.
        joints: Joints of each arm.
        action: `joints`: joint angles; `pose`: the hand's pose in the frame of the arm's base.
        observe: What is observed of each arm: any of `joints`, `velocities`, `torques`, `pose`, `wrench`.
        grippers: Arms with fingers that are observed and commanded.
        controllets: The controllet that follows the actions, by arm; default: the only one that can.
        max_jump_rad: Largest distance of a joint's target from the joint [rad].
        max_jump_m: Largest distance of a pose from the hand [m].
        max_turn_rad: Largest angle of a pose to the hand [rad].
        grasp_below_m: A gripper's target at or below it closes the fingers fully [m].
        grasp_force_n: Force on what is between the fingers [N].
    """

    arms: list[str] = field(default_factory=lambda: ["arm"])
    joints: int = 7
    action: str = "joints"
    observe: list[str] = field(default_factory=lambda: ["joints"])
    grippers: list[str] = field(default_factory=list)
    controllets: dict[str, str] = field(default_factory=dict)
    max_jump_rad: float = 0.3
    max_jump_m: float = 0.1
    max_turn_rad: float = 0.5
    grasp_below_m: float = 0.01
    grasp_force_n: float = 20.0

    def check(self) -> None:
        """Raises ValueError for invalid settings of a robot."""
        super().check()
        _distinct("arms", self.arms)
        if not 1 <= self.joints <= 16:
            raise ValueError(f"joints: expected 1 to 16, found {self.joints}")
        _distinct("observe", self.observe)
        action_names(self.arms, self.action, self.grippers, self.joints)
        state_names(self.arms, self.observe, self.grippers, self.joints)
        _known("grippers", self.grippers, self.arms)
        _known("controllets", list(self.controllets), self.arms)
        for name, most in (("max_jump_rad", math.pi), ("max_jump_m", 0.5), ("max_turn_rad", math.pi)):
            _within(name, getattr(self, name), most)
        for name, most in (("grasp_below_m", 0.2), ("grasp_force_n", 140)):
            _within(name, getattr(self, name), most)


@dataclass(kw_only=True)
class LeaderSettings(RunSettings):
    """Arms that a person guides and that lead others.

    Attributes:
        leaders: Their names in their scene.
        arms: The arms that they lead, in the same order, as the robot names them; empty: the same names.
        joints: Joints of each arm.
        action: As the robot's.
        grippers: Arms, of `arms`, whose leader has fingers that are read.
        guides: By leader: the controllet for guiding it, or "" to leave it as it is; default: its only
            gravity_compensation.
    """

    leaders: list[str] = field(default_factory=lambda: ["arm"])
    arms: list[str] = field(default_factory=list)
    joints: int = 7
    action: str = "joints"
    grippers: list[str] = field(default_factory=list)
    guides: dict[str, str] = field(default_factory=dict)

    @property
    def led(self) -> list[str]:
        """The arms that are led."""
        return self.arms or self.leaders

    def check(self) -> None:
        """Raises ValueError for invalid settings of a leader."""
        super().check()
        _distinct("leaders", self.leaders)
        _distinct("arms", self.led)
        if len(self.led) != len(self.leaders):
            raise ValueError(f"arms: expected one for each of {len(self.leaders)} leaders, found {len(self.led)}")
        action_names(self.led, self.action, self.grippers, self.joints)
        _known("grippers", self.grippers, self.led)
        _known("guides", list(self.guides), self.leaders)


@dataclass(kw_only=True)
class SpaceMouseSettings(RunSettings):
    """SpaceMice that lead the hands of a run: the run of the robot, which must be connected first.

    Attributes:
        arms: The arms that are led, as the robot names them.
        devices: The hidraw device of each; of a single arm by default the one that is plugged in.
        grippers: Arms with fingers.
        gripper_button: Number of the button that opens and closes them, from 3; 0: none.
        open_m: Width of open fingers [m].
        axes: `base` or `hand`, as in SpaceMouse.jog().
        cap_holds: A deflected cap is enough, without the left button.
        speed_m_per_s: Speed at full deflection [m/s].
        turn_rad_per_s: Angular velocity at full deflection [rad/s].
        force_n: Force above which the target does not press further [N].
    """

    arms: list[str] = field(default_factory=lambda: ["arm"])
    devices: dict[str, str] = field(default_factory=dict)
    grippers: list[str] = field(default_factory=list)
    gripper_button: int = 0
    open_m: float = 0.08
    axes: str = "base"
    cap_holds: bool = False
    speed_m_per_s: float = 0.1
    turn_rad_per_s: float = 0.4
    force_n: float = 20.0

    def check(self) -> None:
        """Raises ValueError for settings that cannot lead."""
        super().check()
        _distinct("arms", self.arms)
        _known("grippers", self.grippers, self.arms)
        _known("devices", list(self.devices), self.arms)
        if len(self.arms) > 1 and set(self.devices) != set(self.arms):
            raise ValueError(f"devices: expected one for each of the arms {', '.join(self.arms)}")
        if self.scene is not None:
            raise ValueError("scene: a SpaceMouse moves arms of the robot's run: name its socket, or nothing")
        if self.axes not in ("base", "hand"):
            raise ValueError(f"axes: expected base or hand, found {self.axes!r}")
        if self.gripper_button and not 3 <= self.gripper_button <= 32:
            raise ValueError(f"gripper_button: expected 3 to 32, or 0 for none, found {self.gripper_button}")
        for name, most in (("open_m", 0.2), ("speed_m_per_s", 0.5), ("turn_rad_per_s", 2.5), ("force_n", 100)):
            _within(name, getattr(self, name), most)


@dataclass(kw_only=True)
class ServoLeaderSettings:
    """Small arms of servos that lead arms by their joints.

    Attributes:
        arms: The arms that are led, as the robot names them.
        files: The calibration of each leader, by arm (docs/leader.md).
        joints: Joints of each arm.
        grippers: Arms with fingers that a trigger closes.
        open_m: Width of open fingers [m].
        silence_s: How long the servos may give no valid answer [s].
    """

    arms: list[str] = field(default_factory=lambda: ["arm"])
    files: dict[str, str] = field(default_factory=dict)
    joints: int = 7
    grippers: list[str] = field(default_factory=list)
    open_m: float = 0.08
    silence_s: float = 0.1

    def check(self) -> None:
        """Raises ValueError for settings that cannot lead."""
        _distinct("arms", self.arms)
        _known("grippers", self.grippers, self.arms)
        if set(self.files) != set(self.arms):
            raise ValueError(f"files: expected one for each of the arms {', '.join(self.arms)}")
        for name, most in (("open_m", 0.2), ("silence_s", 10.0)):
            _within(name, getattr(self, name), most)
