"""Studies: a scene or an experiment, run with every combination of choices and every seed."""

from __future__ import annotations

import collections
import csv
import json
import os
import pathlib
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from .errors import Error, Refused
from .program import call, last_lines
from .study_engine import Engine, is_broken, make_engine
from .study_plan import Plan, StudyRun
from .study_store import Store, check_result, result_path, write_result
from .study_worker import _Program

Json = dict[str, Any]
Path = str | os.PathLike[str]
_BATCH_S = 2.0  # intended duration of a batch [s]
_LARGEST_BATCH = 64
_ATTEMPTS = 3  # attempts for a run whose worker is lost


@dataclass(frozen=True)
class StudyResult:
    """The results of a study.

    Attributes:
        folder: Where everything is.
        rows: A dictionary per run: its choices, its seed, `success`, and its figures (docs/studies.md).
        files: The result file of each row, with all that the run has returned (JSON).
        errors: Runs without a result: their choices and seed, and why.
        skipped: How many runs were done before.
        table: The rows as CSV, without figures that are lists.
        page: The HTML page; None if it was not made.
        beyond_s: Time of a worker beyond the runs themselves, per run that was made now [s].
    """

    folder: pathlib.Path
    rows: list[Json]
    files: list[pathlib.Path]
    errors: list[Json]
    skipped: int
    table: pathlib.Path
    page: pathlib.Path | None
    beyond_s: float

    @property
    def success(self) -> bool:
        """Whether every run has a result."""
        return not self.errors

    def _repr_html_(self) -> str:
        return self.page.read_text(encoding="utf-8") if self.page else f"<p>{self.folder}</p>"


def _seconds(value: float) -> str:
    if value < 100:
        return f"{value:.0f} s"
    return f"{value / 60:.0f} min" if value < 6000 else f"{value / 3600:.1f} h"


