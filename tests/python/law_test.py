#!/usr/bin/env python3
"""Laws in Python: their torques against Python and against multipanda's own, and every use that is refused."""

import ctypes
import importlib.util
import inspect
import json
import math
import os
import pathlib
import subprocess
import sys
import textwrap
import types
import unittest
from unittest import mock

import harness  # first: it sets the paths
import multipanda as mp
import numpy as np
from harness import FOLDER, PATIENCE, ROOT, until
from multipanda import law_layout, law_link, law_math
from multipanda.law_math import add_product, add_transposed_product, rotation_error

os.environ["XDG_CACHE_HOME"] = str(FOLDER / "cache")
NUMBA = importlib.util.find_spec("numba") is not None
needs_numba = unittest.skipUnless(NUMBA, "Numba is not installed: pip install 'multipanda[law]'")

GAIN = 3
WEIGHTS = np.array([1.0, 0.5, 0.25])
NAMES = ["a list"]


def clamp(value, most):
    return max(-most, min(most, value))


@mp.law(
    inputs={"pose": "pose", "posture": "joints", "push": "wrench", "share": "scalar"},
    parameters={
        "stiffness": mp.LawParameter([300, 300, 300, 20, 20, 20], 0, 2000, size=6, unit="N/m, N m/rad"),
        "posture_nm_per_rad": mp.LawParameter(5, 0, 20, unit="N m/rad", size="joints"),
        "damping_nms_per_rad": mp.LawParameter(1, 0, 5, unit="N m s/rad"),
    },
    outputs={"force": 6, "ticks": 1},
    memory={"integral": "joints", "ticks": 1, "wrench": 6},
)
def everything(arm, inputs, parameters, outputs, memory, contact, dt, time_s, tau):
    """All that a law can use."""
    e = rotation_error(inputs.pose.R, arm.R_WE)
    for k in range(3):
        memory.wrench[k] = parameters.stiffness[k] * (inputs.pose.p[k] - arm.p_WE[k])
        memory.wrench[3 + k] = parameters.stiffness[3 + k] * e[k]
    for k, f in enumerate(inputs.push):
        memory.wrench[k] += inputs.share * (f + arm.F_K_W_est[k]) + inputs.pose.V[k] - arm.V_WE[k] + inputs.pose.A[k]
        memory.wrench[k] = clamp(memory.wrench[k], contact.spring_force)
        outputs.force[k] = memory.wrench[k]
    add_transposed_product(arm.J_V_WE, memory.wrench, tau)
    add_product(arm.M, inputs.posture.ddq, tau)
    for i in range(len(tau)):
        error = inputs.posture.q[i] - arm.q[i]
        memory.integral[i] = clamp(memory.integral[i] + error * dt, 1.0)
        tau[i] += arm.c[i] + parameters.posture_nm_per_rad[i] * error + GAIN * memory.integral[i]
        tau[i] += parameters.damping_nms_per_rad * (inputs.posture.dq[i] - arm.dq[i])
        tau[i] += WEIGHTS[i % 3] * math.sin(time_s) * (arm.tau_J[i] - arm.g[i] - arm.tau_ext_hat[i])
    memory.ticks[0] += 1
    outputs.ticks[0] = memory.ticks[0]


@everything.start
def begin(arm, memory):
    memory.ticks[0] = 100 * arm.q[0]


@mp.law(
    inputs={"joints": "joints"},
    parameters={
        "stiffness_nm_per_rad": mp.LawParameter([600, 600, 600, 600, 250, 150, 50], 0, 1000, size="joints"),
        "damping_nms_per_rad": mp.LawParameter([2, 2, 2, 1, 1, 1, 0.5], 0, 50, size="joints"),
    },
)
def impedance(arm, inputs, parameters, tau):
    """The law of joint_impedance with damping_design 'given', without the bound for contact."""
    add_product(arm.M, inputs.joints.ddq, tau)
    for i in range(len(tau)):
        tau[i] += parameters.stiffness_nm_per_rad[i] * (inputs.joints.q[i] - arm.q[i]) + arm.c[i]
        tau[i] += parameters.damping_nms_per_rad[i] * (inputs.joints.dq[i] - arm.dq[i])


@mp.law(parameters={"fault": mp.LawParameter(0, 0, 3), "place": mp.LawParameter(0, 0, 100)})
def breaks(arm, parameters, tau):
    """A damper that fails on request; the trial does not find it, because a value between is none."""
    for i in range(len(tau)):
        tau[i] = -arm.dq[i]
    if parameters.fault == 1:
        tau[0] = math.nan
    if parameters.fault == 2:
        tau[int(parameters.place)] = 0.0
    if parameters.fault == 3:
        raise ValueError("fault")


