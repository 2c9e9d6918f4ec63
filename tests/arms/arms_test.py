#!/usr/bin/env python3
"""The program for arms alone, for this processor and for 64-bit ARM under QEMU: arms_test.py PROGRAM

Builds both (packaging/arms.py), runs tests of the core, the wire and the live input on the foreign one, lets both hold
a virtual arm in lock-step, and looks into their wheels. PROGRAM, the whole one, has the virtual arm.
"""

import json
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
TESTS = "core_test threads_test fci_wire_test live_input_test".split()
LARGEST = 6e6  # [bytes], of a program with its libraries, and of a wheel
# ARM's products and sums are rounded once, where x86-64 without FMA rounds twice: 1e-16 of the torques, times the
# conditioning of the laws. A wrong layout, sign or order is above 1e-3.
SAME_TORQUE = 1e-9  # [N m]


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
        cls.foreign = arms.build("arms-aarch64", "multipanda_packaged", *TESTS)
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
        words = "|".join(f"^{name}$" for name in TESTS)
        done = output("ctest", "--test-dir", self.foreign, "--output-on-failure", "--no-tests=error", "-R", words)
        self.assertIn(f"0 tests failed out of {len(TESTS)}", done)

    def torques(self, scene, name, *program):
        """Torques of a held arm, whose world waits for each command."""
        record = self.folder / name
        with VirtualArms(PROGRAM, scene, ["arm"], "lockstep") as world:
            address = f"arm={world.address['arm']}"
            words = ["run", scene, "--no-timeline", "--backend", "fci", "--address", address, "--fast"]
            said = output(*program, *words, "--seconds", 2, "--record", record, "--json")
        self.assertGreaterEqual(json.loads(said)["cycles"], 1990)
        (log,) = record.glob("*/log.mcap")
        output(PROGRAM, "export", log, "--npz", "--out", record / "log.npz")
        data = np.load(record / "log.npz")
        return data["command/tau"]

    def test_both_hold_an_arm_with_the_same_torques(self):
        for law in ("joint_impedance", "cartesian_impedance"):
            scene = self.folder / f"{law}.yaml"
            scene.write_text(
                f"name: {law}\narms: [{{name: arm, model: fr3, start_rad: ready}}]\n"
                f"controllets: [{{name: law, type: {law}, arms: arm}}]\nactive: [law]\n"
            )
            own = self.torques(scene, f"own_{law}", self.own / "multipanda")
            foreign = self.torques(scene, f"foreign_{law}", *self.qemu, self.foreign / "multipanda")
            count = min(len(own), len(foreign))
            self.assertGreater(np.abs(own[:count]).max(), 1e-3)
            difference = np.abs(own[:count] - foreign[:count]).max()
            print(f"{law}: torques differ by at most {difference:.1e} N m in {count} cycles")
            self.assertLessEqual(difference, SAME_TORQUE)

    def test_program_and_wheel_are_small_and_have_what_they_need(self):
        for processor, wheel in self.wheel.items():
            inside = self.folder / processor / "multipanda"
            folders = (inside / "bin", inside / "lib", inside.parent / "multipanda_arms.libs")
            program, packed = sum(map(bytes_of, folders)), wheel.stat().st_size
            print(f"{processor}: program and libraries {program / 1e6:.1f} MB, wheel {packed / 1e6:.1f} MB")
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
