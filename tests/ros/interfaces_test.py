"""All ROS interfaces of a run, as rclpy sees them: interfaces_test.py PROGRAM. Its tests share one run."""

import pathlib
import sys
import time
import unittest

import ros_run

PROGRAM = sys.argv.pop(1) if len(sys.argv) > 1 else ""
try:
    import multipanda_msgs.msg  # noqa: F401
    import rclpy  # noqa: F401
except ImportError as missing:
    print(f"skipped: this Python has no ROS interfaces of this build: {missing}")
    sys.exit(77)

from actions_cases import Gripper, Motions  # noqa: E402, F401
from inputs_cases import Inputs  # noqa: E402, F401
from ros_case import RosCase  # noqa: E402
from services_cases import ArmServices, ModeServices, Parameters, Simulation  # noqa: E402, F401
from topics_cases import Topics  # noqa: E402, F401


def begin():
    started = time.monotonic()
    RosCase.begin(PROGRAM)
    from multipanda_msgs.srv import ListArms
    RosCase.client.call(ListArms, "/multipanda/list_arms")
    print(f"up after {time.monotonic() - started:.1f} s", file=sys.stderr)


def end():
    """The run ends as asked, and leaves neither names in the graph nor files in shared memory."""
    run, client = RosCase.run_, RosCase.client
    mapped = run.shared_memory()
    assert mapped, "the run used no shared memory"
    # The tests provoked faults, so the run says that it failed (1); it must have ended by itself and on request.
    assert run.end() in (0, 1), "".join(run.said)[-3000:]
    assert (run.summary["ended_by"], run.summary["records_lost"]) == ("stopped", 0), run.summary

    def names():
        return [name for name in client.node.get_node_names() if name != "client"]
    ros_run.wait_for(lambda: not names(), f"an empty graph, but {names()}")
    topics = {name for name, _ in client.node.get_topic_names_and_types() if client.node.count_publishers(name) > 0}
    assert topics <= {"/rosout", "/parameter_events", *client.publishers}, topics
    client.close()
    # Ports of other domains are other people's.
    ports = {f"fastdds_port{7400 + 250 * run.domain + k}" for k in range(250)}
    left = {name for name in mapped if pathlib.Path("/dev/shm", name).exists() and (name in ports or "port" not in name)}
    assert not left, f"left in shared memory: {sorted(left)}"


if __name__ == "__main__":
    begin()
    try:
        tests = unittest.main(verbosity=2, exit=False)
    finally:
        end()
    sys.exit(not tests.result.wasSuccessful())
