"""What the trials of studies on clusters share: their packages, a study that is killed and goes on, its judgment."""

import importlib.util
import json
import os
import pathlib
import shutil
import signal
import subprocess
import sys

import harness  # first: it sets the paths
import multipanda as mp
from harness import ROOT, until

sys.path.insert(0, str(ROOT / "tools"))
import build_site

harness.PATIENCE = 300  # [s]; jobs and workers start slowly on a busy computer


def with_packages(script):
    """Starts the script again in build/clusters-env unless its packages are here; exit code 77 if there are none."""
    if importlib.util.find_spec("distributed") and importlib.util.find_spec("submitit"):
        return
    folder = pathlib.Path(os.environ.get("MULTIPANDA_CLUSTERS_ENV", ROOT / "build" / "clusters-env"))
    try:
        python = build_site.environment(folder, ROOT / "requirements-clusters.txt")
    except build_site.SiteError as wrong:
        print(f"skipped: {wrong}")
        sys.exit(77)
    os.execv(python, [python, "-B", script, *sys.argv[1:]])


class Trial:
    """A study in a process of its own.

    Attributes:
        out: Folder of its results.
    """

    def __init__(self, folder, text):
        self.folder, self.out = folder, folder / "out"
        self.file = folder / "study.yaml"
        self.file.write_text(text)

    def start(self, test, executor, *words):
        """The study's process; its messages go to study.log. It ends with the test."""
        log = open(self.folder / "study.log", "a")  # noqa: SIM115
        begin = "import sys; from multipanda.study_command import main; sys.exit(main())"
        words = [sys.executable, "-B", "-c", begin, self.file, "--no-page", "--out", self.out, *words]
        process = subprocess.Popen([*words, "--executor", executor], stdout=log, stderr=log)
        log.close()
        test.addCleanup(process.wait)
        test.addCleanup(process.kill)
        return process

    def results(self):
        return sorted((self.out / "results").rglob("*.json"))

    def wait_for(self, count, process):
        """Until there are so many results while the study goes on."""
        until(lambda: len(self.results()) >= count or process.poll() is not None, f"{count} results in {self.out}")
        if process.poll() is not None:
            raise AssertionError(f"the study has ended too early: {(self.folder / 'study.log').read_text()}")

    def kill_study(self, process):
        """kill -9; {path: time} of what it has left."""
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        return {path: path.stat().st_mtime_ns for path in self.results()}

    def go_on(self, test, executor, left, runs, **options):
        """Lets it go on, and compares everything with `local`, to the bit."""
        found = mp.study(self.file, executor, out=self.out, page=False, **options)
        test.assertEqual((len(found.rows), found.errors), (runs, []))
        test.assertGreaterEqual(found.skipped, len(left))
        test.assertLess(len(left), runs)
        for path, written in left.items():  # nothing is made twice
            test.assertEqual(path.stat().st_mtime_ns, written, path)
        local = mp.study(self.file, out=self.folder / "local", page=False)
        test.assertEqual(found.rows, local.rows)
        for a, b in zip(found.files, local.files, strict=True):
            test.assertEqual(bare(a), bare(b))
        return found


def bare(path):
    """A result without the times that it took."""
    result = json.loads(path.read_text())
    return {name: value for name, value in result.items() if name not in ("seal", "cost")}


def other_program(folder):
    """A program of the same version whose bytes differ."""
    own = pathlib.Path(os.environ["MULTIPANDA_PROGRAM"])
    other = folder / "other" / "multipanda"
    other.parent.mkdir()
    shutil.copy2(own, other)
    with open(other, "ab") as file:
        file.write(b"\n")
    return other


def other_version(folder):
    """What says that it is a program of version 9.9.9."""
    other = folder / "newer"
    other.write_text("#!/bin/sh\necho 9.9.9\n")
    other.chmod(0o755)
    return other


def main():
    harness.main()
