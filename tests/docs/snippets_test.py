#!/usr/bin/env python3
"""The lines of README and docs as they stand on the page: Python runs, C++ compiles, scenes are accepted, commands have
the options that they are given, and those of the first pages run.   snippets_test.py PROGRAM COMPILER"""

import concurrent.futures
import contextlib
import importlib.util
import itertools
import os
import pathlib
import re
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import time
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "python"))
import harness  # first: it sets the paths
import yaml
from harness import FOLDER, PATIENCE, ROOT, sockets, until

PAGES = {
    str(path.relative_to(ROOT)): path.read_text(encoding="utf-8")
    for path in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    if path.parent.name != "results"
}
# Pages whose Python needs more around it: the test that runs it.
ELSEWHERE = {
    "docs/python.md": "tests/python/examples_test.py",
    "docs/learning.md": "tests/python/native_test.py",
    "docs/ros2.md": "tests/ros/examples_test.py",
    "docs/coming_from.md": "tests/docs/coming_from_test.py",
    "docs/lerobot.md": "tests/python/lerobot_trial_test.py",
}
# YAML of other files, or with names of files that its page makes: what reads it.
OTHER_YAML = {
    "docs/experiments.md": "tests/own_experiment_test.py",
    "docs/models.md": "models/from_urdf_test.cpp",
    "docs/python_laws.md": "tests/python/law_test.py",
    "docs/ros2_control.md": "ros/tests/run.sh",
}
SCENE = """
name: page
arms: [{name: arm}, {name: left, base: {position_m: [0, 1, 0]}}, {name: right, base: {position_m: [0, 2, 0]}}]
controllets: [{name: pose, type: cartesian_impedance, arms: left}]
"""
SCRIPT = ("setup", "test", "package", "demo")  # of ./multipanda itself


def blocks(page, *languages):
    return re.findall(rf"^```(?:{'|'.join(languages)})\n(.*?)^```", PAGES[page], re.M | re.S)


def with_blocks(*languages):
    return [page for page in PAGES if blocks(page, *languages)]


def commands():
    """Page, command line without comment, of every line of code that calls the program."""
    for page, text in PAGES.items():
        code = re.findall(r"^(?: {4})(.*)$", text, re.M) + "".join(blocks(page, "sh", "bash", "text")).splitlines()
        for line in code:
            if found := re.match(r"\s*(?:\./|my_env/bin/)?multipanda ([a-z].*)", line):
                yield page, re.split(r"\s+#|\s{3,}| &$", found[1].strip())[0]


def free(*addresses):
    """Whether no other program listens there."""
    with contextlib.suppress(OSError):
        for address in addresses:
            with socket.socket() as probe:
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                probe.bind(address)
        return True
    return False


