"""A run of the program with --ros, and a client of it, for tests.

Uses its own domain and shared memory only, and leaves nothing behind.
"""

import collections
import json
import os
import pathlib
import re
import signal
import subprocess
import threading
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
SHARED_MEMORY = pathlib.Path("/dev/shm")


def environment(domain):
    """Returns an environment that keeps a test's ROS apart from others."""
    return {
        **os.environ,
        "ROS_DOMAIN_ID": str(domain),
        "FASTDDS_BUILTIN_TRANSPORTS": "SHM",
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT",
    }


def own_domain(number=0):
    """Returns a domain for this process: 1 to 100."""
    return 1 + (os.getpid() * 3 + number) % 100


class Run:
    """with Run(program, scene) as run: ...; afterwards run.summary is the program's summary of the run."""

    def __init__(self, program, scene, *options, domain=None, ros=True):
        self.command = [str(program), "run", str(scene), "--json", *(["--ros"] if ros else []), *options]
        self.domain, self.summary, self.output = domain, None, []

    def __enter__(self):
        self.started = time.monotonic()
        self.process = subprocess.Popen(
            self.command,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=ROOT,
            env=environment(self.domain),
        )
        self.reader = threading.Thread(target=lambda: self.output.extend(self.process.stderr), daemon=True)
        self.reader.start()
        return self

    def alive(self):
        return self.process.poll() is None

    def shared_memory(self):
        """Returns the files of Fast DDS that the program has open."""
        maps = pathlib.Path(f"/proc/{self.process.pid}/maps").read_text()
        return set(re.findall(r"/dev/shm/(fastdds_\S+)", maps))

    def end(self, number=signal.SIGINT):
        """Returns the exit code. Kills a run that hangs, which is an error."""
        if self.alive():
            self.process.send_signal(number)
        try:
            out = self.process.communicate(timeout=20)[0] if not self.reader.is_alive() else self._output()
        finally:
            if self.alive():
                self.process.kill()
                self.process.wait()
        lines = [line for line in out.splitlines() if line.startswith("{")]
        self.summary = json.loads(lines[-1]) if lines else None
        return self.process.returncode

    def _output(self):
        out = self.process.stdout.read()
        self.process.wait(20)
        self.reader.join(5)
        for stream in (self.process.stdout, self.process.stderr):
            stream.close()
        return out

    def __exit__(self, *_):
        if self.summary is None:
            self.end()


def wait_for(predicate, what, timeout=30.0):
    """Waits until predicate() is true, and returns it."""
    end = time.monotonic() + timeout
    while time.monotonic() < end:
        value = predicate()
        if value:
            return value
        time.sleep(0.005)
    value = predicate()
    assert value, f"not within {timeout} s: {what}"
    return value


class Topic:
    """The newest messages of a topic, and the number of all messages."""

    def __init__(self, node, message_type, name, qos, keep):
        self.messages, self.count, self.arrived = collections.deque(maxlen=keep), 0, None
        self.name = name
        self.subscription = node.create_subscription(message_type, name, self._take, qos)

    def _take(self, message):
        self.messages.append(message)
        self.count += 1
        self.arrived = time.monotonic()

    def newest(self):
        return self.messages[-1] if self.messages else None

    def next(self, count=1, timeout=30.0):
        """Returns the newest message once `count` more have arrived."""
        begin = self.count
        wait_for(lambda: self.count >= begin + count, f"{count} messages on {self.name}", timeout)
        return self.messages[-1]

    def wait(self, predicate, what, timeout=30.0):
        """Returns the first kept message for which predicate is true."""
        return wait_for(
            lambda: next((m for m in list(self.messages) if predicate(m)), None), f"{what} on {self.name}", timeout
        )


