"""A synthetic run in the layout of an exported log, for tests and for viewing the page.

sample_run.py DIR    writes DIR/log.npz and DIR/meta.json
"""

import json
import pathlib
import sys

import numpy as np

HOME = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
LIMITS = {
    "q_min": [-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973],
    "q_max": [2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973],
    "dq_max": [2.175] * 4 + [2.61] * 3,
    "tau_max": [87.0] * 4 + [12.0] * 3,
    "tau_rate_max": [1000.0] * 7,
}


def _texts(values):
    return np.array(values, dtype=str)


def _topic(out, topic, t, cycle, **fields):
    out[f"{topic}/t"], out[f"{topic}/cycle"] = t, cycle
    for name, values in fields.items():
        out[f"{topic}/{name}"] = np.asarray(values)


def _reference(out, topic, t, cycle, kind, value):
    n = len(t)
    _topic(
        out,
        topic,
        t,
        cycle,
        kind=_texts([kind] * n),
        frame=_texts(["world" if kind == "pose" else ""] * n),
        value=value,
        rate=np.zeros((n, 6 if kind == "pose" else value.shape[1])),
    )


def _arm(out, arm, owners, t, cycle, rng, wrench):
    n, side = len(t), 1.0 if arm == "left" else -1.0
    phase = 2 * np.pi * t / 6
    q = HOME + 0.25 * np.sin(np.outer(phase, np.ones(7)) + np.arange(7)) * np.minimum(t / 3, 1)[:, None]
    dq = np.gradient(q, t, axis=0) + 1e-3 * rng.standard_normal((n, 7))
    tau = 8 * np.sin(np.outer(phase, np.linspace(0.7, 1.6, 7))) * np.array([1, 1, 1, 1, 0.25, 0.25, 0.2])
    gravity = np.array([0, -35.0, 0, 20.0, 1.0, 2.0, 0]) * np.cos(0.3 * np.sin(phase))[:, None]
    _topic(
        out,
        f"{arm}/state",
        t,
        cycle,
        q=q,
        dq=dq,
        tau_j=tau + gravity + 0.05 * rng.standard_normal((n, 7)),
        tau_j_d=tau,
        tau_ext=0.3 * rng.standard_normal((n, 7)),
        age=np.zeros(n),
        sequence=cycle,
    )
    owner = np.select(
        [t >= start for start, _ in reversed(owners)], [name for _, name in reversed(owners)], default=owners[0][1]
    )
    limited = np.zeros((n, 7), dtype=np.int64)
    _topic(
        out,
        f"{arm}/command",
        t,
        cycle,
        owner=_texts(owner),
        due=np.ones(n, dtype=np.int64),
        tau_controllet=tau,
        tau_feature=np.zeros((n, 7)),
        tau_cmd=tau,
        limited=limited,
        interventions=np.zeros(n, dtype=np.int64),
    )
    p = np.stack(
        [0.45 + 0.08 * np.sin(phase), side * 0.26 + 0.06 * np.cos(phase), 0.45 + 0.03 * np.sin(2 * phase)], axis=1
    )
    half = 0.05 * np.sin(phase)  # half the angle about z
    wxyz = np.stack([np.cos(half), np.zeros(n), np.zeros(n), np.sin(half)], axis=1)
    tenth = slice(None, None, 10)
    _topic(
        out,
        f"{arm}/model",
        t[tenth],
        cycle[tenth],
        pose_position=p[tenth],
        pose_orientation=wxyz[tenth][:, [1, 2, 3, 0]],
        tau_gravity=gravity[tenth],
        tau_coriolis=np.zeros((len(t[tenth]), 7)),
        manipulability=0.08 + 0.01 * np.sin(phase[tenth]),
    )
    if wrench:
        push = np.where((t > 12) & (t < 14), -15.0, 0.0)
        contact = np.stack([0 * t, 0 * t, push], axis=1)
        _topic(
            out,
            f"{arm}/wrench",
            t,
            cycle,
            has_estimate=np.ones(n, dtype=np.int64),
            estimated_force=contact + 0.4 * rng.standard_normal((n, 3)),
            estimated_torque=0.1 * rng.standard_normal((n, 3)),
            has_contact_truth=np.ones(n, dtype=np.int64),
            contact_force=contact,
            contact_torque=np.zeros((n, 3)),
        )
    return {"t": t, "cycle": cycle, "q": q, "p": p, "wxyz": wxyz, "owner": owner}


