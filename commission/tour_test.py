#!/usr/bin/env python3
"""The whole tour of `multipanda commission` against strict virtual arms of another process: tour_test.py PROGRAM

The test plays the person: it reads each question, acts on the virtual arms through their standard input (pushes, leads,
hangs weights, presses the button), and answers. Mistakes are made in the arms' world, not in what the tour knows: each
must be found at its step, before any torque control has begun.
"""

import json
import os
import pathlib
import re
import signal
import subprocess
import sys
import tempfile
import threading
import unittest

import numpy as np
import pylibfranka as franka

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "tests" / "fci"))

from virtual_arms import PATIENCE_S, VirtualArms

PROGRAM = ""
FULL = os.environ.get("MULTIPANDA_FULL", "") not in ("", "0")
TIP = [0.0, 0.0, 0.15]  # X_FE of arms without hand [m]
LONG = 100000  # [s]: a push that lasts until the next one
# Where the true base of the second arm is, when it differs from the scene's.
MOVED = {"position": [0.011, -0.307, 0.004], "rpy": [0.006, -0.004, 0.15]}


def rotation(rpy):
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return z @ y @ x


BASES = {
    "left": {"position": [0, 0.3, 0], "rpy": [0, 0, 0.2]},
    "right": {"position": [0, -0.3, 0], "rpy": [0, 0, 0.15]},
}


def scene_text(names, model="fer", bases=None, more="", fidelity="ideal"):
    bases = {**BASES, **(bases or {})}
    lines = ["name: first_day", f"plant: {{fidelity: {fidelity}}}", "arms:"]
    for name in names:
        base = bases[name]
        lines += [
            f"  - name: {name}",
            f"    model: {model}",
            "    hand: false",
            f"    base: {{position_m: {list(base['position'])}, rpy_rad: {list(base['rpy'])}}}",
            f"    end_effector: {{position_m: {TIP}}}",
            "    tool: {mass_kg: 0.3, com_m: [0, 0, 0.05], inertia_kg_m2: {xx: 0.001, yy: 0.001, zz: 0.001}}",
        ]
        if more and name == names[0]:
            lines.append(f"    {more}")
    return "\n".join(lines) + "\n"