@mp.law(arms=2, inputs={"a": mp.LawInput("joints"), "b": mp.LawInput("joints", arm=1)}, outputs={"sum_nm": 1})
def pair(arms, inputs, outputs, tau):
    for i in range(len(tau[0])):
        tau[0][i] = 5.0 * (inputs.a.q[i] - arms[0].q[i]) - arms[1].dq[i]
        tau[1][i] = 7.0 * (inputs.b.q[i] - arms[1].q[i]) - arms[0].dq[i]
        outputs.sum_nm[0] += tau[0][i] + tau[1][i]


def line_of(function, marker="# HERE"):
    lines, first = inspect.getsourcelines(function)
    (place,) = [first + k for k, line in enumerate(lines) if line.rstrip().endswith(marker)]
    return f"{__file__}:{place}"


@needs_numba
def limited(M, K, most, least=-np.inf):
    """K with its modes, the eigenvalues of (K, M), within bounds."""
    L = np.linalg.cholesky(M)
    modes, U = np.linalg.eigh(np.linalg.solve(L, np.linalg.solve(L, K).T))
    return L @ U @ np.diag(np.clip(modes, least, most)) @ (L @ U).T


class Torques(unittest.TestCase):
    def replay(self, law, count, seed):
        """Samples of the program, by the native code of this process and by the Python function."""
        samples = law.samples(count, seed=seed)
        self.assertEqual(len(samples), count)
        memories = [None, None]
        for sample in samples:
            state = {key: sample[key] for key in ("inputs", "parameters", "dt", "time_s")}
            arms, made = sample["arms"], []
            expected = np.array([arm["tau"] for arm in arms])
            scale = 1 + np.abs(expected).max()
            for k, compiled in enumerate((True, False)):
                if sample["started"]:
                    memories[k] = None
                    if "start" in law._functions:
                        memories[k] = law.evaluate(arms, **state, compiled=compiled, start=True).memory
                found = law.evaluate(arms, **state, compiled=compiled, memory=memories[k])
                memories[k] = found.memory
                made.append(found)
                tau = np.atleast_2d(np.asarray(found.tau))
                self.assertLess(np.abs(tau - expected).max() / scale, 1e-12)
                outputs = np.concatenate([*found.outputs.values()]) if found.outputs else np.zeros(0)
                np.testing.assert_allclose(outputs, sample["outputs"], rtol=1e-11, atol=1e-11)
        return samples

    def test_the_program_the_native_code_and_python_agree(self):
        samples = self.replay(everything, 150, 7)
        self.assertEqual([s["state"] for s in samples if s["started"]], [0, 100])
        self.assertGreater(np.std([s["arms"][0]["q"] for s in samples]), 0.5)
        self.replay(pair, 50, 2)

    def test_the_law_of_joint_impedance(self):
        """Against multipanda's own, on the same states: the program draws them from the same seed."""
        done = subprocess.run(
            [os.environ["MULTIPANDA_PROGRAM"], "law", "--type", "joint_impedance", "--json", "--samples", "200"]
            + ["--states", "200", "--repeats", "1", "--most-us", "1e6"],
            capture_output=True, text=True, timeout=PATIENCE, check=True,
        )  # fmt: skip
        seen, before = set(), None
        for sample in json.loads(done.stdout)["laws"][0]["samples"]:
            given = sample["parameters"]
            (arm,) = sample["arms"]
            dq = np.array(arm["dq"])
            if sample["started"]:
                before = dq
            before = dq + (1 - given["velocity_weight"][0]) * (before - dq)
            design, ahead = int(given["damping_design"][0]), given["acceleration_feedforward"][0]
            seen.add((design, ahead))
            if design != 2 or ahead != 1 or given["damping_of"][0] != 0:
                continue
            values = {name: given[name] for name in impedance.declaration.parameters}
            tau = impedance.evaluate(arm, inputs=sample["inputs"], parameters=values).tau
            # The program softens and damps what the arm would not bear (damping_design.hpp); D sees filtered velocity.
            M, K, D = np.array(arm["M"]), np.diag(given["stiffness_nm_per_rad"]), np.diag(given["damping_nms_per_rad"])
            soft, damped = limited(M, K, 150.0**2), limited(M, D, 500.0)
            damped = damped + limited(M, 0.01 * soft - damped, np.inf, 0.0)
            desired = sample["inputs"]["joints"]
            tau = tau + (soft - K) @ (np.array(desired["q"]) - arm["q"])
            tau = tau + damped @ (np.array(desired["dq"]) - before) - D @ (np.array(desired["dq"]) - dq)
            np.testing.assert_allclose(tau, arm["tau"], rtol=1e-9, atol=1e-9)
        self.assertIn((2, 1.0), seen)

    def test_a_spring_is_the_gradient_of_its_energy(self):
        rng = np.random.default_rng(3)
        potential = lambda q, k, q_d: 0.5 * np.sum(k * (q_d - q) ** 2)  # noqa: E731
        for _ in range(20):
            q, q_d, k = rng.uniform(-1, 1, 7), rng.uniform(-1, 1, 7), rng.uniform(0, 1000, 7)
            tau = impedance.evaluate(
                {"q": q, "M": np.eye(7)}, inputs={"joints": q_d}, parameters={"stiffness_nm_per_rad": k}
            ).tau
            h = 1e-5
            slope = [(potential(q + h * e, k, q_d) - potential(q - h * e, k, q_d)) / (2 * h) for e in np.eye(7)]
            np.testing.assert_allclose(tau, -np.array(slope), rtol=1e-7, atol=1e-7)

    def test_the_number_of_joints_comes_with_the_arm(self):
        for n in (1, 6, 7, 16):
            q = np.linspace(-1, 1, n)
            for compiled in (True, False):
                tau = impedance.evaluate(
                    {"q": q, "M": np.eye(n)}, inputs={"joints": np.zeros(n)}, compiled=compiled
                ).tau
                k = np.array([600, 600, 600, 600, 250, 150] + [50] * 10)[:n]
                if compiled or n <= 7:
                    np.testing.assert_allclose(tau[:7], (-k * q)[:7])
                self.assertEqual(tau.shape, (n,))

    def test_faults_are_codes(self):
        for fault, place in ((2, 7), (2, 100), (3, 0)):
            with self.assertRaisesRegex(mp.Error, "reports a fault"):
                breaks.evaluate({"q": np.zeros(7)}, parameters={"fault": fault, "place": place})
        breaks.evaluate({"q": np.zeros(7)}, parameters={"fault": 2, "place": 6})
        with self.assertRaisesRegex(ValueError, "fault"):
            breaks.evaluate({"q": np.zeros(7)}, parameters={"fault": 3}, compiled=False)

    def test_whole_numbers_never_stop_the_process(self):
        """Divisions that are a signal on x86-64, and numbers that no whole number can hold."""

        def divide(arm, tau):
            a, b = int(arm.q[0]), int(arm.q[1])
            tau[0] = a // b
            tau[1] = a % b
            tau[2] = arm.q[2] / arm.q[3]
            tau[3] = arm.dq[a % 7]

        law = mp.law()(divide)
        for a, b in ((-(2.0**63), -1), (5, 0), (7, 2), (math.nan, 3), (1e300, -1e300)):
            try:
                tau = law.evaluate({"q": [a, b, 1, 0, 0, 0, 0]}).tau
            except mp.Error:
                continue
            self.assertEqual(tau[2], math.inf)
            if b == 2:
                np.testing.assert_array_equal(tau[:2], [3, 1])

    def test_what_evaluate_refuses(self):
        q = np.zeros(7)
        for text, call in (
            ("M is missing", lambda: impedance.evaluate({"q": q}, inputs={"joints": q})),
            ("joints is missing", lambda: impedance.evaluate({"q": q, "M": np.eye(7)})),
            ("no input 'x'", lambda: impedance.evaluate({"q": q, "M": np.eye(7)}, inputs={"x": q})),
            ("has no parameter", lambda: breaks.evaluate({"q": q}, parameters={"x": 1})),
            ("expected .7,. numbers", lambda: breaks.evaluate({"q": q, "dq": [1, 2]})),
            ("owns 2 arm", lambda: pair.evaluate({"q": q}, inputs={"a": q, "b": q})),
        ):
            with self.subTest(text), self.assertRaisesRegex(ValueError, text):
                call()


