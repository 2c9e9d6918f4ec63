"""Figures of a task's runs: of each run by itself, and of runs against each other. Units are in the names."""

import numpy as np

from experiments.pages.task_run import rotate, rotate_back
from report import metrics
from report.series import rms

# name: (what, unit shown, factor from SI)
NAMES = {
    "q_rmse_rad": ("joint position", "mrad", 1e3),
    "q_max_rad": ("joint position, worst", "mrad", 1e3),
    "dq_rmse_rad_per_s": ("joint velocity", "mrad/s", 1e3),
    "dq_max_rad_per_s": ("joint velocity, worst", "mrad/s", 1e3),
    "tau_rmse_nm": ("joint torque", "N m", 1),
    "tau_max_nm": ("joint torque, worst", "N m", 1),
    "x_rmse_m": ("end effector", "mm", 1e3),
    "x_max_m": ("end effector, worst", "mm", 1e3),
    "f_rmse_n": ("force", "N", 1),
    "f_max_n": ("force, worst", "N", 1),
    "c_err_rmse_nm": ("control error", "N m", 1),
    "c_err_max_nm": ("control error, worst", "N m", 1),
    "force_rmse_n": ("force RMSE", "N", 1),
    "force_max_n": ("force, largest error", "N", 1),
    "force_est_rmse_n": ("force RMSE, estimate", "N", 1),
    "force_low_n": ("force, lowest", "N", 1),
    "force_high_n": ("force, highest", "N", 1),
    "force_settling_rmse_n": ("force RMSE before the window", "N", 1),
    "impact_peak_n": ("impact peak", "N", 1),
    "settling_s": ("settling after contact", "s", 1),
    "contact_s": ("contact at", "s", 1),
    "contact_to_window_s": ("contact to window", "s", 1),
    "contact_lost_s": ("contact lost for", "s", 1),
    "path_rms_m": ("path error, rms", "mm", 1e3),
    "path_max_m": ("path error, worst", "mm", 1e3),
    "torque_rate_nm_per_s": ("torque rate before the limiter", "N m/s", 1),
    "limiter_hits": ("limiter hits", "", 1),
    "force_tank_min_j": ("force tank, lowest", "J", 1),
    "impedance_tank_min_j": ("impedance tank, lowest", "J", 1),
    "energy_gain_w": ("unsupplied energy gain", "mW", 1e3),
    "stored_energy_max_j": ("stored energy, highest", "J", 1),
    "held": ("held", "", 1),
    "slip_m": ("slip", "mm", 1e3),
    "tilt_rad": ("tilt", "°", 180 / np.pi),
    "lift_error_m": ("lift error", "mm", 1e3),
    "force_difference_max_n": ("force, left to right", "N", 1),
    "loss_speed_m_per_s": ("speed after the loss", "m/s", 1),
    "loss_travel_m": ("travel after the loss", "mm", 1e3),
}
SIX = (
    ("q", "q_rmse_rad", "q_max_rad"),
    ("dq", "dq_rmse_rad_per_s", "dq_max_rad_per_s"),
    ("tau", "tau_rmse_nm", "tau_max_nm"),
    ("x", "x_rmse_m", "x_max_m"),
    ("f", "f_rmse_n", "f_max_n"),
    ("c_err", "c_err_rmse_nm", "c_err_max_nm"),
)
# Figures that need poses of objects or true forces, which arms cannot measure.
NOT_ON_ARMS = ("held", "slip_m", "tilt_rad", "lift_error_m", "energy_gain_w")
IMPACT_S = 0.3  # after contact: the impact of the moving tool
TOUCH_LOST_N = 0.05


def _norm(values):
    return np.linalg.norm(values, axis=1)


