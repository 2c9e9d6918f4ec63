#!/usr/bin/env python3
"""Studies on Slurm: a job is killed, then the study; jobs with another program. Exit code 77 without Slurm.

    study_slurm_test.py PROGRAM

It uses the Slurm that runs here (its default partition), or starts one node on this computer, which needs root, and on
Debian: apt-get install --no-install-recommends slurmd slurmctld slurm-client munge. Everything that it starts listens
on 127.0.0.1 and ends with it. Python packages: requirements-clusters.txt; the first call makes an environment of it.
"""

import contextlib
import json
import os
import pathlib
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
import unittest
import unittest.mock

import clusters  # first: it sets the paths
import multipanda as mp
from harness import ROOT, until

RUNS = 60
STUDY = "{scene: one_arm, seconds: 0.1, set: {plant.fidelity: realistic}, seeds: {count: %d}}"
CONFIGURATION = """ClusterName=one
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
CommunicationParameters=NoCtldInAddrAny,NoInAddrAny
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
MpiDefault=none
SchedulerType=sched/builtin
SchedulerParameters=sched_interval=1,batch_sched_delay=0
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
AccountingStorageType=accounting_storage/none
JobAcctGatherType=jobacct_gather/none
ReturnToService=2
SlurmdParameters=config_overrides
NodeName={host} NodeAddr=127.0.0.1 CPUs=2 State=UNKNOWN
PartitionName=short Nodes=ALL Default=YES MaxTime=INFINITE State=UP
"""


def runs_here():
    """Whether a Slurm answers on this computer."""
    if not program("sinfo"):
        return False
    return subprocess.run(["sinfo"], capture_output=True, timeout=60, check=False).returncode == 0


def missing():
    """What this computer lacks, in words; empty: nothing."""
    tools = ["sbatch", "srun", "squeue", "scancel"]
    if not runs_here():
        tools += ["slurmctld", "slurmd", "munged"]
    words = [name for name in tools if not program(name)]
    return ", ".join(words + ([] if runs_here() or os.getuid() == 0 else ["root"]))


def program(name):
    return shutil.which(name, path=os.environ["PATH"] + ":/usr/sbin")


def free_ports(count):
    with contextlib.ExitStack() as stack:
        sockets = [stack.enter_context(socket.socket()) for _ in range(count)]
        for one in sockets:
            one.bind(("127.0.0.1", 0))
        return [one.getsockname()[1] for one in sockets]


def processes_of(job):
    """Processes of Python in a job, by the job's environment."""
    for folder in pathlib.Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            if f"SLURM_JOB_ID={job}\0".encode() not in (folder / "environ").read_bytes():
                continue
            if b"submitit" in (folder / "cmdline").read_bytes() and b"python" in (folder / "cmdline").read_bytes():
                yield int(folder.name)