class Mathematics(unittest.TestCase):
    def test_products(self):
        rng = np.random.default_rng(1)
        A, x, y = rng.normal(size=(6, 7)), rng.normal(size=7), rng.normal(size=6)
        made, transposed = np.ones(6), np.ones(7)
        add_product(A, x, made)
        add_transposed_product(A, y, transposed)
        np.testing.assert_allclose(made, 1 + A @ x, rtol=1e-13)
        np.testing.assert_allclose(transposed, 1 + A.T @ y, rtol=1e-13)

    def test_rotation_error(self):
        """Rodrigues' formula brings it back, for every angle."""

        def exponential(r):
            angle = np.linalg.norm(r)
            K = np.array([[0, -r[2], r[1]], [r[2], 0, -r[0]], [-r[1], r[0], 0]])
            a = np.sinc(angle / np.pi)
            return np.eye(3) + a * K + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * K @ K

        rng = np.random.default_rng(2)
        for angle in (0, 1e-12, 1e-7, 1e-3, 0.5, 2, 3, np.pi - 1e-6, np.pi):
            for _ in range(20):
                axis = rng.normal(size=3)
                r = angle * axis / np.linalg.norm(axis)
                R = exponential(rng.normal(size=3))
                found = np.array(law_math.rotation_error(exponential(r) @ R, R))
                np.testing.assert_allclose(exponential(found), exponential(r), atol=1e-12)
                if angle < 3.1:
                    np.testing.assert_allclose(found, r, atol=1e-12)
                self.assertLessEqual(np.linalg.norm(found), np.pi + 1e-12)


