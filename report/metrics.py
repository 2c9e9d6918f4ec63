"""Figures of a run: pure functions of a loading.Run. None: the log lacks the data."""

import numpy as np

from report.series import percentile, rms

FRESH_RUN_CYCLE = 1  # number of the first cycle of a run


def cycle_times(run):
    """Median, p99, p99.9 and worst of the whole cycle [s]; every recorded cycle counts, the first included."""
    total = run.get("timing/total")
    if total is None:
        return None
    shares = {"median": 0.5, "p99": 0.99, "p99.9": 0.999, "worst": 1.0}
    return {name: percentile(total, share) for name, share in shares.items()}


def duration(run):
    """Loop time covered [s], both end cycles included."""
    if run.time_range is None:
        return None
    period = run.get("timing/period")
    first, last = run.time_range
    return last - first + (float(np.median(period)) if period is not None else 0.001)


def cycle_counts(run):
    """recorded, missing between first and last, missing before the first, overruns; None for each unknown one."""
    cycle, overruns = run.get("timing/cycle"), run.get("timing/overruns")
    if cycle is None:
        return dict.fromkeys(("recorded", "missing", "missing_before", "overruns"))
    return {
        "recorded": len(cycle),
        "missing": int(cycle[-1] - cycle[0] + 1 - len(cycle)),
        "missing_before": max(0, int(cycle[0]) - FRESH_RUN_CYCLE),
        "overruns": int(overruns[-1]) if overruns is not None else None,
    }


def _per_second(run, name):
    start, values = run.get("timing/start"), run.get(f"timing/{name}")
    if start is None or len(start) < 2 or start[-1] <= start[0]:
        return None
    return float((values[-1] - values[0]) / (start[-1] - start[0]))


def loop_rate(run):
    """Cycles per second of the computer's clock, including lost records; None with fewer than two cycles."""
    return _per_second(run, "cycle")


def realtime_factor(run):
    """Loop time over the computer's time."""
    return _per_second(run, "t")


def is_paced(run):
    """Whether the run was paced: from the log, otherwise by comparing loop time with the computer's time."""
    said = (run.meta.get("run") or {}).get("paced")
    if said in ("true", "false"):
        return said == "true"
    factor = realtime_factor(run)
    return factor is not None and 0.9 < factor < 1.1


# Orientation ---------------------------------------------------------------------------------------------------------


def rotation_error(desired_wxyz, actual_wxyz):
    """log(R_d R^T) in world axes (N x 3) [rad], the shorter rotation; quaternions w x y z (N x 4)."""
    d = np.asarray(desired_wxyz, dtype=float)
    a = np.asarray(actual_wxyz, dtype=float) * np.array([1.0, -1.0, -1.0, -1.0])
    w = d[:, 0] * a[:, 0] - np.sum(d[:, 1:] * a[:, 1:], axis=1)
    v = d[:, :1] * a[:, 1:] + a[:, :1] * d[:, 1:] + np.cross(d[:, 1:], a[:, 1:])
    short_way = np.where(w < 0, -1.0, 1.0)
    w, v = w * short_way, v * short_way[:, None]
    length = np.linalg.norm(v, axis=1)
    angle = 2.0 * np.arctan2(length, w)
    scale = np.divide(angle, length, out=np.full_like(length, 2.0), where=length > 1e-12)
    return v * scale[:, None]


# Tracking ------------------------------------------------------------------------------------------------------------

ORDINALS = ("first", "second", "third", "fourth")


def output_prefix(run, instance, arm):
    """Prefix of this arm's outputs in a controllet with several arms: "", "first_", ..., "<arm>_"; None: none."""
    arms = run.instances.get(instance, {}).get("arms") or []
    candidates = [f"{arm}_"]
    if arm in arms:
        index = arms.index(arm)
        candidates += [ORDINALS[index] + "_"] if index < len(ORDINALS) else []
        candidates += [""] if len(arms) == 1 else []
    for prefix in candidates:
        if f"{instance}/outputs/{prefix}position_error_m/values" in run.names:
            return prefix
    return None