def errors_of(run, arm):
    """The six kinds of error of one arm in the window: name -> (N) or (N x n), or None if there is no target.

    Vectors in space count by their norm; each joint counts separately.
    """

    def part(series, norm=False):
        if series is None:
            return None
        t, values = series
        values = values[run.inside(t)]
        return _norm(values) if norm else values

    joints, force = run.joint_errors(arm), next((f for f in run.forces if f["arm"] == arm), None)
    out = {
        "q": part((joints[0], joints[1])) if joints else None,
        "dq": part((joints[0], joints[2])) if joints else None,
        "tau": part(run.torque_error(arm)),
        "x": part(run.position_errors(arm), True),
        "c_err": part(run.control_error(arm)),
    }
    if force is not None:
        return out | {"f": part((force["t"], force["true"] - force["desired"]))}
    estimate = metrics.wrench(run.run, arm, "estimated", "has_estimate")  # without contact, the estimate is the error
    return out | {"f": part(estimate[:2], True) if estimate is not None else None}


def columns_at(times, t, values):
    """The columns of values (N x n), interpolated at other times."""
    return np.column_stack([np.interp(times, t, column) for column in values.T])


def six(errors):
    """RMSE and largest of each kind; several arms: `errors` is a list, pooled."""
    out = {}
    for key, rmse, largest in SIX:
        values = [e[key].ravel() for e in errors if e[key] is not None and e[key].size]
        if values:
            pooled = np.concatenate(values)
            out[rmse], out[largest] = rms(pooled), float(np.max(np.abs(pooled)))
    return out


def _force(run, out):
    worst = {}

    def add(name, value, worst_of=max):
        worst[name] = worst_of(worst.get(name, value), value)

    for force, contact in zip(run.forces, run.contact_times):
        t, true, desired, error = force["t"], force["true"], force["desired"], force["true"] - force["desired"]
        inside = run.inside(t)
        if not inside.any():
            continue
        add("force_rmse_n", rms(error[inside]))
        add("force_max_n", float(np.max(np.abs(error[inside]))))
        add("force_est_rmse_n", rms((force["estimate"] - desired)[inside]))
        add("force_low_n", float(true[inside].min()), min)
        add("force_high_n", float(true[inside].max()))
        lost = inside & (true < TOUCH_LOST_N) & (desired > 1.0)
        add("contact_lost_s", float(lost.sum() * np.median(np.diff(t))))
        if np.isnan(contact):
            continue
        add("impact_peak_n", float(true[run.inside(t, contact, contact + IMPACT_S)].max()))
        before = run.inside(t, contact, max(run.window[0], contact + 0.01))
        add("force_settling_rmse_n", rms(error[before]))
        far = np.flatnonzero(before & (np.abs(error) > np.maximum(0.5, 0.05 * np.abs(desired))))
        add("settling_s", float(t[far[-1]] - contact) if len(far) else 0.0)
    out.update(worst)
    if run.contact is not None:
        out["contact_s"] = run.contact
        out["contact_to_window_s"] = run.window[0] - run.contact
    if len(run.forces) == 2:
        a, b = run.forces
        inside = run.inside(a["t"])
        if inside.any():
            out["force_difference_max_n"] = float(np.max(np.abs(a["true"] - b["true"])[inside]))


def _torque_rate(run, out):
    """Largest rate of the torque requested before the limiter, from contact (or the window) to the window's end."""
    first = min(x for x in (run.contact, run.window[0]) if x is not None)
    rate, hits = 0.0, 0
    for arm in run.arms:
        t, requested = run.requested_torque(arm)
        inside = run.inside(t, first, run.window[1])
        if not inside.any():
            continue
        step = np.abs(np.diff(requested[inside], axis=0)) / np.diff(t[inside])[:, None]
        rate = max(rate, float(step.max()) if step.size else 0.0)
        hits += int(np.count_nonzero(run.run.get(f"{arm}/command/limited")[inside]))
    out["torque_rate_nm_per_s"], out["limiter_hits"] = rate, hits


def _path(run, out):
    errors = run.path_errors
    if errors is None:
        return
    t, error = errors
    distance = run.path_distance(error[run.inside(t)])
    if len(distance):
        out["path_rms_m"], out["path_max_m"] = rms(distance), float(distance.max())