# What is refused. A refusal names the line that ends with HERE.


def loop_without_end(arm, tau):
    while True:  # HERE
        tau[0] += 1


def loop_over_a_measurement(arm, tau):
    for _ in range(int(arm.q[0])):  # HERE
        tau[0] += 1


def loop_over_a_parameter(arm, parameters, tau):
    n = parameters.n
    for _ in range(n):  # HERE
        tau[0] += 1


def loop_that_grows(arm, tau):
    n = 1
    for _ in range(10):
        n = n * 2
        for _ in range(n):  # HERE
            tau[0] += 1


def loop_over_a_call(arm, tau):
    for k in iter(arm.q):  # HERE
        tau[0] += k


def loop_over_a_hidden_range(arm, tau):
    r = range(int(arm.q[0]))  # HERE
    for _ in r:
        tau[0] += 1


def loop_over_a_choice(arm, tau):
    for _ in range(3) if arm.q[0] > 0 else range(int(arm.q[0])):  # HERE
        tau[0] += 1


def loop_over_the_length_of_a_range(arm, tau):
    for _ in range(len(range(int(arm.q[0])))):  # HERE
        tau[0] += 1


def pass_a_range(arm, tau):
    tau[0] = count(range(int(arm.q[0])))  # HERE


def count(numbers):
    n = 0
    for _ in numbers:
        n += 1
    return n


def own_len():
    def len(x):  # noqa: A001
        return int(x[0])

    def loop(arm, tau):
        for _ in range(len(arm.q)):  # HERE
            tau[0] += 1

    return loop


shadows_len = own_len()


def recursion(x):
    return recursion(x - 1)  # calls itself


def calls_recursion(arm, tau):
    tau[0] = recursion(arm.q[0])


def first_of_two(x):
    return second_of_two(x)


def second_of_two(x):
    return first_of_two(x)


def calls_each_other(arm, tau):
    tau[0] = first_of_two(arm.q[0])


def makes_a_list(arm, tau):
    x = [1.0, 2.0]  # HERE
    tau[0] = x[0]


def makes_a_comprehension(arm, tau):
    tau[0] = max(abs(x) for x in arm.q)  # HERE


def makes_an_array(arm, tau):
    x = np.zeros(7)  # HERE
    tau[0] = x[0]


def makes_a_product(arm, tau):
    x = 2.0
    tau[:] = x * arm.q  # HERE
    tau[0] = 1.0


def makes_a_sine(arm, tau):
    tau[0] = 1.0
    tau[:] = np.sin(arm.q)  # HERE


def multiplies_matrices(arm, tau):
    tau[:] = arm.J_V_WE.T @ arm.V_WE  # HERE


def copies(arm, tau):
    tau[0] = 1.0
    x = arm.q.copy()  # HERE
    tau[0] = x[0]


def sorts(arm, tau):
    for i in range(3):
        tau[i] = 0.0
    arm.q.argsort()  # HERE
    tau[1] = 1.0


def prints(arm, tau):
    print(arm.q[0])  # HERE
    tau[0] = 1.0


def asks_for_the_time(arm, tau):
    tau[0] = os.times()[0]  # HERE


def random_torque(arm, tau):
    tau[0] = np.random.rand()  # HERE


def writes_what_it_reads(arm, tau):
    tau[0] = 1.0
    arm.q[0] = 0.0  # HERE


