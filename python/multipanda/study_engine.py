"""Where a study's batches run: threads here, Dask, Slurm, or any executor of `concurrent.futures`."""

from __future__ import annotations

import concurrent.futures
import getpass
import importlib
import os
import pathlib
import shutil
import subprocess
import time
from collections.abc import Callable
from typing import Any

from . import study_worker
from .errors import Error, Refused
from .program import last_lines
from .study_plan import sha256
from .study_worker import work

Json = dict[str, Any]
Factory = Callable[[], concurrent.futures.Executor]


class Engine:
    """An executor, and how many batches it is given at once.

    Attributes:
        slots: Batches at a time.
        generation: How often the executor was replaced.
        share: Number of batches into which all runs are divided; None: batches of about 2 s.
    """

    slots: int
    share: int | None = None
    generation: int = 0

    def __init__(self, executor: concurrent.futures.Executor, slots: int, remake: Factory | None = None) -> None:
        self._executor, self.slots, self._remake = executor, slots, remake

    def submit(self, task: Json) -> Any:
        """A future of the batch's answer."""
        return self._executor.submit(work, task)

    def wait(self, futures: list[Any]) -> None:
        """Returns when one of them is done, or soon."""
        concurrent.futures.wait(futures, timeout=0.5, return_when=concurrent.futures.FIRST_COMPLETED)

    def broken(self, why: BaseException, generation: int) -> None:
        """After an executor has failed as a whole: makes a new one unless that has happened, or raises Error."""
        if generation != self.generation:
            return
        if self._remake is None:
            raise Error(
                f"the executor no longer accepts runs: {why}",
                "finished runs are kept: start the study again; or pass a function that makes an executor",
            ) from why
        self._executor.shutdown(wait=False, cancel_futures=True)
        self._executor = self._remake()
        self.generation += 1

    def close(self, now: bool) -> None:
        """Ends what this has started; `now`: without waiting for runs."""


class _Local(Engine):
    """A thread per core, each with a process of the program: a thread costs nothing, and a killed process one run."""

    def __init__(self, workers: int | None) -> None:
        workers = workers or len(os.sched_getaffinity(0))
        self._pool = concurrent.futures.ThreadPoolExecutor(workers)
        super().__init__(self._pool, 2 * workers)

    def close(self, now: bool) -> None:
        self._pool.shutdown(wait=not now, cancel_futures=True)
        study_worker.end_programs()
        self._pool.shutdown(wait=True)
        study_worker.close_programs()


class _Dask(Engine):
    def __init__(self, address: str, workers: int | None) -> None:
        try:
            distributed: Any = importlib.import_module("distributed")  # typed in part only
        except ImportError:
            raise Refused(
                "no_dask", "the Python package distributed is missing", "pip install 'multipanda[dask]'"
            ) from None
        try:
            self._client = distributed.Client(address, timeout=20)
        except (OSError, ValueError) as wrong:
            raise Refused(
                "no_dask", f"there is no Dask scheduler at {address}: {wrong}", "start one: dask scheduler"
            ) from None
        threads = sum(self._client.nthreads().values())
        super().__init__(self._client.get_executor(pure=False), 2 * (workers or max(threads, 1)))

    def close(self, now: bool) -> None:
        self._client.close()