class Tour:
    """with Tour(names, known, true) as tour: tour.run()"""

    def __init__(self, names, known=None, true=None, options=(), order=None, pace="lockstep", protocol=10):
        self.names, self.order = names, order or names
        self.known, self.true = known or scene_text(names), true or scene_text(names)
        self.protocol = protocol
        self.options, self.pace = ["--no-gripper", "--strict", *options], pace
        for name in names:  # whose model is compared, and which pylibfranka can read
            self.options += ["--protocol", f"{name}={protocol}"]
        self.steps, self.asked, self.said = {}, [], []

    def __enter__(self):
        self.temporary = tempfile.TemporaryDirectory()
        self.folder = pathlib.Path(self.temporary.name)
        (self.folder / "known.yaml").write_text(self.known)
        (self.folder / "true.yaml").write_text(self.true)
        self.arms = VirtualArms(PROGRAM, self.folder / "true.yaml", self.names, self.pace, self.options).__enter__()
        self.places = {name: self.read(name) for name in self.names if self.protocol == 10}
        return self

    def read(self, name):
        robot = franka.Robot(self.arms.address[name], franka.RealtimeConfig.kIgnore)
        state = robot.read_once()
        return {"q": np.array(state.q), "tip_B": np.array(state.O_T_EE).reshape(4, 4).T[:3, 3]}

    def let_go(self, name):
        self.free(name)
        return self.at_rest(name)

    def at_rest(self, name):
        """The joints after a second of the arm's time."""
        robot = franka.Robot(self.arms.address[name], franka.RealtimeConfig.kIgnore)
        for _ in range(1000):
            state = robot.read_once()
        return np.array(state.q)

    def tip_W(self, name, bases):
        return np.array(bases[name]["position"]) + rotation(bases[name]["rpy"]) @ self.places[name]["tip_B"]

    def run(self, answer=None, resume=False, out="out", page=True):
        """Plays until the tour ends; returns its exit code. `answer(id)` overrides an answer, None: the usual one."""
        words = [PROGRAM, "commission", "--seconds", "0.2", "--answers", "-", "--json"]
        words += ["--fast"] if self.pace == "lockstep" else []
        words += [] if page else ["--no-page"]
        if resume:
            words += ["--resume", str(self.folder / out)]
        else:
            # The person connects the arms in this order and believes that it is the scene's.
            words += [*(self.arms.address[name] for name in self.order), "--scene", str(self.folder / "known.yaml")]
            words += ["--out", str(self.folder / out)]
        self.process = subprocess.Popen(
            words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=self.folder
        )
        self.text = []
        talk = threading.Thread(target=lambda: self.text.extend(self.process.stderr), daemon=True)
        talk.start()
        self.end = None
        for line in self.process.stdout:
            event = json.loads(line)
            if "step" in event:
                self.steps[event["step"]] = event["result"]
            elif "say" in event:
                self.said.append(event["say"])
                self.act(event["say"])
            elif "end" in event:
                self.end = event["end"]
            elif "ask" in event:
                asked = event["ask"]
                self.asked.append(asked)
                said = answer(asked) if answer else None
                said = said or self.usual(asked)
                if said == "SIGINT":
                    self.process.send_signal(signal.SIGINT)
                if said in ("SIGINT", "nothing"):
                    continue
                self.process.stdin.write(f"{asked}: {said}\n")
                self.process.stdin.flush()
        code = self.process.wait(PATIENCE_S)
        talk.join(PATIENCE_S)
        for stream in (self.process.stdin, self.process.stdout, self.process.stderr):
            stream.close()
        return code

    # What the person does at the words of the tour.
    def act(self, said):
        if match := re.match(r"\s*now push arm '(\w+)'", said):
            self.arms.control(f"push {match[1]} 0 14 -6 {LONG}")
        elif match := re.match(r"\s*arm '(\w+)' at .* push measured .* Let go", said):
            self.free(match[1])
        elif match := re.match(r"\s*now press the user stop of arm '(\w+)'", said):
            self.button = match[1]
            self.arms.control(f"user-stop {match[1]} on")
        elif re.match(r"\s*detected; now release it", said):
            self.arms.control(f"user-stop {self.button} off")

    def usual(self, asked):
        step, *more = asked.split(".")
        name = more[0] if more else None
        if step == "guiding" and name:
            self.lead(name, [0.03, 0.06, 0.05])
        elif step == "payload" and len(more) == 2:
            self.lead(name, [0.02, 0.2, 0.05] if more[1] == "2" else [0.1, -0.1, -0.05])
        elif step == "payload" and len(more) == 3:
            self.free(name)
        elif step == "joint_motion" and name:
            self.free(name)
        elif step == "cartesian_motion" and len(more) == 2:
            return "yes"
        elif step == "weight" and name:
            if len(more) == 1:
                return "1.2"
            if more[1] == "with":
                self.arms.control(f"push {name} 0 0 {-9.81 * 1.2} {LONG}")
            if more[1] == "off":
                self.free(name)
        elif step == "bases" and name == "points":
            return "4"
        elif step == "bases" and len(more) == 2:
            # The plate with dimples stands in the true world; the person leads away at the end.
            point = [0.42, 0.0, 0.45] if more[1] == "away" else list(self.points(name)[int(more[1]) - 1])
            if more[1] == "away":
                point[1] = 0.35 if name == "left" else -0.35
            self.arms.control(f"lead {name} {' '.join(map(str, point))} {LONG}")
        return "go"

    points_of = None

    def points(self, name):
        if self.points_of:
            return self.points_of[name]
        return [[0.40, -0.06, 0.40], [0.52, -0.06, 0.42], [0.40, 0.06, 0.44], [0.52, 0.08, 0.40]]

    def lead(self, name, away):
        place = self.tip_W(name, self.true_bases) + np.array(away)
        self.arms.control(f"lead {name} {' '.join(f'{value:.5f}' for value in place)} {LONG}")

    true_bases = BASES

    def free(self, name):
        self.arms.control(f"push {name} 0 0 0 0.01")

    def __exit__(self, *_):
        self.arms.close()
        self.temporary.cleanup()