class Sessions(unittest.TestCase):
    """A reader types the commands of a page one after the other, in a folder that has the tree's scenes."""

    def setUp(self):
        self.folder = FOLDER / self.id().rpartition("_")[2]
        self.folder.mkdir()
        for name in ("examples", "experiments"):
            (self.folder / name).symlink_to(ROOT / name)

    def typed(self, page, begins):
        """The page's command that begins so."""
        (line,) = {line for where, line in commands() if where == page and line.startswith(begins)}
        return [os.environ["MULTIPANDA_PROGRAM"], *shlex.split(line)]

    def do(self, page, *beginnings):
        """Executes commands; what the last one says."""
        for begins in beginnings:
            words = self.typed(page, begins)
            done = subprocess.run(
                words,
                input="\n" * 6,  # where it asks, the defaults
                cwd=self.folder,
                capture_output=True,
                text=True,
                timeout=3 * PATIENCE,
                check=False,
            )
            self.assertEqual(done.returncode, 0, f"{page}: {words}\n{done.stdout}{done.stderr}")
        return done.stdout

    @contextlib.contextmanager
    def goes_on(self, page, begins, sign):
        """A command that goes on until Ctrl-C, from the time when it has said this."""
        file = self.folder / f"{begins.split()[0]}.txt"
        with file.open("w") as output:
            words = self.typed(page, begins)
            process = subprocess.Popen(words, cwd=self.folder, stdout=output, stderr=subprocess.STDOUT)
        try:
            until(lambda: sign in file.read_text() or process.poll() is not None, f"{begins}: {sign}")
            self.assertIn(sign, file.read_text())
            yield
        finally:
            process.send_signal(signal.SIGINT)
            code = process.wait(PATIENCE)
        self.assertEqual(code, 0, file.read_text())

    def owners(self):
        words = [os.environ["MULTIPANDA_PROGRAM"], "ctl", "state", "--json"]
        answer = subprocess.run(words, capture_output=True, text=True, check=True).stdout
        return re.findall(r'"controllet": ?"(\w+)"', answer)

    @unittest.skipUnless(free(("127.0.0.1", 8765)), "another program listens at port 8765")
    def test_readme(self):
        self.do("README.md", "new scene")
        with self.goes_on("README.md", "run two_arms", "http://127.0.0.1:8765"):
            self.do("README.md", "ctl switch dual")
            self.assertEqual(self.owners(), ["dual", "dual"])
        self.assertEqual(sockets(), [])

    @unittest.skipUnless(free(("127.0.0.1", 8765)), "another program listens at port 8765")
    def test_first_run(self):
        page = "docs/first_run.md"
        with self.goes_on(page, "run two_arms", "http://127.0.0.1:8765"):
            self.do(page, "ctl state", "ctl list", "ctl switch", "ctl reference", "ctl parameter")
            self.assertEqual(self.owners(), ["left_cartesian", "right_cartesian"])
            self.do(page, "ctl stop")
            until = time.monotonic() + 10  # a state may be 0.1 s old
            while self.owners() != ["left_hold", "right_hold"]:
                self.assertLess(time.monotonic(), until)
        self.do(page, "report", "export")
        self.assertTrue(list(self.folder.rglob("*.csv")) and list(self.folder.rglob("report.html")))
        with self.goes_on(page, "cockpit runs", "http://127.0.0.1:8765"):
            pass

    def test_live_input(self):
        with self.goes_on("docs/live_input.md", "run two_arms", " Hz"):
            self.do("docs/live_input.md", "ctl list", "ctl reference")

    @unittest.skipUnless(free(("127.0.0.1", 1337)), "another program listens at port 1337")
    def test_sim_to_real(self):
        page = "docs/tutorials/sim_to_real.md"
        scene = "experiments/scenes/excitation_fer.yaml"
        with self.goes_on(page, "virtual-arm experiments", "127.0.0.1"):
            for name in ("my/real", "my/again"):
                self.do(page, f"run {scene} --backend fci --fast --record {name}")
        self.do(page, "lab compare", "lab predict my/real --model fer --motor-friction", "lab identify my/real")
        predicted = self.do(page, "lab predict my/again")
        self.assertIn("my/panda.yaml", predicted)