class _Slurm(Engine):
    """Jobs through submitit, which pickles the call and starts Python in the job. One job does many runs."""

    def __init__(self, options: str, workers: int | None, folder: pathlib.Path) -> None:
        try:
            import submitit
        except ImportError:
            raise Refused(
                "no_submitit", "the Python package submitit is missing", "pip install 'multipanda[slurm]'"
            ) from None
        for tool in ("sbatch", "srun", "squeue", "scancel"):
            if not shutil.which(tool):
                raise Refused("no_slurm", f"Slurm's command {tool} is missing here", "start the study on a login node")
        self.slots = workers or 4
        self.share = 4 * self.slots
        parameters: Json = {"cpus_per_task": 1, "timeout_min": 24 * 60}
        for part in options.split(",") if options else []:
            name, sign, value = part.partition("=")
            if not (name and sign and value):
                raise Refused("bad_option", f"slurm: '{part}' is not a valid option", "slurm:partition=short,mem=2G")
            parameters["slurm_" + name] = int(value) if value.isdigit() else value
        # Jobs that a killed study has left in the queue would do the same runs as ours.
        self._name = "multipanda-" + sha256(os.fsencode(os.path.realpath(folder)))[:12]
        subprocess.run(["scancel", f"--user={getpass.getuser()}", f"--name={self._name}"], check=False)
        self._jobs = submitit.AutoExecutor(folder=folder / "slurm", cluster="slurm")
        try:
            self._jobs.update_parameters(**{"name": self._name, **parameters})
        except Exception as wrong:  # submitit raises NameError and others
            raise Refused("bad_option", f"slurm: {wrong}", "slurm:partition=short,mem=2G") from None
        self._alive_at = time.monotonic()

    def submit(self, task: Json) -> Any:
        try:
            return _Job(self._jobs.submit(work, task))
        except Exception as wrong:  # submitit's error contains the messages of sbatch
            said = last_lines(str(wrong), 2)
            raise Error(f"Slurm does not accept a job: {said}", "correct the options of --executor slurm:...") from None

    def wait(self, futures: list[Any]) -> None:
        time.sleep(0.5)
        if time.monotonic() - self._alive_at < 5:
            return
        # submitit asks Slurm's accounting, which small clusters do not have; the queue also shows which jobs have died.
        answer = subprocess.run(["squeue", "--noheader", "--format=%i"], capture_output=True, text=True, check=False)
        self._alive_at = time.monotonic()
        if answer.returncode == 0:
            queued = set(answer.stdout.split())
            for job in futures:
                job.missing = job.missing + 1 if job.number not in queued else 0

    def close(self, now: bool) -> None:
        if now:
            subprocess.run(["scancel", f"--user={getpass.getuser()}", f"--name={self._name}"], check=False)


class _Job:
    """A job of submitit as a future; one that has left the queue without a result has died."""

    def __init__(self, job: Any) -> None:
        self._job, self.number, self.missing = job, str(job.job_id), 0

    def _file(self) -> bool:
        return bool(self._job.paths.result_pickle.exists())

    def done(self) -> bool:
        return self._file() or self.missing >= 2

    def result(self) -> Any:
        if not self._file():
            raise Error(f"job {self.number} of Slurm ended without a result", f"see {self._job.paths.stderr}")
        outcome, answer = self._job._get_outcome_and_result()
        if outcome == "error":
            text = str(answer)
            if "Refused" in text:
                raise Refused("refused", text.strip().splitlines()[-1])
            raise Error(f"job {self.number} of Slurm failed: {text.strip().splitlines()[-1]}", "see its messages")
        return answer


def make_engine(executor: Any, workers: int | None, folder: pathlib.Path) -> Engine:
    """From `local`, `dask:ADDRESS`, `slurm[:NAME=VALUE,...]`, an executor, or a function that makes one."""
    study_worker.begin_programs()
    if isinstance(executor, str):
        name, _, rest = executor.partition(":")
        if executor == "local":
            return _Local(workers)
        if name == "dask" and rest:
            return _Dask(rest, workers)
        if name == "slurm":
            return _Slurm(rest, workers, folder)
        raise Refused("unknown_executor", f"there is no executor '{executor}'", "local, dask:ADDRESS or slurm")
    remake: Factory | None = None
    if not hasattr(executor, "submit"):
        remake = executor
        executor = executor()
    slots = workers or getattr(executor, "_max_workers", None) or len(os.sched_getaffinity(0))
    return Engine(executor, 2 * slots, remake)


def is_broken(why: BaseException) -> bool:
    """Whether the executor is lost, not only a batch."""
    return isinstance(why, concurrent.futures.BrokenExecutor)