def writes_a_constant(arm, tau):
    WEIGHTS[0] = 2.0  # HERE
    tau[0] = 1.0


def catches(arm, tau):
    try:  # HERE
        tau[0] = 1.0
    except ValueError:
        tau[0] = 2.0


def uses_a_list(arm, tau):
    tau[0] = len(NAMES)  # HERE


def keeps_state(arm, tau):
    global GAIN  # HERE
    GAIN = 2
    tau[0] = 1.0


def formats(arm, tau):
    tau[0] = 1.0
    if arm.q[0] > 1:
        raise ValueError(f"{arm.q[0]}")  # HERE


def defines(arm, tau):
    f = lambda x: x  # noqa: E731  # HERE
    tau[0] = f(1.0)


def knows_no_such_name(arm, tau):
    tau[0] = stiffness  # noqa: F821  # HERE


def knows_no_such_member(arm, tau):
    tau[0] = 1.0
    tau[1] = arm.temperature[0]  # HERE


def reads_a_file(arm, tau):
    tau[0] = open("/dev/null")  # noqa: SIM115  # HERE


LIBC = ctypes.CDLL(None)
LIBC.rand.restype = ctypes.c_int


def calls_c(arm, tau):
    tau[0] = LIBC.rand()  # HERE


def returns(arm, tau):
    return arm.q[0]  # HERE


def helper_that_allocates(x):
    y = np.empty(3)  # HERE
    y[0] = x
    return y[0]


def calls_helper_that_allocates(arm, tau):
    tau[0] = helper_that_allocates(arm.q[0])


def deep_copy(x):
    y = x.copy()  # HERE
    return y[0]


def calls_deep_copy(arm, tau):
    tau[0] = 1.0
    tau[0] = deep_copy(arm.q)


AT_ONCE = (
    (loop_without_end, "while loop has no bound"),
    (loop_over_a_measurement, "no bound"),
    (loop_over_a_parameter, "no bound"),
    (loop_that_grows, "no bound"),
    (loop_over_a_hidden_range, "range outside of a loop"),
    (loop_over_a_choice, "its length is not known"),
    (loop_over_the_length_of_a_range, "range outside of a loop"),
    (pass_a_range, "range outside of a loop"),
    (shadows_len, "len hides a Python name"),
    (loop_over_a_call, "iter: it needs Python"),
    (makes_a_list, "a list: it allocates"),
    (makes_a_comprehension, "it allocates"),
    (makes_an_array, "numpy.zeros|np.zeros"),
    (multiplies_matrices, "operator @"),
    (prints, "print: it needs Python"),
    (asks_for_the_time, "os.times"),
    (random_torque, "np.random"),
    (catches, "try: it needs Python"),
    (uses_a_list, "'list'"),
    (keeps_state, "no state"),
    (formats, "formatted text"),
    (defines, "define it outside"),
    (knows_no_such_name, "not defined"),
    (reads_a_file, "open: it needs Python"),
    (calls_c, "LIBC"),
    (returns, "must not return a value"),
)
WHEN_COMPILED = (
    (makes_a_product, "allocates"),
    (makes_a_sine, "allocates"),
    (copies, "allocates"),
    (sorts, "Numba cannot|allocates"),
    (writes_what_it_reads, "only read"),
    (writes_a_constant, "only read"),
    (knows_no_such_member, "temperature"),
)