class Snippets(unittest.TestCase):
    def ask(self, *words):
        return subprocess.run([os.environ["MULTIPANDA_PROGRAM"], *words], capture_output=True, text=True, check=False)

    def run_page(self, page, folder):
        """Runs the page's Python as one program in a folder; again where a busy computer left a stream silent."""
        folder.mkdir(exist_ok=True)
        program = folder / "page.py"
        program.write_text("\n".join(blocks(page, "python")))
        done = subprocess.run(
            [sys.executable, "-B", str(program)],
            cwd=folder,
            capture_output=True,
            text=True,
            timeout=3 * PATIENCE,
            check=False,
        )
        self.assertEqual(done.returncode, 0, f"{page}\n{done.stdout}{done.stderr}")
        return done.stdout

    def test_each_page_is_run_by_a_test(self):
        for page, test in [*ELSEWHERE.items(), *OTHER_YAML.items()]:
            self.assertTrue((ROOT / test).exists() and page in PAGES, f"{page}: {test}")
        runs = {name.removeprefix("test_page_") for name in dir(self) if name.startswith("test_page_")}
        pages = {pathlib.Path(page).stem.lower() for page in with_blocks("python") if page not in ELSEWHERE}
        self.assertEqual(runs, pages)

    def test_page_readme(self):
        said = self.run_page("README.md", FOLDER / "readme")
        self.assertRegex(said, r"at \[.*\]\none_arm: \d+ cycles")
        self.assertLessEqual(len(PAGES["README.md"].splitlines()), 90)

    @unittest.skipIf(importlib.util.find_spec("OpenGL") is None, "PyOpenGL is not installed")
    def test_page_cameras(self):
        said = self.run_page("docs/cameras.md", FOLDER / "cameras_page")
        self.assertTrue(said.startswith("(240, 320, 3) "), said)
        (pictures,) = (FOLDER / "cameras_page").glob("runs/*/pictures.mcap")
        self.assertGreater(pictures.stat().st_size, 1000)

    def test_page_python_laws(self):
        if not importlib.util.find_spec("numba"):
            self.skipTest("Numba is not installed")
        self.run_page("docs/python_laws.md", FOLDER / "laws")

    def test_page_studies(self):
        folder = FOLDER / "studies"
        folder.mkdir()
        shutil.copy(ROOT / "examples/studies/stiffness.yaml", folder)
        self.assertIn("report.html", self.run_page("docs/studies.md", folder))

    def test_page_logs(self):
        if not importlib.util.find_spec("mcap_ros2"):
            self.skipTest("mcap-ros2-support is not installed")
        import multipanda as mp

        log = mp.play("two_arms", seconds=0.5, record=FOLDER / "logged").log
        self.assertEqual(len(self.run_page("docs/logs.md", log.parent).splitlines()), 500)

    def test_page_virtual_arm(self):
        if not importlib.util.find_spec("pylibfranka"):
            self.skipTest("pylibfranka is not installed")
        if free(("127.0.0.1", 1337)):
            words = blocks("docs/virtual_arm.md", "sh")[0].splitlines()[0].partition("#")[0].split()[1:]
            with subprocess.Popen(
                [os.environ["MULTIPANDA_PROGRAM"], *words], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
            ) as arm:
                try:
                    while "1337" not in (line := arm.stdout.readline()):
                        self.assertTrue(line, "the virtual arm did not start")
                    first = blocks("docs/virtual_arm.md", "python")[0]
                    done = subprocess.run(
                        [sys.executable, "-c", first], capture_output=True, text=True, timeout=PATIENCE, check=False
                    )
                    self.assertRegex(done.stdout, r"^\[.*\]$", done.stderr)
                finally:
                    arm.terminate()
                return
        self.skipTest("another program listens at 127.0.0.1")

    def test_cpp_compiles(self):
        source = FOLDER / "page.cpp"
        source.write_text(blocks("docs/writing_a_controllet.md", "cpp")[0])
        build = pathlib.Path(os.environ["MULTIPANDA_PROGRAM"]).parent
        done = subprocess.run(
            [COMPILER, "-std=c++20", "-fsyntax-only", f"-I{ROOT}", f"-isystem{build / 'eigen'}", str(source)],
            capture_output=True,
            text=True,
            check=False,
        )
        self.assertEqual(done.returncode, 0, done.stderr)

    def test_yaml_is_accepted(self):
        for page in sorted(set(with_blocks("yaml")) - set(OTHER_YAML)):
            for text in blocks(page, "yaml"):
                scene, given = yaml.safe_load(SCENE), yaml.safe_load(text)
                if given.keys() <= {"features", "parameters"}:
                    scene["controllets"][0] |= given
                elif "arms" in given and "controllets" not in given:
                    scene = {"name": "page", **given}
                else:
                    scene |= given
                file = FOLDER / "page.yaml"
                file.write_text(yaml.safe_dump(scene))
                done = self.ask("check", str(file))
                self.assertEqual(done.returncode, 0, f"{page}\n{text}\n{done.stdout}{done.stderr}")

    def test_commands_have_their_options(self):
        script = subprocess.run([ROOT / "multipanda", "--help"], capture_output=True, text=True, check=True).stdout
        found = [(page, line) for page, line in commands() if line]
        self.assertGreater(len(found), 80)

        def fault(entry):
            page, line = entry
            words = line.replace("[", " ").replace("]", " ").split()
            if words[0] in SCRIPT:
                known = script
            else:
                done = self.ask(*itertools.takewhile(lambda word: not word.startswith("-"), words), "--help")
                if done.returncode != 0:
                    return f"{page}: {line}: there is no such command"
                known = done.stdout
            options = [word.partition("=")[0] for word in words if word.startswith("--")]
            missing = [option for option in options if not re.search(rf"{option}\b(?!-)", known)]
            return f"{page}: {line}: no option {missing}" if missing else None

        with concurrent.futures.ThreadPoolExecutor(4) as pool:
            self.assertEqual([text for text in pool.map(fault, found) if text], [])


if __name__ == "__main__":
    COMPILER = sys.argv.pop(2)
    harness.main()
