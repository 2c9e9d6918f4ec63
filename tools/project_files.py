"""The project's own files, for the checks in this folder."""

import os
import pathlib
import subprocess

ROOT = pathlib.Path(__file__).resolve().parent.parent
# Excluded if git is not available (an unpacked archive, a tree of another user).
GENERATED = {".git", ".venv", "runs", "__pycache__", "node_modules"}


def project_files(root=ROOT, suffixes=()):
    """Sorted paths of the files under `root` that git tracks or would track; all suffixes when none is given."""
    listing = (
        subprocess.run(
            ["git", "-C", str(root), "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
            capture_output=True,
            text=True,
            check=False,
        )
        if (root / ".git").exists()
        else None
    )
    if listing is not None and listing.returncode == 0:
        paths = [root / name for name in listing.stdout.split("\0") if name]
    else:
        paths = []
        for folder, subfolders, names in os.walk(root):
            subfolders[:] = [
                s
                for s in subfolders
                if s not in GENERATED and not (s.startswith("build") and pathlib.Path(folder) == root)
            ]
            paths += [pathlib.Path(folder) / name for name in names]
    return sorted(p for p in paths if p.is_file() and (not suffixes or p.suffix in suffixes))
