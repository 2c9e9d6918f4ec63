"""The wheel in clean environments: an empty HOME, the system's PATH alone, another folder; each Python of the computer.

Each environment: install the file alone, run the demo, which does without the report and says how to get it; install
the report's packages; make the report; run the examples from where the wheel has put them.
"""

import concurrent.futures
import functools
import json
import os
import pathlib
import re
import shutil
import subprocess
import time
import unittest

import made
from made import FOLDER, ROOT

DEBIAN = pathlib.Path("/usr/bin/python3")
VERSIONS = {(3, minor) for minor in range(10, 14)}
# The extra `ros` is 80 distributions: tested in the version of the build, and in the newest.
WITH_ROS = {(3, 11), (3, 13)}
# The extra `law` compiles with Numba, which knows each Python's instructions: the oldest and the newest.
WITH_LAW = {(3, 10), (3, 13)}
PATIENCE = 300  # [s]; only reached by a hang


def version(python):
    words = [python, "-I", "-c", "import sys; print(*sys.version_info[:2])"]
    done = subprocess.run(words, capture_output=True, text=True)
    return tuple(map(int, done.stdout.split())) if done.returncode == 0 else None


def pythons():
    """Debian's, and those that pyenv has installed."""
    others = sorted((pathlib.Path.home() / ".pyenv" / "versions").glob("3.1*/bin/python3"))
    return [python for python in (DEBIAN, *others) if version(python) in VERSIONS]


@functools.cache
def constraints():
    """The tested versions (requirements*.txt), so that a release elsewhere does not change what is tested."""
    path = FOLDER / "constraints.txt"
    pins = "".join((ROOT / f"requirements{name}.txt").read_text() for name in ("", "-more"))
    lines = re.findall(r"^[\w.-]+==[^\\\n]*", pins, re.M)
    path.write_text("\n".join(lines))
    return path


class Environment:
    """A virtual environment, and a folder of the user's from which everything is called."""

    def __init__(self, python, name):
        top = FOLDER / name
        self.home, self.here, self.run = top / "home", top / "here", top / "r"
        for folder in (self.home, self.here, self.run):
            folder.mkdir(parents=True)
        self.variables = {
            "HOME": str(self.home),
            "PATH": "/usr/bin:/bin",
            "LANG": "C.UTF-8",
            "XDG_RUNTIME_DIR": str(self.run),
            "PIP_CACHE_DIR": str(FOLDER / "cache"),  # one download for all
            "PIP_CONSTRAINT": str(constraints()),
            "PIP_NO_COMPILE": "1",  # what is imported is compiled then
        }
        # The package index of this computer is no property of the user's environment.
        index = re.compile(r"PIP_(INDEX|EXTRA|CERT|FIND|TRUST)")
        self.variables |= {name: value for name, value in os.environ.items() if index.match(name)}
        self.call(python, "-m", "venv", top / "env")
        self.bin = top / "env" / "bin"

    def try_call(self, *words, **variables):
        return subprocess.run(
            [str(word) for word in words],
            capture_output=True,
            text=True,
            timeout=PATIENCE,
            cwd=self.here,
            env={**self.variables, **variables},
        )

    def call(self, *words, **variables):
        done = self.try_call(*words, **variables)
        if done.returncode != 0:
            raise AssertionError(f"{' '.join(map(str, words))}: {done.returncode}\n{done.stdout}{done.stderr}")
        return done

    def install(self):
        self.call(self.bin / "python", "-m", "pip", "install", "-q", made.wheel())

    def package(self):
        """The folder of the installed package, and a check that it is the installed one."""
        said = self.call(self.bin / "python", "-c", "import multipanda; print(multipanda.__file__)").stdout
        folder = pathlib.Path(said.strip()).parent
        if not folder.is_relative_to(self.bin.parent):
            raise AssertionError(f"{folder} is not in {self.bin.parent}")
        return folder

    def example(self, name, *arguments):
        """An example, begun again if a busy computer left its stream silent: the arms were held, as promised."""
        path = self.package() / "share/multipanda/examples/python" / name
        for _ in range(10):
            done = self.try_call(self.bin / "python", path, *arguments)
            if "reference_stale" not in done.stderr and "not_active" not in done.stderr:
                break
        if done.returncode != 0:
            raise AssertionError(f"{name}: {done.returncode}\n{done.stdout}{done.stderr}")
        return done.stdout


# One compiled file for every version of Python: a world of the seed, and all of its bits.
NATIVE = """
import multipanda_native
world = multipanda_native.World("one_arm", seed=3, hidden=True)
world.step(300)
saved = world.save()
world.step(200)
print(world.arms["arm"].q_rad.tobytes().hex())
world.restore(saved)
world.step(200)
print(world.arms["arm"].q_rad.tobytes().hex())
"""