class Mistakes(unittest.TestCase):
    """Each is found at its step, and no arm has moved: none ever began a motion."""

    def found(self, step, words, tour):
        with tour:
            # An arm that carries what it does not know sinks a little when its world begins.
            places = {name: tour.at_rest(name) for name in tour.names}
            self.assertEqual(tour.run(page=False), 1, "".join(tour.text))
            self.assertEqual(tour.end["step"], step, "".join(tour.text))
            result = tour.steps[step]
            self.assertEqual(result["verdict"], "no-go")
            self.assertRegex(result["found"], words)
            self.assertTrue(result["expected"] and result["remedy"])
            self.assertEqual(list(tour.steps)[-1], step)  # no later step ran
            for name in tour.names:
                moved = np.abs(tour.let_go(name) - places[name])
                self.assertLess(moved.max(), 1e-4, name)
            # It cannot be resumed past what was found.
            self.assertEqual(tour.run(page=False, resume=True), 1)
            self.assertEqual(tour.end["step"], step)
        for name in tour.names:
            self.assertEqual(tour.arms.ended["arms"][name]["motions"], 0, name)
        return result

    def test_loose_cable(self):
        result = self.found("network", "states lost", Tour(["left"], options=["--loss", "0.2", "--seed", "3"]))
        self.assertIn("cable", result["remedy"])

    def test_swapped_addresses(self):
        result = self.found(
            "identity", "'left' was measured at .*'right'", Tour(["left", "right"], order=["right", "left"])
        )
        self.assertIn("swapped", result["remedy"])

    def test_wrong_model(self):
        result = self.found("model", "the scene's model is 'fr3'", Tour(["left"], known=scene_text(["left"], "fr3")))
        self.assertIn("'fer'", result["remedy"])

    def test_wrong_mounting(self):
        tilted = {"left": {"position": [0, 0.3, 0], "rpy": [0.1, 0.3, 0.2]}}
        result = self.found("gravity", "base turned by 1[78]", Tour(["left"], true=scene_text(["left"], bases=tilted)))
        self.assertIn("rpy_rad", result["remedy"])

    def test_wrong_payload(self):
        load = "load_present: {mass_kg: 0.8, com_m: [0, 0, 0.1]}"
        result = self.found(
            "gravity", "0.[789]\\d* kg more on the flange", Tour(["left"], true=scene_text(["left"], more=load))
        )
        self.assertIn("load_declared", result["remedy"])

    def test_wrong_end_effector(self):
        known = scene_text(["left"]).replace("mass_kg: 0.3", "mass_kg: 0.9")
        self.found("end_effector", "0.300 kg .* the scene 0.900 kg", Tour(["left"], known=known))