def _model_pose(run, arm):
    """cycle (N), p_WE (N x 3), quaternion w x y z (N x 4) of the model summary; None when not logged."""
    p, q = run.get(f"{arm}/model/pose_position"), run.get(f"{arm}/model/pose_orientation")
    if p is None or q is None:
        return None
    return run.get(f"{arm}/model/cycle"), p, q[:, [3, 0, 1, 2]]  # ROS x y z w


def _rows_of(cycles, requested):
    """Rows of `cycles` (ascending) that hold the requested cycles, and which of the requested ones were found."""
    rows = np.minimum(np.searchsorted(cycles, requested), len(cycles) - 1)
    return rows, cycles[rows] == requested


def own_inputs(run, instance, arm, kind):
    """Topics of the instance's targets of this kind when it owns this arm alone."""
    if (run.instances.get(instance, {}).get("arms") or []) != [arm]:
        return []
    topics = [name.removesuffix("/kind") for name in sorted(run.names) if name.endswith("/kind")]
    kinds = {topic: run.get(f"{topic}/kind") for topic in topics if topic.rpartition("/")[0] == instance}
    return [topic for topic, found in kinds.items() if found is not None and found[0] == kind]


def _own_pose_input(run, instance, arm):
    """Topic of the instance's pose target when it owns this arm alone and the target is in the world."""
    for topic in own_inputs(run, instance, arm, "pose"):
        frame = run.get(f"{topic}/frame")
        if frame is None or frame[0] in ("", "world"):
            return topic
    return None


def owners(run, arm):
    """Names of the instances that owned the arm, in the order of their first time."""
    return list(dict.fromkeys(span.instance for span in run.spans(arm)))


def pose_errors(run, arm):
    """Per owner with a target for this arm: {"instance", "t", "position" (N x 3) [m], "rotation" (N x 3) [rad]}.

    Desired minus actual, world axes: the controllet's own error output if it has one, otherwise target minus model.
    """
    out = []
    for instance in owners(run, arm):
        prefix = output_prefix(run, instance, arm)
        if prefix is not None:
            topic = f"{instance}/outputs/{prefix}"
            position = run.get(f"{topic}position_error_m/values")
            rotation = run.get(f"{topic}orientation_error_rad/values")
            if position is None:
                continue
            if rotation is None or len(rotation) != len(position):
                rotation = np.full_like(position, np.nan)
            t = run.get(f"{topic}position_error_m/t")
            out.append({"instance": instance, "t": t, "position": position, "rotation": rotation})
            continue
        topic, model = _own_pose_input(run, instance, arm), _model_pose(run, arm)
        if topic is None or model is None:
            continue
        value, cycle = run.get(f"{topic}/value"), run.get(f"{topic}/cycle")
        rows, found = _rows_of(model[0], cycle)
        rows, value, t = rows[found], value[found], run.get(f"{topic}/t")[found]
        if len(value):
            position, rotation = value[:, :3] - model[1][rows], rotation_error(value[:, 3:7], model[2][rows])
            out.append({"instance": instance, "t": t, "position": position, "rotation": rotation})
    return out


def pose_targets(run, arm):
    """Set-point of E's position per owner: {"instance", "t", "position"}.

    The logged target of a controllet that owns only this arm; otherwise actual + error, if the controllet outputs it.
    """
    out, model = [], _model_pose(run, arm)
    errors = {entry["instance"]: entry for entry in pose_errors(run, arm)}
    for instance in owners(run, arm):
        topic = _own_pose_input(run, instance, arm)
        if topic is not None:
            out.append({"instance": instance, "t": run.get(f"{topic}/t"), "position": run.get(f"{topic}/value")[:, :3]})
        elif instance in errors and model is not None:
            t_model = run.get(f"{arm}/model/t")
            rows, found = _rows_of(t_model, errors[instance]["t"])  # both are the stamp of the same cycle
            if found.any():
                t, error = errors[instance]["t"][found], errors[instance]["position"][found]
                out.append({"instance": instance, "t": t, "position": model[1][rows[found]] + error})
    return out