class Refusals(unittest.TestCase):
    declared = {"parameters": {"n": mp.LawParameter(1, 0, 5)}}

    def test_in_the_source(self):
        for function, text in AT_ONCE:
            with self.subTest(function.__name__), self.assertRaisesRegex(mp.Refused, text) as caught:
                mp.law(**self.declared)(function)
            self.assertIn(line_of(function) + ": ", str(caught.exception))
            self.assertEqual(caught.exception.verdict, "law_refused")
            self.assertTrue(caught.exception.next_step)

    def test_recursion(self):
        for function, place, text in (
            (calls_recursion, recursion, "recursion calls itself"),
            (calls_each_other, first_of_two, "first_of_two calls itself"),
        ):
            with self.assertRaisesRegex(mp.Refused, text) as caught:
                mp.law()(function)
            self.assertIn(f"{__file__}:{inspect.getsourcelines(place)[1]}: ", str(caught.exception))

    def test_in_a_function_that_it_calls(self):
        with self.assertRaisesRegex(mp.Refused, "np.empty") as caught:
            mp.law()(calls_helper_that_allocates)
        self.assertIn(line_of(helper_that_allocates), str(caught.exception))

    @needs_numba
    def test_by_the_compiler(self):
        for function, text in WHEN_COMPILED:
            law = mp.law()(function)
            with self.subTest(function.__name__), self.assertRaisesRegex(mp.Refused, text) as caught:
                law.evaluate({name: np.zeros(1) for name in law.declaration.arm_fields} | {"q": np.zeros(7)})
            self.assertIn(line_of(function) + ": ", str(caught.exception), function.__name__)
        law = mp.law()(calls_deep_copy)
        with self.assertRaisesRegex(mp.Refused, "allocates") as caught:
            law.evaluate({"q": np.zeros(7)})
        self.assertIn(line_of(deep_copy), str(caught.exception))

    def test_declarations(self):
        def fine(arm, tau):
            tau[0] = 1.0

        def fine_two(arms, tau):
            tau[0][0] = 1.0

        def without_torque(arm):
            pass

        def unknown(arm, stiffness, tau):
            tau[0] = 1.0

        def undeclared(arm, memory, tau):
            tau[0] = 1.0

        def default(arm, tau, dt=1):
            tau[0] = 1.0

        for function, text in (
            (without_torque, "no argument 'tau'"),
            (unknown, "argument 'stiffness'"),
            (undeclared, "declares no memory"),
            (default, "defaults"),
            (fine_two, "argument 'arms'"),
        ):
            with self.subTest(text), self.assertRaisesRegex(mp.Refused, text):
                mp.law()(function)
        with self.assertRaisesRegex(mp.Refused, "argument 'arm'"):
            mp.law(arms=2)(fine)
        P = mp.LawParameter
        for declared, text in (
            ({"arms": 17}, "arms"),
            ({"inputs": {"x": "force"}}, "input 'x'"),
            ({"inputs": {"x": mp.LawInput("pose", arm=1)}}, "arm 1 of 1"),
            ({"parameters": {"a.b": P(0, 0, 1)}}, "a.b"),
            ({"parameters": {"class": P(0, 0, 1)}}, "class"),
            ({"parameters": {"k": P(2, 0, 1)}}, "low <= initial"),
            ({"parameters": {"k": P(0, 0, math.inf)}}, "finite"),
            ({"parameters": {"k": P([1, 1], 0, 1, size=3)}}, "2 initial values"),
            ({"parameters": {"k": P(0, 0, 1, size=17)}}, "17"),
            ({"parameters": {"k": 3}}, "LawParameter"),
            ({"outputs": {"e_m": 0}}, "output 'e_m'"),
            ({"memory": {"x": 10**6}}, "memory 'x'"),
        ):
            with self.subTest(text), self.assertRaisesRegex(ValueError, text):
                mp.law(**declared)(fine)
        with self.assertRaisesRegex(ValueError, "owns 1 arm"):
            mp.law()(fine).on("left", "right")

    def test_without_numba_or_linker_the_package_is_named(self):
        program = textwrap.dedent("""
            import sys
            sys.modules["numba"] = None  # as if it were not installed
            sys.path.insert(0, sys.argv[1])
            import law_of_a_file
            try:
                law_of_a_file.damper.library
            except law_of_a_file.mp.Error as error:
                print(error)
        """)
        (FOLDER / "law_of_a_file.py").write_text(
            "import multipanda as mp\n\n@mp.law()\ndef damper(arm, tau):\n    tau[0] = -arm.dq[0]\n"
        )
        done = subprocess.run(
            [sys.executable, "-c", program, str(FOLDER)], capture_output=True, text=True, check=True, timeout=PATIENCE
        )
        self.assertIn('pip install "multipanda[law]"', done.stdout)

    def test_without_a_linker_the_package_is_named(self):
        empty = FOLDER / "empty"
        empty.mkdir(exist_ok=True)
        with mock.patch.dict(os.environ, {"PATH": str(empty)}):
            if importlib.util.find_spec("ziglang") is None:
                with self.assertRaisesRegex(mp.Error, r'"multipanda\[linker\]".*binutils'):
                    law_link.linker()
            else:
                self.assertIn("ziglang", law_link.linker())

    @needs_numba
    def test_a_linker_of_a_wheel(self):
        """That of the wheel ziglang, where it is installed."""
        if importlib.util.find_spec("ziglang") is None:
            self.skipTest("the wheel ziglang is not installed")
        command = [sys.executable, "-m", "ziglang", "ld.lld"]
        with mock.patch.object(law_link, "linker", lambda: command), cache("ziglang"):
            q = np.linspace(0, 1, 7)
            np.testing.assert_allclose(mp.law()(damper).evaluate({"q": q, "dq": q}).tau, -q)


