"""Third-party software in the packages, and where its notice is.

A row covers Python distributions (wheels of .venv) and Debian packages whose libraries or headers end up in the program
or beside it, and npm packages that are bundled into the cockpit's page. tests/packages/notices_complete.py derives
these from the linked libraries, the included headers and the bundler's list, and fails if one has no row. A notice is
taken from the installed package, so that it belongs to the version that is bundled; the wheels that carry none have
theirs in packaging/licenses.
"""

import importlib.metadata
import pathlib
import re
from typing import NamedTuple

HERE = pathlib.Path(__file__).resolve().parent
COMMON = pathlib.Path("/usr/share/common-licenses")


class Component(NamedTuple):
    name: str
    sources: tuple  # "wheel:NAME", "npm:NAME", "debian:NAME" (its copyright file), "file:NAME" (in packaging/licenses)
    covers: tuple  # distributions, Debian packages, "npm:NAME"


COMPONENTS = (
    Component("assimp", ("file:assimp.txt",), ("cmeel-assimp",)),
    Component("Boost", ("file:boost.txt",), ("cmeel-boost",)),
    Component("CLI11", ("debian:libcli11-dev",), ("libcli11-dev",)),
    Component("coal", ("wheel:libcoal",), ("libcoal",)),
    Component("console_bridge", ("file:console_bridge.txt",), ("cmeel-console-bridge",)),
    Component("Eigen", ("debian:libeigen3-dev",), ("libeigen3-dev",)),
    Component("fmt", ("debian:libfmt-dev",), ("libfmt-dev", "libfmt9", "libfmt8")),
    Component("JSON for Modern C++", ("debian:nlohmann-json3-dev",), ("nlohmann-json3-dev",)),
    Component("MuJoCo", ("wheel:mujoco-core",), ("mujoco-core",)),
    Component("nanobind", ("wheel:nanobind",), ("nanobind",)),
    Component("OctoMap", ("file:octomap.txt",), ("cmeel-octomap",)),
    Component("Pinocchio", ("wheel:libpinocchio",), ("libpinocchio",)),
    Component("Qhull", ("wheel:cmeel-qhull",), ("cmeel-qhull",)),
    Component("stb", ("debian:libstb-dev",), ("libstb-dev",)),
    Component("three.js", ("npm:three",), ("npm:three",)),
    Component("TinyXML-2", ("file:tinyxml2.txt",), ("cmeel-tinyxml2",)),
    Component("uPlot", ("npm:uplot",), ("npm:uplot",)),
    Component("urdfdom", ("file:urdfdom.txt",), ("cmeel-urdfdom", "cmeel-urdfdom-headers")),
    Component("websockets", ("wheel:websockets",), ("websockets",)),
    Component("yaml-cpp", ("debian:libyaml-cpp-dev",), ("libyaml-cpp-dev", "libyaml-cpp0.7", "libyaml-cpp0.8")),
    Component("Zstandard", ("debian:libzstd1",), ("libzstd1", "libzstd-dev")),
)

# What the wheel for arms alone contains.
OF_ARMS = """Boost CLI11 console_bridge Eigen fmt Pinocchio TinyXML-2 urdfdom yaml-cpp Zstandard""".split() + [
    "JSON for Modern C++"
]


def canonical(name):
    return re.sub(r"[-_.]+", "-", name).lower()


def debian_notice(package):
    path = pathlib.Path("/usr/share/doc") / package / "copyright"
    text = path.read_text(encoding="utf-8", errors="replace")
    # These texts are part of Debian only.
    for name in sorted(set(re.findall(rf"{COMMON}/([\w.-]*\w)", text))):
        if (COMMON / name).exists():
            text += f"\n==== {name}\n\n" + (COMMON / name).read_text(encoding="utf-8", errors="replace")
    return text


def wheel_notice(name, site_packages):
    for found in importlib.metadata.distributions(path=[str(site_packages)]):
        if canonical(found.metadata["Name"]) == canonical(name):
            files = [file for file in found.files or [] if ".dist-info/licenses/" in str(file)]
            return "\n".join(
                pathlib.Path(file.locate()).read_text(encoding="utf-8", errors="replace") for file in sorted(files)
            )
    raise FileNotFoundError(f"{name} is not installed in {site_packages}")


def notice(source, site_packages):
    kind, _, name = source.partition(":")
    if kind == "file":
        return (HERE / "licenses" / name).read_text(encoding="utf-8")
    if kind == "npm":
        text = (HERE.parent / "cockpit/page/node_modules" / name / "LICENSE").read_text(encoding="utf-8")
    else:
        text = debian_notice(name) if kind == "debian" else wheel_notice(name, site_packages)
    if len(text) < 200:
        raise ValueError(f"the notice of {source} is empty; put its text into packaging/licenses")
    return text


def is_of_page(component):
    return all(source.startswith("npm:") for source in component.sources)


def write_notices(folder, site_packages, with_page=True, of=None):
    """Writes one file for each component, or each in `of`; without the cockpit's page none for its bundled packages."""
    folder.mkdir(parents=True)
    for component in COMPONENTS:
        if is_of_page(component) and not with_page or of and component.name not in of:
            continue
        text = "\n".join(notice(source, site_packages).strip() + "\n" for source in component.sources)
        name = canonical(component.name.replace(" ", "-"))
        (folder / f"{name}.txt").write_text(f"{component.name}\n\n{text}", encoding="utf-8")
