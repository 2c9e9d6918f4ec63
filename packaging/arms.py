#!/usr/bin/env python3
"""Builds the program for arms alone, and its wheel: ./multipanda package --arms [--aarch64] (docs/install.md).

For 64-bit ARM it compiles on x86-64, with Debian's libraries for that processor in a folder of the build: they are
downloaded and unpacked there, and nothing is installed.
"""

import argparse
import os
import pathlib
import re
import shutil
import subprocess
import sys

sys.dont_write_bytecode = True
ROOT = pathlib.Path(__file__).resolve().parent.parent
# lld and QEMU, too, have to be installed: apt install lld qemu-user-static
DEBIAN = """libc6 libc6-dev linux-libc-dev libgcc-s1 libgcc-12-dev libstdc++6 libstdc++-12-dev
    libfmt9 libfmt-dev libyaml-cpp0.7 libyaml-cpp-dev libzstd1 libzstd-dev libgtest-dev libgmock-dev
    libeigen3-dev libcli11-dev nlohmann-json3-dev""".split()
WHEELS = ("cmeel-urdfdom", "cmeel-tinyxml2", "cmeel-console-bridge")


def call(*words, **options):
    done = subprocess.run([str(word) for word in words], check=False, **options)
    if done.returncode != 0:
        sys.exit(f"{' '.join(str(word) for word in words)} failed with code {done.returncode}")


def make_sysroot(folder):
    """The libraries for 64-bit ARM; apt keeps its lists and packages beside them, so this needs no root."""
    work = folder.with_suffix(".part")
    shutil.rmtree(work, ignore_errors=True)
    (work / "apt/lists/partial").mkdir(parents=True)
    (work / "apt/status").touch()
    apt = ["apt-get", "-q", "-o", "APT::Architecture=arm64", "-o", "APT::Architectures=arm64"]
    apt += [
        "-o",
        f"Dir::State={work}/apt",
        "-o",
        f"Dir::Cache={work}/apt",
        "-o",
        f"Dir::State::status={work}/apt/status",
    ]
    apt += ["-o", "APT::Sandbox::User="]
    call(*apt, "update", stdout=sys.stderr)
    call(*apt, "download", *DEBIAN, cwd=work / "apt", stdout=sys.stderr)
    for package in sorted((work / "apt").glob("*.deb")):
        call("dpkg-deb", "-x", package, work)
    pins = (ROOT / "requirements.txt").read_text()
    pinned = [re.search(rf"^{name}==\S+", pins, re.M).group() for name in WHEELS]
    pip = [ROOT / ".venv/bin/python", "-I", "-m", "pip", "--disable-pip-version-check", "--no-input"]
    call(
        *pip,
        "download",
        "--no-deps",
        "--only-binary=:all:",
        "--platform",
        "manylinux_2_28_aarch64",
        "-d",
        work / "apt",
        *pinned,
        stdout=sys.stderr,
    )
    for wheel in sorted((work / "apt").glob("*.whl")):
        shutil.unpack_archive(wheel, work, "zip")
    # A link from the root, such as libm.so, would be followed on this computer; the linker would then take libm.a.
    for link in work.rglob("*.so"):
        if link.is_symlink() and link.readlink().is_absolute():
            target = os.path.relpath(f"{work}{link.readlink()}", link.parent)
            link.unlink()
            link.symlink_to(target)
    shutil.rmtree(work / "apt")
    work.rename(folder)


def build(name, *targets):
    """Configures and builds the preset of this name; returns its folder."""
    folder = ROOT / f"build-{name}"
    if name == "arms-aarch64" and not (folder / "sysroot").exists():
        make_sysroot(folder / "sysroot")
    call("cmake", "--preset", name, cwd=ROOT, stdout=sys.stderr)
    call("cmake", "--build", "--preset", name, "--target", *targets, cwd=ROOT, stdout=sys.stderr)
    return folder


def main():
    parser = argparse.ArgumentParser(description="Makes the wheel of the program for arms alone, in dist/.")
    parser.add_argument(
        "--aarch64", action="store_true", help="for 64-bit ARM; needs the packages lld and qemu-user-static"
    )
    name = "arms-aarch64" if parser.parse_args().aarch64 else "arms"
    folder = build(name, "multipanda_packaged")
    call(sys.executable, "-B", ROOT / "packaging/make_packages.py", "--build", folder)


if __name__ == "__main__":
    main()
