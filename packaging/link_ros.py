"""Lets the wheel's ROS 2 interfaces find the libraries of the extra `ros`: link_ros.py WHEEL OUT SITE_PACKAGES.

auditwheel removes search paths that lead out of the wheel, so this comes after it, in the same environment. pip puts
the ROS 2 libraries into ENV/lib, and those that their wheels have bundled into site-packages/ros_*.libs, of which
SITE_PACKAGES, an environment with the same wheels, shows the names.
"""

import pathlib
import subprocess
import sys

from auditwheel.wheeltools import InWheel

ROS = pathlib.Path("multipanda/lib/ros")


def search_path(file, bundled):
    """From the folder of a file, which is named from site-packages. RPATH and not RUNPATH: it serves what the named
    libraries need in their turn, too."""
    packages = "$ORIGIN/" + "/".join([".."] * (len(file.parts) - 1))
    inside = [f"{packages}/{folder}" for folder in (ROS, ROS.parent, "multipanda.libs")]
    return ":".join([*inside, f"{packages}/../..", *(f"{packages}/{name}" for name in bundled)])


def main():
    wheel, out, site_packages = map(pathlib.Path, sys.argv[1:])
    bundled = sorted(folder.name for folder in site_packages.glob("ros_*.libs"))
    with InWheel(wheel, out):  # the current folder; on exit, writes the list of files and their hashes
        for file in sorted(ROS.rglob("*.so")):
            subprocess.run(["patchelf", "--force-rpath", "--set-rpath", search_path(file, bundled), file], check=True)


if __name__ == "__main__":
    main()
