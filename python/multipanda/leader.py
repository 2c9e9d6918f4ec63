"""Leader arms of servos: calibrates one by a guided dialogue, and drives arms by one or several.

python -m multipanda.leader calibrate PORT FILE
python -m multipanda.leader drive FILE...
"""

from __future__ import annotations

import argparse
import contextlib
import math
import sys
import time
from collections.abc import Callable, Mapping

import numpy as np

from .client import connect
from .errors import Error, Refused
from .lerobot import ArmsRobot, RobotSettings, ServoLeader, ServoLeaderSettings
from .lerobot.names import gripper_name, quantity_names
from .model import model
from .pedal import KEYS, Marks, Pedal
from .rotations import Array
from .servos import COUNT_RAD, Calibration, ServoChain, find_servos
from .state import RunState

_SHOWN_DEG = (0, 0, 0, -90, 0, 90, 0)
_SHOWN = "upper arm upright, forearm level and pointing ahead, hand straight down, joints 1, 3, 5, 7 at 0"
_TURNS = (  # the positive direction of each joint of a Panda or FR3 in this pose
    "the whole arm to its left (counter-clockwise from above)",
    "the upper arm forward and down",
    "the forearm to the left, about the upright upper arm",
    "the forearm up, which stretches the elbow",
    "the hand to the left, about the forearm",
    "the hand forward and up",
    "the hand clockwise, seen from above",
)
_LEAST_TURN_RAD, _CLEARLY = math.radians(10), 2.0
_QUARTER_RAD, _LEAST_CARE_RAD = math.pi / 2, math.radians(20)

_PERIOD_S = 1 / 150  # the run smooths streams below 200 Hz, and with them the servos' steps of 1.5 mrad
_NEAR_RAD, _STILL_RAD, _STILL_S = 0.3, 0.05, 1.0
_NEAR_M, _GAP_S = 0.02, 0.2
_LEFT_BEHIND_RAD = 0.6  # as joint_follower
_SAY_S = 2.0


def calibrate(
    port: str,
    arm: str = "fr3",
    *,
    exact: bool = False,
    prompt: Callable[[str], object] = input,
    say: Callable[[str], object] = print,
) -> Calibration:
    """Finds servos, order, signs and offsets of a leader with a person who turns its joints.

    Args:
        port: Its serial port.
        arm: The arm that it leads: fr3, fer or another with such joints.
        exact: Offsets as measured. By default the nearest multiple of 90 degrees, which is exact where the horns are
            mounted so, however the pose was held.
        prompt: Called with an instruction; returns when it is done.
        say: Called with what was found.

    Raises:
        Refused: The pose was not that which was shown, or the number of servos is wrong.
        Disconnected: As ServoChain.
    """
    robot, shown = model(arm), np.radians(_SHOWN_DEG)
    if robot.joints != len(shown):
        raise Refused("wrong_size", f"{arm} has {robot.joints} joints, expected {len(shown)}", "--arm fr3 or fer")
    baud, ids = find_servos(port)
    say(f"found servos {', '.join(map(str, ids))} at {baud} baud")
    if len(ids) - len(shown) not in (0, 1):
        raise Refused(
            "wrong_size",
            f"found {len(ids)} servos, expected {len(shown)}, or one more for a trigger",
            "check cables and supply, and give each servo a number of its own",
        )
    with ServoChain(port, baud, ids) as chain:
        prompt(f"Hold the leader in this pose: {_SHOWN}. Then press Enter.")
        first = chain.read()
        found: list[tuple[int, int]] = []  # place in `ids` and sign of each joint
        for k, turn in enumerate(_TURNS):
            found.append(_turned(chain, f"Joint {k + 1}: turn {turn}", [place for place, _ in found], prompt, say))
        places, signs = [place for place, _ in found], [sign for _, sign in found]
        trigger = None
        if left := [place for place in range(len(ids)) if place not in places]:
            prompt("Let go of the trigger. Then press Enter.")
            free = chain.read()[left[0]]
            _turned(chain, "Squeeze the trigger fully and keep it squeezed", places, prompt, say)
            squeezed = free + (chain.read()[left[0]] - free + 2048) % 4096 - 2048
            trigger = [ids[left[0]], free, squeezed]
    offsets = COUNT_RAD * np.array([first[place] for place in places]) - np.array(signs) * shown
    rest = offsets - _QUARTER_RAD * np.round(offsets / _QUARTER_RAD)
    if not exact:
        worst = int(np.argmax(np.abs(rest)))
        if abs(rest[worst]) > _LEAST_CARE_RAD:
            raise Refused(
                "out_of_bounds",
                f"joint {worst + 1} was {abs(math.degrees(rest[worst])):.0f} degrees from a multiple of 90",
                "hold the pose more exactly; if horns are mounted at other angles, add --exact",
            )
        offsets = offsets - rest
    say(f"the pose was held to {np.degrees(np.max(np.abs(rest))):.0f} degrees of multiples of 90")
    offsets = np.mod(offsets, 2 * math.pi)
    return Calibration(
        port=port,
        baud=baud,
        arm=arm,
        ids=[ids[place] for place in places],
        signs=signs,
        offsets_rad=offsets.tolist(),
        q_min_rad=robot.q_min_rad.tolist(),
        q_max_rad=robot.q_max_rad.tolist(),
        trigger=trigger,
    )