def joint_targets(run, arm):
    """Joint set-points per owner: {"instance", "topic", "t", "q_d" (N x n) [rad], "error" (N x n) = q_d - q}."""
    out, q, cycles = [], run.get(f"{arm}/state/q"), run.get(f"{arm}/state/cycle")
    for instance in owners(run, arm) if q is not None else []:
        for topic in own_inputs(run, instance, arm, "joints"):
            value = run.get(f"{topic}/value")
            if value.shape[1] != q.shape[1]:
                continue
            rows, found = _rows_of(cycles, run.get(f"{topic}/cycle"))
            t, q_d = run.get(f"{topic}/t")[found], value[found]
            out.append({"instance": instance, "topic": topic, "t": t, "q_d": q_d, "error": q_d - q[rows[found]]})
    return out


TRACKED = ("position_max", "position_rms", "rotation_max", "rotation_rms", "joint_max")


def tracking(run, arm):
    """One row per owner of the arm: active time [s] and tracking errors (max and RMS of norms, largest joint)."""
    pose = {entry["instance"]: entry for entry in pose_errors(run, arm)}
    joint = {entry["instance"]: entry for entry in joint_targets(run, arm)}
    rows = []
    for instance in owners(run, arm):
        active = sum(s.end - s.start for s in run.spans(arm) if s.instance == instance)
        row = {"arm": arm, "instance": instance, "active": active, **dict.fromkeys(TRACKED)}
        for key in ("position", "rotation") if instance in pose else ():
            norm = np.linalg.norm(pose[instance][key], axis=1)
            norm = norm[np.isfinite(norm)]
            if len(norm):
                row[f"{key}_max"], row[f"{key}_rms"] = float(norm.max()), rms(norm)
        if instance in joint and len(joint[instance]["error"]):
            row["joint_max"] = float(np.abs(joint[instance]["error"]).max())
        rows.append(row)
    return rows


def largest_errors(run, arm):
    """Over all owners: position [m], rotation [rad], joint [rad]; None if no controllet had such a target."""
    rows = tracking(run, arm)
    return {
        key: max((row[f"{key}_max"] for row in rows if row[f"{key}_max"] is not None), default=None)
        for key in ("position", "rotation", "joint")
    }


# Effort --------------------------------------------------------------------------------------------------------------


def torque_without_gravity(run, arm):
    """tau_J - g(q) at every state (N x n); g between two model summaries by interpolation. None without both."""
    tau, g = run.get(f"{arm}/state/tau_j"), run.get(f"{arm}/model/tau_gravity")
    if tau is None or g is None or g.shape[1] != tau.shape[1]:
        return None
    t, t_model = run.get(f"{arm}/state/t"), run.get(f"{arm}/model/t")
    return tau - np.column_stack([np.interp(t, t_model, g[:, i]) for i in range(g.shape[1])])


def used_share(values, limit):
    """|values| / limit, per joint; joints without a finite, positive limit become NaN."""
    limit = np.where(np.isfinite(limit) & (limit > 0), limit, np.nan)
    return np.abs(values) / limit


def effort(run, arm):
    """Largest use of the limits: each entry (value, joint index) or None."""

    def largest(name, limit_name):
        values, limit = run.get(f"{arm}/{name}"), run.limits(arm, limit_name)
        if values is None or limit is None:
            return None
        peak = np.nanmax(np.where(np.isfinite(share := used_share(values, limit)), share, 0.0), axis=0)
        return float(peak.max()), int(peak.argmax())

    q, low, high = run.get(f"{arm}/state/q"), run.limits(arm, "q_min"), run.limits(arm, "q_max")
    margin = None
    if q is not None and low is not None and high is not None:
        smallest = np.nanmin(np.minimum(q - low, high - q), axis=0)
        margin = float(smallest.min()), int(smallest.argmin())
    manipulability = run.get(f"{arm}/model/manipulability")
    return {
        "torque": largest("command/tau_cmd", "tau_max"),
        "speed": largest("state/dq", "dq_max"),
        "joint_margin": margin,
        "manipulability_min": float(np.nanmin(manipulability)) if manipulability is not None else None,
        "force_estimated": _largest_force(run, arm, "estimated", "has_estimate"),
        "force_contact": _largest_force(run, arm, "contact", "has_contact_truth"),
    }


