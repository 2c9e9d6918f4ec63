"""The checks in tools/ find what they are for: each rule is broken once in a tree made for it."""

import pathlib
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "tools"))
import check_core_includes  # noqa: E402
import check_texts  # noqa: E402


class Tree(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.root = pathlib.Path(folder.name)

    def write(self, name, text):
        path = self.root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


class CoreIncludes(Tree):
    def faults(self, name, include):
        self.write(name, f"// first line\n#include {include}\n")
        return check_core_includes.check(self.root)

    def test_down_the_list_and_own_folder_are_allowed(self):
        self.assertEqual(self.faults("core/cycle/a.cpp", '"core/types/b.hpp"'), [])
        self.assertEqual(self.faults("core/cycle/a.cpp", '"core/cycle/b.hpp"'), [])
        self.assertEqual(self.faults("core/cycle/a.cpp", "<vector>"), [])

    def test_each_step_up_the_list_is_refused(self):
        order = check_core_includes.ORDER
        for upper, lower in zip(order, order[1:]):
            fault = check_core_includes.fault_of(f"core/{lower}/a.hpp", '"', f"core/{upper}/b.hpp")
            self.assertIn(f"{lower} may not include {upper}", fault or "nothing")

    def test_message_names_file_and_line(self):
        (fault,) = self.faults("core/types/a.hpp", '"core/cycle/b.hpp"')
        self.assertTrue(fault.startswith("core/types/a.hpp:2: "), fault)

    def test_what_the_core_does_not_know(self):
        for name in ("<mujoco/mujoco.h>", "<spdlog/spdlog.h>", "<iostream>", "<rcl/rcl.h>", "<sensor_msgs/msg/x.h>",
                     '"backends/mujoco/x.hpp"', '"core/unknown/x.hpp"', '"spatial.hpp"'):
            self.assertEqual(len(self.faults("core/rt/a.cpp", name)), 1, name)

    def test_pinocchio_stays_in_the_model(self):
        self.assertEqual(self.faults("core/model/a.cpp", "<pinocchio/fwd.hpp>"), [])
        self.assertEqual(len(self.faults("core/model/b.hpp", "<pinocchio/fwd.hpp>")), 1)
        self.assertEqual(len(self.faults("core/model/b.hpp", "<vector>")), 0)
        self.assertEqual(len(self.faults("core/cycle/c.cpp", "<pinocchio/fwd.hpp>")), 1)
        self.assertEqual(len(self.faults("core/cycle/c.cpp", '"core/model/pinocchio_model.hpp"')), 1)

    def test_tests_may_reach_up_but_not_out(self):
        self.assertEqual(self.faults("core/safety/a_test.cpp", '"core/cycle/b.hpp"'), [])
        self.assertEqual(len(self.faults("core/safety/a_test.cpp", "<mujoco/mujoco.h>")), 1)

    def test_a_file_beside_the_folders_and_an_empty_core_are_faults(self):
        self.assertEqual(len(check_core_includes.check(self.root)), 1)
        self.assertEqual(len(self.faults("core/stray.cpp", "<vector>")), 1)


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


if __name__ == "__main__":
    unittest.main()