class cache:
    """Another cache folder, so that a law is compiled again."""

    def __init__(self, name):
        self.patch = mock.patch.dict(os.environ, {"XDG_CACHE_HOME": str(FOLDER / name)})

    def __enter__(self):
        self.patch.start()

    def __exit__(self, *_):
        self.patch.stop()


def damper(arm, tau):
    for i in range(len(tau)):
        tau[i] = -arm.dq[i]


def divides(arm, tau):
    tau[0] = 1.0 / max(0.0, arm.q[0])  # HERE


def out_of_bounds(arm, tau):
    k = int(4.0 * abs(arm.q[1]))
    tau[0] = arm.q[k]  # HERE


def too_slow(arm, tau):
    x = arm.q[0]
    for _ in range(1000):
        for _ in range(1000):
            x = math.sin(x) + arm.q[1]
    tau[0] = x


@needs_numba
class Trial(unittest.TestCase):
    def test_a_state_with_an_infinite_torque(self):
        with self.assertRaisesRegex(mp.Refused, "ZeroDivisionError|not finite") as caught:
            assert mp.law()(divides).library
        self.assertIn("q = [", str(caught.exception))
        self.assertIn(f"{__file__}:", str(caught.exception))

    def test_a_state_with_an_index_out_of_bounds(self):
        with self.assertRaisesRegex(mp.Refused, "IndexError") as caught:
            assert mp.law()(out_of_bounds).library
        self.assertIn(line_of(out_of_bounds), str(caught.exception))

    def test_a_slow_law(self):
        with self.assertRaisesRegex(mp.Refused, "us of processor time"):
            assert mp.law()(too_slow).library

    def test_what_is_kept(self):
        """The cache has the tried library; another law of the same name is compiled again, and a folder gets a copy."""
        with cache("kept"):
            first = mp.law()(damper)
            self.assertEqual(first.trial["states"], 10_000)
            self.assertLess(first.trial["median_us"], first.trial["worst_us"] + 1e-9)
            with (
                mock.patch.object(law_link, "link", side_effect=AssertionError),
                mock.patch("multipanda.law.call", side_effect=AssertionError),
            ):
                again = mp.law()(damper)
                self.assertEqual(again.library, first.library)
            # In another process, too, whose sets and addresses have another order.
            program = (
                f"import sys; sys.argv = ['']; sys.path.insert(0, {str(ROOT / 'tests/python')!r}); import law_test"
            )
            program += "; print(law_test.mp.law()(law_test.damper).library, law_test.everything._key)"
            for seed in ("1", "2"):
                variables = {**os.environ, "PYTHONHASHSEED": seed}
                words = [sys.executable, "-c", program]
                done = subprocess.run(
                    words, capture_output=True, text=True, check=True, env=variables, timeout=PATIENCE
                )
                self.assertEqual(done.stdout.split()[1], everything._key)
            other = mp.law(memory={"x": 1})(damper)
            self.assertNotEqual(other.library, first.library)
            folder = FOLDER / "built"
            self.assertEqual(first.build(folder), folder / "damper.so")
            self.assertEqual([path.name for path in folder.iterdir()], ["damper.so"])
            cached = sorted(path.suffix for path in (FOLDER / "kept/multipanda/laws").iterdir())
            self.assertEqual(cached, [".json", ".json", ".so", ".so"])

    def test_a_changed_constant_is_another_law(self):
        settings = types.ModuleType("settings")
        settings.GAIN = 1.0
        keys = set()

        def constant(arm, tau):
            tau[0] = settings.GAIN * WEIGHTS[1] * GAIN

        for name, value in ((settings, 1.0), (settings, 2.0), (None, 4)):
            if name is settings:
                settings.GAIN = value
            with mock.patch.dict(globals(), {"GAIN": value if name is None else GAIN}):
                keys.add(mp.law()(constant)._key)
        with mock.patch.dict(globals(), {"WEIGHTS": WEIGHTS + 1e-12}):
            keys.add(mp.law()(constant)._key)
        self.assertEqual(len(keys), 4)

    def test_the_library_needs_neither_python_nor_a_processor_s_extensions(self):
        with cache("needs"):
            path = mp.law(inputs=everything.declaration.inputs, parameters=everything.declaration.parameters,
                          outputs=everything.declaration.outputs, memory=everything.declaration.memory)(
                everything.function
            ).build(FOLDER)  # fmt: skip
        tools = {name: subprocess.run(words, capture_output=True, text=True, check=True).stdout for name, words in {
            "needed": ["readelf", "-d", str(path)],
            "symbols": ["nm", "-D", str(path)],
            "code": ["objdump", "-d", str(path)],
        }.items()}  # fmt: skip
        self.assertNotIn("NEEDED", tools["needed"])
        self.assertNotRegex(tools["symbols"], r"Py|NRT|numba_")
        self.assertRegex(tools["symbols"], r" T multipanda_laws")
        self.assertNotRegex(tools["code"], r"%[yz]mm")


