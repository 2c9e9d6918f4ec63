"""The checks in tools/ find what they are for: each rule is violated once in a tree made for it."""

import io
import pathlib
import subprocess
import sys
import tempfile
import unittest
from unittest import mock

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "tools"))
import check_layers
import check_phrases
import check_texts
import pin_hashes
from layers import LAYERS


class Tree(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.root = pathlib.Path(folder.name)

    def write(self, name, text):
        path = self.root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


class Layers(Tree):
    def faults(self, name, include):
        self.write(name, f"// first line\n#include {include}\n")
        return check_layers.check_includes(self.root)

    def test_own_folder_and_listed_layers_are_allowed(self):
        self.assertEqual(self.faults("core/cycle/a.cpp", '"core/types/b.hpp"'), [])
        self.assertEqual(self.faults("core/cycle/a.cpp", '"core/cycle/b.hpp"'), [])
        self.assertEqual(self.faults("core/cycle/a.cpp", "<vector>"), [])
        self.assertEqual(self.faults("runtime/live_input/a.cpp", '"core/rt/b.hpp"'), [])

    def test_a_layer_that_is_not_listed_is_refused_for_every_pair(self):
        for layer in LAYERS:
            for other in LAYERS:
                if layer.folder in ("tests", "core/testing") or check_layers.allowed(layer, other, layer.uses):
                    continue
                fault = check_layers.fault_of(f"{layer.folder}/a.hpp", '"', f"{other.folder}/b.hpp", self.root)
                expected = "is test support" if other.folder == "core/testing" else "may not include"
                self.assertIn(expected, fault or "nothing", f"{layer.folder} -> {other.folder}")

    def test_message_names_file_and_line(self):
        (fault,) = self.faults("core/types/a.hpp", '"core/cycle/b.hpp"')
        self.assertTrue(fault.startswith("core/types/a.hpp:2: "), fault)

    def test_core_includes_no_simulator_middleware_or_stream(self):
        for name in (
            "<mujoco/mujoco.h>",
            "<spdlog/spdlog.h>",
            "<iostream>",
            "<rcl/rcl.h>",
            "<sensor_msgs/msg/x.h>",
            '"backends/mujoco/x.hpp"',
            '"core/unknown/x.hpp"',
            '"spatial.hpp"',
        ):
            self.assertEqual(len(self.faults("core/rt/a.cpp", name)), 1, name)

    def test_pinocchio_stays_in_the_model(self):
        self.assertEqual(self.faults("core/model/a.cpp", "<pinocchio/fwd.hpp>"), [])
        self.assertEqual(len(self.faults("core/model/b.hpp", "<pinocchio/fwd.hpp>")), 1)
        self.assertEqual(len(self.faults("core/model/b.hpp", "<vector>")), 0)
        self.assertEqual(len(self.faults("core/cycle/c.cpp", "<pinocchio/fwd.hpp>")), 1)
        self.assertEqual(len(self.faults("core/cycle/c.cpp", '"core/model/pinocchio_chain.hpp"')), 1)

    def test_third_party_headers_stay_in_their_layers(self):
        self.assertEqual(self.faults("scene/a.cpp", "<yaml-cpp/yaml.h>"), [])
        self.assertEqual(len(self.faults("scene/a.cpp", "<CLI/CLI.hpp>")), 1)

    def test_tests_may_reach_up_but_not_out(self):
        self.assertEqual(self.faults("core/safety/a_test.cpp", '"core/cycle/b.hpp"'), [])
        self.assertEqual(len(self.faults("core/safety/a_test.cpp", "<mujoco/mujoco.h>")), 1)

    def test_test_support_is_for_tests_only(self):
        self.assertEqual(self.faults("scene/a_test.cpp", '"scene/testing/b.hpp"'), [])
        self.assertEqual(len(self.faults("scene/a.cpp", '"scene/testing/b.hpp"')), 1)

    def test_a_file_outside_the_known_folders_and_an_empty_tree_are_faults(self):
        self.assertEqual(len(check_layers.check_includes(self.root)), 1)
        self.assertEqual(len(self.faults("core/stray.cpp", "<vector>")), 1)

    def test_a_product_target_that_links_test_support_is_a_fault(self):
        for name in ("scene/a.cpp", "scene/testing/fake.cpp", "scene/a_test.cpp"):
            self.write(name, "")
        cmake = (
            "multipanda_library(fake SOURCES testing/fake.cpp)\n"
            "multipanda_test(a_test SOURCES a_test.cpp DEPS fake)\n"
            "multipanda_library(product SOURCES a.cpp DEPS core{})  # a comment (with parentheses)\n"
        )
        self.write("scene/CMakeLists.txt", cmake.format(""))
        self.assertEqual(check_layers.check_links(self.root), [])
        self.write("scene/CMakeLists.txt", cmake.format(" fake"))
        self.assertEqual(
            check_layers.check_links(self.root), ["scene/CMakeLists.txt:3: product links fake, which is test support"]
        )

    def test_a_source_file_that_no_target_compiles_is_a_fault(self):
        self.write("scene/CMakeLists.txt", "multipanda_test(a_test SOURCES a_test.cpp)\n")
        self.write("scene/a_test.cpp", "")
        self.write("scene/b_test.cpp", "")
        (fault,) = check_layers.check_links(self.root)
        self.assertTrue(fault.startswith("scene/b_test.cpp:1: "), fault)

    def test_the_table_has_no_cycle(self):
        self.assertEqual(check_layers.check_table(), [])
        table = [*LAYERS, LAYERS[0]._replace(folder="last"), LAYERS[0]._replace(folder="core/a", uses=("last", "b"))]
        with mock.patch.object(check_layers, "LAYERS", table[::-1]):
            self.assertTrue(check_layers.check_table())


class Texts(Tree):
    def test_a_place_on_one_machine_is_found_with_its_line(self):
        self.write("docs/a.md", "fine\nsee /" + "root/notes\n")
        (fault,) = check_texts.check(self.root)
        self.assertTrue(fault.startswith("docs/a.md:2: "), fault)

    def test_ordinary_texts_and_binaries_pass(self):
        self.write("a.md", "the /tmp folder, network/rooted and /usr/bin\n")
        (self.root / "b.bin").write_bytes(b"\0 /" + b"root/x")
        self.assertEqual(check_texts.check(self.root), [])

    def test_an_empty_tree_is_a_fault(self):
        self.assertEqual(len(check_texts.check(self.root)), 1)

    def test_a_link_must_lead_to_a_file_and_a_heading(self):
        self.write("docs/b.md", "# Two words, and `code`\n")
        self.write("docs/a.md", "[b](b.md) [c](b.md#two-words-and-code) [web](https://a.b/c) `[x](y)`\n")
        self.assertEqual(check_texts.check(self.root), [])
        self.write("docs/a.md", "\n[b](missing.md)\n[c](b.md#three)\n")
        faults = check_texts.check(self.root)
        self.assertEqual([f.split(": ")[0] for f in faults], ["docs/a.md:2", "docs/a.md:3"])


class Pins(unittest.TestCase):
    """Hashes of Python packages. 'a' * 64 stands for the hash of a file."""

    GOOD = f"# a comment\nnumpy==2.4.6; python_version >= '3.11' \\\n    --hash=sha256:{'a' * 64}\n"

    def test_every_package_of_the_project_has_a_version_and_a_hash(self):
        for path in pin_hashes.FILES:
            text = path.read_text()
            self.assertEqual(pin_hashes.faults(text), [], path.name)
            self.assertGreater(len(list(filter(pin_hashes.is_pin, pin_hashes.read(text)))), 0, path.name)

    def test_a_line_without_version_or_hash_is_found_with_its_line(self):
        self.assertEqual(pin_hashes.faults(self.GOOD), [])
        for text, line, word in (
            ("numpy==2.4.6\n", 1, "no hash"),
            ("# first\nnumpy==2.4.6; python_version < '3.11'\n", 2, "no hash"),
            (f"numpy>=2.4.6 --hash=sha256:{'a' * 64}\n", 1, "no exact version"),
            ("numpy\n", 1, "no exact version"),
            (f"numpy==2.4.6 --hash=md5:{'a' * 32}\n", 1, "no exact version"),
            (self.GOOD + self.GOOD.replace("numpy", "NumPy"), 5, "twice"),
        ):
            (fault,) = pin_hashes.faults(text)
            self.assertTrue(fault.startswith(f"{line}: "), fault)
            self.assertIn(word, fault)
        self.assertEqual(len(pin_hashes.faults("# nothing\n")), 1)

    def test_hashes_of_each_python_are_written_and_old_ones_replaced(self):
        asked = []

        def offered(name, version, python, source):
            asked.append((name, version, python, source))
            return set() if python == "3.13" else {python[-1] * 64, "f" * 64}

        text, missing = pin_hashes.renew("--no-binary empy\n" + self.GOOD + "empy==4.2.1\n", offered)
        self.assertEqual(missing, [])  # a Python that no supported distribution has may lack a file
        self.assertEqual(
            asked,
            [("numpy", "2.4.6", p, False) for p in ("3.11", "3.12", "3.13")]
            + [("empy", "4.2.1", p, True) for p in ("3.10", "3.11", "3.12", "3.13")],
        )
        option, comment, numpy, empy = pin_hashes.read(text)
        self.assertEqual((option.text, comment.text), ("--no-binary empy", "# a comment"))
        self.assertEqual(numpy.text, "numpy==2.4.6; python_version >= '3.11'")
        self.assertEqual(numpy.hashes, ("1" * 64, "2" * 64, "f" * 64))
        self.assertEqual(empy.hashes, ("0" * 64, "1" * 64, "2" * 64, "f" * 64))
        self.assertEqual(pin_hashes.renew(text, offered)[0], text)

    def test_a_version_without_a_file_for_a_supported_python_is_a_fault(self):
        _, missing = pin_hashes.renew(self.GOOD, lambda name, version, python, source: set())
        self.assertEqual([fault.split(": ")[0] for fault in missing], ["2", "2"])


class Promises(Tree):
    HEAD = "| promise | proved by |\n|---|---|\n"

    def faults(self, rows, head=HEAD):
        self.write("core/a_test.cpp", "TEST(Stop, Holds) {}\nTEST_P(Limit, IsKept) {}\nTEST(Stop, DISABLED_Old) {}\n")
        self.write("tests/b_test.py", "class Door(Base):\n    def test_is_shut(self):\n        pass\n")
        self.write("docs/promises.md", head + rows)
        return check_texts.check(self.root)

    def test_named_tests_must_exist(self):
        self.assertEqual(
            self.faults("| it holds | `Stop.Holds`, `Limit.IsKept` |\n| shut | `Door.test_is_shut` |\n"), []
        )
        for name in ("Stop.Hold", "Limit.Holds", "Stop.Old", "Door.test_is_open", "Holds"):
            (fault,) = self.faults(f"| it holds | `{name}` |\n")
            self.assertTrue(fault.startswith("docs/promises.md:3: "), fault)
            self.assertIn(name, fault)

    def test_a_promise_without_a_test_and_a_page_without_promises_are_faults(self):
        (fault,) = self.faults("| it holds | `Stop.Holds` |\n| it flies | sure |\n")
        self.assertTrue(fault.startswith("docs/promises.md:4: "), fault)
        self.assertEqual(len(self.faults("| it holds | `None.Here` |\n", head="| a | b |\n|---|---|\n")), 1)

    def test_the_pages_of_the_project_are_checked(self):
        existing = check_texts.tests_in_sources(check_texts.ROOT)
        for page, rows in zip(check_texts.PROVED, (100, 25), strict=True):
            self.assertGreater((check_texts.ROOT / page).read_text(encoding="utf-8").count("\n| "), rows)
            self.assertEqual(check_texts.check_proofs(check_texts.ROOT, page, existing), [])


class Ros2Control(Tree):
    """ros/tests/run.sh with a ROS 2 and tools that do nothing but end with a code."""

    def run_script(self, description, colcon=0):
        prefix, build = self.root / "ros", self.root / "build"
        self.write("ros/setup.bash", f"export AMENT_PREFIX_PATH={prefix}\n")
        self.write("ros/share/controller_manager/package.xml", "<version>1.2.3</version>\n")
        self.write("build/install/setup.bash", "")
        for name, code in (
            ("colcon", f'case "$*" in *" test "*) exit {colcon} ;; esac'),
            ("python3", f"exit {description}"),
        ):
            self.write(f"bin/{name}", f"#!/bin/sh\n{code}\n")
            (self.root / "bin" / name).chmod(0o755)
        script = pathlib.Path(__file__).resolve().parent.parent / "ros/tests/run.sh"
        environment = {"PATH": f"{self.root}/bin:/usr/bin:/bin", "MULTIPANDA_ROS2_PREFIX": str(prefix)}
        result = subprocess.run([script, build], env=environment, capture_output=True, text=True, check=False)
        return result.returncode, result.stdout

    def test_descriptions_that_were_not_checked_are_reported_as_skipped(self):
        code, text = self.run_script(description=77)
        self.assertEqual(code, 77)
        self.assertRegex(text, r"(?m)^skipped: the robot descriptions .* xacro")
        self.assertNotIn("built and tested", text)

    def test_what_failed_is_a_failure_and_what_passed_passes(self):
        self.assertEqual(self.run_script(description=0)[0], 0)
        self.assertEqual(self.run_script(description=1)[0], 1)
        self.assertEqual(self.run_script(description=77, colcon=1)[0], 1)
        self.assertEqual(self.run_script(description=0, colcon=1)[0], 1)


class Phrases(Tree):
    def faults(self, text, name="a.md"):
        self.write(name, text)
        return check_phrases.check(self.root)

    def test_a_banned_phrase_is_found_with_its_line_and_a_better_one(self):
        (fault,) = self.faults("fine\nread it an" + "ew\n")
        self.assertEqual(fault, "a.md:2: 'anew': better: again")  # phrases: quoted

    def test_each_rule_finds_its_phrase(self):
        for text in (
            "the maker's library",  # phrases: quoted
            "it would else stop",  # phrases: quoted
            "one behind the other",  # phrases: quoted
            "output for people",  # phrases: quoted
            "'x' is no number",  # phrases: quoted
            "// Of the joints, the first",  # phrases: quoted
            "Who has no arm gets one",  # phrases: quoted
            "the wanted force",  # phrases: quoted
            "the behaviour at the centre",  # phrases: quoted
            "initialise and normalise",  # phrases: quoted
            "a test rig",  # phrases: quoted
        ):
            self.assertTrue(self.faults(text), text)

    def test_ordinary_sentences_pass(self):
        for text in (
            "there is no name for it",
            "Who may command?",
            "the list is no longer sorted",
            "exercise, otherwise, promise, advertise, precise",
            "the trigger of a rigid body",
        ):
            self.assertEqual(self.faults(text), [], text)

    def test_names_in_code_are_not_texts(self):
        self.assertEqual(self.faults("int rig = 1;\n", "a.cpp"), [])  # phrases: quoted
        self.assertEqual(len(self.faults("int rig = 1;  // the rig\n", "a.cpp")), 1)  # phrases: quoted

    def test_keys_of_scenes_keep_their_names(self):
        text = "the over" + "tones of a motion\n"
        self.assertEqual(self.faults(text, "scene/a.cpp"), [])
        self.assertEqual(len(self.faults(text, "docs/a.md")), 1)

    def test_a_last_line_of_one_word_and_a_broken_banner_are_faults(self):
        long = "// " + "word " * 20
        self.assertEqual(len(self.faults(f"{long}\n// end.\nint a;\n", "a.cpp")), 1)
        self.assertEqual(self.faults(f"{long}\n// the end.\nint a;\n", "a.cpp"), [])
        self.assertEqual(len(self.faults("// --- Title and\n// more ---\n", "a.cpp")), 1)
        self.assertEqual(self.faults("// --- Title ---\n", "a.cpp"), [])

    def test_only_strict_fails(self):
        text = self.root / "a.md"
        text.write_text("an" + "ew\n")
        with mock.patch.object(check_phrases, "ROOT", self.root), mock.patch("sys.stdout", io.StringIO()):
            for options, code in (([], 0), (["--strict"], 1)):
                with mock.patch.object(sys, "argv", ["check_phrases.py", *options, str(text)]):
                    self.assertEqual(check_phrases.main(), code)


if __name__ == "__main__":
    unittest.main()
