"""What is in the packages: size, tag, libraries, and nothing of the computer that built them."""

import functools
import pathlib
import re
import subprocess
import unittest
import urllib.request
import zipfile
from email.parser import HeaderParser

import made
from made import BUILD, ROOT, binaries, dynamic, output

# What the manylinux standard expects of every Linux (PEP 600), as far as it is needed here, and Debian's package.
SYSTEM = {name: "libc6" for name in ("libc.so.6", "libm.so.6", "libpthread.so.0", "libdl.so.2", "librt.so.1")}
SYSTEM |= {"ld-linux-x86-64.so.2": "libc6", "libz.so.1": "zlib1g", "libstdc++.so.6": "libstdc++6"}
SYSTEM |= {"libgcc_s.so.1": "libstdc++6"}  # which depends on it

# What belongs to the extra `ros`; the .deb does not have it.
ROS = "multipanda/lib/ros"
OF_ROS = (f"{ROS}/", "multipanda/share/multipanda/ros/", "multipanda/share/multipanda/examples/ros/", "multipanda_ros")


def glibc_needed(path):
    versions = re.findall(r"GLIBC_(\d+)\.(\d+)", output("objdump", "-T", path))
    return max(((int(a), int(b)) for a, b in versions), default=(0, 0))


def normal(name):
    return re.sub(r"[-_.]+", "-", name).lower()


@functools.cache
def of_ros_wheels():
    """Libraries that the wheels of ROS 2 have put into lib/ of the build's environment, and of which distribution."""
    lib, (site_packages,) = ROOT / ".venv/lib", (ROOT / ".venv/lib").glob("python3.*/site-packages")
    found = {}
    for record in site_packages.glob("ros_*.dist-info/RECORD"):
        name, version = record.parent.name.removesuffix(".dist-info").rsplit("-", 1)
        for file in re.findall(r"^(?:\.\./)+(lib[^/,]+\.so[^/,]*),", record.read_text(), re.M):
            if (lib / file).exists():
                found[file] = f"{normal(name)}=={version}"
    return found


def required(extra):
    with zipfile.ZipFile(made.wheel()) as archive:
        (name,) = [n for n in archive.namelist() if n.endswith(".dist-info/METADATA")]
        metadata = HeaderParser().parsestr(archive.read(name).decode())
    return {line.split(";")[0].strip() for line in metadata.get_all("Requires-Dist") if f"extra == '{extra}'" in line}


class CockpitPage(unittest.TestCase):
    @unittest.skipUnless(
        (BUILD / "cockpit_page/index.html").exists(), "this build has no page: it was made without Node"
    )
    def test_the_program_of_the_wheel_serves_it(self):
        page = pathlib.Path("multipanda/share/multipanda/cockpit_page")
        files = sorted(path.name for path in (made.unpacked() / page).iterdir())
        self.assertIn("index.html", files)
        in_deb = made.unpacked_deb() / "usr/lib/python3/dist-packages" / page
        self.assertEqual(sorted(path.name for path in in_deb.iterdir()), files)
        self.assertLessEqual(sum(path.stat().st_size for path in in_deb.iterdir()), 1_000_000)
        program = made.unpacked() / "multipanda/bin/multipanda"
        for path in (program, *program.parent.iterdir()):
            path.chmod(0o755)
        words = [program, "run", "one_arm", "--no-timeline", "--cockpit", "0", "--until-input-ends"]
        with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as run:
            address = next((line.strip() for line in run.stdout if line.startswith("http://")), "")
            try:
                with urllib.request.urlopen(address.partition("#")[0], timeout=30) as answer:
                    self.assertIn(b"<html", answer.read())
            finally:
                run.stdin.close()
                run.stdout.read()


class LerobotWheels(unittest.TestCase):
    def test_each_has_the_name_that_lerobot_imports_and_nothing_else(self):
        for kind in ("robot", "teleoperator"):
            name = f"lerobot_{kind}_multipanda"
            (path,) = made.OUT.glob(f"{name}-*.whl")
            with zipfile.ZipFile(path) as archive:
                files = {file for file in archive.namelist() if ".dist-info/" not in file}
                (about,) = [file for file in archive.namelist() if file.endswith(".dist-info/METADATA")]
                metadata = HeaderParser().parsestr(archive.read(about).decode())
            self.assertEqual(files, {f"{name}/{part}.py" for part in ("__init__", "config_multipanda", "multipanda")})
            self.assertEqual(metadata["Name"], name)  # not lerobot-robot-multipanda: LeRobot imports this text
            self.assertEqual(metadata["Version"], made.wheel().name.split("-")[1])
            needed = {re.match(r"[\w.-]+", line).group() for line in metadata.get_all("Requires-Dist")}
            self.assertEqual(needed, {"lerobot", "numpy"})