class Client:
    """An rclpy node with a thread that spins it."""

    def __init__(self, domain, name="client"):
        os.environ.update(environment(domain))
        import rclpy  # after the environment is set
        from rclpy.executors import SingleThreadedExecutor

        self.rclpy = rclpy
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = rclpy.create_node(name, context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.closing = False
        self.thread = threading.Thread(target=self._spin, daemon=True)
        self.thread.start()
        self.topics, self.services, self.publishers, self.actions = {}, {}, {}, {}

    def _spin(self):
        try:
            self.executor.spin()
        except Exception:  # rclpy's own threads use what close() has destroyed already
            if not self.closing:
                raise

    def made(self, make, *arguments, **options):
        """Calls make() in the spinning thread, since rclpy's executor must not see half-made entities."""
        future = self.executor.create_task(lambda: make(*arguments, **options))
        wait_for(future.done, f"{make.__name__} in the spinning thread")
        return future.result()

    def close(self):
        self.closing = True
        self.executor.shutdown()
        self.thread.join(5)
        for client in self.actions.values():
            client.destroy()
        self.node.destroy_node()
        self.rclpy.shutdown(context=self.context)

    def topic(self, message_type, name, latched=False, keep=200, best_effort=False):
        """Subscribes; best_effort is for messages faster than Python reads, so that no publisher waits."""
        from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

        key = name, latched
        if key not in self.topics:
            qos = QoSProfile(depth=max(keep, 50))
            if latched:
                qos.durability = DurabilityPolicy.TRANSIENT_LOCAL
            if best_effort:
                qos.reliability = ReliabilityPolicy.BEST_EFFORT
            self.topics[key] = self.made(Topic, self.node, message_type, name, qos, keep)
        return self.topics[key]

    def forget(self, *topics):
        for key, topic in list(self.topics.items()):
            if topic in topics:
                self.made(self.node.destroy_subscription, topic.subscription)
                del self.topics[key]

    def publisher(self, message_type, name, best_effort=False):
        from rclpy.qos import QoSProfile, ReliabilityPolicy

        if name not in self.publishers:
            qos = QoSProfile(depth=10)
            if best_effort:
                qos.reliability = ReliabilityPolicy.BEST_EFFORT
            publisher = self.made(self.node.create_publisher, message_type, name, qos)
            self.publishers[name] = publisher
            wait_for(lambda: publisher.get_subscription_count() > 0, f"a subscriber of {name}")
        return self.publishers[name]

    def call(self, service_type, name, request=None, timeout=30.0, **fields):
        """Returns the response of a service."""
        if name not in self.services:
            self.services[name] = self.made(self.node.create_client, service_type, name)
            assert self.services[name].wait_for_service(timeout), f"there is no service {name}"
        future = self.services[name].call_async(request or service_type.Request(**fields))
        wait_for(future.done, f"answer of {name}", timeout)
        return future.result()

    def send_goal(self, action_type, name, goal, feedback=None, timeout=30.0):
        """Sends a goal and returns its handle."""
        from rclpy.action import ActionClient

        new = name not in self.actions
        if new:
            self.actions[name] = self.made(ActionClient, self.node, action_type, name)
            assert self.actions[name].wait_for_server(timeout), f"there is no action {name}"

        def answer():
            future = self.actions[name].send_goal_async(goal, feedback_callback=feedback)
            return wait_for(lambda: future.done() and future.result(), f"answer of {name}", timeout)

        # The middleware drops the answer to a client whose reader the server has not discovered yet, which the client
        # cannot see. A client that has heard one loses none.
        try:
            return answer()
        except AssertionError:
            if not new:
                raise
            return answer()

    def result(self, handle, timeout=60.0):
        """Returns (status, result) of a goal; status as in action_msgs/GoalStatus."""
        future = handle.get_result_async()
        wait_for(future.done, "the goal's result", timeout)
        return future.result().status, future.result().result

    def cancel(self, handle, timeout=30.0):
        future = handle.cancel_goal_async()
        wait_for(future.done, "answer to a cancel", timeout)
        return len(future.result().goals_canceling)
