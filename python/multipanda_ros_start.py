"""Run at each start of a Python that multipanda's wheel is installed in (multipanda_ros.pth).

With the extra `ros` it adds multipanda's messages, and keeps ROS 2 on this computer by default, as the program does
(ros/rcl/context.cpp). Without the extra it changes nothing.
"""

import os
import sys

TOLD_OTHERWISE = (
    "FASTDDS_BUILTIN_TRANSPORTS",
    "FASTDDS_DEFAULT_PROFILES_FILE",
    "FASTRTPS_DEFAULT_PROFILES_FILE",
    "ROS_AUTOMATIC_DISCOVERY_RANGE",
    "ROS_LOCALHOST_ONLY",
    "ROS_STATIC_PEERS",
    "ROS_DISCOVERY_SERVER",
)


def start() -> None:
    packages = os.path.dirname(os.path.abspath(__file__))
    # The extra's wheels put their libraries into lib/ of the environment.
    if not os.path.exists(os.path.join(packages, "..", "..", "librcl.so")):
        return
    messages = os.path.join(packages, "multipanda", "lib", "ros", "python")
    if messages not in sys.path:
        sys.path.append(messages)
    if not any(os.environ.get(name) for name in TOLD_OTHERWISE):
        profile = os.path.join(packages, "multipanda", "share", "multipanda", "ros", "rcl", "fastdds_loopback.xml")
        os.environ["FASTDDS_DEFAULT_PROFILES_FILE"] = profile
        os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "SYSTEM_DEFAULT"


start()
