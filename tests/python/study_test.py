#!/usr/bin/env python3
"""Studies: what they compute, to the bit, how they go on after kill -9, what they refuse, and where they run."""

import concurrent.futures
import csv
import importlib
import json
import os
import pathlib
import pickle
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest

import harness  # first: it sets the paths
import multipanda as mp
from harness import FOLDER, PATIENCE, ROOT, until
from multipanda import study_store, study_worker
from multipanda.study_plan import canonical, sha256

STUDY = """title: Stiffness
scene: one_arm
seconds: 0.1
axes:
  - {{name: stiffness, key: controllets.cartesian.parameters.translational_stiffness_n_per_m, values: [200, 800]}}
  - name: plant
    choices:
      - {{name: ideal, set: {{plant.fidelity: ideal}}}}
      - {{name: realistic, set: {{plant.fidelity: realistic}}}}
vary:
  - {{key: objects.box.mass_kg, by: 0.1}}
seeds: {{first: 3, count: {seeds}}}
"""


def program_words():
    return [os.environ["MULTIPANDA_PROGRAM"], "study"]


def _use(program):
    """Initializer of a pool: its processes use this program."""
    os.environ["MULTIPANDA_PROGRAM"] = program


def bare(result):
    return {name: value for name, value in result.items() if name != "seal"}


class Far(concurrent.futures.ThreadPoolExecutor):
    """Stands for another computer: its workers do not see the folder. `change` acts on results on their way back."""

    def __init__(self, change=lambda result: None):
        super().__init__(1)
        self._change = change

    def submit(self, work, task):
        def there():
            answer = work({**task, "token": "another folder's"})
            for result in answer["results"]:
                self._change(result)
            return answer

        return super().submit(there)


