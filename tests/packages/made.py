"""The packages under test, their contents, and what is foreign to them."""

import atexit
import functools
import pathlib
import re
import shutil
import subprocess
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
FOLDER = pathlib.Path(tempfile.mkdtemp(prefix="mp-pkg-"))  # short: a socket's path has at most 107 bytes
OUT = FOLDER / "dist"
BUILD = ROOT / "build"  # packages_test.py sets it
atexit.register(shutil.rmtree, FOLDER, ignore_errors=True)


def wheel():
    (path,) = OUT.glob("multipanda-*.whl")
    return path


def deb():
    (path,) = OUT.glob("*.deb")
    return path


def output(*words, **options):
    done = subprocess.run([str(w) for w in words], capture_output=True, text=True, check=False, **options)
    if done.returncode != 0:
        raise AssertionError(f"{' '.join(map(str, words))}: code {done.returncode}\n{done.stdout}{done.stderr}")
    return done.stdout


@functools.cache
def unpacked():
    """The wheel's files, unpacked by nothing of ours."""
    folder = FOLDER / "unpacked"
    output("python3", "-m", "zipfile", "-e", wheel(), folder)
    return folder


@functools.cache
def unpacked_deb():
    folder = FOLDER / "deb"
    output("dpkg-deb", "-x", deb(), folder)
    return folder


def binaries(folder):
    """Programs and shared libraries below a folder."""
    found = []
    for path in sorted(folder.rglob("*")):
        if path.is_file() and not path.is_symlink():
            with path.open("rb") as file:
                found += [path] if file.read(4) == b"\x7fELF" else []
    return found


def dynamic(path, *tags):
    """Values of entries of the dynamic section, such as NEEDED."""
    found = re.findall(r"^\s+(\w+)\s+(\S+)$", output("objdump", "-p", path), re.M)
    return [value for tag, value in found if tag in tags]
