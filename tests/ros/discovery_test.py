"""Tests who sees a run with --ros: discovery_test.py PROGRAM.

Each test has a network and shared memory of its own (namespaces), an ordinary ROS 2 client in an environment without
any variable, and looks at every socket with `ss`.
"""

import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import time
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]
SCENE = ROOT / "tests/ros/scene.yaml"
UNSHARE = ["unshare", *(["--map-root-user"] if os.getuid() else []), "--net", "--mount", "--ipc"]
FIRST_PORT = 7410  # of domain 0: 7400 + 10 for the metatraffic of participant 0, and 2 for each further one
WITHIN_S = 60.0  # for anything to happen; nothing below compares times of a busy machine
DISTINCT_TOPICS = {"/left/robot_state", "/right/robot_state", "/multipanda/loop_statistics"}


def without_ros_variables():
    """What a user has who has set nothing. The mark of the ROS wheels stays away, too."""
    return {k: v for k, v in os.environ.items() if not re.match(r"ROS_(?!LOG_DIR)|RMW_|FAST|_ROS|PYTHONSTARTUP", k)}


# --- Inside the namespaces ---


def sockets(pid):
    """(protocol, address, port) of each socket of a process."""
    found = []
    for protocol in ("udp", "tcp", "raw"):
        listing = subprocess.run(
            ["ss", "--no-header", "--numeric", "--all", "--processes", f"--{protocol}"],
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for line in listing.splitlines():
            if f"pid={pid}," in line:
                address, port = line.split()[3].rsplit(":", 1)
                found.append((protocol, address, port))
    return found


def packets_sent(interface):
    return int(pathlib.Path(f"/sys/class/net/{interface}/statistics/tx_packets").read_text())


def wait_for(predicate, what):
    end = time.monotonic() + WITHIN_S
    while time.monotonic() < end:
        value = predicate()
        if value:
            return value
        time.sleep(0.02)
    raise AssertionError(f"not within {WITHIN_S} s: {what}")


def occupy(count):
    """Takes the well-known ports of the participants 1 to count; returns the sockets."""
    import socket

    taken = []
    for number in range(1, count + 1):
        each = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        each.bind(("0.0.0.0", FIRST_PORT + 2 * number))
        taken.append(each)
    return taken


def inside(program, variables, occupied):
    """Starts a run and looks for it with rclpy; prints what was found as JSON. variables: the client's."""
    run = subprocess.Popen(
        [program, "run", str(SCENE), "--ros", "--no-timeline", "--json"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env=without_ros_variables(),
    )
    try:
        wait_for(lambda: sockets(run.pid) or run.poll() is not None, "sockets of the run")
        taken = occupy(occupied)
        # What .venv sets for its own Python is not what an ordinary client has.
        for name in [name for name in os.environ if re.match(r"ROS_(?!LOG_DIR)|RMW_|FAST", name)]:
            del os.environ[name]
        os.environ.update(variables)
        import rclpy
        from multipanda_msgs.msg import RobotState
        from multipanda_msgs.srv import ListControllets
        from rclpy.qos import qos_profile_sensor_data

        rclpy.init()
        node = rclpy.create_node("ordinary_client")
        begin = time.monotonic()
        wait_for(lambda: {n for n, _ in node.get_topic_names_and_types()} >= DISTINCT_TOPICS, "the run's topics")
        seconds = time.monotonic() - begin
        states = []
        node.create_subscription(RobotState, "/left/robot_state", states.append, qos_profile_sensor_data)
        wait_for(lambda: rclpy.spin_once(node, timeout_sec=0.05) or states, "a state of the left arm")
        calls = node.create_client(ListControllets, "/multipanda/list_controllets")
        wait_for(calls.service_is_ready, "a service of the run")
        answer = calls.call_async(ListControllets.Request())
        wait_for(lambda: rclpy.spin_once(node, timeout_sec=0.05) or answer.done(), "an answer of the run")
        found = {
            "run": sockets(run.pid),
            "client": sockets(os.getpid()),
            "seconds": seconds,
            "controllets": len(answer.result().controllets),
            "sent": {i: packets_sent(i) for i in os.listdir("/sys/class/net") if i != "lo"},
        }
        node.destroy_node()
        rclpy.shutdown()
        for each in taken:
            each.close()
        print(json.dumps(found))
    finally:
        run.terminate()
        error = run.communicate(timeout=WITHIN_S)[1]
        if run.returncode not in (0, 1):
            print(error, file=sys.stderr)


# --- The tests ---


class Discovery(unittest.TestCase):
    program = None

    @classmethod
    def setUpClass(cls):
        tried = subprocess.run([*UNSHARE, "true"], capture_output=True, text=True, check=False)
        if tried.returncode != 0:
            print(f"skipped: no network namespace can be made here ({tried.stderr.strip()})")
            sys.exit(77)

    def found(self, *network, variables=(), occupied=0):
        """What a client sees in a network that the commands `network` make."""
        code = "import sys; sys.path.insert(0, sys.argv[1]); import discovery_test as t, json;"
        code += " t.inside(sys.argv[2], json.loads(sys.argv[3]), int(sys.argv[4]))"
        commands = [
            "mount -t tmpfs none /dev/shm",
            "mount -t sysfs none /sys",
            "ip link set lo up",
            *network,
            'exec "$@"',
        ]
        arguments = [ROOT / ".venv/bin/python", "-c", code, pathlib.Path(__file__).parent, self.program]
        arguments += [json.dumps(dict(variables)), occupied]
        with tempfile.TemporaryDirectory() as home:
            result = subprocess.run(
                [*UNSHARE, "bash", "-ec", "\n".join(commands), "bash", *map(str, arguments)],
                capture_output=True,
                text=True,
                env={**without_ros_variables(), "ROS_LOG_DIR": home, "PYTHONPATH": os.environ.get("PYTHONPATH", "")},
                timeout=5 * WITHIN_S,
                check=False,
            )
        self.assertEqual(result.returncode, 0, result.stdout + result.stderr)
        return json.loads(result.stdout.splitlines()[-1])

    def assert_loopback_only(self, sockets):
        self.assertTrue([s for s in sockets if s[0] == "udp"], "no socket was found, nothing was checked")
        for protocol, address, port in sockets:
            self.assertRegex(address, r"^127\.|^\[::1\]$", f"{protocol} port {port}")

    def assert_seen(self, found):
        self.assertGreater(found["controllets"], 5)  # the service answered
        self.assert_loopback_only(found["run"])
        # The client is an ordinary one: by default it listens everywhere, so the check above can fail.
        self.assertTrue([s for s in found["client"] if not s[1].startswith("127.")])

    def test_a_client_without_any_variable_sees_a_run(self):
        self.assert_seen(self.found("ip link set lo multicast off"))

    def test_a_client_without_any_variable_sees_a_run_where_loopback_has_multicast(self):
        self.assert_seen(self.found("ip link set lo multicast on", "ip route add 224.0.0.0/4 dev lo"))

    CARD = (
        "ip link add card type veth peer name far",
        "sysctl -qw net.ipv6.conf.all.disable_ipv6=1 || true",
        "ip link set card addrgenmode none",
        "ip link set far addrgenmode none",
        "ip address add 10.9.9.1/24 dev card",
        "ip link set far up",
        "ip link set card up",
        "ip route add default via 10.9.9.2",
    )

    def test_with_a_network_card_sockets_stay_on_loopback(self):
        found = self.found(*self.CARD)
        self.assert_seen(found)
        self.assertGreater(found["sent"]["card"], 0)  # by the client: its multicast, so the next test can fail

    def test_run_and_client_of_this_project_send_nothing_through_a_card(self):
        profile = {
            "FASTDDS_DEFAULT_PROFILES_FILE": str(ROOT / "ros/rcl/fastdds_loopback.xml"),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT",
        }
        found = self.found(*self.CARD, variables=profile)
        self.assertEqual(found["sent"]["card"], 0)
        self.assert_loopback_only(found["run"])
        self.assert_loopback_only(found["client"])

    def test_the_thirty_second_participant_of_a_domain_still_sees_a_run(self):
        found = self.found("ip link set lo multicast off", occupied=30)
        self.assertIn(str(FIRST_PORT + 2 * 31), [port for _, _, port in found["client"]])
        self.assert_seen(found)


if __name__ == "__main__":
    Discovery.program = pathlib.Path(sys.argv.pop(1)).resolve()
    unittest.main()
