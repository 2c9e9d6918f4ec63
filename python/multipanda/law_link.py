"""Links the object file of a law to a library that the program loads, and keeps libraries in the user's cache."""

from __future__ import annotations

import contextlib
import importlib.util
import os
import pathlib
import shutil
import struct
import subprocess
import sys
import tempfile
from collections.abc import Iterator

from .errors import Error

_SYMBOLS = 2  # SHT_SYMTAB


def undefined_symbols(code: bytes) -> list[str]:
    """Names that an object file (ELF, 64 bit) needs from elsewhere.

    Raises:
        ValueError: It is not such a file.
    """
    if code[:5] != b"\x7fELF\x02":
        raise ValueError("expected an ELF object file of 64 bit")
    (start,) = struct.unpack_from("<Q", code, 0x28)
    size, count = struct.unpack_from("<HH", code, 0x3A)
    sections = [struct.unpack_from("<IIQQQQIIQQ", code, start + i * size) for i in range(count)]
    names = []
    for section in sections:
        if section[1] != _SYMBOLS:
            continue
        texts = sections[section[6]][4]
        for at in range(section[4], section[4] + section[5], section[9]):
            name, _, _, home, _, _ = struct.unpack_from("<IBBHQQ", code, at)
            text = code[texts + name : code.index(b"\0", texts + name)].decode()
            if home == 0 and text and text != "_GLOBAL_OFFSET_TABLE_":
                names.append(text)
    return names


def linker() -> list[str]:
    """The linker's command: the system's, or that of the wheel ziglang.

    Raises:
        Error: There is none; the text names the packages.
    """
    for name in ("ld", "ld.lld"):
        found = shutil.which(name)
        if found:
            return [found]
    if importlib.util.find_spec("ziglang") is not None:
        return [sys.executable, "-m", "ziglang", "ld.lld"]
    raise Error(
        "a law needs a linker to become a library, and this computer has none (no compiler is needed)",
        'pip install "multipanda[linker]" (the wheel ziglang), or apt-get install binutils',
    )


def link(code: bytes, path: pathlib.Path) -> None:
    """Links an object file to a library at `path`, written atomically.

    Raises:
        Error: There is no linker, or it failed.
    """
    command = linker()
    with temporary_beside(path) as made:
        source = made.with_suffix(".o")
        source.write_bytes(code)
        try:
            words = [*command, "-shared", "-z", "now", "-z", "relro", "-z", "noexecstack", "-s", "-o", str(made)]
            done = subprocess.run([*words, str(source)], capture_output=True, text=True, check=False, timeout=120)
        finally:
            source.unlink()
        if done.returncode != 0:
            raise Error(f"the linker {command[0]} failed: {done.stderr.strip()}", "install another linker (binutils)")
        os.replace(made, path)


@contextlib.contextmanager
def temporary_beside(path: pathlib.Path) -> Iterator[pathlib.Path]:
    """A file of another name in the same folder, removed at the end unless it was renamed."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix=f".{path.stem}-", suffix=path.suffix, dir=path.parent)
    os.close(handle)
    try:
        yield pathlib.Path(name)
    finally:
        pathlib.Path(name).unlink(missing_ok=True)


def cache_folder() -> pathlib.Path:
    """Folder of compiled laws: XDG_CACHE_HOME/multipanda/laws, by default in ~/.cache; only its owner writes there."""
    base = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    folder = pathlib.Path(base) / "multipanda" / "laws"
    folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    return folder
