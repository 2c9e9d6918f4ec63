#!/usr/bin/env python3
"""The program for arms alone, for this processor and for 64-bit ARM under QEMU: arms_test.py PROGRAM

Builds both (packaging/arms.py), runs tests of the core, the wire and the live input on the foreign one, lets both hold
a virtual arm in lock-step, and looks into their wheels. PROGRAM, the whole one, has the virtual arm.
"""

import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest
import zipfile

import numpy as np

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "packaging"), str(ROOT / "tests" / "fci")]
import arms
from virtual_arms import VirtualArms

PROGRAM = ""
TESTS = ("fci/wire/fci_wire_test", "core/core_test", "core/threads_test", "runtime/live_input_test")
# What QEMU 7.2 has not: which pages are in memory, the times at which the kernel received packets, and the pace of a
# client that reads 1,000 states per second.
NOT_UNDER_QEMU = (
    "ThreadSetup.TheMemoryLockLeavesTheStacksOfOtherThreads",
    "ServerTest.PacketsThatWaitedTooLongAreCountedAndMoveNothing",
    "ServerTest.StreamsTheState",
)
LARGEST = 6e6  # [bytes], of the program with its own library, and of a wheel
# From the same states: ARM's products and sums are rounded once, where x86-64 without FMA rounds twice: 1e-16 of the
# torques, times the conditioning of the laws. A wrong layout, sign or order is above 1e-3.
SAME_TORQUE = 1e-9  # [N m]
# In lock-step the arm has been still for another number of periods: q differs by 1e-14 at the start, and the wire has
# 32-bit numbers, of which a few are then rounded to the next, 1.2e-7 rad apart. Two runs of one program: 1.8e-5 N m.
SAME_RUN = 5e-4  # [N m]
HELD = """
name: held
duration_s: 3
arms: [{name: arm, model: fr3, start_rad: ready}]
controllets:
  - {name: cartesian, type: cartesian_impedance, arms: arm, features: [joint_limits, collision_avoidance]}
  - {name: joint, type: joint_impedance, arms: arm}
timeline:  # QEMU translates the first cycles' code while the arm, still without a command, does not wait
  - {at_s: 0.1, switch: {activate: [cartesian]}}
  - at_s: 0.2
    reference: {controllet: cartesian, input: pose, position_m: [0.45, 0.2, 0.45], rpy_rad: [pi, 0, 0], duration_s: 0.5}
  - {at_s: 1, switch: {activate: [joint]}}
  - {at_s: 1.5, reference: {controllet: joint, input: joints, q_rad: [0, -pi/4, 0, -3*pi/4, 0, pi/2, 1], duration_s: 1}}
"""


def output(*words, **options):
    done = subprocess.run([str(w) for w in words], capture_output=True, text=True, check=False, **options)
    if done.returncode != 0:
        raise AssertionError(f"{' '.join(map(str, words))}: code {done.returncode}\n{done.stdout[-5000:]}{done.stderr}")
    return done.stdout


def bytes_of(folder):
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


