"""Tests the script ./multipanda with fake programs: PATH contains a single folder of fakes.

There is no network, package manager or compiler: a fake records its call and does just enough for the next step.
"""

import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest

ROOT = pathlib.Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tools"))
import pin_hashes

REAL_TOOLS = (
    "bash env readlink dirname sha256sum awk cat find mkdir rm mv cp chmod touch flock grep tail head sed sort tr"
).split()

FAKES = {
    "uname": 'echo "Linux x86_64"',
    "nproc": "echo 2",
    "id": "echo 0",
    "df": 'printf "Filesystem 1024-blocks Used Available\\nx 1 1 %s Capacity\\n" $((50000 * 1024))',
    # Every requested package is installed, except those named in the file `missing`.
    "dpkg-query": 'for p; do grep -qsx -- "$p" "$STATE/missing" || printf "ii %s\\n" "$p"; done',
    "apt-get": """[ -e "$STATE/no_network" ] && { echo "Could not resolve host"; exit 100; }
        case "$*" in *install*) rm -f "$STATE/missing" ;; esac""",
    "cmake": """echo "ccache in ${CCACHE_DIR:-its place}" >>"$STATE/calls"
        [ -e "$STATE/broken_source" ] && { echo "x.cpp:1: error: no"; exit 1; }
        case "$*" in
          --build*) cp "$STATE/program" build/multipanda && chmod +x build/multipanda ;;
          *) touch build/build.ninja ;;
        esac""",
    "ctest": 'echo "ctest $* full=${MULTIPANDA_FULL:-0} series=${MULTIPANDA_SERIES:-}"; exit 8',
    "python3": """case "$*" in
          *"-c import"*) echo "${FAKE_PYTHON:-311}" ;;
          *"-m venv"*) d="${*: -1}"; rm -rf "$d"
                       mkdir -p "$d/bin" "$d/lib/python3.11/site-packages"; cp "$0" "$d/bin/python" ;;
          *"-m pip"*) [ -e "$STATE/kill_pip" ] && kill -9 $PPID
                      [ -e "$STATE/no_network" ] && exit 1; exit 0 ;;
        esac""",
}


