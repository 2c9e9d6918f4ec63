"""Leaders of a robot's arms: arms guided by hand, SpaceMice, or small arms of servos."""

from __future__ import annotations

from ..client import Client, connect
from ..errors import Disconnected, Refused
from ..jog import JogLimits, within_lead
from ..pose import Pose
from ..rotations import Array
from ..servos import LeaderArm
from ..space_mouse import STOP_BUTTON, Grip, SpaceMouse, led_by
from ..state import ArmState
from ..tasks.arms import in_base
from .names import SteadySigns, action_names, gripper_name, quantity_names, state_values
from .runs import Connected, arms_of, close_run, entries, started_here, take_from, with_grippers
from .settings import LeaderSettings, ServoLeaderSettings, SpaceMouseSettings


class ArmsLeader(Connected):
    """Arms in gravity compensation, whose joints or hands are the action of the arms that they lead.

    connect() makes them compliant, so that a person can guide them; otherwise they stay in place. disconnect() holds
    them.

    Attributes:
        settings: What it was made from.
    """

    _what = "the leader"

    def __init__(self, settings: LeaderSettings) -> None:
        """Raises ValueError for invalid settings of a leader."""
        super().__init__()
        settings.check()
        self.settings = settings
        self._bases: dict[str, Array] = {}
        self._guides: dict[str, str] = {}
        self._signs = SteadySigns()

    @property
    def action_names(self) -> list[str]:
        """The names of an action, for the arms that follow."""
        s = self.settings
        return action_names(s.led, s.action, s.grippers, s.joints)

    def connect(self) -> None:
        """Starts the leaders' scene or attaches to it, and makes each leader ready for hand guiding.

        Raises:
            Refused: The scene has other arms, a leader is stopped, in error, or owned by another client, or has no
                gravity_compensation.
            Timeout: The run does not answer.
            Disconnected: No scene runs.
        """
        self._open(self.settings, self._begin)

    def _begin(self, client: Client) -> None:
        s = self.settings
        self._bases = arms_of(client, s.leaders, s.joints)
        with_grippers(client, [leader for leader, arm in zip(s.leaders, s.led) if arm in s.grippers])
        self._guides = {
            leader: guide for leader in s.leaders if (guide := _guide_of(client, leader, s.guides.get(leader)))
        }
        state = client.state()
        for leader, guide in self._guides.items():
            owned = state.arms[leader]
            if owned.stopped or owned.errors:
                why = client.lost_by(guide, owned)
                raise Refused("arm_not_ready", f"the leader '{leader}' cannot be guided by hand: {why}")
            if not (owned.held or owned.controllet == guide or started_here(client)):
                raise Refused(
                    "two_owners",
                    f"the leader '{leader}' is owned by {owned.controllet}",
                    "deactivate it first, or leave it as it is: guides={'" + leader + "': ''}",
                )
        if self._guides:
            try:
                client.switch(list(self._guides.values()))
            except BaseException:
                take_from(client, list(self._guides.values()))
                raise

    def read(self) -> dict[str, float]:
        """Positions of the leaders, as an action of the arms that they lead; at most 0.1 s old, all of one cycle.

        Raises:
            Refused: A leader cannot be guided any more, after a stop, an error, or another switch.
            Timeout: The loop has stalled.
            Disconnected: The run has ended, or the leader is not connected.
        """
        s = self.settings
        state = self.client.state()
        found: dict[str, float] = {}
        for leader, arm in zip(s.leaders, s.led):
            now = state.arms[leader]
            if leader in self._guides and now.controllet != self._guides[leader]:
                why = self.client.lost_by(self._guides[leader], now)
                raise Refused("not_active", f"the leader '{leader}' is owned by {now.controllet}: {why}")
            values = state_values(now, self._bases[leader], s.action)
            if s.action == "pose":
                values = self._signs.of(arm, values)
            found.update(zip(quantity_names(arm, s.action, s.joints), values.tolist()))
            if arm in s.grippers and now.gripper is not None:
                found[gripper_name(arm)] = now.gripper.width_m
        return found

    def disconnect(self) -> None:
        """Holds the leaders, and ends a run that connect() has started. May be called again; raises nothing."""
        client, self._client = self._client, None
        if client is not None:
            take_from(client, list(self._guides.values()))
            close_run(client)