def _energy(run, out):
    instance = run.main_instance
    for name, tank in (("force_tank_min_j", "force_tank_j"), ("impedance_tank_min_j", "impedance_tank_j")):
        series = run.output(instance, tank)
        if series is not None:
            out[name] = float(np.nanmin(series[1]))
    stored = run.output(instance, "stored_energy_j")
    if stored is None:
        return
    t, energy = stored
    out["stored_energy_max_j"] = float(np.nanmax(energy))
    if run.measured:  # the power from the environment is not known
        return
    out["energy_gain_w"] = energy_gain(run, t, energy)


def energy_gain(run, t, energy):
    """Largest increase of stored energy that the environment did not supply, per second of the run [W].

    The arm's power into its environment is F_K . V_K, of which logs have the force in every cycle and the velocity of
    E at the model's rate; rotation of the tool against friction is left out, since it only dissipates energy.
    """
    given = np.zeros(len(t))
    for arm in run.arms:
        contact = metrics.wrench(run.run, arm, "contact", "has_contact_truth")
        tm, v = run.run.get(f"{arm}/model/t"), run.run.get(f"{arm}/model/twist_linear")
        if contact is None or tm is None:
            continue
        velocity = columns_at(contact[0], tm, v)
        power = np.nan_to_num(np.sum(contact[1] * velocity, axis=1))
        work = np.concatenate([[0.0], np.cumsum(power[1:] * np.diff(contact[0]))])
        given += np.interp(t, contact[0], work)
    balance = energy + given
    elapsed = np.maximum(t - t[0], 0.1)
    return float(np.nanmax((balance - balance[0]) / elapsed))


def _grasp(run, out):
    grasp = run.measure.get("grasp")
    if not grasp or run.window is None:
        return
    pose = run.object_pose(grasp["name"])
    if pose is None:
        return
    t, p, q = pose
    inside = run.inside(t)
    if not inside.any():
        return
    # Slip: motion, across the push and relative to the hand, of the object's point that was at E when the window began.
    slip = 0.0
    for force in run.forces:
        tm, hand, turn = run.pose(force["arm"])
        rows = run.inside(tm) & (tm >= t[0]) & (tm <= t[-1])
        hand, turn = hand[rows], turn[rows]
        place, attitude = columns_at(tm[rows], t, p), columns_at(tm[rows], t, q)
        attitude /= _norm(attitude)[:, None]
        point = rotate_back(attitude[:1], hand[:1] - place[:1])
        moved = rotate_back(turn, place + rotate(attitude, point) - hand)
        push = rotate_back(turn[:1], force["direction"][None])[0]
        across = moved - np.outer(moved @ push, push)
        slip = max(slip, float(_norm(across).max()))
    out["slip_m"] = slip
    level = np.repeat(q[:1], len(q), axis=0)
    out["tilt_rad"] = float(_norm(metrics.rotation_error(level, q))[inside].max())
    target = run.target(grasp["instance"], grasp["input"])
    if target is not None:
        requested = np.interp(t, target[0], target[1][:, 2])
        start = np.flatnonzero(inside)[0]
        error = (p[:, 2] - p[start, 2]) - (requested - requested[start])
        out["lift_error_m"] = float(np.max(np.abs(error[inside])))
    lifted = p[inside, 2].max() - p[0, 2]
    whole_lift = target[1][:, 2].max() - target[1][0, 2] if target is not None else 0.1
    held = all(f["true"][run.inside(f["t"])].min() > 0 for f in run.forces)
    out["held"] = float(held and lifted > 0.25 * whole_lift)  # with soft gains it sags but does not fall


def _loss(run, out):
    loss = run.measure.get("loss")
    if not loss:
        return
    t, speed = run.speed(loss["arm"])
    after = t >= loss["at_s"]
    out["loss_speed_m_per_s"] = float(speed[after].max())
    tp, p, _ = run.pose(loss["arm"])
    along = p @ np.array(loss["direction"], dtype=float)
    out["loss_travel_m"] = float((along[tp >= loss["at_s"]] - along[tp < loss["at_s"]][-1]).max())