class WholeTour(unittest.TestCase):
    def complete(self, tour, code=0):
        self.assertEqual(code, 0, "".join(tour.text[-30:]))
        self.assertEqual(tour.end["verdict"], "go")
        for step, result in tour.steps.items():
            self.assertEqual(result["verdict"], "go", step)
            self.assertTrue(all(reading["good"] for reading in result["readings"]), step)

    def test_one_arm(self):
        tour = Tour(["left"])
        with tour:
            self.complete(tour, tour.run())
            self.assertNotIn("bases", tour.steps)  # there is no second arm
            self.assertEqual(len(tour.steps), 17)
            page = (tour.folder / "out" / "commission.html").read_text()
            self.assertEqual(page.count("<figure>"), 2)
            self.assertIn("virtual twin", page)
            self.twin_agrees(tour)

    def test_a_pandas_own_library_is_compared(self):
        """Up to protocol version 7 the arm's model is a library."""
        with Tour(["left"], protocol=5) as tour:
            self.assertEqual(tour.run(lambda asked: "quit" if asked == "end_effector" else None, page=False), 1)
            result = tour.steps["model"]
            self.assertEqual(result["verdict"], "go", result)
            (version,) = (
                reading["value"] for reading in tour.steps["versions"]["readings"] if "version" in reading["quantity"]
            )
            self.assertEqual(version, 5)
            read = {reading["quantity"]: reading["value"] for reading in result["readings"]}
            self.assertGreater(read["difference in gravity torque"], 0.1)
            self.assertLess(read["difference in gravity torque"], 0.2)

    def twin_agrees(self, tour):
        """The true arms are ideal, as their twins are."""
        state = json.loads((tour.folder / "out" / "commission.json").read_text())
        for name in tour.names:
            measured = state["steps"]["cartesian_motion"]["measured"][name]["error_m"]
            self.assertLess(abs(state["twin"][name]["error_m"] - measured), 2e-3)

    @unittest.skipUnless(FULL, "a long one: runs with --full")
    def test_two_arms_and_their_bases(self):
        names = ["left", "right"]
        bases = {**BASES, "right": MOVED}
        tour = Tour(names, true=scene_text(names, bases=bases))
        tour.true_bases = bases
        with tour:
            # The first part ends at a question; the arms hold themselves, and a second tour goes on.
            self.assertEqual(tour.run(lambda asked: "quit" if asked == "stop" else None, page=False), 1)
            self.assertEqual(tour.end["step"], "stop")
            self.assertNotIn("stop", tour.steps)
            first = list(tour.asked)
            tour.asked.clear()
            self.complete(tour, tour.run(resume=True))
            # What protects the arms is repeated, what was measured is not.
            for step in ("versions", "identity", "model", "end_effector", "gravity", "hold", "button"):
                self.assertIn(step, first)
                self.assertIn(step, tour.asked)
            for step in ("doctor", "network", "guiding", "joint_motion"):
                self.assertIn(step, first)
                self.assertNotIn(step, tour.asked)
            out = tour.folder / "out"
            state = json.loads((out / "commission.json").read_text())
            self.check_base(state["steps"]["bases"]["measured"]["right"])
            self.assertIn(f"{MOVED['position'][0]:.3f}"[:4], (out / "scene.yaml").read_text())
            page = (out / "commission.html").read_text()
            self.assertEqual(page.count("<figure>"), 4)
            self.assertIn("virtual twin", page)
            self.twin_agrees(tour)
            if keep := os.environ.get("COMMISSION_KEEP"):
                subprocess.run(["cp", "-r", str(out), keep], check=True)
            checked = subprocess.run([PROGRAM, "check", str(out / "scene.yaml")], capture_output=True, text=True)
            self.assertEqual(checked.returncode, 0, checked.stdout + checked.stderr)

    def check_base(self, base):
        # The scene's first base is true; the second is measured against it.
        np.testing.assert_allclose(base["position_m"], MOVED["position"], atol=1.5e-3)
        np.testing.assert_allclose(base["rpy_rad"], MOVED["rpy"], atol=6e-3)
        self.assertLess(max(base["residual_m"]), 1e-3)

    @unittest.skipUnless(FULL, "a long one: runs with --full")
    def test_one_realistic_arm_on_its_own_clock(self):
        tour = Tour(
            ["left"],
            true=scene_text(["left"], fidelity="realistic"),
            pace="realtime",
            options=["--phase-us", "left=300", "--drift-ppm", "left=40"],
        )
        with tour:
            self.complete(tour, tour.run())
            friction = json.loads((tour.folder / "out" / "commission.json").read_text())["steps"]["joint_motion"][
                "measured"
            ]["left"]["friction_nm"]
            self.assertGreater(min(friction), 0.05)  # the plant has friction, and it is seen