def _turned(
    chain: ServoChain, what: str, taken: list[int], prompt: Callable[[str], object], say: Callable[[str], object]
) -> tuple[int, int]:
    """Which servo a person turns, and its sign; asks again until one has turned clearly."""
    while True:
        before = chain.read()
        prompt(f"{what}, by about 30 degrees. Then press Enter.")
        steps = (np.array(chain.read()) - before + 2048) % 4096 - 2048
        sizes = COUNT_RAD * np.abs(steps)
        k = int(np.argmax(sizes))
        others = np.max(np.delete(sizes, k), initial=0.0)
        if sizes[k] > _LEAST_TURN_RAD and sizes[k] > _CLEARLY * others and k not in taken:
            return k, int(np.sign(steps[k]))
        turned = f"servo {chain.ids[k]} turned by {math.degrees(sizes[k]):.0f} degrees"
        say(f"{turned}{', which is another joint' if k in taken else ''}; turn this joint alone, once more")


def drive(
    robot: ArmsRobot,
    leader: ServoLeader,
    pedal: Pedal | None = None,
    *,
    seconds: float | None = None,
    say: Callable[[str], object] = print,
) -> None:
    """Lets arms follow leaders, and returns after `seconds`, or without them when it is interrupted.

    Following begins when the leaders have been still for a second, each joint within 0.3 rad of its arm's and each
    trigger within 20 mm of its fingers, or squeezed farther if they hold something; until then nothing moves. The arms
    then go to them within the bounds of their controllets. Leaders more than 0.6 rad ahead, or a silence of this
    process, hold the arms until they are near and still again. Any other fault holds the arms and ends this
    function: a leader or pedal that is gone, silent, in error, or jumps; a stop, an error, another owner of an arm.

    Args:
        robot: The arms, connected, with joints as actions.
        leader: Their leaders, connected.
        pedal: Marks episodes in the run's log.
        seconds: How long; without end by default.
        say: Called with a line about what begins, waits and was marked.

    Raises:
        Disconnected: A device or the run is gone. The arms are held, as with the following.
        Refused: An arm is stopped, in error, or owned by another controllet; the run refuses a set-point.
        Timeout: The run does not answer.
    """
    marks = Marks(robot.client, say)
    end = math.inf if seconds is None else time.monotonic() + seconds
    waits: _Waits | None = _Waits(robot, say)
    try:
        due = time.monotonic()
        while (now := time.monotonic()) < end:
            time.sleep(max(0.0, due - now))
            due = max(due + _PERIOD_S, now)
            action = leader.read()
            for mark in pedal.read() if pedal is not None else []:
                marks.take(mark)
            if waits is not None and not waits.over(action, robot.client.state(), time.monotonic()):
                continue
            begins, waits, lost, silences = waits is not None, None, "", robot.silences
            try:
                robot.act(action)
            except Refused as refused:
                if refused.verdict != "jump":
                    raise
                lost = refused.reason
            if robot.silences > silences:
                lost = "this program was silent for longer than the input's timeout_s"
            if lost:
                robot.hold()
                say(f"the arms are held: {lost}")
                waits = _Waits(robot, say)
            elif begins:
                say("the arms follow")
    finally:
        robot.hold()
        marks.end()