def _guide_of(client: Client, leader: str, named: str | None) -> str:
    """The controllet for guiding an arm by hand; empty: unchanged."""
    if named == "":
        return ""
    own = {name: entry["type"] for name, entry in entries(client).items() if entry["arms"] == [leader]}
    if named is not None:
        if named not in own:
            raise Refused("unknown_instance", f"'{named}' is not a controllet that owns '{leader}' alone")
        return named
    guides = [name for name, kind in own.items() if kind == "gravity_compensation"]
    if len(guides) == 1:
        return guides[0]
    raise Refused(
        "unknown_instance",
        f"{client.scene} has {len(guides) or 'no'} gravity_compensation of '{leader}', expected one",
        "add it to the scene, or name a controllet in `guides`",
    )


class _Mouse:
    """A device and the target of its hand."""

    def __init__(self, mouse: SpaceMouse, cap_holds: bool) -> None:
        self.mouse, self.grip = mouse, Grip(cap_holds)
        self.target: Pose | None = None
        self.moved = False
        self.at_s = 0.0  # loop time of the run
        self.width_m = 0.0


class SpaceMouseLeader:
    """SpaceMice that move the targets of hands while their left buttons are held; the right button stops all arms.

    An idle target stays at the hand's pose when the button was released.

    Attributes:
        settings: What it was made from.
    """

    def __init__(self, settings: SpaceMouseSettings) -> None:
        """Raises ValueError for invalid settings."""
        settings.check()
        self.settings = settings
        self._limits = JogLimits(settings.speed_m_per_s, settings.turn_rad_per_s, settings.force_n)
        self._mice: dict[str, _Mouse] = {}
        self._client: Client | None = None
        self._signs = SteadySigns()

    @property
    def action_names(self) -> list[str]:
        """The names of an action: poses in the frame of each arm's base."""
        return action_names(self.settings.arms, "pose", self.settings.grippers)

    @property
    def connected(self) -> bool:
        """Whether its devices are open."""
        return bool(self._mice)

    def connect(self) -> None:
        """Opens the devices. The run is looked up at the first read(), when the robot has started it.

        Raises:
            Refused: It is connected already.
            Disconnected: A device is missing, or cannot be read.
        """
        if self._mice:
            raise Refused("connected", "the SpaceMouse is connected already", "disconnect() first")
        opened: dict[str, _Mouse] = {}
        try:
            for arm in self.settings.arms:
                opened[arm] = _Mouse(SpaceMouse(self.settings.devices.get(arm)), self.settings.cap_holds)
                opened[arm].grip.settle(opened[arm].mouse)
        except BaseException:
            for led in opened.values():
                led.mouse.close()
            raise
        self._mice = opened

    def read(self) -> dict[str, float]:
        """The target of every hand.

        Raises:
            Refused: The run has other arms.
            Timeout: The loop has stalled.
            Disconnected: A device was unplugged, no run is there, or it is not connected.
        """
        if not self._mice:
            raise Disconnected("the SpaceMouse is not connected", "call connect() first")
        s = self.settings
        if self._client is None:
            client = connect(s.socket)
            try:
                for arm in s.arms:
                    if arm not in client.arms:
                        raise Refused("unknown_arm", f"{client.scene} has no arm '{arm}'")
                    _ = client.arms[arm].base  # refuses an arm whose base moves
                with_grippers(client, s.grippers)
            except BaseException:
                client.close()
                raise
            self._client = client
        fingers = 1 << (s.gripper_button - 1) if s.gripper_button else 0
        pressed = {arm: led.grip.read(led.mouse) for arm, led in self._mice.items()}
        if any(bits & STOP_BUTTON for bits in pressed.values()):
            self._client.stop()
        state = self._client.state()
        found: dict[str, float] = {}
        for arm, led in self._mice.items():
            base = self._client.arms[arm].base
            target = self._step(led, state.arms[arm], base)
            values = self._signs.of(arm, in_base(base.values, target.values))
            found.update(zip(quantity_names(arm, "pose"), values.tolist()))
            gripper = state.arms[arm].gripper
            if arm in s.grippers and gripper is not None:
                if led.width_m == 0.0 and not gripper.grasped:
                    led.width_m = gripper.width_m
                if pressed[arm] & fingers:
                    led.width_m = s.open_m if led.width_m < s.open_m / 2 else 0.0
                found[gripper_name(arm)] = led.width_m
        return found

    def _step(self, led: _Mouse, state: ArmState, base: Pose) -> Pose:
        if state.stopped or state.errors:
            led.grip.lose()
        if led.target is None or (led.moved and not led.grip.held):
            led.target, led.moved = state.pose, False
        elif led.grip.held:
            led.moved = True
            step_s = state.t_s - led.at_s
            led.target = led_by(led.mouse, led.target, state, base, self.settings.axes, step_s, self._limits)
        else:
            led.target = within_lead(led.target, state.pose, self._limits)
        led.at_s = state.t_s
        return led.target

    def disconnect(self) -> None:
        """Closes the devices. May be called again."""
        mice, self._mice = self._mice, {}
        for led in mice.values():
            led.mouse.close()
        client, self._client = self._client, None
        if client is not None:
            close_run(client)


