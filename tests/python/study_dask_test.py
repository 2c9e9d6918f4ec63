#!/usr/bin/env python3
"""Studies on Dask: a scheduler and two worker processes on this computer. Exit code 77 without the packages.

    study_dask_test.py PROGRAM

What it needs is in requirements-clusters.txt; the first call makes an environment of it, build/clusters-env.
"""

import json
import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import unittest

import clusters  # first: it sets the paths
import multipanda as mp
from harness import FOLDER, until

STUDY = "{scene: one_arm, seconds: 0.1, set: {plant.fidelity: realistic}, seeds: {count: %d}}"


class Dask(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp(dir=FOLDER))
        self.started = 0
        file = self.folder / "scheduler.json"
        self.start("scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", file)
        until(file.exists, "Dask's scheduler")
        self.address = json.loads(file.read_text())["address"]

    def start(self, *words, **environment):
        log = open(self.folder / f"dask{self.started}.log", "w")  # noqa: SIM115
        self.addCleanup(log.close)
        self.started += 1
        words = [sys.executable, "-m", "distributed.cli.dask_" + words[0], *words[1:]]
        environment = {**os.environ, **environment}
        process = subprocess.Popen(words, stdout=log, stderr=log, cwd=self.folder, env=environment)
        self.addCleanup(process.wait)
        self.addCleanup(process.kill)
        return process, pathlib.Path(log.name)

    def worker(self, **environment):
        words = ["worker", self.address, "--host", "127.0.0.1", "--nthreads", "1", "--no-dashboard", "--no-nanny"]
        process, log = self.start(*words, **environment)
        until(lambda: "Registered to" in log.read_text(), "a worker of Dask")
        return process

    def test_a_killed_worker_and_then_the_killed_study_lose_nothing(self):
        runs = 240
        trial = clusters.Trial(self.folder, STUDY % runs)
        first, _second = self.worker(), self.worker()
        executor = f"dask:{self.address}"
        study = trial.start(self, executor, "--batch", "4")
        trial.wait_for(10, study)
        os.kill(first.pid, signal.SIGKILL)
        first.wait()
        trial.wait_for(len(trial.results()) + 20, study)  # it goes on with the other one
        trial.kill_study(study)
        self.worker()
        until(self.is_quiet(trial), "workers that have finished what the killed study gave them")
        left = {path: path.stat().st_mtime_ns for path in trial.results()}
        found = trial.go_on(self, executor, left, runs)
        print(json.dumps({"runs": runs, "left": len(left), "beyond_ms": round(1e3 * found.beyond_s, 1)}), flush=True)

    def is_quiet(self, trial):
        seen = {}

        def quiet():
            now = tuple(trial.results())
            seen[now] = seen.get(now, 0) + 1
            return seen[now] > 100  # for a second

        return quiet

    def test_a_worker_with_another_program_or_version_is_refused(self):
        trial = clusters.Trial(self.folder, STUDY % 3)
        other = self.worker(MULTIPANDA_PROGRAM=str(clusters.other_program(self.folder)))
        with self.assertRaises(mp.Refused) as caught:
            mp.study(trial.file, f"dask:{self.address}", out=trial.out, page=False)
        self.assertEqual(caught.exception.verdict, "other_program")
        self.assertIn("sha256", str(caught.exception))
        other.kill()
        other.wait()
        self.worker(MULTIPANDA_PROGRAM=str(clusters.other_version(self.folder)))
        with self.assertRaises(mp.Error) as failed:
            mp.study(trial.file, f"dask:{self.address}", out=trial.out, page=False)
        self.assertIn("9.9.9", str(failed.exception))
        self.assertEqual(trial.results(), [])


if __name__ == "__main__":
    clusters.with_packages(__file__)
    clusters.main()
