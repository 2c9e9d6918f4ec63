"""Tests ROS' requirements on the machine, without a run: environment_test.py PROGRAM BUILD.

The program links no ROS library, the module has no foreign symbols, Python in .venv works, and the interfaces equal the
public ones.
"""

import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]
PROGRAM, BUILD = (sys.argv.pop(1) for _ in range(2)) if len(sys.argv) > 2 else ("", "")
ROS_LIBRARIES = re.compile(r"lib(rcl|rmw|rosidl|fastdds|fastcdr|tracetools|lttng|python)\S*")
# Computed from the definitions in the packages' own repositories (control_msgs 6, tf2_msgs,
# visualization_msgs 5): fields and order.
PUBLIC = {
    "tf2_msgs/msg/TFMessage": "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
    "visualization_msgs/msg/MarkerArray": "RIHS01_86cb8800b6fb05b5eff1abd7a56f62a5641d3ae9a1c29e78e67e704f1d067dcf",
    "control_msgs/action/FollowJointTrajectory": "RIHS01_ff29901b2693f5deb847e96084a1c2cdb26e70b7c847be21859b70a55fb29cf0",  # noqa: E501
    "control_msgs/action/GripperCommand": "RIHS01_e17c0e644eccf14bea84a0a93e0977182872c2eb7873ca6694900059b46dbc84",
}


def output(*command, **environment):
    # Removes the variables that other tests of this session set, and the mark of the wheels.
    clean = {k: v for k, v in os.environ.items() if not re.match(r"ROS_|RMW_|FAST|_ROS", k)}
    result = subprocess.run(
        [str(part) for part in command],
        capture_output=True,
        text=True,
        env={**clean, **environment},
        timeout=60,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    return result.stdout + result.stderr


class Environment(unittest.TestCase):
    def test_plain_program_loads_no_ros(self):
        self.assertIsNone(ROS_LIBRARIES.search(output("ldd", PROGRAM)))

    def test_module_shows_nothing_but_its_entries(self):
        module = pathlib.Path(BUILD) / "libmultipanda_ros.so"
        self.assertIsNotNone(ROS_LIBRARIES.search(output("ldd", module)))  # the search does find them
        symbols = [line.split()[-1] for line in output("nm", "-D", "--defined-only", module).splitlines()]
        self.assertTrue(symbols)
        self.assertEqual(
            [
                name
                for name in symbols
                # Py...: stand-ins for Python's symbols (ros/adapter/no_python.cpp).
                if not name.startswith(("multipanda_", "Py", "_Py")) and name not in ("__bss_start", "_edata", "_end")
            ],
            [],
        )  # the linker's own

    def test_python_imports_the_messages_of_the_build(self):
        program = (
            "import rclpy, multipanda_msgs.srv, multipanda_msgs.action, control_msgs.action, tf2_msgs.msg, "
            "visualization_msgs.msg; print(multipanda_msgs.__file__)"
        )
        path = {} if pathlib.Path(BUILD).resolve() == ROOT / "build" else {"PYTHONPATH": f"{BUILD}/python"}
        found = output(ROOT / ".venv/bin/python", "-c", program, **path).strip()
        self.assertEqual(pathlib.Path(found).parents[1].resolve(), (pathlib.Path(BUILD) / "python").resolve())

    VARIABLES = ("FASTDDS_DEFAULT_PROFILES_FILE", "FASTDDS_BUILTIN_TRANSPORTS", "ROS_AUTOMATIC_DISCOVERY_RANGE")

    def local(self, **environment):
        program = f"import os; print(*map(os.environ.get, {self.VARIABLES}))"
        return output(ROOT / ".venv/bin/python", "-c", program, **environment).split()

    def test_python_keeps_to_this_machine_unless_told_otherwise(self):
        source = (ROOT / "ros/rcl/context.cpp").read_text().split("bool keep_to_this_machine")[1]
        names = set(re.findall(r'"((?:FAST|ROS_|RMW_)\w+)"', source.split("}) {")[0]))
        self.assertGreater(len(names), 5)
        hook = (ROOT / "ros/python/multipanda.pth").read_text()
        self.assertEqual(set(re.findall(r"(?:FAST|ROS_|RMW_)\w+", hook)), names)
        default = [str(ROOT / "ros/rcl/fastdds_loopback.xml"), "None", "SYSTEM_DEFAULT"]
        self.assertEqual(self.local(), default)
        self.assertEqual(self.local(ROS_DOMAIN_ID="7", ROS_STATIC_PEERS=""), default)
        for name in names:
            expected = ["1" if variable == name else "None" for variable in self.VARIABLES]
            self.assertEqual(self.local(**{name: "1"}), expected, name)

    def test_python_without_a_build_is_complete(self):
        with tempfile.TemporaryDirectory() as folder:
            shutil.copy(ROOT / "ros/python/multipanda.pth", folder)  # ../../../../build does not exist from there
            program = (
                f"import os, site; [os.environ.pop(v, 0) for v in {self.VARIABLES}]; site.addsitedir({folder!r});"
                f" print(*map(os.environ.get, {self.VARIABLES}))"
            )
            # Without the profile nothing but shared memory is left.
            self.assertEqual(
                output(ROOT / ".venv/bin/python", "-c", program).split(), ["None", "SHM", "SYSTEM_DEFAULT"]
            )

    def test_own_copies_of_public_interfaces_are_the_public_ones(self):
        files = list(pathlib.Path(BUILD).glob("ros/vendored_interfaces/*/rosidl_generator_type_description/*/*/*.json"))
        if not files:
            self.skipTest("the real packages are installed")
        hashes = {e["type_name"]: e["hash_string"] for f in files for e in json.loads(f.read_text())["type_hashes"]}
        self.assertEqual({name: hashes.get(name) for name in PUBLIC}, PUBLIC)


if __name__ == "__main__":
    unittest.main()
