#!/usr/bin/env python3
"""A study on Slurm: one node on this computer, of which a job is killed in the middle. Exit code 77 without Slurm.

    study_slurm_test.py PROGRAM

It needs root, submitit (pip install submitit), and on Debian: apt-get install --no-install-recommends slurmd slurmctld
slurm-client munge. Everything that it starts listens on 127.0.0.1 and ends with it.
"""

import contextlib
import importlib.util
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

import harness  # first: it sets the paths
import multipanda as mp
from harness import ROOT, until

STUDY = "{scene: one_arm, seconds: 0.1, set: {plant.fidelity: realistic}, seeds: {count: 60}}"
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


def missing():
    """What this computer lacks, in words; empty: nothing."""
    words = [name for name in ("slurmctld", "slurmd", "munged", "sbatch") if not program(name)]
    words += [] if importlib.util.find_spec("submitit") else ["submitit"]
    return ", ".join(words + ([] if os.getuid() == 0 else ["root"]))


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
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="mp-slurm-", dir="/tmp"))
        self.addCleanup(shutil.rmtree, self.folder, ignore_errors=True)
        for name in ("state", "spool"):
            (self.folder / name).mkdir()
        host = socket.gethostname().split(".")[0]
        text = CONFIGURATION.format(folder=self.folder, host=host, ports=free_ports(2))
        (self.folder / "slurm.conf").write_text(text)
        (self.folder / "munge.key").write_bytes(os.urandom(1024))
        (self.folder / "munge.key").chmod(0o400)
        os.environ["SLURM_CONF"] = str(self.folder / "slurm.conf")
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

    def test_a_study_of_which_a_job_is_killed(self):
        file = self.folder / "study.yaml"
        file.write_text(STUDY)
        out = self.folder / "out"
        killed = []

        def kill_one(_text):
            queue = subprocess.run(["squeue", "-h", "-t", "R", "-o", "%i"], capture_output=True, text=True, check=False)
            for job in [] if killed or not list((out / "results").rglob("*.json")) else queue.stdout.split():
                for process in processes_of(job):
                    os.kill(process, signal.SIGKILL)
                    killed.append(process)
                if killed:
                    return

        begin = time.monotonic()
        found = mp.study(file, "slurm:partition=short", out=out, workers=2, page=False, progress=kill_one)
        whole_s = time.monotonic() - begin
        jobs = len(list((out / "slurm").glob("*_submitted.pkl")))
        self.assertEqual((len(found.rows), found.errors), (60, []))
        self.assertGreaterEqual(len(killed), 1)
        local = mp.study(file, out=self.folder / "local", page=False)
        self.assertEqual(found.rows, local.rows)
        print(json.dumps({"runs": 60, "seconds": round(whole_s, 1), "jobs": jobs, "killed": len(killed)}), flush=True)


if __name__ == "__main__":
    if missing():
        print(f"skipped: no {missing()}")
        sys.exit(77)
    os.chdir(ROOT)
    harness.main()
