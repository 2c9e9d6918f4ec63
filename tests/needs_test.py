"""From a fresh clone each command works on its own: what it starts or installs is among what it builds.

Asks `./multipanda needs COMMAND` for its targets, and ninja, in a fresh build folder, which commands make them.
"""

import pathlib
import re
import subprocess
import sys
import tempfile
import unittest

ROOT = pathlib.Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"


def words(file, function):
    """The commands that a program adds."""
    text = (ROOT / file).read_text(encoding="utf-8")
    listed = re.search(function, text, re.S).group(1)
    return [word.replace("_", "-") for word in re.findall(r"add_(\w+)", listed) if word != "lab"]


STARTS = {word: ["multipanda"] for word in words("cli/main.cpp", r"\{(add_demo.*?)\}")}
STARTS |= {word: ["multipanda", "multipanda-lab"] for word in words("cli/lab.cpp", r"\{(add_experiment.*?)\}")}
STARTS["doctor"] += ["multipanda_cycle_probe"]
STARTS["cockpit"] += ["libmultipanda_cockpit.so"]
STARTS["soak"] = ["multipanda", "multipanda-lab", "multipanda-soak"]
STARTS["bench"] = ["multipanda", "multipanda-lab", "multipanda_bench"]
STARTS["run x --cockpit"] = STARTS["cockpit"]
STARTS["run x --ros"] = ["multipanda", "libmultipanda_ros.so"]
for lab in words("cli/lab.cpp", r"\{(add_experiment.*?)\}"):
    STARTS[f"lab {lab}"] = STARTS[lab]


class Needs(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(cls.folder.cleanup)
        cls.build = pathlib.Path(cls.folder.name) / "build"
        ros = "ON" if (VENV / "share/rcl").exists() else "OFF"
        configure = ["cmake", "--preset", "release", "-B", cls.build, f"-DMULTIPANDA_ROS={ros}", "-S", ROOT]
        done = subprocess.run(configure, cwd=ROOT, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise RuntimeError(done.stdout + done.stderr)
        cls.ros = ros == "ON"

    def made_by(self, command):
        """Names of the files that the command's targets make."""
        needs = subprocess.run(
            [ROOT / "multipanda", "needs", *command.split()], capture_output=True, text=True, check=True
        ).stdout
        targets = re.search(r"^targets (.*)$", needs, re.M).group(1).split()
        dry = subprocess.run(
            ["ninja", "-C", self.build, "-t", "commands", *targets], capture_output=True, text=True, check=False
        )
        self.assertEqual(dry.returncode, 0, f"{command}: {dry.stdout[-500:]}{dry.stderr}")
        return set(re.findall(r"[\w./-]+", dry.stdout)), dry.stdout

    def test_each_command_builds_what_it_starts(self):
        for command, programs in STARTS.items():
            if "--ros" in command and not self.ros:
                continue
            made, _ = self.made_by(command)
            names = {pathlib.PurePath(path).name for path in made}
            with self.subTest(command):
                self.assertEqual(set(programs) - names, set())

    def test_the_small_program_has_no_other_programs_code(self):
        _, printed = self.made_by("demo")
        for folder in "benchmarks commission cockpit doctor experiments sysid/(?!measured) motion_generators".split():
            self.assertNotRegex(printed, rf"-o {folder}/?\S+\.o")

    def test_package_builds_what_it_installs(self):
        if not self.ros:
            print("skipped: packages contain the ROS 2 interfaces, and .venv has no ROS 2")
            return
        made, _ = self.made_by("package")
        installed = set()
        for file in self.build.rglob("cmake_install.cmake"):
            if "_deps" not in file.parts:
                installed |= set(re.findall(rf"\"{self.build}/([\w./-]*(?:\.so|multipanda[\w-]*))\"", file.read_text()))
        installed = {name for name in installed if not name.endswith("/")}
        self.assertIn("multipanda", installed)
        missing = {name for name in installed if pathlib.PurePath(name).suffix in ("", ".so")} - made
        self.assertEqual({name for name in missing if not (ROOT / name).is_dir()}, set())

    def test_the_program_for_arms_has_no_simulator_and_no_page(self):
        """What ninja would compile and link for it; nothing is built."""
        build = self.build.with_name("arms")
        done = subprocess.run(["cmake", "--preset", "arms", "-B", build], cwd=ROOT, capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        words = ["ninja", "-C", build, "-t", "commands", "multipanda_packaged"]
        commands = subprocess.run(words, capture_output=True, text=True, check=True).stdout
        made = set(re.findall(r"-o (?:\w+/)*(lib\w+\.so|multipanda)\b", commands))
        self.assertEqual(made, {"multipanda", "libmultipanda_core.so"})
        libraries = set(re.findall(r"\b(lib\w+)\.(?:so|a)\b", commands))
        self.assertIn("libmultipanda_fci_client", libraries)
        foreign = "mujoco|assimp|coal|pinocchio|boost|rcl|multipanda_(arm|report|fci_server|cockpit)$"
        self.assertEqual({name for name in libraries if re.search(foreign, name)}, set())


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0]])