class ServoLeader:
    """Small arms of servos, whose joints are the action; their triggers close the fingers (docs/leader.md).

    Attributes:
        settings: What it was made from.
    """

    def __init__(self, settings: ServoLeaderSettings) -> None:
        """Raises ValueError for invalid settings."""
        settings.check()
        self.settings = settings
        self._leaders: dict[str, LeaderArm] = {}

    @property
    def action_names(self) -> list[str]:
        """The names of an action: joint angles, and widths of fingers."""
        return action_names(self.settings.arms, "joints", self.settings.grippers, self.settings.joints)

    @property
    def connected(self) -> bool:
        """Whether its ports are open."""
        return bool(self._leaders)

    def connect(self) -> None:
        """Opens the ports.

        Raises:
            Refused: It is connected already, or a calibration has other joints or no trigger for fingers.
            Disconnected: A port or a servo is missing, or in error.
        """
        if self._leaders:
            raise Refused("connected", "the leader is connected already", "disconnect() first")
        opened: dict[str, LeaderArm] = {}
        try:
            for arm in self.settings.arms:
                opened[arm] = LeaderArm(self.settings.files[arm], self.settings.silence_s)
                about = opened[arm].calibration
                if len(about.ids) != self.settings.joints:
                    raise Refused("wrong_size", f"the leader of '{arm}' has {len(about.ids)} joints", "set `joints`")
                if arm in self.settings.grippers and about.trigger is None:
                    raise Refused("no_gripper", f"the leader of '{arm}' has no trigger", "leave it out of `grippers`")
        except BaseException:
            for leader in opened.values():
                leader.close()
            raise
        self._leaders = opened

    def read(self) -> dict[str, float]:
        """The joint angles and widths of all arms. Raises Disconnected: a leader is gone, silent, in error or jumps."""
        if not self._leaders:
            raise Disconnected("the leader is not connected", "call connect() first")
        for leader in self._leaders.values():
            leader.request()
        found: dict[str, float] = {}
        for arm, leader in self._leaders.items():
            q_rad, squeezed = leader.answer()
            found.update(zip(quantity_names(arm, "joints", self.settings.joints), q_rad.tolist()))
            if arm in self.settings.grippers and squeezed is not None:
                found[gripper_name(arm)] = self.settings.open_m * (1 - squeezed)
        return found

    def disconnect(self) -> None:
        """Closes the ports. May be called again."""
        leaders, self._leaders = self._leaders, {}
        for leader in leaders.values():
            leader.close()