def figures(run):
    """All figures of one run: (of the run, of each arm)."""
    out = {}
    _loss(run, out)
    if run.window is None or not run.window_is_whole:
        return _finite(out), {}
    errors = {arm: errors_of(run, arm) for arm in run.arms}
    out.update(six(list(errors.values())))
    _force(run, out)
    _torque_rate(run, out)
    _path(run, out)
    _energy(run, out)
    _grasp(run, out)
    # A figure that is not finite was not measured, for example in a run that failed.
    return _finite(out), {arm: _finite(six([e])) for arm, e in errors.items()}


def _finite(figures):
    return {name: value for name, value in figures.items() if np.isfinite(value)}


# Runs against each other ----------------------------------------------------------------------------------------------


def series_of(run):
    """The six quantities in the window on a grid of their own, times from its beginning; for comparisons.

    Force: the true one if a force is controlled and it is known, otherwise the estimate, which is also in "f_est".
    """
    if run.window is None or not run.window_is_whole:
        return None
    first, last = run.window
    grid = np.arange(0.0, min(last, run.run.time_range[1]) - first - 0.0025, 0.005)
    out = {}
    for arm in run.arms:
        t, q = run.state(arm, "q")
        estimate = metrics.wrench(run.run, arm, "estimated", "has_estimate")
        true = metrics.wrench(run.run, arm, "contact", "has_contact_truth") if run.forces else None
        force = estimate if run.measured or not run.forces else true
        series = {
            "q": (t, q),
            "dq": run.state(arm, "dq"),
            "tau": run.torque(arm),
            "x": run.pose(arm)[:2],
            "f": force[:2] if force else None,
            "f_est": estimate[:2] if estimate else None,
            "c_err": run.control_error(arm),
        }
        if run.measured:
            del series["f"]
        for key, pair in series.items():
            if pair is not None and pair[1] is not None:
                out[arm, key] = columns_at(first + grid, *pair)
    return out


def difference(a, b):
    """RMSE and largest difference of two runs' series, as six(). Forces: the estimates, if one run has no others."""
    if a is None or b is None:
        return {}
    a, b = comparable(a, b), comparable(b, a)
    out = {}
    for key, rmse, largest in SIX:
        parts = []
        for (arm, name), values in a.items():
            if name != key or (arm, name) not in b:
                continue
            other = b[arm, name]
            n = min(len(values), len(other))
            delta = values[:n] - other[:n]
            parts.append((_norm(delta) if key in ("x", "f") else delta).ravel())
        if parts:
            pooled = np.concatenate(parts)
            out[rmse], out[largest] = rms(pooled), float(np.max(np.abs(pooled)))
    return _finite(out)


def comparable(a, b):
    """`a` with its estimated forces as "f" if `b` has estimates only."""
    out = dict(a)
    for arm in {arm for one in (a, b) for arm, name in one if name == "f_est" and (arm, "f") not in one}:
        if (arm, "f_est") in a:
            out[arm, "f"] = a[arm, "f_est"]
        else:
            out.pop((arm, "f"), None)
    return out


def mean_series(many):
    many = [m for m in many if m is not None]
    if not many:
        return None
    out = {}
    for key in many[0]:
        parts = [m[key] for m in many if key in m]
        n = min(len(p) for p in parts)
        out[key] = np.mean([p[:n] for p in parts], axis=0)
    return out


def pooled(rows):
    """Combines several results of difference(): the root mean square of the RMSE, the maximum of the largest."""
    out = {}
    for _, rmse, largest in SIX:
        values = [row[rmse] for row in rows if rmse in row]
        if values:
            out[rmse], out[largest] = rms(values), max(row[largest] for row in rows if largest in row)
    return out