def first_steps_over_ros(environment, number, refusal):
    """The extra `ros` as the refusal names it, then the program and a client of rclpy, both from the wheel."""
    (command,) = re.findall(r"(\S+ -m pip install) '(multipanda\[ros\])'", refusal)
    environment.call(*command[0].split(), "-q", command[1], PIP_CONSTRAINT="")
    examples = environment.package() / "share/multipanda/examples/ros"
    variables = {"ROS_DOMAIN_ID": str(1 + (os.getpid() * 3 + number) % 100)}  # apart from other tests
    program = subprocess.Popen(
        [environment.bin / "multipanda", "run", examples / "scene.yaml", "--ros", "--until-input-ends"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        cwd=environment.here,
        env={**environment.variables, **variables},
    )
    try:
        client = environment.try_call(environment.bin / "python", examples / "first_steps.py", **variables)
    finally:
        try:
            said, _ = program.communicate(timeout=PATIENCE)
        except subprocess.TimeoutExpired:
            program.kill()
            said, _ = program.communicate()
    if client.returncode != 0 or program.returncode != 0:
        raise AssertionError(f"{client.stdout}{client.stderr}\nthe run ({program.returncode}):\n{said}")
    return client.stdout


def whole_use(python, number):
    """Everything that a user of the wheel does; returns what was seen."""
    environment = Environment(python, f"e{number}")
    seen = {}
    begin = time.monotonic()
    environment.install()
    seen["install_s"] = time.monotonic() - begin
    demo = environment.call(environment.bin / "multipanda", "demo", "--fast", "--json")
    seen["demo_s"] = time.monotonic() - begin - seen["install_s"]  # its first switch comes before its end
    seen["demo"], seen["demo_said"] = json.loads(demo.stdout), demo.stderr
    seen["report_refused"] = environment.try_call(environment.bin / "multipanda", "report", "runs")
    seen["run_refused"] = environment.try_call(
        environment.bin / "multipanda", "run", "one_arm", "--fast", "--seconds", "1", "--record", "r", "--report"
    )
    ros = ("run", "one_arm", "--ros", "--fast", "--seconds", "1")
    seen["ros_refused"] = environment.try_call(environment.bin / "multipanda", *ros)
    # The command that the demo has named: what is installed needs no index for itself.
    (command,) = re.findall(r"(\S+ -m pip install) '(multipanda\[report\])'", demo.stderr)
    environment.call(*command[0].split(), "-q", command[1])
    seen["first_arm"] = environment.example("first_arm.py", "--record", "more")
    # Without the launcher, too, the program finds the Python that it is installed in.
    program = environment.package() / "bin" / "multipanda" if python == DEBIAN else environment.bin / "multipanda"
    seen["page"] = (environment.here / environment.call(program, "report", "more").stdout.strip()).read_text()
    seen["two_arms"] = environment.example("two_arms.py")
    seen["stream"] = environment.example("stream_policy.py", "--seconds", "1")
    seen["native"] = environment.call(environment.bin / "python", "-c", NATIVE).stdout
    if version(python) in WITH_LAW:
        environment.call(environment.bin / "python", "-m", "pip", "install", "-q", "multipanda[law]")
        seen["law"] = environment.example("own_law.py")
    if version(python) in WITH_ROS:
        seen["ros"] = first_steps_over_ros(environment, number, seen["ros_refused"].stderr)
    # Fonts that matplotlib has found, and pip's own notes.
    seen["left"] = sorted({path.name for path in environment.home.iterdir()} - {".cache", ".config", ".ros"})
    seen["sockets"] = sorted(path.name for path in environment.run.rglob("*") if path.is_file() or path.is_socket())
    shutil.rmtree(environment.bin.parent)
    return seen


@functools.cache
def native_here():
    """What NATIVE says in this source tree, with its Python."""
    python = made.BUILD / "share/multipanda-venv/bin/python"
    return made.output(python, "-c", NATIVE, env={**os.environ, "PYTHONPATH": str(made.ROOT / "python")})


class CleanEnvironments(unittest.TestCase):
    def test_each_python(self):
        found = pythons()
        self.assertIn(DEBIAN, found, "Debian's Python is missing")
        with concurrent.futures.ThreadPoolExecutor(2) as pool:
            results = list(pool.map(whole_use, found, range(len(found))))
        for python, seen in zip(found, results):
            with self.subTest(python=str(python)):
                print(
                    f"Python {'.'.join(map(str, version(python)))}: installed in {seen['install_s']:.1f} s, "
                    f"demo --fast after {seen['demo_s']:.1f} s more"
                )
                self.check(seen)
        missing = VERSIONS - {version(python) for python in found}
        if missing:
            print(f"skipped: this computer has no Python {sorted(missing)}")

    def check(self, seen):
        self.assertEqual(seen["demo"]["cycles"], 20000)
        self.assertEqual(seen["demo"]["faults"], [])
        self.assertIn(["left_joints"], [switch["started"] for switch in seen["demo"]["switches"]])
        self.assertRegex(seen["demo_said"], r"no report: .* has no matplotlib; .*multipanda\[report\]")
        self.assertEqual(seen["report_refused"].returncode, 1)
        self.assertIn("multipanda[report]", seen["report_refused"].stdout + seen["report_refused"].stderr)
        self.assertEqual(seen["run_refused"].returncode, 2)
        self.assertIn("multipanda[report]", seen["run_refused"].stderr)
        self.assertNotEqual(seen["ros_refused"].returncode, 0)
        self.assertRegex(seen["ros_refused"].stderr, r"the ROS 2 libraries are not installed .*'multipanda\[ros\]'")
        self.assertEqual(seen["native"], native_here())
        if "ros" in seen:
            self.assertRegex(seen["ros"], r"switched: \['left_cartesian'\] instead of")
        if "law" in seen:
            (gradient,) = re.findall(r"gradient: (\S+) N m", seen["law"])
            self.assertLess(float(gradient), 1e-6)
            (difference,) = re.findall(r"against the Python function: (\S+) N m", seen["law"])
            self.assertLess(float(difference), 1e-9)
        self.assertIn("<html", seen["page"])
        self.assertGreater(len(seen["page"]), 10000)
        self.assertRegex(seen["first_arm"], r"torques: \(\d{4}, 7\)")
        self.assertIn("both hands 5 cm higher", seen["two_arms"])
        self.assertIn("held: True", seen["stream"])
        self.assertEqual((seen["left"], seen["sockets"]), ([], []))
