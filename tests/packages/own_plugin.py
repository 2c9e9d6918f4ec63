"""Libraries and programs of one's own, built with nothing but the installed packages, and loaded by their program."""

import os
import pathlib
import shutil
import sys
import unittest

import made
from made import FOLDER, output

VARIABLES = {"PATH": "/usr/bin:/bin", "HOME": str(FOLDER / "nobody"), "LANG": "C.UTF-8"}

PROGRAM = """
#include <cstdio>

#include "core/modes/registry.hpp"
#include "core/plugin/load_plugin.hpp"

int main(int, char** argv) {
  multipanda::Registry registry = multipanda::Registry::with_builtins();
  multipanda::load_plugin(registry, argv[1]);
  std::printf("loaded\\n");
}
"""
LISTS = """
cmake_minimum_required(VERSION 3.22)
project(own_program CXX)
find_package(multipanda 0.1 REQUIRED)
add_executable(own_program main.cpp)
target_link_libraries(own_program PRIVATE multipanda::core)
"""


class OwnLibraries(unittest.TestCase):
    def build(self, source, name, package, build=None):
        build = build or FOLDER / f"build_{name}"
        output(
            *("cmake", "-S", source, "-B", build, "-G", "Ninja", f"-Dmultipanda_DIR={package}"),
            *("-DCMAKE_BUILD_TYPE=Debug",),  # compiles faster; only the layout matters
            env=VARIABLES,
        )
        output("cmake", "--build", build, env=VARIABLES)
        return build

    def installed(self):
        """The wheel as pip installs it, with the mode of its program."""
        package = made.unpacked() / "multipanda"
        for program in (package / "bin").iterdir():
            os.chmod(program, 0o755)
        return package

    def test_the_example_s_library(self):
        package = self.installed()
        # Away from the source tree, which must not be found by accident.
        source = FOLDER / "own_controllet"
        shutil.copytree(package / "share/multipanda/examples/own_controllet", source)
        self.build(source, "controllet", package / "lib/cmake/multipanda", source / "build")
        scene = source / "scene.yaml"
        program = package / "bin/multipanda"
        said = output(program, "run", scene, "--fast", "--seconds", "1", "--json", env=VARIABLES, cwd=FOLDER)
        self.assertRegex(said, r'"success": ?true')
        # The same file is loaded by the .deb's program: both packages have the same headers.
        deb = made.unpacked_deb() / "usr/bin/multipanda"
        output(deb, "run", scene, "--fast", "--seconds", "1", "--json", env=VARIABLES, cwd=FOLDER)

    def test_a_program(self):
        """Against the .deb's folders, by its link in usr/lib/cmake."""
        source = FOLDER / "own_program"
        source.mkdir()
        (source / "main.cpp").write_text(PROGRAM)
        (source / "CMakeLists.txt").write_text(LISTS)
        build = self.build(source, "program", made.unpacked_deb() / "usr/lib/cmake/multipanda")
        with self.assertRaisesRegex(AssertionError, "nothing.so"):
            output(build / "own_program", "/nothing.so", env=VARIABLES)
        needed = made.dynamic(build / "own_program", "NEEDED")
        self.assertIn("libmultipanda_core.so", needed)

    def test_the_folder_is_printed(self):
        variables = {**VARIABLES, "PYTHONPATH": str(made.unpacked())}
        folder = pathlib.Path(output(sys.executable, "-m", "multipanda.cmake", env=variables).strip())
        self.assertTrue(folder.is_relative_to(made.unpacked()))
        self.assertTrue((folder / "multipandaConfig.cmake").exists())