@needs_numba
class Runs(unittest.TestCase):
    def test_a_law_is_a_controllet_like_any_other(self):
        with mp.run("one_arm", laws=[impedance.on("arm", name="mine", parameters={"damping_nms_per_rad": 4})]) as run:
            law = run["mine"]
            self.assertEqual(law.type, "impedance")
            self.assertEqual(law.parameters["damping_nms_per_rad"].tolist(), [4] * 7)
            self.assertIn("input joints: joints of 7 numbers", law.__doc__)
            self.assertIn("stiffness_nm_per_rad", mp.stubs(run))
            run.switch("mine")
            law.stiffness_nm_per_rad = 300
            self.assertEqual(law.stiffness_nm_per_rad.tolist(), [300] * 7)
            with self.assertRaisesRegex(mp.Refused, "bounds|1000"):
                law.stiffness_nm_per_rad = 2000
            q = run.arms["arm"].state.q_rad.copy()
            q[3] += 0.1
            law.goal("joints", q, duration_s=0.5).wait(PATIENCE)
            self.assertLess(np.abs(run.arms["arm"].state.q_rad - q).max(), 0.02)
            self.assertEqual(run.arms["arm"].state.controllet, "mine")
        self.assertTrue(run.summary.success, run.summary)

    def test_the_log_names_its_library(self):
        """A log is exported and reported by the scene in it, which has the law."""
        with mp.run("one_arm", laws=[impedance.on("arm", name="mine")], record=FOLDER / "runs") as run:
            run.switch("mine")
        log = mp.read_log(run.log)
        self.assertGreater(len(log["mine/joints/cycle"]), 0)
        scene = next(pathlib.Path(run.log).parent.glob("**/*scene*.yaml"), None)
        if scene is not None:
            self.assertIn(str(impedance.library), scene.read_text())

    def test_a_fault_in_the_loop_holds_its_arm_and_leaves_the_other(self):
        for fault, place in ((1, 0), (2, 50), (3, 0)):
            with mp.run("two_arms", laws=[breaks.on("left"), breaks.on("right")]) as run:
                run.switch(["breaks_left", "breaks_right"])
                run["breaks_left"].place = place
                until(lambda: run["breaks_left"].active, "activated")  # noqa: B023
                with run.events() as events:
                    run["breaks_left"].fault = fault
                    until(lambda: not run["breaks_left"].active, "deactivated")  # noqa: B023
                self.assertTrue(run["breaks_right"].active)
                self.assertIsNotNone(events)
            self.assertFalse(run.summary.success)
            self.assertIn("left", " ".join(run.summary.faults))
            self.assertNotIn("right", " ".join(run.summary.faults))

    def test_in_a_scene_file(self):
        folder = FOLDER / "scene_of_mine"
        impedance.build(folder)
        text = (ROOT / "config/scenes/one_arm.yaml").read_text()
        (folder / "mine.yaml").write_text(
            "plugins: [impedance.so]\n"
            + text.replace("controllets:\n", "controllets:\n  - {name: mine, type: impedance, arms: arm}\n")
        )
        summary = mp.play(folder / "mine.yaml", seconds=0.1)
        self.assertTrue(summary.success)

    def test_additions_that_do_not_fit_are_refused(self):
        with self.assertRaisesRegex(mp.Refused, "no_such_arm"):
            mp.run("one_arm", laws=[impedance.on("no_such_arm")])
        with self.assertRaisesRegex(mp.Refused, "stiffness"):
            mp.run("one_arm", laws=[impedance.on("arm", parameters={"stiffness": 3})])
        with self.assertRaisesRegex(mp.Refused, "--controllet"):
            mp.run("one_arm", arguments=["--controllet", "none"])

    def test_another_version_of_the_interface(self):
        with cache("version"), mock.patch.object(law_layout, "VERSION", 2):
            with self.assertRaisesRegex(mp.VersionMismatch, "version 2 of the C interface, this program has version 1"):
                assert mp.law()(damper).library


if __name__ == "__main__":
    harness.main()
