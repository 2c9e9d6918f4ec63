"""What leads a robot's arms: arms that a person leads by hand, or SpaceMice."""

from __future__ import annotations

import time

import numpy as np

from ..client import Client, connect
from ..errors import Refused
from ..jog import JogLimits, axes_rotation, jogged, shaped, within_lead
from ..space_mouse import Grip, SpaceMouse
from ..state import ArmState, Array, Pose
from ..tasks.arms import in_base
from .names import SteadySigns, action_names, gripper_name, quantity_names, state_values
from .runs import arms_of, close_run, connected, entries, open_run, started_here, take_from, why, with_grippers
from .settings import LeaderSettings, SpaceMouseSettings

_HOLD_BUTTON, _STOP_BUTTON = 1, 2
_SETTLE_S = 0.15
_BLIND_S = 0.4  # Linux keeps half a second of a device's reports, and drops the newest then


class ArmsLeader:
    """Arms in gravity compensation, whose joints or hands are the action of the arms that they lead.

    connect() makes them soft: a person holds them, or they stay where they are. disconnect() holds them.

    Attributes:
        settings: What it was made from.
    """

    def __init__(self, settings: LeaderSettings) -> None:
        """Raises ValueError for settings that cannot be a leader."""
        settings.check()
        self.settings = settings
        self._client: Client | None = None
        self._bases: dict[str, Array] = {}
        self._guides: dict[str, str] = {}
        self._signs = SteadySigns()

    @property
    def action_names(self) -> list[str]:
        """The names of an action: those of the arms that are led."""
        s = self.settings
        return action_names(s.led, s.action, s.grippers, s.joints)

    @property
    def connected(self) -> bool:
        """Whether connect() was called, and disconnect() was not."""
        return self._client is not None

    @property
    def client(self) -> Client:
        """The run. Raises Disconnected before connect()."""
        return connected(self._client, "the leader")

    def connect(self) -> None:
        """Starts the leaders' scene or attaches to it, and lets each leader be led.

        Raises:
            Refused: The scene has other arms, a leader is stopped, in error, or owned by somebody else, or has no
                gravity_compensation.
            Timeout: The run does not answer.
            Disconnected: No scene runs.
        """
        if self._client is not None:
            raise Refused("connected", "the leader is connected already", "disconnect() first")
        s = self.settings
        client = open_run(s)
        try:
            self._bases = arms_of(client, s.leaders, s.joints)
            with_grippers(client, [leader for leader, arm in zip(s.leaders, s.led) if arm in s.grippers])
            self._guides = {
                leader: guide for leader in s.leaders if (guide := _guide_of(client, leader, s.guides.get(leader)))
            }
            state = client.state()
            for leader, guide in self._guides.items():
                owned = state.arms[leader]
                if owned.stopped or owned.errors:
                    raise Refused("arm_not_ready", f"the leader '{leader}' cannot be led: {why(owned)}")
                if not (owned.held or owned.controllet == guide or started_here(client)):
                    raise Refused(
                        "two_owners",
                        f"the leader '{leader}' is owned by {owned.controllet}",
                        "deactivate it first, or leave it as it is: guides={'" + leader + "': ''}",
                    )
            if self._guides:
                client.switch(list(self._guides.values()))
        except BaseException:
            take_from(client, list(self._guides.values()))
            close_run(client)
            raise
        self._client = client

    def read(self) -> dict[str, float]:
        """Where the leaders are, as an action of the arms that they lead; at most 0.1 s old, all of one cycle.

        Raises:
            Refused: A leader is not led any more: by a stop, an error, or another switch.
            Timeout: The loop stands still.
            Disconnected: The run has ended, or the leader is not connected.
        """
        s = self.settings
        state = self.client.state()
        found: dict[str, float] = {}
        for leader, arm in zip(s.leaders, s.led):
            now = state.arms[leader]
            if leader in self._guides and now.controllet != self._guides[leader]:
                raise Refused("not_active", f"the leader '{leader}' is owned by {now.controllet}: {why(now)}")
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
    """The controllet that lets an arm be led; empty: it is left as it is."""
    if named == "":
        return ""
    own = {name: entry["type"] for name, entry in entries(client).items() if entry["arms"] == [leader]}
    if named is not None:
        if named not in own:
            raise Refused("unknown_instance", f"'{named}' is not a controllet of '{leader}' alone")
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
        self.mouse = mouse
        self.grip = Grip(cap_holds)
        self.grip.lose()  # what is down at the beginning must be let go first
        self.target: Pose | None = None
        self.moved = False
        self.at_s = 0.0  # of the run
        self.looked_s = time.monotonic()
        self.width_m = 0.0

    def settle(self) -> None:
        """Forgets old reports. A deflected cap reports all the time."""
        until = time.monotonic() + _SETTLE_S
        while (rest := until - time.monotonic()) > 0:
            self.mouse.read(rest)
        if not self.mouse.buttons & _HOLD_BUTTON and not np.any(shaped(self.mouse.deflection)):
            self.grip.take(np.zeros(6), self.mouse.buttons, time.monotonic())
        self.looked_s = time.monotonic()

    def look_up(self, buttons: int) -> int:
        """Takes all reports that wait. Returns the bits of `buttons` that were pressed."""
        pressed, before = 0, self.mouse.buttons
        blind = time.monotonic() - self.looked_s > _BLIND_S
        while self.mouse.read():
            if not self.mouse._spoke:
                continue
            pressed |= self.mouse.buttons & ~before & buttons
            before = self.mouse.buttons
            self.grip.take(shaped(self.mouse.deflection), self.mouse.buttons, time.monotonic())
        if blind:
            self.grip.lose()
        self.looked_s = time.monotonic()
        self.grip.look(self.looked_s)
        return pressed


class SpaceMouseLeader:
    """SpaceMice that move the targets of hands while their left buttons are held; the right button stops all arms.

    A target that nobody moves stays where the hand was when the button was let go.

    Attributes:
        settings: What it was made from.
    """

    def __init__(self, settings: SpaceMouseSettings) -> None:
        """Raises ValueError for settings that cannot lead."""
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
        """Opens the devices. The run is looked for at the first read(), when the robot has it.

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
                opened[arm].settle()
        except BaseException:
            for led in opened.values():
                led.mouse.close()
            raise
        self._mice = opened

    def read(self) -> dict[str, float]:
        """The target of every hand.

        Raises:
            Refused: The run has other arms.
            Timeout: The loop stands still.
            Disconnected: A device was unplugged, no run is there, or it is not connected.
        """
        if not self._mice:
            connected(None, "the SpaceMouse")
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
        pressed = {arm: led.look_up(_STOP_BUTTON | fingers) for arm, led in self._mice.items()}
        if any(bits & _STOP_BUTTON for bits in pressed.values()):
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
            rotation = axes_rotation(self.settings.axes, base, state.pose)
            deflection = shaped(led.mouse.deflection)
            twist = np.concatenate([rotation @ deflection[:3], rotation @ deflection[3:]])
            force = np.zeros(3) if state.wrench_n_nm is None else state.wrench_n_nm[:3]
            led.target = jogged(led.target, twist, state.t_s - led.at_s, state.pose, force, self._limits)
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
