"""Figures of a run: pure functions of a loading.Run. None: the log lacks the data."""

import math

import numpy as np

FRESH_RUN_CYCLE = 1  # number of the first cycle of a run


def percentile(values, share):
    """Smallest value that at least `share` of all do not exceed (nearest rank), as the live summary counts it."""
    rank = max(1, math.ceil(share * len(values) - 1e-6))  # 0.999 * 4000 is 3996, not a little more
    return float(np.partition(values, rank - 1)[rank - 1])


def cycle_times(run):
    """p50, p99, p99.9 and worst of the whole cycle [s]; every recorded cycle counts, the first included."""
    total = run.get("timing/total")
    if total is None:
        return None
    return {
        "p50": percentile(total, 0.5),
        "p99": percentile(total, 0.99),
        "p99.9": percentile(total, 0.999),
        "max": float(total.max()),
    }


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
        return {"recorded": None, "missing": None, "missing_before": None, "overruns": None}
    return {
        "recorded": len(cycle),
        "missing": int(cycle[-1] - cycle[0] + 1 - len(cycle)),
        "missing_before": max(0, int(cycle[0]) - FRESH_RUN_CYCLE),
        "overruns": int(overruns[-1]) if overruns is not None else None,
    }


def loop_rate(run):
    """Cycles per second of the computer's clock, including lost records; None with fewer than two cycles."""
    start, cycle = run.get("timing/start"), run.get("timing/cycle")
    if start is None or len(start) < 2 or start[-1] <= start[0]:
        return None
    return float((cycle[-1] - cycle[0]) / (start[-1] - start[0]))


def realtime_factor(run):
    """Loop time over the computer's time."""
    t, start = run.get("timing/t"), run.get("timing/start")
    if start is None or len(start) < 2 or start[-1] <= start[0]:
        return None
    return float((t[-1] - t[0]) / (start[-1] - start[0]))


def is_paced(run):
    """As the log says; otherwise, whether loop time advanced with the computer's time."""
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


def _own_pose_input(run, instance, arm):
    """Topic of the instance's pose target when it owns this arm alone and the target is in the world."""
    if (run.instances.get(instance, {}).get("arms") or []) != [arm]:
        return None
    for name in sorted(run.names):
        topic, _, leaf = name.rpartition("/")
        if leaf == "kind" and topic.rpartition("/")[0] == instance:
            kind, frame = run.get(name), run.get(f"{topic}/frame")
            if kind is not None and kind[0] == "pose" and (frame is None or frame[0] in ("", "world")):
                return topic
    return None


def pose_errors(run, arm):
    """Per owner with a target for this arm: {"instance", "t", "position" (N x 3) [m], "rotation" (N x 3) [rad]}.

    Desired minus actual, world axes: the controllet's own error output if it has one, otherwise target minus model.
    """
    out = []
    for instance in dict.fromkeys(span.instance for span in run.spans(arm)):
        prefix = output_prefix(run, instance, arm)
        if prefix is not None:
            topic = f"{instance}/outputs/{prefix}"
            position = run.get(f"{topic}position_error_m/values")
            rotation = run.get(f"{topic}orientation_error_rad/values")
            if position is None:
                continue
            if rotation is None or len(rotation) != len(position):
                rotation = np.full_like(position, np.nan)
            out.append(
                {
                    "instance": instance,
                    "t": run.get(f"{topic}position_error_m/t"),
                    "position": position,
                    "rotation": rotation,
                }
            )
            continue
        topic, model = _own_pose_input(run, instance, arm), _model_pose(run, arm)
        if topic is None or model is None:
            continue
        value, cycle = run.get(f"{topic}/value"), run.get(f"{topic}/cycle")
        rows, found = _rows_of(model[0], cycle)
        rows, value = rows[found], value[found]
        if len(value):
            out.append(
                {
                    "instance": instance,
                    "t": run.get(f"{topic}/t")[found],
                    "position": value[:, :3] - model[1][rows],
                    "rotation": rotation_error(value[:, 3:7], model[2][rows]),
                }
            )
    return out


def pose_targets(run, arm):
    """Set-point of E's position per owner: {"instance", "t", "position"}.

    The logged target of a controllet that owns only this arm; otherwise actual + error, if the controllet outputs it.
    """
    out, model = [], _model_pose(run, arm)
    errors = {entry["instance"]: entry for entry in pose_errors(run, arm)}
    for instance in dict.fromkeys(span.instance for span in run.spans(arm)):
        topic = _own_pose_input(run, instance, arm)
        if topic is not None:
            out.append({"instance": instance, "t": run.get(f"{topic}/t"), "position": run.get(f"{topic}/value")[:, :3]})
        elif instance in errors and model is not None:
            t_model = run.get(f"{arm}/model/t")
            rows, found = _rows_of(t_model, errors[instance]["t"])  # both are the stamp of the same cycle
            if found.any():
                out.append(
                    {
                        "instance": instance,
                        "t": errors[instance]["t"][found],
                        "position": model[1][rows[found]] + errors[instance]["position"][found],
                    }
                )
    return out


