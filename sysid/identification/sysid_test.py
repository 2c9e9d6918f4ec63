"""Our fits of delay, bandwidth and stiffness against MuJoCo's own system identification toolbox (mujoco.sysid).

The same recorded data go to both. The toolbox gets a model made here from the arm's MJCF: torque tracking is MuJoCo's
exact first-order filter of an actuator, delay its shift of predicted signals, the surface a contact pair whose figures
are computed here from the definition of solref. It uses only multipanda's data and the arm's MJCF.
"""

import csv
import json
import math
import pathlib
import subprocess
import sys
import tempfile
import unittest

import numpy as np

try:
    import mujoco
    from mujoco import sysid

    sysid.optimize  # the toolbox ignores missing packages and stays empty  # noqa: B018
    MISSING = ""
except (ImportError, AttributeError) as error:
    MISSING = f"mujoco.sysid cannot be used here ({error}): it needs mujoco 4, scipy, absl-py, colorama, tabulate"

PERIOD = 0.001
THREADS = 2


def table(path):
    with open(path, encoding="utf-8") as stream:
        return np.array([[float(x) for x in row] for row in csv.reader(stream)])


def series(rows, first=0):
    return PERIOD * (first + np.arange(len(rows)))


def fit(parameters, spec, starts, controls, measured, residual):
    """Runs the toolbox on windows that begin in `starts`; values of the parameters."""
    spec.option.timestep = PERIOD
    model = spec.compile()
    dictionary = sysid.ParameterDict({p.name: p for p in parameters})
    ctrl = sysid.TimeSeries.compute_all_control_mapping(model)
    sensors = sysid.TimeSeries.compute_all_sensor_mapping(model)
    sequences = sysid.ModelSequences(
        "arm",
        spec,
        [f"window {i}" for i in range(len(starts))],
        starts,
        [sysid.TimeSeries(series(c), c, ctrl) for c in controls],
        [sysid.TimeSeries(series(m), m, sensors) for m in measured],
    )
    function = sysid.build_residual_fn(
        models_sequences=[sequences], modify_residual=residual, n_threads=THREADS, resample_true=False
    )
    found, _ = sysid.optimize(dictionary, function, optimizer="mujoco", verbose=False, max_iters=25)
    return {name: float(found[name].value[0]) for name in dictionary.keys()}