class _Waits:
    """Waits until leaders are still, near their arms and fingers."""

    def __init__(self, robot: ArmsRobot, say: Callable[[str], object]) -> None:
        self._settings, self._say = robot.settings, say
        self._still: Array | None = None
        self._since_s, self._seen_s, self._said_s, self._said = 0.0, -math.inf, -math.inf, ""

    def over(self, action: Mapping[str, float], state: RunState, now_s: float) -> bool:
        q, away = [], [("", 0.0)]  # what is too far away, over the allowed distance
        for arm in self._settings.arms:
            names = quantity_names(arm, "joints", self._settings.joints)
            at = np.array([action[name] for name in names])
            q.append(at)
            ahead = at - state.arms[arm].q_rad
            k = int(np.argmax(np.abs(ahead)))
            line = f"{arm}: joint {k + 1} of the leader is {ahead[k]:+.2f} rad from the arm's: bring it within"
            away.append((f"{line} {_NEAR_RAD} rad", abs(ahead[k]) / _NEAR_RAD))
            hand = state.arms[arm].gripper if arm in self._settings.grippers else None
            if hand is not None:
                wider = action[gripper_name(arm)] - hand.width_m
                line = f"{arm}: the trigger is {wider * 1e3:+.0f} mm from the fingers' {hand.width_m * 1e3:.0f} mm"
                far = max(wider, 0.0) if hand.grasped else abs(wider)  # a squeezed trigger drops nothing
                away.append((f"{line}: bring it within {_NEAR_M * 1e3:.0f} mm", far / _NEAR_M))
        still, (where, most) = np.concatenate(q), max(away, key=lambda each: each[1])
        restless = self._still is None or np.max(np.abs(still - self._still)) > _STILL_RAD
        if restless or most > 1 or now_s - self._seen_s > _GAP_S:
            self._still, self._since_s = still, now_s
        self._seen_s = now_s
        self._tell(where if most > 1 else "near: hold the leader still for a second", now_s)
        return now_s - self._since_s >= _STILL_S

    def _tell(self, line: str, now_s: float) -> None:
        if line != self._said and now_s - self._said_s > _SAY_S:
            self._say(line)
            self._said, self._said_s = line, now_s


def lead(
    run: str | None,
    files: Mapping[str, str],
    pedal: Pedal | None = None,
    *,
    say: Callable[[str], object] = print,
) -> None:
    """Lets arms of a run follow their leaders as drive() does, until it is interrupted.

    Args:
        run: Name, socket or ssh:// of the run; by default the only one.
        files: The calibration of each leader, by the arm that it leads.
        pedal: Marks episodes in the run's log.
        say: Called with a line about what begins, waits and was marked.

    Raises:
        Disconnected, Refused, Timeout: As drive().
    """
    arms = list(files)
    with connect(run) as client:
        state = client.state()
    hands = [arm for arm in arms if Calibration.load(files[arm]).trigger and state.arms[arm].gripper is not None]
    robot = ArmsRobot(RobotSettings(socket=run, arms=arms, grippers=hands, max_jump_rad=_LEFT_BEHIND_RAD))
    leader = ServoLeader(ServoLeaderSettings(arms=arms, files=dict(files), grippers=hands))
    try:
        robot.connect()
        leader.connect()
        drive(robot, leader, pedal, say=say)
    finally:
        leader.disconnect()
        robot.disconnect()


def _drive(options: argparse.Namespace) -> None:
    keys = {int(code): mark for code, _, mark in (word.partition("=") for word in options.key)} or KEYS
    with connect(options.run) as client:
        arms = options.arms or list(client.arms)
    if len(arms) != len(options.files):
        raise Refused("wrong_size", f"{len(options.files)} leaders for {', '.join(arms)}", "name them with --arms")
    with contextlib.ExitStack() as stack:
        pedal = stack.enter_context(Pedal(options.pedal, keys)) if options.pedal else None
        lead(options.run, dict(zip(arms, options.files)), pedal)


def main() -> int:
    """Runs the command."""
    parser = argparse.ArgumentParser(prog="python -m multipanda.leader", description=(__doc__ or "").partition("\n")[0])
    commands = parser.add_subparsers(dest="command", required=True)
    one = commands.add_parser("calibrate", help="find order, signs and offsets of a leader's servos")
    one.add_argument("port", help="its serial port, such as /dev/serial/by-id/usb-FTDI_...")
    one.add_argument("file", help="where to write the calibration")
    one.add_argument("--arm", default="fr3", help="the arm that it leads (default fr3)")
    one.add_argument("--exact", action="store_true", help="offsets as measured, not multiples of 90 degrees")
    other = commands.add_parser("drive", help="let the arms of a run follow leaders")
    other.add_argument("files", nargs="+", help="the calibration of each leader")
    other.add_argument("--arms", nargs="+", help="the arms that they lead (default: all of the run)")
    other.add_argument("--run", help="name, socket or ssh:// of the run (default: the only one)")
    other.add_argument("--pedal", help="input device of a foot pedal that marks episodes")
    other.add_argument("--key", nargs="+", default=[], metavar="CODE=MARK", help="such as 30=start 48=success")
    options = parser.parse_args()
    try:
        if options.command == "calibrate":
            calibrate(options.port, options.arm, exact=options.exact).save(options.file)
            print(f"written: {options.file}")
        else:
            _drive(options)
    except KeyboardInterrupt:
        return 130
    except (Error, ValueError) as wrong:
        print(f"the arms are held: {wrong}" if options.command == "drive" else wrong, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