def joint_targets(run, arm):
    """Joint set-points per owner: {"instance", "t", "q_d" (N x n) [rad], "error" (N x n) = q_d - q}."""
    out, q, cycles = [], run.get(f"{arm}/state/q"), run.get(f"{arm}/state/cycle")
    if q is None:
        return out
    for instance in dict.fromkeys(span.instance for span in run.spans(arm)):
        if (run.instances.get(instance, {}).get("arms") or []) != [arm]:
            continue
        for name in sorted(run.names):
            topic, _, leaf = name.rpartition("/")
            if leaf != "kind" or topic.rpartition("/")[0] != instance or run.get(name) is None:
                continue
            value = run.get(f"{topic}/value")
            if run.get(name)[0] != "joints" or value.shape[1] != q.shape[1]:
                continue
            rows, found = _rows_of(cycles, run.get(f"{topic}/cycle"))
            out.append(
                {
                    "instance": instance,
                    "t": run.get(f"{topic}/t")[found],
                    "q_d": value[found],
                    "error": value[found] - q[rows[found]],
                }
            )
    return out


def tracking(run, arm):
    """One row per owner of the arm: active time [s] and tracking errors (max and RMS of norms, largest joint)."""
    pose = {entry["instance"]: entry for entry in pose_errors(run, arm)}
    joint = {entry["instance"]: entry for entry in joint_targets(run, arm)}
    rows = []
    for instance in dict.fromkeys(span.instance for span in run.spans(arm)):
        row = {
            "instance": instance,
            "active": sum(s.end - s.start for s in run.spans(arm) if s.instance == instance),
            "position_max": None,
            "position_rms": None,
            "rotation_max": None,
            "rotation_rms": None,
            "joint_max": None,
        }
        if instance in pose:
            for key in ("position", "rotation"):
                norm = np.linalg.norm(pose[instance][key], axis=1)
                norm = norm[np.isfinite(norm)]
                if len(norm):
                    row[f"{key}_max"] = float(norm.max())
                    row[f"{key}_rms"] = float(np.sqrt(np.mean(norm**2)))
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
    """(t, force N x 3, torque N x 3) where the flag says that it is valid (NaN elsewhere); None when it never is."""
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
    timing = {}
    requests, cycles = run.get("switch_timing/request"), run.get("switch_timing/cycle")
    if requests is not None:
        for i, key in enumerate(zip(requests.tolist(), cycles.tolist())):
            timing[key] = {
                name: float(run.get(f"switch_timing/{name}")[i]) for name in ("waiting", "computing", "total")
            }
    rows = []
    for switch in run.switches:
        row = dict(switch)
        row.update(
            timing.get((switch["request"], switch["cycle"]), {"waiting": None, "computing": None, "total": None})
        )
        rows.append(row)
    return rows


def intervention_groups(run):
    """By rule, arm and controllet: how many episodes, first and last time, extreme value, its limit and joint."""
    groups = {}
    for message in run.interventions:
        key = (message["code"], message["arm"], message["instance"])
        group = groups.setdefault(
            key,
            {
                "code": key[0],
                "arm": key[1],
                "instance": key[2],
                "count": 0,
                "first": message["stamp"],
                "last": message["stamp"],
                "value": None,
                "limit": None,
                "joints": set(),
            },
        )
        group["count"] += 1
        group["last"] = message["stamp"]
        if message["joint"] >= 0:
            group["joints"].add(message["joint"])
        value = message["value"]
        if value is not None and (group["value"] is None or abs(value) > abs(group["value"])):
            group["value"], group["limit"] = value, message["limit"]
    return list(groups.values())


def missing(run):
    """What is not in the log, one sentence each; empty: nothing is known to be missing."""
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
            out.append(f"The log begins with cycle {int(run.get('timing/cycle')[0])}: those before it are missing.")
    end = run.meta.get("missing")
    if end is None:
        out.append(
            "The log has no closing summary (killed, or the disk was full): the time after its last message is unknown."
        )
    else:
        if int(end.get("events_lost") or 0):
            out.append(
                f"{end['events_lost']} events (switches, interventions, ...) are not in the log: too many at once."
            )
        if int(end.get("messages_lost") or 0):
            topics = ", ".join(f"{key[5:]} {end[key]}" for key in sorted(end) if key.startswith("lost:"))
            reason = f" ({end['error']})" if end.get("error") else ""
            out.append(f"{end['messages_lost']} messages could not be written{reason}: {topics or 'topics not known'}.")
        elif end.get("error"):
            out.append(f"The log's writer reported: {end['error']}.")
    if not run.arms:
        out.append("No arm is in the log.")
    for arm in run.arms:
        for topic, key, what in (
            ("state", "t", "joint states"),
            ("command", "t", "commands"),
            ("model", "t", "model summary (pose, gravity, manipulability)"),
        ):
            if run.get(f"{arm}/{topic}/{key}") is None:
                out.append(f"Arm {arm}: no {what} (/{arm}/{topic}).")
    return out
