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
# Of 64-bit ARM. lld and QEMU run here: apt install lld qemu-user-static
DEBIAN = """libc6 libc6-dev linux-libc-dev libgcc-s1 libgcc-12-dev libstdc++6 libstdc++-12-dev
    libfmt9 libfmt-dev libyaml-cpp0.7 libyaml-cpp-dev libzstd1 libzstd-dev libgtest-dev libgmock-dev
    libeigen3-dev libcli11-dev nlohmann-json3-dev"""
WHEELS = ("cmeel-urdfdom", "cmeel-tinyxml2", "cmeel-console-bridge")


def call(*words, **options):
    words = [str(word) for word in words]
    if code := subprocess.run(words, check=False, stdout=sys.stderr, **options).returncode:
        sys.exit(f"{' '.join(words)} failed with code {code}")


def make_sysroot(folder):
    """The libraries for 64-bit ARM; apt keeps its lists and packages beside them, so this needs no root."""
    work = folder.with_suffix(".part")
    shutil.rmtree(work, ignore_errors=True)
    apt = work / "apt"
    (apt / "lists/partial").mkdir(parents=True)
    (apt / "status").touch()
    settings = "APT::Architecture=arm64 APT::Architectures=arm64 APT::Sandbox::User="
    settings += f" Dir::State={apt} Dir::Cache={apt} Dir::State::status={apt}/status"
    get = ["apt-get", "-q", *(f"-o{setting}" for setting in settings.split())]
    call(*get, "update")
    call(*get, "download", *DEBIAN.split(), cwd=apt)
    pins = (ROOT / "requirements.txt").read_text()
    pinned = [re.search(rf"^{name}==\S+", pins, re.M).group() for name in WHEELS]
    pip = [ROOT / ".venv/bin/python", "-I", "-m", "pip", "--disable-pip-version-check", "--no-input", "download"]
    call(*pip, "--no-deps", "--only-binary=:all:", "--platform=manylinux_2_28_aarch64", "-d", apt, *pinned)
    for package in sorted(apt.glob("*.deb")):
        call("dpkg-deb", "-x", package, work)
    for wheel in sorted(apt.glob("*.whl")):
        shutil.unpack_archive(wheel, work, "zip")
    # A link from the root, such as libm.so, would be followed on this computer; the linker would then take libm.a.
    for link in work.rglob("*.so"):
        if link.is_symlink() and link.readlink().is_absolute():
            target = os.path.relpath(f"{work}{link.readlink()}", link.parent)
            link.unlink()
            link.symlink_to(target)
    shutil.rmtree(apt)
    work.rename(folder)


def build(name, *targets):
    """Configures and builds the preset of this name; returns its folder."""
    folder = ROOT / f"build-{name}"
    if name == "arms-aarch64" and not (folder / "sysroot").exists():
        make_sysroot(folder / "sysroot")
    call("cmake", "--preset", name, cwd=ROOT)
    call("cmake", "--build", "--preset", name, "--target", *targets, cwd=ROOT)
    return folder


def main():
    parser = argparse.ArgumentParser(description="Makes the wheel of the program for arms alone, in dist/.")
    parser.add_argument("--aarch64", action="store_true", help="for 64-bit ARM; needs Debian's lld, qemu-user-static")
    folder = build("arms-aarch64" if parser.parse_args().aarch64 else "arms", "multipanda_packaged")
    os.execv(sys.executable, [sys.executable, "-B", str(ROOT / "packaging/make_packages.py"), "--build", str(folder)])


if __name__ == "__main__":
    main()