def _single(out, name, truth, rng):
    """cartesian_impedance with this arm alone: target and errors."""
    on = truth["owner"] == name
    n = int(on.sum())
    error = 0.004 * np.sin(2 * np.pi * truth["t"][on] / 3)[:, None] * np.array(
        [1, 0.4, -0.5]
    ) + 5e-5 * rng.standard_normal((n, 3))
    _reference(
        out,
        f"{name}/pose",
        truth["t"][on],
        truth["cycle"][on],
        "pose",
        np.hstack([truth["p"][on] + error, truth["wxyz"][on]]),
    )
    _topic(out, f"{name}/outputs/position_error_m", truth["t"][on], truth["cycle"][on], values=error)
    _topic(
        out,
        f"{name}/outputs/orientation_error_rad",
        truth["t"][on],
        truth["cycle"][on],
        values=0.01 * np.sin(2 * np.pi * truth["t"][on] / 4)[:, None] * np.array([0.3, 1, 0.2]),
    )


def _pair(out, name, truths, prefixes, rng):
    for truth, prefix in zip(truths, prefixes):
        on = truth["owner"] == name
        wave = np.sin(2 * np.pi * truth["t"][on] / 2.5)[:, None]
        _topic(
            out,
            f"{name}/outputs/{prefix}position_error_m",
            truth["t"][on],
            truth["cycle"][on],
            values=0.003 * wave * np.array([1, -0.3, 0.5]) + 3e-5 * rng.standard_normal((int(on.sum()), 3)),
        )
        _topic(
            out,
            f"{name}/outputs/{prefix}orientation_error_rad",
            truth["t"][on],
            truth["cycle"][on],
            values=0.008 * wave * np.array([0.2, 1, 0.4]),
        )


