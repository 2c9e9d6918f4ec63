"""Each third-party library that is bundled or compiled in has its notice; derived here from the binaries and from the
headers that the compiler has read, not from the table of packaging/notices.py."""

import functools
import importlib.metadata
import pathlib
import re
import sys
import unittest

import made
from made import ROOT, output

sys.path.insert(0, str(ROOT / "packaging"))
from notices import COMPONENTS, canonical, is_of_page

# Part of every Linux, and compiled in under the runtime library exception; Python's interface, of which nothing but
# declarations is compiled in.
OF_THE_SYSTEM = re.compile(
    r"^(libc6|libpython3.*-dev|libc6-dev|linux-libc-dev|libstdc\+\+.*|libgcc.*|gcc-.*|libclang-common-.*)$"
)


@functools.cache
def site_packages():
    (folder,) = (made.BUILD / "share/multipanda-venv").resolve().glob("lib/python3*/site-packages")
    return folder


@functools.cache
def files_of_wheels():
    """Each file of .venv and the distribution that it came with."""
    owners = {}
    for found in importlib.metadata.distributions(path=[str(site_packages())]):
        for file in found.files or []:
            owners[str(file)] = canonical(found.metadata["Name"])
    return owners


@functools.cache
def files_of_debian():
    """Each file below /usr and /lib, and the Debian package that it came with."""
    owners = {}
    for listing in pathlib.Path("/var/lib/dpkg/info").glob("*.list"):
        package = listing.stem.split(":")[0]
        for line in listing.read_text().splitlines():
            owners[line] = package
            owners[f"/usr{line}"] = package  # /lib is a link to /usr/lib, but packages name either
    return owners


def owner(path):
    """The distribution or Debian package that a file belongs to."""
    path = pathlib.Path(path)
    path = path.parent.resolve() / path.name
    if path.is_relative_to(site_packages()):
        return files_of_wheels().get(str(path.relative_to(site_packages())))
    return files_of_debian().get(str(path)) or files_of_debian().get(str(path.resolve()))


@functools.cache
def bundled():
    """Owners of the shared libraries in the wheel; auditwheel has put a hash into their names."""
    folders = [site_packages() / "cmeel.prefix/lib", site_packages() / "mujoco", "/usr/lib/x86_64-linux-gnu"]
    found = {}
    for library in (made.unpacked() / "multipanda.libs").iterdir():
        name = re.sub(r"-[0-9a-f]{8}(?=\.so)", "", library.name)
        places = [pathlib.Path(folder) / name for folder in folders]
        found[library.name] = next((owner(p) for p in places if p.exists()), None)
    return found


@functools.cache
def compiled_in():
    """Owners of the headers outside this project that went into the program, and one header of each."""
    ninja = ["ninja", "-C", made.BUILD]
    inputs = output(*ninja, "-t", "inputs", "multipanda", "multipanda_native_core").splitlines()
    objects = [line for line in inputs if line.endswith(".o")]
    headers = set()
    for line in output(*ninja, "-t", "deps", *objects).splitlines():
        if line.startswith("    "):
            headers.add(line.strip())
    build = str(made.BUILD)
    copied = {f"{build}/eigen/": "/usr/include/eigen3/"}  # cmake/dependencies.cmake replaces one file in a copy
    owners = {}
    for header in sorted(headers):
        for copy, original in copied.items():
            header = header.replace(copy, original)
        path = pathlib.Path(header)
        if not path.is_absolute() or (path.is_relative_to(ROOT) and ".venv" not in path.parts) or build in header:
            continue
        owners.setdefault(owner(header) or f"nobody ({header})", header)
    return {who: header for who, header in owners.items() if not OF_THE_SYSTEM.match(who)}


@functools.cache
def in_page():
    """The npm packages that the bundler has read for the cockpit's page; none in a build without it."""
    listed = made.BUILD / "cockpit_page.packages"
    return [f"npm:{name}" for name in listed.read_text().split()] if listed.exists() else []


def beside():
    """Python distributions that programs of the packages bring along."""
    server = made.unpacked() / "multipanda/share/multipanda/cockpit/server"
    return sorted(folder.name for folder in server.iterdir() if folder.is_dir())


def without_notice(owners, components):
    covered = {name for component in components for name in component.covers}
    return sorted(who for who in owners if who not in covered)


class Notices(unittest.TestCase):
    def test_each_bundled_library_has_one(self):
        self.assertGreater(len(bundled()), 10)
        self.assertEqual([name for name, who in bundled().items() if who is None], [])
        self.assertEqual(without_notice(bundled().values(), COMPONENTS), [])

    def test_each_library_that_is_compiled_in_has_one(self):
        self.assertIn("libeigen3-dev", compiled_in())
        self.assertIn("libcli11-dev", compiled_in())
        self.assertEqual(without_notice(compiled_in(), COMPONENTS), [], compiled_in())

    def test_each_library_that_is_beside_a_program_has_one(self):
        self.assertEqual(beside(), ["websockets"])
        self.assertEqual(without_notice(beside(), COMPONENTS), [])

    def test_each_package_in_the_page_has_one(self):
        self.assertEqual(bool(in_page()), (made.BUILD / "cockpit_page/index.html").exists())
        self.assertEqual(without_notice(in_page(), COMPONENTS), [])

    def test_a_missing_row_is_found(self):
        for name in ("MuJoCo", "CLI11", *(["uPlot"] if in_page() else [])):
            fewer = [component for component in COMPONENTS if component.name != name]
            self.assertTrue(without_notice([*bundled().values(), *compiled_in(), *in_page()], fewer), name)

    def test_no_row_is_without_use(self):
        used = {*bundled().values(), *compiled_in(), *beside(), *in_page()}
        needed = [c for c in COMPONENTS if in_page() or not is_of_page(c)]
        self.assertEqual([c.name for c in needed if not used & set(c.covers)], [])

    def test_the_texts_are_in_both_packages(self):
        (folder,) = made.unpacked().glob("multipanda-*.dist-info/licenses")
        copyright_file = (made.unpacked_deb() / "usr/share/doc/multipanda/copyright").read_text()
        for component in COMPONENTS:
            if is_of_page(component) and not in_page():
                continue
            text = (folder / "licenses" / f"{canonical(component.name.replace(' ', '-'))}.txt").read_text()
            self.assertGreater(len(text), 300, component.name)
            self.assertRegex(text, r"(?i)copyright|public domain|boost software|'as-is'", component.name)
            self.assertIn(text.strip(), copyright_file)
        self.assertIn("Apache License", (folder / "LICENSE").read_text())