class FrontDoor(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.top = pathlib.Path(folder.name).resolve()
        self.tree, self.bin, self.state = self.top / "tree", self.top / "bin", self.top / "state"
        for path in (self.tree / "core", self.bin, self.state, self.top / "home"):
            path.mkdir(parents=True)
        (self.tree / "ros/python").mkdir(parents=True)
        pins = [f"requirements{name}.txt" for name in ("", "-more", "-ros")]
        for name in ("multipanda", *pins, "ros/python/multipanda.pth"):
            shutil.copy(ROOT / name, self.tree / name)
        for name in REAL_TOOLS:
            (self.bin / name).symlink_to(shutil.which(name))
        for name, body in FAKES.items():
            self.fake(name, body)
        self.release("debian", "12")
        self.program('printf "<%s>" "$@"')

    # --- Fakes ---

    def fake(self, name, body):
        path = self.bin / name
        path.write_text(f'#!{shutil.which("bash")}\nSTATE={self.state}\necho "{name} $*" >>"$STATE/calls"\n{body}\n')
        path.chmod(0o755)

    def release(self, name, version):
        (self.state / "os-release").write_text(f'ID={name}\nVERSION_ID="{version}"\n')

    def program(self, body):
        (self.state / "program").write_text(f"#!{shutil.which('bash')}\n{body}\n")

    def mark(self, name, text=""):
        (self.state / name).write_text(text)

    def environment(self, **more):
        return {
            "PATH": str(self.bin),
            "HOME": str(self.top / "home"),
            "MULTIPANDA_PYTHON": str(self.bin / "python3"),
            "MULTIPANDA_OS_RELEASE": str(self.state / "os-release"),
            **more,
        }

    def call(self, *words, script=None, cwd=None, **environment):
        self.mark("calls")
        return subprocess.run(
            [str(script or self.tree / "multipanda"), *words],
            capture_output=True,
            text=True,
            env=self.environment(**environment),
            cwd=cwd or self.top,
            timeout=60,
            check=False,
        )

    def calls(self, name):
        return [line for line in (self.state / "calls").read_text().splitlines() if line.startswith(name + " ")]

    def set_up(self):
        result = self.call("setup")
        self.assertEqual(result.returncode, 0, result.stderr)

    def assert_refused(self, result, *words):
        """Checks that the call failed, printed nothing on standard output and gave one reason, in its last line."""
        self.assertNotEqual(result.returncode, 0)
        self.assertEqual(result.stdout, "")
        last = result.stderr.splitlines()[-1]
        self.assertTrue(last.startswith("multipanda: "), last)
        for word in words:
            self.assertIn(word, last)

    # --- Set-up ---

    def test_bare_machine_is_set_up_once(self):
        self.mark("missing", "cmake\nlibosmesa6\n")
        self.set_up()
        self.assertEqual(len(self.calls("apt-get")), 1)
        self.assertIn("--no-install-recommends cmake libosmesa6", self.calls("apt-get")[0])
        self.assertEqual(len(self.calls("cmake")), 2)  # configure, build
        self.set_up()
        for name in ("apt-get", "cmake", "python3"):
            self.assertEqual(self.calls(name), [], name)

    def test_nothing_missing_adds_less_than_a_second(self):
        self.set_up()
        self.program("true")
        times = []
        for _ in range(3):
            begin = time.monotonic()
            self.assertEqual(self.call("run").returncode, 0)
            times.append(time.monotonic() - begin)
        self.assertLess(min(times), 1.0)

    def test_dev_adds_the_tools_of_the_checks(self):
        self.mark("missing", "clang-tidy\n")
        self.set_up()
        self.assertEqual(self.calls("apt-get"), [])
        self.assertEqual(self.call("setup", "--dev").returncode, 0)
        self.assertIn("clang-tidy", self.calls("apt-get")[0])
        self.assert_refused(self.call("setup", "--deev"), "--dev", "--deev")

    def test_ros_is_left_out_on_demand_and_stays_so(self):
        def installs():
            return [line.split("-r ")[1] for line in self.calls("python3") if "-m pip" in line and "-r " in line]

        all_sets = [f"{self.tree}/requirements{name}.txt" for name in ("", "-more", "-ros")]
        hook = self.tree / ".venv/lib/python3.11/site-packages/multipanda.pth"
        result = self.call("setup", "--no-ros", "--dev")
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertEqual((installs(), hook.exists(), self.calls("apt-get")), (all_sets[:2], False, []))
        self.assertIn("-DMULTIPANDA_ROS=off", self.calls("cmake")[0])
        self.call("run", "x", "--ros")  # remembers --no-ros
        self.assertEqual((installs(), self.calls("cmake")), ([], []))
        (self.tree / "requirements.txt").write_text((self.tree / "requirements.txt").read_text() + "# changed\n")
        self.call("run")
        self.assertEqual((installs(), hook.exists()), (all_sets[:1], False))
        self.set_up()  # setup without --no-ros adds ROS again
        self.assertEqual((installs(), hook.exists()), (all_sets[1:], True))
        self.assertIn("-DMULTIPANDA_ROS=on", self.calls("cmake")[0])
        self.set_up()
        self.assertEqual(self.calls("python3"), [])

    def test_every_package_is_installed_by_its_hash(self):
        for version in ("310", "311"):
            shutil.rmtree(self.tree / ".venv", ignore_errors=True)
            self.assertEqual(self.call("setup", FAKE_PYTHON=version).returncode, 0)
            fetched = [c for c in self.calls("python3") if re.search(r"-m pip .*\b(install|download)\b", c)]
            self.assertEqual(len(fetched), 4 if version == "310" else 3)
            for call in fetched:
                self.assertIn("--require-hashes", call)
                # A package built from source must not fetch a builder without a hash.
                self.assertTrue("--only-binary=:all:" in call or "--no-build-isolation" in call, call)
        # Python 3.10 gets MuJoCo's library from another Python's wheel: the same pin, without its marker.
        lines = (self.tree / "build/wheels/mujoco.txt").read_text().splitlines()
        self.assertRegex(lines[0], r"^mujoco-core==[\d.]+ *\\$")
        (pin,) = [
            p for p in pin_hashes.read((ROOT / "requirements.txt").read_text()) if p.text.startswith("mujoco-core==")
        ]
        self.assertGreaterEqual(len(pin.hashes), 3)
        self.assertEqual(sorted(re.findall("[0-9a-f]{64}", "\n".join(lines))), sorted(pin.hashes))

    def test_a_package_that_is_not_the_tested_file_is_named_as_such(self):
        self.fake(
            "python3",
            FAKES["python3"].replace(
                "exit 0 ;;", 'echo "THESE PACKAGES DO NOT MATCH THE HASHES FROM THE REQUIREMENTS FILE"; exit 1 ;;'
            ),
        )
        self.assert_refused(self.call("setup"), "requirements.txt", "hash", "pip config list")

    def test_a_ros_of_the_shell_stays_out_of_set_up(self):
        self.fake(
            "cmake", FAKES["cmake"] + '\necho "prefix <${AMENT_PREFIX_PATH:-}> <${PYTHONPATH:-}>" >>"$STATE/calls"'
        )
        self.program('echo "<${AMENT_PREFIX_PATH:-}>"')
        result = self.call("run", AMENT_PREFIX_PATH="/opt/ros/x", PYTHONPATH="/opt/ros/y")
        self.assertEqual(result.stdout, "</opt/ros/x>\n")  # the program gets the user's environment
        self.assertEqual(set(self.calls("prefix")), {"prefix <> <>"})

    def test_package_lists_are_fetched_only_after_a_failure(self):
        self.mark("missing", "cmake\n")
        self.fake(
            "apt-get",
            """case "$*" in *update*) touch "$STATE/fetched" ;; esac
            [ -e "$STATE/fetched" ] || exit 100
            case "$*" in *install*) rm -f "$STATE/missing" ;; esac""",
        )
        self.set_up()
        self.assertEqual([c.split()[3] for c in self.calls("apt-get")], ["install", "update", "install"])

    def test_sudo_is_used_where_there_is_no_root(self):
        self.mark("missing", "cmake\n")
        self.fake("id", "echo 1000")
        self.fake("sudo", 'exec "$@"')
        self.set_up()
        self.assertEqual(len(self.calls("sudo")), 1)
        self.assertEqual(len(self.calls("apt-get")), 1)

    def test_a_command_builds_what_it_needs_and_no_more(self):
        for arguments, targets in (
            (["demo"], "multipanda"),
            (["run", "x", "--ros"], "multipanda multipanda_ros multipanda_interfaces"),
            (["lab", "experiment", "task-1"], "multipanda multipanda-lab"),
            (["bench"], "multipanda multipanda-lab multipanda_bench"),
            (["test"], "first_tier"),
        ):
            self.call(*arguments)
            built = [c.split("--target ")[1].split(" -j")[0] for c in self.calls("cmake") if "--build" in c]
            self.assertEqual(built, [targets])
            self.call(*arguments)
            self.assertEqual(self.calls("cmake"), [])

    def test_package_builds_the_program_and_makes_the_packages_from_it(self):
        result = self.call("package")
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertTrue(any("--target multipanda multipanda_packaged -j" in line for line in self.calls("cmake")))
        made = [line for line in self.calls("python3") if "make_packages.py" in line]
        script = self.tree / "packaging/make_packages.py"
        self.assertEqual(made, [f"python3 -B {script} --build {self.tree / 'build'} --out {self.tree / 'dist'}"])
        self.assert_refused(self.call("package", "--fast"), "package has no options", "dist")

    def test_the_package_for_arms_is_built_by_its_own_script(self):
        for words, script_words in ((["--arms"], ""), (["--arms", "--aarch64"], " --aarch64")):
            self.mark("missing", "lld\nqemu-user-static\n")
            result = self.call("package", *words)
            self.assertEqual(result.returncode, 0, result.stderr)
            made = [line for line in self.calls("python3") if "packaging" in line]
            self.assertEqual(made, [f"python3 -B {self.tree / 'packaging/arms.py'}{script_words}"])
            tools = [
                name for name in ("lld", "qemu-user-static") if any(name in line for line in self.calls("apt-get"))
            ]
            self.assertEqual(tools, ["lld", "qemu-user-static"] if script_words else ["lld"])

    def test_a_request_to_a_running_program_never_waits_for_a_build(self):
        self.call("run", "x", "--ros")
        time.sleep(0.02)
        (self.tree / "core" / "x.cpp").touch()
        self.call("ctl", "stop")
        self.assertEqual(self.calls("cmake"), [])

    def test_each_stage_says_how_long_it_took(self):
        lines = self.call("setup").stderr.splitlines()
        for stage in ("Python environment", "build"):
            self.assertTrue(
                any(line.startswith(f"multipanda: {stage}: ") and line.endswith(" s") for line in lines), lines
            )

    def test_new_source_and_removed_source_are_built(self):
        self.set_up()
        source = self.tree / "core" / "x.cpp"
        for change in (source.touch, source.unlink):
            time.sleep(0.02)  # file times have a resolution of milliseconds
            change()
            self.set_up()
            self.assertEqual([c.split()[1] for c in self.calls("cmake")], ["--build"])
            self.set_up()
            self.assertEqual(self.calls("cmake"), [])

    def test_output_of_a_run_is_not_a_source(self):
        (self.tree / "runs").mkdir()
        self.set_up()
        time.sleep(0.02)
        for name in ("runs/log.mcap", "build/x.o", "MUJOCO_LOG.TXT"):
            (self.tree / name).touch()
        self.set_up()
        self.assertEqual(self.calls("cmake"), [])

    def test_broken_source_is_an_error_until_fixed(self):
        self.mark("broken_source")
        result = self.call("run")
        self.assert_refused(result, "build.log")
        self.assertIn("x.cpp:1: error: no", result.stderr)
        (self.state / "broken_source").unlink()
        self.assertEqual(self.call("run").returncode, 0)

    def test_changed_pins_and_a_moved_tree_recreate_the_environment(self):
        self.set_up()
        with open(self.tree / "requirements.txt", "a", encoding="utf-8") as pins:
            pins.write("# changed\n")
        self.set_up()
        self.assertTrue(any("-m venv --clear" in c for c in self.calls("python3")))
        moved = self.top / "moved"
        self.tree.rename(moved)
        self.assertEqual(self.call("setup", script=moved / "multipanda").returncode, 0)
        self.assertTrue(any("-m venv --clear" in c for c in self.calls("python3")))
        self.assertEqual(len(self.calls("cmake")), 2)

    def test_interrupted_environment_is_redone(self):
        self.mark("kill_pip")
        self.assertNotEqual(self.call("setup").returncode, 0)
        self.assertTrue((self.tree / ".venv/bin/python").exists())
        (self.state / "kill_pip").unlink()
        self.set_up()
        self.assertTrue(any("-m venv --clear" in c for c in self.calls("python3")))

    def test_cache_of_the_compiler_without_a_home(self):
        self.set_up()
        self.assertIn("ccache in its place", self.calls("ccache"))
        for home in ("", "/nonexistent"):
            shutil.rmtree(self.tree / "build")
            self.assertEqual(self.call("setup", HOME=home).returncode, 0)
            self.assertIn(f"ccache in {self.tree}/build/.ccache", self.calls("ccache"))
        shutil.rmtree(self.tree / "build")
        self.assertEqual(self.call("setup", HOME="", CCACHE_DIR="/mine").returncode, 0)
        self.assertIn("ccache in /mine", self.calls("ccache"))

    # --- Messages ---

    def test_another_machine_is_refused(self):
        for machine in ("Linux aarch64", "Darwin x86_64"):
            self.fake("uname", f'echo "{machine}"')
            result = self.call("demo")
            self.assert_refused(result, machine, "Linux x86_64")
            self.assertEqual(len(result.stderr.splitlines()), 1)
            self.assertEqual(self.calls("python3"), [])

    def test_too_little_disk_is_refused(self):
        self.fake("df", 'printf "Filesystem 1024-blocks Used Available\\nx 1 1 2048000 Capacity\\n"')
        result = self.call("demo")
        self.assert_refused(result, "2000 MB", "3000 MB")
        self.assertEqual(len(result.stderr.splitlines()), 1)
        self.assertFalse((self.tree / ".venv").exists())

    def test_neither_root_nor_sudo_prints_the_line_for_the_administrator(self):
        self.mark("missing", "cmake\nlibfmt-dev\n")
        self.fake("id", "echo 1000")
        result = self.call("demo")
        self.assert_refused(result, "apt-get install -y --no-install-recommends cmake libfmt-dev")
        self.assertEqual(len(result.stderr.splitlines()), 1)
        self.assertEqual(self.calls("apt-get"), [])

    def test_unknown_distribution(self):
        self.release("fedora", "42")
        self.mark("missing", "cmake\n")
        self.assert_refused(self.call("demo"), "fedora 42", "cmake")
        self.mark("missing")  # nothing: installed by hand
        result = self.call("demo")
        self.assertEqual(result.returncode, 0)
        self.assertIn("warning: fedora 42 is untested", result.stderr)

    def test_no_network(self):
        self.mark("no_network")
        self.mark("missing", "cmake\n")
        self.assert_refused(self.call("demo"), "Check the network", "packages.log")
        (self.state / "missing").unlink()
        self.assert_refused(self.call("demo"), "Check the network", "venv.log")
        self.assertFalse((self.tree / ".venv/.complete").exists())

    def test_python_too_old_or_absent(self):
        self.assert_refused(self.call("demo", FAKE_PYTHON="309"), "older than 3.10")
        self.assert_refused(self.call("demo", MULTIPANDA_PYTHON="/nonexistent"), "/nonexistent", "MULTIPANDA_PYTHON")

    # --- Starting the program ---

    def test_arguments_exit_code_and_output_are_the_programs(self):
        self.program('printf "<%s>" "$@"; exit 37')
        for _ in range(2):  # with and without set-up before it
            result = self.call("run", "a b", "", "*", "--json")
            self.assertEqual((result.returncode, result.stdout), (37, "<run><a b><><*><--json>"))
        self.assertEqual(result.stderr, "")

    def test_signals_reach_the_program(self):
        self.program('trap "echo closed; exit 5" TERM INT\necho ready\nwhile :; do read -r -t 1 <> <(:); done')
        self.set_up()
        for number in (signal.SIGTERM, signal.SIGINT):
            with subprocess.Popen(
                [str(self.tree / "multipanda"), "run"],
                stdout=subprocess.PIPE,
                text=True,
                env=self.environment(),
                start_new_session=True,
            ) as process:
                try:
                    self.assertEqual(process.stdout.readline(), "ready\n")
                    process.send_signal(number)  # to this one process, not to its group
                    self.assertEqual(process.communicate(timeout=10)[0], "closed\n")
                    self.assertEqual(process.returncode, 5)
                finally:
                    try:  # without exec, the script would leave a child behind
                        os.killpg(process.pid, signal.SIGKILL)
                    except ProcessLookupError:
                        pass
        self.program("kill -KILL $$")
        self.set_up()
        shutil.copyfile(self.state / "program", self.tree / "build/multipanda")
        self.assertEqual(self.call("run").returncode, -signal.SIGKILL)

    def test_from_another_folder_and_through_a_link(self):
        self.set_up()
        self.program("printf '%s' \"$PWD\"")
        shutil.copyfile(self.state / "program", self.tree / "build/multipanda")
        link = self.top / "link"
        link.symlink_to("tree/multipanda")
        elsewhere = self.top / "home"
        result = self.call("run", script=link, cwd=elsewhere)
        self.assertEqual((result.returncode, result.stdout), (0, str(elsewhere)))
        self.assertEqual(self.calls("cmake"), [])

    def test_a_real_arm_is_made_ready_without_a_build(self):
        self.assertEqual(self.call("arm", "status", "172.16.0.2").returncode, 0)
        (call,) = self.calls("python3")
        self.assertIn("python/multipanda/desk.py status 172.16.0.2", call)
        self.assertFalse((self.tree / "build").exists())

    def test_help_sets_nothing_up(self):
        for words in ((), ("help",), ("--help",)):
            result = self.call(*words)
            self.assertEqual(result.returncode, 0)
            self.assertIn("setup [--dev] [--no-ros]", result.stdout)
        self.assertFalse((self.tree / "build").exists())
        self.set_up()
        self.assertIn("<--help>", self.call("--help").stdout)

    def test_test_hands_over_to_ctest(self):
        result = self.call("test", "-R", "hold", "-j8")
        self.assertEqual(result.returncode, 8)
        self.assertTrue(result.stdout.endswith("-L first -R hold -j8 full=0 series=\n"), result.stdout)
        self.assertIn("--output-on-failure --no-tests=error", result.stdout)
        result = self.call("test", "--all", "-V")
        self.assertTrue(result.stdout.endswith("-j 3 --repeat until-pass:2 -V full=0 series=\n"), result.stdout)
        result = self.call("test", "--long")
        self.assertTrue(result.stdout.endswith("-C full full=1 series=tenth\n"), result.stdout)


if __name__ == "__main__":
    unittest.main()