def invent(seconds=20.0, arms=("left", "right"), seed=1, wrench=True):
    """(arrays by name, metadata)"""
    rng = np.random.default_rng(seed)
    n = int(round(1000 * seconds))
    cycle, t = np.arange(1, n + 1), np.arange(n) * 1e-3
    out, truths = {}, {}
    two = len(arms) == 2
    for arm in arms:
        owners = [(0.0, f"{arm}_cartesian")]
        if arm == "left":
            owners.append((0.25 * seconds, "left_joints"))
        if two:
            owners += [(0.45 * seconds, "dual"), (0.65 * seconds, "coupled")]
            owners += (
                [(0.9 * seconds, "left_hold"), (0.905 * seconds, "left_cartesian")]
                if arm == "left"
                else [(0.9 * seconds, "right_hold")]
            )
        truths[arm] = _arm(out, arm, owners, t, cycle, rng, wrench and arm == "left")
        _single(out, f"{arm}_cartesian", truths[arm], rng)
    if "left" in arms:
        on = truths["left"]["owner"] == "left_joints"
        error = 0.01 * np.exp(-(t[on] - t[on][0])[:, None]) * np.linspace(1, -1, 7)
        _reference(out, "left_joints/joints", t[on], cycle[on], "joints", truths["left"]["q"][on] + error)
    if two:
        _pair(out, "dual", [truths[a] for a in arms], ("first_", "second_"), rng)
        _pair(out, "coupled", [truths[a] for a in arms], ("absolute_", "relative_"), rng)

    total = 9e-6 * (1 + rng.gamma(2.0, 0.06, n)) + np.where(rng.random(n) < 0.004, rng.gamma(2.0, 15e-6, n), 0)
    total[n // 3] = 4.1e-4
    shares = np.array([0.12, 0.58, 0.08, 0.1, 0.12])
    _topic(
        out,
        "timing",
        t,
        cycle,
        start=t + np.abs(4e-5 * rng.standard_normal(n)),
        period=np.full(n, 1e-3),
        overruns=np.where(t > seconds / 3, 1, 0),
        total=total,
        records_lost=np.zeros(n, dtype=np.int64),
        **{name: total * share for name, share in zip(("read", "controllets", "features", "safety", "write"), shares)},
    )

    switches, timings, interventions, events = [], [], [], []

    def switch(at, started, stopped, kept, step, request):
        k = int(round(1000 * at * seconds))
        switches.append(
            {
                "stamp": float(t[k]),
                "cycle": int(cycle[k]),
                "request": request,
                "accepted": True,
                "verdict": "accepted",
                "text": f"started {', '.join(started)}; stopped {', '.join(stopped)}",
                "started": started,
                "stopped": stopped,
                "kept": kept,
                "arms": list(step),
                "torque_step_computed": [v[0] for v in step.values()],
                "torque_step": [v[1] for v in step.values()],
            }
        )
        if request:
            timings.append((float(t[k]), int(cycle[k]), request, 0.45e-3 + 0.1e-3 * len(timings), 21e-6))

    if "left" in arms:
        kept = [f"{a}_cartesian" for a in arms if a != "left"]
        switch(0.25, ["left_joints"], ["left_cartesian"], kept, {"left": (2.31, 1.0)}, 11)
    if two:
        switch(
            0.45, ["dual"], ["left_joints", "right_cartesian"], [], {"left": (0.82, 0.82), "right": (0.41, 0.41)}, 12
        )
        switch(0.65, ["coupled"], ["dual"], [], {"left": (0.12, 0.12), "right": (0.09, 0.09)}, 13)
        switch(0.9, ["left_hold", "right_hold"], ["coupled"], [], {"left": (3.2, 1.0), "right": (2.9, 1.0)}, 0)
        switch(0.905, ["left_cartesian"], ["left_hold"], ["right_hold"], {"left": (0.4, 0.4)}, 14)
        k = int(round(900 * seconds))
        interventions += [
            {
                "stamp": float(t[k]),
                "cycle": int(cycle[k]),
                "code": "torque not finite",
                "arm": arm,
                "instance": "coupled",
                "joint": 0,
                "value": None,
                "limit": None,
                "count": 1,
            }
            for arm in arms
        ]
    k = n // 4
    interventions.append(
        {
            "stamp": float(t[k]),
            "cycle": int(cycle[k]),
            "code": "torque rate clamped",
            "arm": arms[0],
            "instance": f"{arms[0]}_cartesian",
            "joint": 3,
            "value": 2310.0,
            "limit": 1000.0,
            "count": 1,
        }
    )
    events.append(
        {
            "stamp": float(t[n // 10]),
            "cycle": int(cycle[n // 10]),
            "kind": "target_set",
            "verdict": "accepted",
            "request": 3,
            "arms": [],
            "instance": f"{arms[0]}_cartesian",
            "item": "pose",
            "text": f"{arms[0]}_cartesian.pose to 0.5 0.2 0.4",
            "values": [0.5, 0.2, 0.4],
        }
    )
    for topic, messages in (("switches", switches), ("interventions", interventions), ("events", events)):
        if messages:
            out[f"{topic}/t"] = np.array([m["stamp"] for m in messages])
            out[f"{topic}/json"] = _texts([json.dumps(m) for m in messages])
    if timings:
        columns = list(zip(*timings))
        _topic(
            out,
            "switch_timing",
            np.array(columns[0]),
            np.array(columns[1]),
            request=columns[2],
            waiting=columns[3],
            computing=columns[4],
            total=np.array(columns[3]) + np.array(columns[4]),
        )

    names = sorted({str(name) for truth in truths.values() for name in np.unique(truth["owner"])})
    instances = [
        {
            "name": name,
            "type": "hold" if name.endswith("_hold") else "cartesian_impedance",
            "arms": list(arms) if name in ("dual", "coupled") else [name.split("_")[0]],
        }
        for name in names
    ]
    meta = {
        "scene_name": "invented",
        "scene_description": "A synthetic run, for viewing the page.",
        "scene_text": "arms: []\n",
        "run": {
            "scene": "invented",
            "seed": str(seed),
            "version": "0.0",
            "cpu": "none",
            "cores": "2",
            "threads": "SCHED_FIFO refused: no right",
        },
        "intervention_units": {"torque rate clamped": "N m/s"},
        "missing": {"cycles": str(n), "cycles_lost": "0", "events_lost": "0", "messages_lost": "0", "error": ""},
        "layout": {"arms": [{"name": arm, "joints": 7} for arm in arms], "instances": instances},
        "limits": {arm: LIMITS for arm in arms},
        "plant": {"name": "ideal", "joint_friction": False, "torque_bandwidth_hz": 0},
    }
    return out, meta


def write(folder, arrays, meta=None):
    """(path of the archive, path of the metadata or None)"""
    folder = pathlib.Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    np.savez(folder / "log.npz", **arrays)
    if meta is None:
        return folder / "log.npz", None
    (folder / "meta.json").write_text(json.dumps(meta), encoding="utf-8")
    return folder / "log.npz", folder / "meta.json"


if __name__ == "__main__":
    write(sys.argv[1], *invent())