class _Study:
    """The progress of one study while it runs."""

    def __init__(self, plan: Plan, store: Store, engine: Engine, batch: int | None, say: Callable[[str], None]) -> None:
        self.plan, self.store, self.engine, self.batch, self.say = plan, store, engine, batch, say
        probe = _Program()
        self.program, _ = probe.identity
        probe.end()
        self.runs = list(plan.runs(self.program))
        self.waiting: collections.deque[StudyRun] = collections.deque()
        self.in_flight: dict[Any, tuple[list[StudyRun], int]] = {}  # runs, and the executor's generation
        self.lost: collections.Counter[str] = collections.Counter()
        self.errors: dict[str, str] = {}
        self.busy_s = 0.0  # time spent in runs, by the workers' clocks
        self.made = 0
        self.begun = self.said = time.monotonic()

    def look(self) -> int:
        """Finds the results that exist already; returns how many."""
        self.waiting.extend(run for run in self.runs if self.store.load(run, self.program) is None)
        return len(self.runs) - len(self.waiting)

    def _batch_size(self) -> int:
        if self.store.machine is None:
            return 1  # the first run is executed alone, because its result sets the reference machine
        if self.batch:
            return self.batch
        if self.engine.share:
            return max(1, -(-len(self.runs) // self.engine.share))
        per_run = self.busy_s / self.made if self.made else _BATCH_S
        fair = -(-len(self.waiting) // (2 * self.engine.slots))
        return max(1, min(_LARGEST_BATCH, fair, round(_BATCH_S / max(per_run, 1e-3))))

    def _give(self) -> None:
        single = self.store.machine is None
        while self.waiting and len(self.in_flight) < (1 if single else self.engine.slots):
            # A run whose worker was lost runs alone, so that it cannot abort others.
            count = 1 if self.lost[self.waiting[0].key] else self._batch_size()
            batch = [self.waiting.popleft() for _ in range(min(count, len(self.waiting)))]
            self._submit(batch)

    def _submit(self, batch: list[StudyRun]) -> None:
        task = {
            "folder": str(self.store.folder),
            "token": self.store.token,
            "program": self.program,
            "machine": self.store.machine,
            "any_machine": self.store.any_machine,
            "files": self.plan.files,
            "runs": [{"key": run.key, "row": run.row, "inputs": run.inputs, "job": run.job} for run in batch],
        }
        try:
            future = self.engine.submit(task)
        except Exception as why:
            if not is_broken(why):
                raise
            self.engine.broken(why, self.engine.generation)
            future = self.engine.submit(task)
        self.in_flight[future] = (batch, self.engine.generation)

    def _lose(self, batch: list[StudyRun], generation: int, why: BaseException) -> None:
        """After a batch whose worker was lost: its stored results count, the rest is assigned again."""
        if is_broken(why):
            self.engine.broken(why, generation)
        for run in reversed(batch):
            if self.store.load(run, self.program) is not None:
                self.made += 1
                continue
            self.lost[run.key] += 1
            if self.lost[run.key] < _ATTEMPTS:
                self.waiting.appendleft(run)
            elif self.store.machine is None:  # no run has succeeded yet: the others would fail in the same way
                raise Error(f"no worker finishes the study's first run: {why}", "see its messages") from why
            else:
                self.errors[run.key] = f"its worker was lost {_ATTEMPTS} times: {why}"

    def _take(self, batch: list[StudyRun], answer: Json) -> None:
        runs = {run.key: run for run in batch}
        self.store.take_machine(answer["machine"], f"a result of {answer['host']}")
        for result in answer["results"]:
            check_result(result, runs[result["key"]], self.program, f"a result of {answer['host']}")
            write_result(self.store.folder, result)
        self.errors.update(answer["errors"])
        self.busy_s += answer["busy_s"]
        self.made += len(batch)

    def _progress(self) -> None:
        now = time.monotonic()
        if now - self.said < 1 and self.waiting:
            return
        self.said = now
        left = len(self.waiting) + sum(len(batch) for batch, _ in self.in_flight.values())
        rate = self.made / max(now - self.begun, 1e-3)
        text = f"{len(self.runs) - left} of {len(self.runs)} runs"
        if self.errors:
            text += f", {len(self.errors)} without a result"
        if self.made and left:
            text += f", {rate:.3g} a second, {_seconds(left / rate)} left"
        self.say(text)

    def run(self) -> None:
        while self.waiting or self.in_flight:
            self._give()
            self.engine.wait(list(self.in_flight))
            for future in [future for future in self.in_flight if future.done()]:
                batch, generation = self.in_flight.pop(future)
                try:
                    answer = future.result()
                except Refused:
                    raise
                except Exception as why:  # engines raise different errors for a lost worker
                    self._lose(batch, generation, why)
                else:
                    self._take(batch, answer)
            self._progress()


def _write_table(path: pathlib.Path, plan: Plan, rows: list[Json]) -> None:
    first = [axis["name"] for axis in plan.axes] + ["seed", "success"]
    names = dict.fromkeys(name for row in rows for name, value in row.items() if not isinstance(value, list))
    columns = first + [name for name in names if name not in first]
    part = path.with_suffix(".part")
    with open(part, "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns, extrasaction="ignore", restval="")
        writer.writeheader()
        writer.writerows(rows)
    part.replace(path)


def study(
    file: Path,
    executor: Any = "local",
    *,
    out: Path | None = None,
    workers: int | None = None,
    batch: int | None = None,
    any_machine: bool = False,
    page: bool = True,
    progress: Callable[[str], None] = lambda text: None,
) -> StudyResult:
    """Runs or resumes a study and returns its results. Finished runs are not repeated.

    Args:
        file: The study file (docs/studies.md).
        executor: `local`, `dask:ADDRESS`, `slurm`, any executor of `concurrent.futures`, or a function that makes one,
            so that a process pool that a killed worker has broken is replaced.
        out: Folder of the results; `runs/study_NAME` by default.
        workers: Runs at once; one per core by default.
        batch: Runs per batch; as many as take 2 s by default.
        any_machine: Accepts results of different processors and libraries, which differ in the last bits.
        page: Whether to make the HTML page, which needs matplotlib.
        progress: Called about once a second with a line about the progress and the time left.

    Raises:
        Refused: The file is not accepted, a stored result was changed or belongs to something else, a worker has
            another program, machine or file, or the folder is in use.
        Error: The executor has failed; what is done is kept.
    """
    plan = Plan.of(file)
    folder = pathlib.Path(out) if out else pathlib.Path("runs") / f"study_{pathlib.Path(file).stem}"
    folder = folder.absolute()
    store = Store(folder, any_machine)
    try:
        engine = make_engine(executor, workers, folder)
        try:
            going = _Study(plan, store, engine, batch, progress)
            skipped = going.look()
            if skipped:
                progress(f"{skipped} of {len(going.runs)} runs were done before")
            begin = time.monotonic()
            going.run()
        except BaseException:
            engine.close(now=True)
            raise
        engine.close(now=False)
        elapsed_s = time.monotonic() - begin
        return _finish(going, skipped, elapsed_s, page)
    finally:
        store.close()


def _finish(going: _Study, skipped: int, elapsed_s: float, page: bool) -> StudyResult:
    plan, store, folder = going.plan, going.store, going.store.folder
    rows, files, errors, faults = [], [], [], []
    for run in going.runs:
        result = store.load(run, going.program)
        if result is None:
            errors.append({**run.row, "error": going.errors.get(run.key, "no result")})
            continue
        rows.append({**run.row, "success": result["success"], **result["figures"]})
        files.append(result_path(folder, run.key))
        faults += [{**run.row, "fault": fault} for fault in result["faults"]]
    table = folder / "table.csv"
    _write_table(table, plan, rows)
    lanes = going.engine.slots / 2 if going.engine.share is None else going.engine.slots
    beyond_s = max(0.0, elapsed_s * lanes - going.busy_s) / going.made if going.made else 0.0
    summary = {
        "title": plan.title,
        "kind": plan.kind,
        "file": plan.plan["path"],
        "axes": [{"name": a["name"], "choices": [[c["name"], c["label"]] for c in a["choices"]]} for a in plan.axes],
        "runs": len(going.runs),
        "skipped": skipped,
        "made": going.made,
        "elapsed_s": elapsed_s,
        "beyond_s": beyond_s,
        "errors": errors,
        "faults": faults,
        "program": going.program,
        "machine": store.machine,
        "any_machine": store.any_machine,
    }
    (folder / "study.json").write_text(json.dumps(summary, indent=1))
    made = None
    if page:
        code, _, err = call(["study", "--page", folder])
        if code != 0:
            raise Error(f"the results are complete, but not the page: {last_lines(err)}", f"see {table}")
        made = folder / "report.html"
    return StudyResult(folder, rows, files, errors, skipped, table, made, beyond_s)