class Refusals(unittest.TestCase):
    def call(self, *words):
        return subprocess.run(
            [PROGRAM, "commission", *words],
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            stdin=subprocess.DEVNULL,
        )

    def test_nothing_is_assumed(self):
        with tempfile.TemporaryDirectory() as folder:
            safety = "{allow_looser_limits: true, torque_max_nm: [90, 80, 87, 87, 12, 12, 12]}"
            pathlib.Path(folder, "loose.yaml").write_text(f"arms: [{{name: left, model: fer, safety: {safety}}}]\n")
            for words, text in (
                (["127.0.0.9", "--out", f"{folder}/a"], "no terminal"),
                (["127.0.0.9", "127.0.0.8", "--scene", "one_arm", "--out", f"{folder}/a"], "1 arm"),
                (["--out", f"{folder}/a"], "address"),
                (["--resume", f"{folder}/a"], "there is no"),
                (["127.0.0.9", "--answers", f"{folder}/none", "--out", f"{folder}/a"], "cannot open"),
                (["127.0.0.9", "--scene", f"{folder}/loose.yaml", "--out", f"{folder}/a"], "loosens limits"),
            ):
                done = self.call(*words)
                self.assertEqual(done.returncode, 2, done.stderr)
                self.assertIn(text, done.stderr)
                self.assertFalse(os.path.exists(f"{folder}/a"))
            (pathlib.Path(folder) / "empty").write_text("")
            done = self.call("127.0.0.9", "--answers", f"{folder}/empty", "--out", f"{folder}/b")
            self.assertEqual(done.returncode, 1)
            self.assertIn("nothing is assumed", done.stdout)

    def test_an_arm_that_is_touched_in_hold_ends_the_tour_in_hold(self):
        tour = Tour(["left"])
        with tour:

            def answer(asked):
                if asked == "button":  # it waits for a key, in hold, when the arm stops itself
                    tour.arms.control("reflex left joint_reflex")
                    return "nothing"
                return None

            self.assertEqual(tour.run(answer, page=False), 1)
            self.assertEqual(tour.end["step"], "button")
            self.assertIn("joint_reflex", tour.steps["button"]["found"])

    def test_an_arm_that_stops_itself_while_its_button_is_awaited_is_not_recovered(self):
        tour = Tour(["left"])
        usual = tour.act
        tour.act = lambda said: (
            tour.arms.control("reflex left joint_reflex") if "press the user" in said else usual(said)
        )
        with tour:
            self.assertEqual(tour.run(page=False), 1, "".join(tour.text))
            self.assertEqual(tour.end["step"], "button")
            self.assertIn("stopped itself: joint_reflex", tour.steps["button"]["found"])
            self.assertNotIn("button.left.recover", tour.asked)

    def test_the_button_of_another_arm_ends_the_tour_before_anything_moves(self):
        tour = Tour(["left", "right"])
        usual = tour.act

        def act(said):
            if "press the user stop of arm 'left'" in said:
                tour.arms.control("user-stop right on")
            else:
                usual(said)

        tour.act = act
        with tour:
            self.assertEqual(tour.run(page=False), 1, "".join(tour.text))
            self.assertEqual(tour.end["step"], "button")
            self.assertIn("'right': its user stop", tour.steps["button"]["found"])
            self.assertNotIn("guiding", tour.asked)

    # A load that the pose at rest hides would let a led arm fall: nobody holds it here.
    def test_an_arm_that_falls_while_it_is_led_is_held(self):
        tour = Tour(["left"])
        tour.lead = lambda name, away: tour.arms.control(f"push {name} 0 0 -12 {LONG}")
        with tour:
            self.assertEqual(tour.run(page=False), 1, "".join(tour.text))
            self.assertEqual(tour.end["step"], "guiding")
            self.assertIn("falls", tour.steps["guiding"]["found"])

    @unittest.skipUnless(FULL, "a long one: runs with --full")
    def test_points_in_mirrored_order_write_no_scene(self):
        """Two arms face each other; on a plate near the height of their bases the mirrored order fits a base that is
        turned over, 40 mm away, without any residual."""
        names = ["left", "right"]
        bases = {
            "left": {"position": [0, 0, 0], "rpy": [0, 0, 0]},
            "right": {"position": [1.1, 0, 0], "rpy": [0, 0, 3.141592653589793]},
        }
        tour = Tour(names, *[scene_text(names, bases=bases)] * 2)
        plate = {"left": [[0.49, -0.06, 0.02], [0.61, -0.06, 0.02], [0.49, 0.06, 0.02], [0.61, 0.06, 0.02]]}
        plate["right"] = [[x, -y, z] for x, y, z in plate["left"]]
        with tour:
            self.assertEqual(tour.run(lambda asked: "quit" if asked == "guiding" else None, page=False), 1)
            file = tour.folder / "out" / "commission.json"
            state = json.loads(file.read_text())
            for step in ("guiding", "payload", "joint_motion", "cartesian_motion", "stop", "delay", "noise", "weight"):
                state["steps"][step] = {"verdict": "go"}  # as if they were done: this is about the points
            file.write_text(json.dumps(state))
            tour.points_of = plate
            self.assertEqual(tour.run(page=False, resume=True), 1, "".join(tour.text[-20:]))
            self.assertEqual(tour.end["step"], "bases")
            self.assertEqual(tour.steps["bases"]["verdict"], "no-go")
            self.assertIn("rotation of the base from the scene", tour.steps["bases"]["found"])
            self.assertFalse((tour.folder / "out" / "scene.yaml").exists())

    def test_ctrl_c_while_it_waits_holds_the_arm(self):
        tour = Tour(["left"])
        with tour:
            self.assertEqual(tour.run(lambda asked: "SIGINT" if asked == "guiding" else None, page=False), 1)
            self.assertEqual(tour.end["step"], "guiding")
            self.assertLess(np.abs(tour.read("left")["q"] - tour.places["left"]["q"]).max(), 5e-3)


if __name__ == "__main__":
    PROGRAM = os.path.abspath(sys.argv.pop(1))
    unittest.main(verbosity=2)