class Arms(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory(prefix="mp-arms-")
        cls.addClassCleanup(folder.cleanup)
        cls.folder = pathlib.Path(folder.name)
        cls.own = arms.build("arms", "multipanda_packaged")
        cls.foreign = arms.build("arms-aarch64", "multipanda_packaged", *(pathlib.Path(test).name for test in TESTS))
        cls.qemu = [shutil.which("qemu-aarch64") or shutil.which("qemu-aarch64-static"), "-L", cls.foreign / "sysroot"]
        cls.wheel = {}
        for build in (cls.own, cls.foreign):
            output(sys.executable, "-B", ROOT / "packaging/make_packages.py", "--build", build, "--out", cls.folder)
        for path in cls.folder.glob("multipanda_arms-*.whl"):
            processor = "aarch64" if path.stem.endswith("aarch64") else "x86_64"
            cls.wheel[processor] = path
            with zipfile.ZipFile(path) as archive:
                archive.extractall(cls.folder / processor)
            (cls.folder / processor / "multipanda/bin/multipanda").chmod(0o755)

    def test_its_tests_pass_on_the_other_processor(self):
        short = {name: value for name, value in os.environ.items() if name != "MULTIPANDA_FULL"}
        for test in TESTS:
            done = output(*self.qemu, self.foreign / test, f"--gtest_filter=-{':'.join(NOT_UNDER_QEMU)}", env=short)
            self.assertRegex(done, r"\[  PASSED  \] \d\d+ tests")

    def torques(self, name, program, *words):
        """The log of a run, and its torques since the timeline began."""
        record = self.folder / name
        output(*program, "run", self.scene, *words, "--fast", "--record", record)
        (log,) = record.glob("*/log.mcap")
        output(PROGRAM, "export", log, "--npz", "--out", record / "log.npz")
        return log, np.load(record / "log.npz")["arm/command/tau_cmd"][-2900:]

    def in_lock_step(self, name, program):
        """With a virtual arm, whose world waits for each command."""
        with VirtualArms(PROGRAM, self.scene, ["arm"], "lockstep") as world:
            return self.torques(name, program, "--backend", "fci", "--address", f"arm={world.address['arm']}")

    def test_both_hold_and_move_an_arm_with_the_same_torques(self):
        self.scene = self.folder / "held.yaml"
        self.scene.write_text(HELD)
        own, foreign = [self.own / "multipanda"], [*self.qemu, self.foreign / "multipanda"]
        log, held = self.in_lock_step("held", own)
        difference = np.abs(held - self.in_lock_step("foreign_held", foreign)[1]).max()
        self.assertLessEqual(difference, SAME_RUN)
        same_states = ("--backend", "replay", "--log", log)
        tau = self.torques("same_states", own, *same_states)[1]
        same = np.abs(tau - self.torques("foreign_same_states", foreign, *same_states)[1]).max()
        self.assertLessEqual(same, SAME_TORQUE)
        for law, part in (("cartesian", tau[:900]), ("joint", tau[900:])):
            self.assertGreater(np.abs(part).max(), 1, f"the {law} law does nothing")
        print(f"torques of {len(tau)} cycles differ by at most {same:.1e} N m, in lock-step {difference:.1e} N m")

    def test_program_and_wheel_are_small_and_have_what_they_need(self):
        for processor, wheel in self.wheel.items():
            inside = self.folder / processor / "multipanda"
            program, packed = sum(map(bytes_of, (inside / "bin", inside / "lib"))), wheel.stat().st_size
            others = bytes_of(inside.parent / "multipanda_arms.libs")
            print(
                f"{processor}: wheel {packed / 1e6:.2f} MB, program and its library {program / 1e6:.2f} MB, "
                f"libraries of others {others / 1e6:.2f} MB"
            )
            self.assertLessEqual(max(program, packed), LARGEST)
            names = " ".join(path.name for path in inside.parent.rglob("*"))
            self.assertNotRegex(names, "mujoco|assimp|coal|matplotlib")
            run = [inside / "bin/multipanda"] if processor != "aarch64" else [*self.qemu, inside / "bin/multipanda"]
            self.assertIn("one_arm", output(*run, "list", "scenes", env={"PATH": "/usr/bin:/bin"}, cwd=self.folder))
            self.assertIn("ok", output(*run, "check", "two_arms", env={"PATH": "/usr/bin:/bin"}, cwd=self.folder))
            refused = subprocess.run([*run, "run", "one_arm"], capture_output=True, text=True, check=False)
            self.assertEqual(refused.returncode, 2, refused.stderr)
            self.assertIn("for arms alone", refused.stderr)
        self.assertEqual(set(self.wheel), {"x86_64", "aarch64"})

    def test_python_needs_neither_mujoco_nor_matplotlib(self):
        code = "import sys; sys.modules.update(mujoco=None, matplotlib=None)\n"
        code += "import multipanda as mp; print(len(dir(mp)))"
        packages = self.folder / "x86_64"
        self.assertGreater(int(output(sys.executable, "-c", code, cwd=packages)), 20)


def missing():
    for names in (["ld.lld"], ["clang++"], ["qemu-aarch64", "qemu-aarch64-static"]):
        if not any(map(shutil.which, names)):
            return f"there is no {names[0]}: sudo apt install clang lld qemu-user-static"
    return ""


if __name__ == "__main__":
    if missing():
        print(f"skipped: {missing()}")
        sys.exit(77)
    PROGRAM = str(pathlib.Path(sys.argv.pop(1)).resolve())
    unittest.main()