def wrench(run, arm, which, flag):
    """(t, force N x 3, torque N x 3) where its flag is set (NaN elsewhere); None when it never is."""
    force, valid = run.get(f"{arm}/wrench/{which}_force"), run.get(f"{arm}/wrench/{flag}")
    if force is None or valid is None or not np.any(valid):
        return None
    invalid = ~np.asarray(valid, dtype=bool)[:, None]
    torque = run.get(f"{arm}/wrench/{which}_torque")
    return run.get(f"{arm}/wrench/t"), np.where(invalid, np.nan, force), np.where(invalid, np.nan, torque)


def _largest_force(run, arm, which, flag):
    found = wrench(run, arm, which, flag)
    return float(np.nanmax(np.linalg.norm(found[1], axis=1))) if found is not None else None


# What happened -------------------------------------------------------------------------------------------------------


def switch_rows(run):
    """Each answer to a switch request, with its durations [s] for requested switches (otherwise None)."""
    names, timing = ("waiting", "computing", "total"), {}
    if run.get("switch_timing/request") is not None:
        columns = [run.get(f"switch_timing/{name}").tolist() for name in ("request", "cycle", *names)]
        timing = {(request, cycle): dict(zip(names, times)) for request, cycle, *times in zip(*columns)}
    return [switch | timing.get((switch["request"], switch["cycle"]), dict.fromkeys(names)) for switch in run.switches]


def intervention_groups(run):
    """By rule, arm and controllet: how many episodes, first and last time, extreme value, its limit and joint."""
    groups, unknown = {}, {"value": None, "limit": None}
    for message in run.interventions:
        key, at, value = (message["code"], message["arm"], message["instance"]), message["stamp"], message["value"]
        names = dict(zip(("code", "arm", "instance"), key))
        group = groups.setdefault(key, {**names, **unknown, "count": 0, "first": at, "joints": set()})
        group |= {"count": group["count"] + 1, "last": at}
        if message["joint"] >= 0:
            group["joints"].add(message["joint"])
        if value is not None and (group["value"] is None or abs(value) > abs(group["value"])):
            group |= {"value": value, "limit": message["limit"]}
    return list(groups.values())


def missing(run):
    """Sentences about data missing in the log; empty: none known."""
    out = [str(note) for note in run.meta.get("notes") or []]
    counts = cycle_counts(run)
    if counts["recorded"] is None:
        out.append("Cycle times are not in the log (no /timing).")
    else:
        if counts["missing"]:
            out.append(
                f"{counts['missing']} of {counts['recorded'] + counts['missing']} cycles are not in the log: the "
                "writer fell behind or the disk was full. Lines are broken there."
            )
        if counts["missing_before"]:
            out.append(f"The log begins with cycle {int(run.get('timing/cycle')[0])}: earlier cycles are missing.")
    end = run.meta.get("missing")
    if end is None:
        out.append(
            "The log has no closing summary (killed, or the disk was full): the time after its last message is unknown."
        )
    else:
        if int(end.get("events_lost") or 0):
            out.append(
                f"{end['events_lost']} events (switches, interventions, ...) were lost: the log could not keep up."
            )
        if int(end.get("messages_lost") or 0):
            topics = ", ".join(f"{key[5:]} {end[key]}" for key in sorted(end) if key.startswith("lost:"))
            reason = f" ({end['error']})" if end.get("error") else ""
            out.append(f"{end['messages_lost']} messages could not be written{reason}: {topics or 'topics not known'}.")
        elif end.get("error"):
            out.append(f"The log's writer reported: {end['error']}.")
    if not run.arms:
        out.append("No arm is in the log.")
    topics = {
        "state": "joint states",
        "command": "commands",
        "model": "model summary (pose, gravity, manipulability)",
    }
    for arm in run.arms:
        absent = [topic for topic in topics if run.get(f"{arm}/{topic}/t") is None]
        out += [f"Arm {arm}: no {topics[topic]} (/{arm}/{topic})." for topic in absent]
    return out