@unittest.skipIf(MISSING, MISSING)
class AgainstTheToolbox(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.temporary = tempfile.TemporaryDirectory()
        cls.folder = pathlib.Path(cls.temporary.name)
        subprocess.run([PROGRAM, str(cls.folder)], check=True, timeout=200)
        cls.ours = json.loads((cls.folder / "ours.json").read_text())

    @classmethod
    def tearDownClass(cls):
        cls.temporary.cleanup()

    def arm(self):
        return mujoco.MjSpec.from_file(str(self.folder / "arm.xml"))

    def test_delay_and_bandwidth(self):
        data, ours = table(self.folder / "torque.csv"), self.ours["actuation"]
        command, torque = data[:, :7], data[:, 7:]
        spec = self.arm()
        for joint in spec.joints:
            joint.armature = 1e6  # the effect of the torque on the arm is not used
            spec.add_sensor(
                name="torque of " + joint.name,
                type=mujoco.mjtSensor.mjSENS_JOINTACTFRC,
                objtype=mujoco.mjtObj.mjOBJ_JOINT,
                objname=joint.name,
            )
        for actuator in spec.actuators:
            actuator.dyntype = mujoco.mjtDyn.mjDYN_FILTEREXACT
            actuator.actearly = True  # force of a period from the filter's value at its end, as ours

        def track(s, p):
            for actuator in s.actuators:
                actuator.dynprm[0] = 1e-3 * p.value[0]

        lag = sysid.Parameter("lag", 8.0, 0.5, 30.0, modifier=track)  # [ms]
        delay = sysid.Parameter("delay", 0.5, 0.0, 6.0)  # [ms]

        def residual(params, predicted, measured, model, return_all, **_):
            times = measured.times[100:]
            shifted = sysid.apply_resample_and_delay(predicted, times, 1e-3 * params["delay"].value[0])
            kept = sysid.TimeSeries(times, measured.data[100:], measured.signal_mapping)
            return shifted.data - kept.data, shifted, kept

        model = spec.compile()
        start = sysid.create_initial_state(model, model.qpos0, np.zeros(model.nv), np.zeros(model.na))
        # The first measured row belongs to the start; row k of torque is the torque of period k.
        seen = np.vstack([np.zeros((1, 7)), torque[:-1]])
        found = fit([lag, delay], spec, [start], [command], [seen], residual)
        bandwidth = 1 / (2 * math.pi * 1e-3 * found["lag"])
        print(
            f"toolbox {found['delay']:.3f} ms {bandwidth:.2f} Hz, ours {1e3 * ours['delay']:.3f} ms "
            f"{ours['bandwidth']:.2f} Hz, by rollouts {1e3 * ours['rollouts_delay']:.3f} ms "
            f"{ours['rollouts_bandwidth']:.2f} Hz"
        )
        for kind in ("", "rollouts_"):
            self.assertAlmostEqual(1e3 * ours[kind + "delay"], found["delay"], delta=0.05)
            self.assertAlmostEqual(ours[kind + "bandwidth"] / bandwidth, 1, delta=0.02)
        self.assertAlmostEqual(found["delay"], 1e3 * ours["true_delay"], delta=0.1)
        self.assertAlmostEqual(bandwidth / ours["true_bandwidth"], 1, delta=0.05)

    def test_stiffness(self):
        data, ours = table(self.folder / "pressed.csv"), self.ours["surface"]
        q, dq, torque = data[:, :7], data[:, 7:14], data[:, 14:]
        spec = self.arm()
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        body = spec.worldbody.add_body(name="table", pos=ours["table_position"], quat=ours["table_quaternion"])
        body.add_geom(
            name="table",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=0.5 * np.array(ours["table_size"]),
            contype=0,
            conaffinity=0,
        )
        flange = spec.site("flange")
        tool = flange.parent.add_body(name="tool", pos=flange.pos, quat=flange.quat)
        tool.add_geom(
            name="ball",
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[0.5 * ours["ball_diameter"], 0, 0],
            pos=ours["ball_in_flange"],
            mass=0,
            contype=0,
            conaffinity=0,
        )
        tool.add_site(name="ball", pos=ours["ball_in_flange"])
        spec.add_pair(name="contact", geomname1="ball", geomname2="table", condim=1)
        for joint in spec.joints:
            spec.add_sensor(
                name="angle of " + joint.name,
                type=mujoco.mjtSensor.mjSENS_JOINTPOS,
                objtype=mujoco.mjtObj.mjOBJ_JOINT,
                objname=joint.name,
            )
        model = spec.compile()
        inverse_weight = model.body("tool").invweight0[0] + model.body("table").invweight0[0]
        impedance = 0.2  # any: force follows from depth by solref (1 - impedance), less inertia of impedance
        normal = np.zeros(9)
        mujoco.mju_quat2Mat(normal, np.array(ours["table_quaternion"]))
        outwards = -normal.reshape(3, 3)[:, 2]

        def press(s, p):
            stiffness = math.exp(p.value[0])
            damping = 2 * ours["damping_ratio"] * math.sqrt(4.0 * stiffness)
            scale = (1 - impedance) * inverse_weight
            s.pair("contact").solref = [-stiffness * scale, -damping * scale]
            s.pair("contact").solimp = [impedance, impedance, 1e-3, 0.5, 2]

        def lift(s, p):
            s.body("table").pos = np.array(ours["table_position"]) + 1e-4 * p.value[0] * outwards

        stiffness = sysid.Parameter("log stiffness", math.log(8000), math.log(500), math.log(1e6), modifier=press)
        height = sysid.Parameter("height", -3.0, -50.0, 50.0, modifier=lift)  # [0.1 mm]
        looked_at = mujoco.MjData(model)

        def along(angles):
            out = np.empty(len(angles))
            for i, angle in enumerate(angles):
                looked_at.qpos[:7] = angle
                mujoco.mj_kinematics(model, looked_at)
                out[i] = looked_at.site("ball").xpos @ outwards
            return out

        def residual(params, predicted, measured, model, return_all, state, **_):
            kept = sysid.TimeSeries(measured.times[1:], measured.data[1:], measured.signal_mapping)
            e = (along(state[:, 1:8]) - along(kept.data)) / 1e-5
            return e.reshape(-1, 1), predicted, kept

        length, starts, controls, measured = 50, [], [], []
        smooth = np.array([-21, 14, 39, 54, 59, 54, 39, 14, -21]) / 231.0
        for first in range(1200, 5900, 600):
            around = slice(first - 4, first + 5)
            starts.append(sysid.create_initial_state(model, smooth @ q[around], smooth @ dq[around]))
            # Control k acts from row k on and shows in the torque of row k + 1.
            controls.append(torque[first + 1 : first + length + 2])
            measured.append(q[first : first + length + 1])
        found = fit([stiffness, height], spec, starts, controls, measured, residual)
        theirs = math.exp(found["log stiffness"])
        print(
            f"toolbox {theirs:.0f} N/m {0.1 * found['height']:.4f} mm, ours {ours['stiffness']:.0f} N/m "
            f"{1e3 * ours['height']:.4f} mm"
        )
        self.assertAlmostEqual(ours["stiffness"] / theirs, 1, delta=0.03)
        self.assertAlmostEqual(theirs / ours["true_stiffness"], 1, delta=0.05)
        self.assertAlmostEqual(1e3 * ours["height"], 0.1 * found["height"], delta=0.02)


if __name__ == "__main__":
    PROGRAM = sys.argv.pop(1)
    if MISSING:
        print(MISSING)  # the test counts as skipped by this text
    unittest.main()