class Studies(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp(dir=FOLDER))
        self.out = self.folder / "out"

    def file(self, text=None, seeds=2):
        path = self.folder / "study.yaml"
        path.write_text(text or STUDY.format(seeds=seeds))
        return path

    def command(self, *words, expect=0):
        done = subprocess.run(
            [*program_words(), *map(str, words)], capture_output=True, text=True, timeout=3 * PATIENCE, check=False
        )
        self.assertEqual(done.returncode, expect, done.stdout + done.stderr)
        return done

    def results(self):
        return sorted((self.out / "results").rglob("*.json"))

    def test_the_command_makes_table_and_page_and_then_has_nothing_to_do(self):
        done = self.command(self.file(), "--out", self.out, "--json")
        answer = json.loads(done.stdout)
        self.assertEqual((answer["success"], answer["runs"], answer["skipped"]), (True, 8, 0))
        self.assertIn("8 of 8 runs", done.stderr)
        with open(answer["table"], newline="") as file:
            rows = list(csv.DictReader(file))
        self.assertEqual(
            {(row["stiffness"], row["plant"], row["seed"]) for row in rows},
            {(k, p, s) for k in ("200", "800") for p in ("ideal", "realistic") for s in ("3", "4")},
        )
        page = pathlib.Path(answer["report"]).read_text()
        for words in ("Stiffness", "8 of 8", "stiffness 200, realistic", "arm/torque_max_nm", "libmujoco"):
            self.assertIn(words, page)
        again = json.loads(self.command(self.file(), "--out", self.out, "--json", "--no-page").stdout)
        self.assertEqual((again["runs"], again["skipped"]), (8, 8))

    def test_a_run_is_that_of_the_program_to_the_bit(self):
        """The figures against the log of `multipanda run` of the same scene, which another part of the program made."""
        text = (ROOT / "config/scenes/one_arm.yaml").read_text()
        (self.folder / "scene.yaml").write_text(text.replace("fidelity: ideal", "fidelity: realistic"))
        log = mp.read_log(mp.play(self.folder / "scene.yaml", record=self.folder, seconds=0.1).log)
        found = mp.study(
            self.file("{scene: scene.yaml, seconds: 0.1, logs: true, seed_list: [1]}"), out=self.out, page=False
        )
        (row,) = found.rows
        self.assertEqual(row["arm/torque_max_nm"], abs(log["arm/tau_cmd"][: row["cycles"]]).max())
        self.assertEqual(row["arm/q_end_rad"], log["arm/q"][row["cycles"] - 1].tolist())
        (kept,) = (self.out / "logs").glob("*.mcap")
        own = mp.read_log(kept)
        for name in ("arm/q", "arm/dq", "arm/tau_cmd", "arm/tau_J"):
            self.assertEqual(own[name].tobytes(), log[name][: len(own[name])].tobytes(), name)

    def test_seeds_reproduce_and_hidden_plants_differ(self):
        text = "{scene: one_arm, seconds: 0.1, seeds: {count: 2}, set: {plant.fidelity: realistic}, hidden: %s}"
        digests = {}
        for name, hidden in (("a", "false"), ("b", "false"), ("c", "true")):
            found = mp.study(self.file(text % hidden), out=self.folder / name, page=False, workers=1 + (name == "b"))
            digests[name] = [row["digest"] for row in found.rows]
        self.assertEqual(digests["a"], digests["b"])
        self.assertEqual(len({*digests["a"], *digests["c"]}), 4)

    def test_killed_with_kill_9_it_goes_on(self):
        """The study is killed in the middle; then it does what is missing, and nothing twice."""
        file = self.file(seeds=20)
        process = subprocess.Popen(
            [*program_words(), str(file), "--out", str(self.out), "--no-page"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        until(lambda: self.results() or process.poll() is not None, "the first result")
        process.kill()
        process.wait()
        before = {path: path.stat().st_mtime_ns for path in self.results()}
        self.assertLess(len(before), 80)
        until(lambda: not self._workers_of(file), "its workers end as well")
        before = {path: path.stat().st_mtime_ns for path in self.results()}
        found = mp.study(file, out=self.out, page=False)
        self.assertEqual((len(found.rows), found.skipped), (80, len(before)))
        for path, time_ns in before.items():
            self.assertEqual(path.stat().st_mtime_ns, time_ns)
        whole = mp.study(file, out=self.folder / "whole", page=False)
        self.assertEqual(found.rows, whole.rows)

    def _workers_of(self, _file):
        """Whether the folder is still in use: its lock is held by the study, and its workers write results."""
        count = len(self.results())
        try:
            study_store.Store(self.out, False).close()
        except mp.Refused:
            return True
        return len(self.results()) != count

    def test_a_killed_worker_costs_one_run(self):
        """A worker process is killed three times in the middle; all runs have their results all the same."""
        killed = []

        def kill_one(_text):
            if len(killed) < 3 and len(study_worker._all) > 0:
                victim = study_worker._all[-1].process
                if victim.poll() is None:
                    os.kill(victim.pid, signal.SIGKILL)
                    killed.append(victim.pid)

        found = mp.study(self.file(seeds=80), out=self.out, page=False, workers=2, batch=10, progress=kill_one)
        self.assertGreaterEqual(len(killed), 1)
        self.assertEqual(len(found.rows), 320)
        self.assertEqual(found.errors, [])

    def test_a_run_that_kills_its_worker_has_no_result_and_the_others_do(self):
        library = self.folder / "deadly.so"
        source = self.folder / "deadly.c"
        source.write_text("#include <stdlib.h>\n__attribute__((constructor)) static void die(void) { abort(); }\n")
        subprocess.run(["cc", "-shared", "-fPIC", "-o", library, source], check=True)
        plan = mp.study_plan.Plan.of(self.file(seeds=1))
        choices = [{"name": "well", "label": "well", "set": []}]
        choices.append({"name": "deadly", "label": "deadly", "set": [["plugins", f"[{library}]"]]})
        plan.axes[:] = [{"name": "library", "choices": choices}]
        original = mp.study_plan.Plan.of
        try:
            mp.study_plan.Plan.of = classmethod(lambda cls, file: plan)
            found = mp.study("deadly.yaml", out=self.out, page=False)
        finally:
            mp.study_plan.Plan.of = original
        self.assertEqual([row["library"] for row in found.rows], ["well"])
        (error,) = found.errors
        self.assertEqual(error["library"], "deadly")
        self.assertIn("died twice", error["error"])
        self.assertIn("signal 6", error["error"])

    def test_changed_and_foreign_results_are_refused(self):
        mp.study(self.file(), out=self.out, page=False)
        path, other = self.results()[:2]
        original = path.read_bytes()

        def refused(text, verdict):
            path.write_bytes(text)
            with self.assertRaises(mp.Refused) as caught:
                mp.study(self.file(), out=self.out, page=False)
            self.assertEqual(caught.exception.verdict, verdict)
            self.assertIn(path.name, str(caught.exception))

        result = json.loads(original)
        result["figures"]["arm/torque_max_nm"] = 0.0
        refused(canonical(result), "tampered")
        refused(original[:-20], "tampered")
        refused(other.read_bytes(), "foreign")  # of another run, under this one's name

        def forged(**changes):
            content = {name: value for name, value in {**result, **changes}.items() if name != "seal"}
            return canonical({**content, "seal": sha256(canonical(content))})

        refused(forged(program={**result["program"], "sha256": "0" * 64}), "foreign")
        machine = {**result["machine"], "processor": "another"}
        refused(forged(machine=machine), "other_machine")
        self.assertEqual(len(mp.study(self.file(), out=self.out, page=False, any_machine=True).rows), 8)
        path.unlink()
        self.assertEqual(mp.study(self.file(), out=self.out, page=False).skipped, 7)
        self.assertEqual(json.loads(path.read_bytes())["figures"], json.loads(original)["figures"])

    def test_workers_with_another_program_or_file_are_refused(self):
        plan = mp.study_plan.Plan.of(self.file(seeds=1))
        study_worker.begin_programs()
        program, _ = study_worker._program().identity
        self.addCleanup(study_worker.close_programs)
        self.addCleanup(study_worker.end_programs)
        task = {"folder": str(self.out), "token": "", "machine": None, "any_machine": False, "runs": []}
        task |= {"program": program, "files": plan.files}
        self.assertEqual(study_worker.work(task)["done"], [])
        for changes, verdict in (
            ({"program": {**program, "sha256": "0" * 64}}, "other_program"),
            ({"machine": {"processor": "another", "libraries": {}}}, "other_machine"),
            ({"files": {next(iter(plan.files)): "0" * 64}}, "other_file"),
        ):
            with self.assertRaises(mp.Refused) as caught:
                study_worker.work({**task, **changes})
            self.assertEqual(caught.exception.verdict, verdict)

    def test_changed_files_and_programs_are_other_runs(self):
        """The key depends on each input, and not on where the files are."""
        shutil.copy(ROOT / "config/scenes/one_arm.yaml", self.folder / "scene.yaml")
        text = "{scene: scene.yaml, seconds: 0.1, seeds: {count: 1}}"
        program = {"version": "1", "sha256": "a"}

        def key(text, program=program):
            return next(iter(mp.study_plan.Plan.of(self.file(text)).runs(program))).key

        first = key(text)
        self.assertEqual(first, key(text))
        for other in (text.replace("0.1", "0.2"), text.replace("{count: 1}", "{first: 2, count: 1}")):
            self.assertNotEqual(first, key(other))
        self.assertNotEqual(first, key(text, {"version": "1", "sha256": "b"}))
        self.assertNotEqual(first, key(text[:-1] + ", set: {plant.fidelity: realistic}}"))
        moved = self.folder
        self.folder = moved / "elsewhere"
        self.folder.mkdir()
        shutil.copy(moved / "scene.yaml", self.folder)
        self.assertEqual(first, key(text))
        with open(self.folder / "scene.yaml", "a") as file:
            file.write("# changed\n")
        self.assertNotEqual(first, key(text))

    def test_invalid_files_are_refused_before_the_first_run(self):
        for text, words in (
            ("{scene: one_arm, experiment: task-1}", "one of the keys"),
            ("{scene: no_scene}", "no scene"),
            ("{scene: one_arm, axes: [{name: a, key: plant.fidelity, values: [ideal, wrong]}]}", "choice 'wrong'"),
            ("{scene: one_arm, set: {controllets.nothing.type: x}}", "does not exist"),
            ("{experiment: task-1, vary: [{key: a, by: 1}]}", "no meaning"),
        ):
            done = self.command(self.file(text), "--out", self.out, expect=2)
            self.assertIn(words, done.stderr)
            self.assertFalse(self.out.exists())
        self.assertIn("no executor", self.command(self.file(), "--out", self.out, "--executor", "x", expect=2).stderr)

    def test_experiments_are_run_with_seeds_and_values(self):
        text = """{experiment: task-1, seeds: {first: 5, count: 1},
                   axes: [{name: k, key: controllets.0.parameters.stiffness_nm_per_rad, values: [300, 600]}]}"""
        found = mp.study(self.file(text), out=self.out, page=False)
        soft, stiff = found.rows
        names = [name for name in soft if name.startswith("plain/ideal/q_")]
        self.assertTrue(names, list(soft))
        for name in names:
            self.assertNotEqual(soft[name], stiff[name], name)

    def test_two_studies_do_not_share_a_folder(self):
        store = study_store.Store(self.out, False)
        self.addCleanup(store.close)
        with self.assertRaises(mp.Refused) as caught:
            mp.study(self.file(), out=self.out, page=False)
        self.assertEqual(caught.exception.verdict, "in_use")

    def test_workers_that_outlive_a_killed_study_do_not_keep_its_folder(self):
        """A pool's processes are forked from the study: they must not inherit its lock."""
        words = (
            "import os, pathlib, signal, sys\n"
            "from multipanda.study_store import Store\n"
            "store = Store(pathlib.Path(sys.argv[1]), False)\n"
            "child = os.fork()\n"
            "if child == 0: signal.pause()\n"
            "print(child, flush=True)\n"
            "os.kill(os.getpid(), signal.SIGKILL)\n"
        )
        process = subprocess.Popen([sys.executable, "-c", words, str(self.out)], stdout=subprocess.PIPE, text=True)
        self.addCleanup(process.stdout.close)
        child = int(process.stdout.readline())
        self.addCleanup(os.kill, child, signal.SIGKILL)
        process.wait()
        os.kill(child, 0)  # it lives
        study_store.Store(self.out, False).close()

    def test_results_of_workers_that_do_not_see_the_folder_come_back_and_are_checked(self):
        near = mp.study(self.file(), out=self.folder / "near", page=False)
        with Far() as far:
            found = mp.study(self.file(), far, out=self.out, page=False, workers=1)
        self.assertEqual(found.rows, near.rows)
        changed = (
            ("tampered", lambda result: result["figures"].update({"arm/torque_max_nm": 0.0})),
            ("tampered", lambda result: result.pop("seal")),
            ("foreign", lambda result: result.update(study_store.sealed({**bare(result), "program": {}}))),
            ("foreign", lambda result: result.update(study_store.sealed({**bare(result), "inputs": {}}))),
        )
        for i, (verdict, change) in enumerate(changed):
            out = self.folder / f"changed_{i}"
            with Far(change) as far, self.assertRaises(mp.Refused) as caught:
                mp.study(self.file(), far, out=out, page=False, workers=1)
            self.assertEqual(caught.exception.verdict, verdict)
            self.assertEqual(list((out / "results").rglob("*.json")), [])

    def test_a_process_pool_is_replaced_when_a_killed_worker_has_broken_it(self):
        pools = []

        def make():
            pools.append(concurrent.futures.ProcessPoolExecutor(2))
            return pools[-1]

        def kill_one(_text):
            if len(pools) == 1 and self.results():
                os.kill(next(iter(pools[0]._processes)), signal.SIGKILL)

        found = mp.study(self.file(seeds=15), make, out=self.out, page=False, batch=5, progress=kill_one)
        self.assertEqual(len(found.rows), 60)
        for pool in pools:
            pool.shutdown(wait=True, cancel_futures=True)

    PROGRAM = """import json, os, pathlib, sys, time
mode, seed, out = sys.argv[1:]
place = pathlib.Path(__file__).parent
if (place / "slow").exists():
    (place / f"begun_{seed}").touch()
    time.sleep(60)
if seed == "2" and mode == "die_once" and not (place / "died").exists():
    (place / "died").touch()
    os.kill(os.getpid(), 9)
if mode == "silent": sys.exit(0)
found = {"x": int(seed) / 3, "y": [1], "faults": ["odd"] * (mode == "odd")}
pathlib.Path(out, "result.json").write_text(json.dumps(found))
sys.exit(3 if mode == "bad" else 0)
"""

    def program(self, modes, count=3):
        (self.folder / "evaluate.py").write_text(self.PROGRAM)
        words = f"[{sys.executable}, evaluate.py, '{{mode}}', '{{seed}}', '{{out}}']"
        axes = f"[{{name: mode, key: mode, values: [{modes}]}}]"
        return self.file(f"{{program: {words}, axes: {axes}, seeds: {{count: {count}}}}}")

    def test_a_program_is_run_and_its_file_decides_about_the_results(self):
        file = self.program("well, odd, bad, die_once, silent")
        found = mp.study(file, out=self.out)
        rows = {(row["mode"], row["seed"]): row for row in found.rows}
        self.assertEqual(len(rows), 12)
        self.assertEqual({entry["mode"] for entry in found.errors}, {"silent"})
        self.assertIn("no result.json", found.errors[0]["error"])
        for (mode, seed), row in rows.items():
            self.assertEqual((row["x"], row["y"], row["success"]), (seed / 3, [1], mode != "bad"))
        faults = json.loads((self.out / "study.json").read_text())["faults"]
        self.assertEqual(sorted({entry["fault"][:11] for entry in faults}), ["exit code 3", "odd"])
        self.assertIn("well", found.page.read_text())
        self.assertTrue((self.folder / "died").exists())  # and was tried again
        self.assertEqual(mp.study(file, out=self.out, page=False).skipped, 12)
        with open(self.folder / "evaluate.py", "a") as text:
            text.write("# changed\n")
        self.assertEqual(mp.study(file, out=self.out, page=False).skipped, 0)

    def test_a_stopped_study_ends_its_commands(self):
        """Ctrl-C does not wait for a long run to its end."""
        file = self.program("well", count=1)
        (self.folder / "slow").touch()
        words = [*program_words(), str(file), "--out", str(self.out), "--no-page"]
        process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        self.addCleanup(process.stderr.close)
        until((self.folder / "begun_1").exists, "the run")
        begin = time.monotonic()
        process.send_signal(signal.SIGINT)
        self.assertEqual(process.wait(PATIENCE), 130)
        self.assertLess(time.monotonic() - begin, 30)  # of 60 s
        self.assertIn("resumes it", process.stderr.read())

    def test_variants_of_an_experiment_are_runs_of_their_own(self):
        words = [os.environ["MULTIPANDA_PROGRAM"], "experiment", "list", "--json"]
        listed = json.loads(subprocess.run(words, capture_output=True, text=True, check=True).stdout)
        names = [v["name"] for entry in listed if entry["name"] == "contact-loss" for v in entry["variants"]][:2]
        text = f"{{experiment: contact-loss, axes: [{{name: v, key: only, values: [{', '.join(names)}]}}]}}"
        found = mp.study(self.file(text), out=self.out, page=False)
        self.assertEqual([row["v"] for row in found.rows], names)
        for row in found.rows:
            figures = {name.split("/")[0] for name in row if "/" in name}
            self.assertEqual(figures, {row["v"]})

    def test_errors_of_other_processes_arrive_as_they_were_raised(self):
        def kinds(kind):
            yield kind
            for other in kind.__subclasses__():
                yield from kinds(other)

        for kind in kinds(mp.Error):
            words = ("verdict", "reason", "step") if issubclass(kind, mp.Refused) else ("cause", "step")
            error = kind(*words)
            arrived = pickle.loads(pickle.dumps(error))
            self.assertIs(type(arrived), kind)
            self.assertEqual((str(arrived), vars(arrived)), (str(error), vars(error)))

    def test_workers_that_all_fail_end_the_study(self):
        class Broken(concurrent.futures.ThreadPoolExecutor):
            def submit(self, work, task):
                return super().submit(lambda: importlib.import_module("a_module_that_workers_lack"))

        with Broken(1) as broken, self.assertRaises(mp.Error) as caught:
            mp.study(self.file(), broken, out=self.out, page=False)
        self.assertIn("a_module_that_workers_lack", str(caught.exception))

    def test_a_process_pool_names_what_it_refuses(self):
        other = self.folder / "multipanda"
        own = pathlib.Path(os.environ["MULTIPANDA_PROGRAM"])
        for name in ("multipanda", "multipanda-lab"):  # the first starts the second for studies
            shutil.copy2(own.parent / name, self.folder)
            with open(self.folder / name, "ab") as file:
                file.write(b"\n")
        with concurrent.futures.ProcessPoolExecutor(1, initializer=_use, initargs=(str(other),)) as pool:
            with self.assertRaises(mp.Refused) as caught:
                mp.study(self.file(), pool, out=self.out, page=False)
        self.assertEqual(caught.exception.verdict, "other_program")


if __name__ == "__main__":
    harness.main()