class Wheel(unittest.TestCase):
    def test_size(self):
        self.assertLess(made.wheel().stat().st_size, 31e6)

    def test_the_tag_names_the_glibc_that_is_needed(self):
        a, b = re.search(r"-py3-none-manylinux_(\d+)_(\d+)_x86_64\.whl$", made.wheel().name).groups()
        needed = max(map(glibc_needed, binaries(made.unpacked())))
        self.assertLessEqual(needed, (int(a), int(b)))

    def test_every_library_is_inside_or_of_the_system(self):
        files = binaries(made.unpacked())
        self.assertGreater(len(files), 10)
        inside = {path.name for path in files}
        for path in files:
            with self.subTest(file=path.name):
                outside = set(dynamic(path, "NEEDED")) - inside - set(SYSTEM)
                if str(path.relative_to(made.unpacked())).startswith(ROS):
                    outside -= of_ros_wheels().keys()
                self.assertEqual(outside, set())
                for folders in dynamic(path, "RPATH", "RUNPATH"):
                    for folder in folders.split(":"):
                        self.assertRegex(folder, r"^\$ORIGIN")

    def test_no_path_of_this_computer_is_inside(self):
        foreign = {str(ROOT), str(ROOT.resolve()), str(BUILD), str(made.BUILD), str(made.FOLDER)}
        foreign = {path.encode() + b"/" for path in foreign}
        for tree in (made.unpacked(), made.unpacked_deb()):
            for path in sorted(tree.rglob("*")):
                if path.is_file():
                    text = path.read_bytes()
                    self.assertEqual([f for f in foreign if f in text], [], path.relative_to(tree))

    def test_versions_agree(self):
        version = re.search(r"project\(multipanda VERSION ([\d.]+)", (ROOT / "CMakeLists.txt").read_text()).group(1)
        self.assertTrue(made.wheel().name.startswith(f"multipanda-{version}-"), made.wheel().name)
        self.assertEqual(made.deb().name, f"multipanda_{version}_amd64.deb")

    def test_extras_name_published_distributions(self):
        """Each has a pin with hashes, which only a published distribution has."""
        pinned = set()
        for name in ("requirements.txt", "requirements-more.txt", "requirements-ros.txt", "requirements-linker.txt"):
            pinned |= set(re.findall(r"^([\w.-]+)==", (ROOT / name).read_text(), re.M))
        pinned = {normal(name) for name in pinned}
        for extra in ("report", "law", "linker"):
            self.assertTrue(required(extra), extra)
        for line in required("report") | required("law") | required("linker") | required("ros"):
            self.assertIn(normal(re.match(r"[\w.-]+", line).group()), pinned, line)

    def test_the_extra_ros_is_what_the_module_was_linked_with(self):
        """Every library that lib/ros needs, and that those need, is in a distribution of the extra, same version."""
        libraries, seen = of_ros_wheels(), set()
        lib = ROOT / ".venv/lib"
        open_ones = binaries(made.unpacked() / ROS)
        self.assertGreater(len(open_ones), 10)
        while open_ones:
            for name in dynamic(open_ones.pop(), "NEEDED"):
                if name in libraries and name not in seen:
                    seen.add(name)
                    open_ones.append(lib / name)
        self.assertIn("librcl.so", seen)
        self.assertLessEqual({libraries[name] for name in seen}, required("ros"))
        available = set(libraries.values())
        self.assertLessEqual(
            {line for line in required("ros") if "rclpy" not in line and "-msgs" not in line}, available
        )


class Deb(unittest.TestCase):
    def test_has_what_the_wheel_has(self):
        ours = made.unpacked_deb() / "usr/lib/python3/dist-packages"
        for path in sorted(made.unpacked().rglob("*")):
            inner = path.relative_to(made.unpacked())
            if path.is_file() and not inner.parts[0].endswith(".dist-info") and not str(inner).startswith(OF_ROS):
                self.assertEqual((ours / inner).read_bytes(), path.read_bytes(), inner)
        for link in ("usr/bin/multipanda", "usr/lib/cmake/multipanda/multipandaConfig.cmake"):
            self.assertTrue((made.unpacked_deb() / link).exists(), link)

    def test_has_nothing_of_ros(self):
        ours = made.unpacked_deb() / "usr/lib/python3/dist-packages"
        names = [str(path.relative_to(ours)) for path in ours.rglob("*") if path.is_file()]
        self.assertEqual([name for name in names if name.startswith(OF_ROS)], [])

    def test_depends_on_the_system_s_libraries_only(self):
        depends = output("dpkg-deb", "-f", made.deb(), "Depends")
        self.assertRegex(depends, r"^libc6 \(>= 2\.\d+\), libstdc\+\+6 \(>= \d+\), ")
        needed = {name for path in binaries(made.unpacked_deb()) for name in dynamic(path, "NEEDED")}
        packages = {SYSTEM[name] for name in needed if name in SYSTEM}
        self.assertEqual(packages, {word.split()[0] for word in depends.split(",")})
        self.assertEqual(output("dpkg-deb", "-f", made.deb(), "Architecture").strip(), "amd64")

    def test_its_program_runs_where_it_lies(self):
        program = made.unpacked_deb() / "usr/bin/multipanda"
        here = {"env": {"PATH": "/usr/bin:/bin"}, "cwd": made.FOLDER}
        self.assertIn("two_arms", output(program, "list", "scenes", **here))
        words = "--arms 2 --model fr3 --hand none --mount duo --use both --name of_deb".split()
        self.assertIn("next: multipanda run of_deb.yaml", output(program, "new", "scene", *words, **here))