class Slurm(unittest.TestCase):
    def setUp(self):
        running = runs_here()  # then other computers see this folder, as they see the program
        place = pathlib.Path(os.environ["MULTIPANDA_PROGRAM"]).parent if running else "/tmp"
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="mp-slurm-", dir=place))
        self.addCleanup(shutil.rmtree, self.folder, ignore_errors=True)
        if running:
            return
        for name in ("state", "spool"):
            (self.folder / name).mkdir()
        host = socket.gethostname().split(".")[0]
        text = CONFIGURATION.format(folder=self.folder, host=host, ports=free_ports(2))
        (self.folder / "slurm.conf").write_text(text)
        (self.folder / "munge.key").write_bytes(os.urandom(1024))
        (self.folder / "munge.key").chmod(0o400)
        os.environ["SLURM_CONF"] = str(self.folder / "slurm.conf")
        self.addCleanup(os.environ.pop, "SLURM_CONF")
        files = [f"--socket={self.folder}/munge.socket", f"--key-file={self.folder}/munge.key"]
        files += [f"--{name}-file={self.folder}/munge.{name}" for name in ("log", "pid", "seed")]
        self.start("munged", "--foreground", "--force", *files)
        until((self.folder / "munge.socket").exists, "munge's socket")
        self.start("slurmctld", "-D", "-c")
        self.start("slurmd", "-D")
        until(self.node_is_idle, f"a node that is idle, see {self.folder}")

    def start(self, name, *words):
        log = open(self.folder / f"{name}.out", "w")  # noqa: SIM115
        self.addCleanup(log.close)
        process = subprocess.Popen([program(name), *words], stdout=log, stderr=log)
        self.addCleanup(process.wait)
        self.addCleanup(process.terminate)

    def node_is_idle(self):
        time.sleep(0.2)
        return "idle" in subprocess.run(["sinfo", "--noheader"], capture_output=True, text=True, check=False).stdout

    def queue(self, state):  # squeue also knows jobs that have ended a while ago
        words = ["squeue", "-h", "-t", state, "-o", "%i"]
        return subprocess.run(words, capture_output=True, text=True, check=True).stdout.split()

    def kill_a_job(self):
        """kill -9 of the worker of one running job; the job's number, or None."""
        for job in self.queue("R"):
            found = list(processes_of(job))
            for process in found:
                os.kill(process, signal.SIGKILL)
            if not found:  # it runs on another computer
                subprocess.run(["scancel", "--signal=KILL", "--full", job], check=True)
            return job
        return None

    def test_a_killed_job_and_then_the_killed_study_lose_nothing(self):
        trial = clusters.Trial(self.folder, STUDY % RUNS)
        begin = time.monotonic()
        study = trial.start(self, "slurm", "--workers", "2")
        trial.wait_for(4, study)
        until(self.kill_a_job, "a running job")
        trial.wait_for(len(trial.results()) + 8, study)  # the others go on
        left = trial.kill_study(study)
        self.assertTrue(self.queue("PD,R"))  # its jobs are still there
        found = trial.go_on(self, "slurm", left, RUNS, workers=2)
        whole_s = time.monotonic() - begin
        jobs = len(list((trial.out / "slurm").glob("*_submitted.pkl")))
        until(lambda: not self.queue("PD,R,CG"), "an empty queue")
        said = {"runs": RUNS, "left": len(left), "skipped": found.skipped, "seconds": round(whole_s, 1), "jobs": jobs}
        print(json.dumps(said), flush=True)

    def test_a_job_with_another_program_is_refused(self):
        trial = clusters.Trial(self.folder, STUDY % 3)
        other = clusters.other_program(self.folder)
        (self.folder / "sitecustomize.py").write_text(
            f"import os\nif 'SLURM_JOB_ID' in os.environ: os.environ['MULTIPANDA_PROGRAM'] = {str(other)!r}\n"
        )
        with unittest.mock.patch.dict(os.environ, PYTHONPATH=f"{self.folder}:{os.environ['PYTHONPATH']}"):
            with self.assertRaises(mp.Refused) as caught:
                mp.study(trial.file, "slurm", out=trial.out, page=False)
        self.assertIn("another program", str(caught.exception))
        self.assertEqual(trial.results(), [])

    def test_options_that_slurm_does_not_know_are_refused(self):
        trial = clusters.Trial(self.folder, STUDY % 3)
        for options, words in (("slurm:short", "not a valid option"), ("slurm:nonsense=1", "nonsense")):
            with self.assertRaises(mp.Refused) as caught:
                mp.study(trial.file, options, out=trial.out, page=False)
            self.assertIn(words, str(caught.exception))
        with self.assertRaises(mp.Error) as failed:
            mp.study(trial.file, "slurm:partition=nowhere", out=trial.out, page=False)
        self.assertIn("invalid partition", str(failed.exception))


if __name__ == "__main__":
    if missing():
        print(f"skipped: no {missing()}")
        sys.exit(77)
    clusters.with_packages(__file__)
    os.chdir(ROOT)
    clusters.main()
