"""One run of a task: its log as series, its contact, and the window of its figures."""

import pathlib
from functools import cached_property

import numpy as np

from report import loading, metrics

TOUCHING_N = 0.1  # true contact force above which a tool touches
TOUCHING_EST_N = 2.0  # the same for an estimated force, which is never quite zero, for TOUCHING_EST_S
TOUCHING_EST_S = 0.02
MEASURED = "measured"  # the plant of runs on arms, which have no true forces and no poses of objects


class TaskRun:
    """`entry` is one of the plan's `runs`, `measure` the experiment's; paths are relative to `folder`."""

    def __init__(self, entry, measure, folder):
        self.entry, self.measure = entry, measure or {}
        self.run = loading.load(pathlib.Path(folder) / entry["npz"])
        self.run.meta["instance_arms"] = entry.get("instance_arms") or {}
        self._objects = pathlib.Path(folder) / entry["objects"] if entry.get("objects") else None

    plant = property(lambda self: self.entry["plant"])
    variant = property(lambda self: self.entry["variant"])
    repeat = property(lambda self: self.entry["repeat"])
    arms = property(lambda self: self.run.arms)

    @property
    def measured(self):
        """Whether the run was on arms: its forces are the estimated ones."""
        return self.plant == MEASURED

    # Forces ----------------------------------------------------------------------------------------------------------

    @cached_property
    def forces(self):
        """Per controlled force: {"arm", "t", "desired", "true", "estimate"} along its direction, each (N) [N].

        On arms `true` is the estimate, too.
        """
        out = []
        for item in self.measure.get("force") or []:
            arm, direction = item["arm"], np.array(item["direction"], dtype=float)
            t, true = self.run.get(f"{arm}/wrench/t"), metrics.wrench(self.run, arm, "contact", "has_contact_truth")
            estimate = metrics.wrench(self.run, arm, "estimated", "has_estimate")
            true = estimate if true is None and self.measured else true
            if t is None or true is None:
                raise ValueError(f"the log of {self.entry['name']} has no contact force of arm {arm}")
            topic = f"{item['instance']}/outputs/{item['desired']}"
            desired, t_desired = self.run.get(f"{topic}/values"), self.run.get(f"{topic}/t")
            if desired is None:  # a law without a force target: the expected force
                if "desired_n" not in item:
                    raise ValueError(f"the log of {self.entry['name']} has no output {topic}")
                t_desired, desired = t, np.full(len(t), item["desired_n"])
            desired = desired[:, 0] if desired.ndim > 1 else desired
            force = {"arm": arm, "t": t, "direction": direction, "true": true[1] @ direction}
            force["estimate"] = estimate[1] @ direction if estimate is not None else np.full(len(t), np.nan)
            out.append(force | {"desired": np.interp(t, t_desired, desired, left=np.nan, right=np.nan)})
        return out

    @cached_property
    def contact_times(self):
        """Time of each arm's first contact in `force` [s]; NaN: never."""
        return [first_touch(force["t"], force["true"], self.measured) for force in self.forces]

    @cached_property
    def contact(self):
        """Time of the last of these contacts; None: no force is measured, or an arm never touched."""
        if not self.contact_times or any(np.isnan(self.contact_times)):
            return None
        return max(self.contact_times)

    @cached_property
    def motion_start(self):
        """When the first motion of a set-point began; None: there was none."""
        found = [e["at_s"] for e in self.entry.get("timeline") or [] if e["what"] == "motion"]
        return min(found) if found else None

    @cached_property
    def window(self):
        """(first, last) [s] of the evaluated window; None: it never started."""
        window = self.measure.get("window") or {"after": "start", "offset_s": 0.0, "duration_s": 1e9}
        first = {"start": self.run.time_range[0], "contact": self.contact, "motion": self.motion_start}[window["after"]]
        if first is None:
            return None
        first += window["offset_s"]
        return first, first + window["duration_s"]

    @property
    def window_is_whole(self):
        return self.window is not None and self.run.time_range[1] >= self.window[1] - 0.002

    def inside(self, t, first=None, last=None):
        """Rows of `t` inside the window, or between two times."""
        if first is None:
            first, last = self.window if self.window is not None else (np.inf, np.inf)
        return (t >= first - 1e-9) & (t < last - 1e-9)

    # Arms ------------------------------------------------------------------------------------------------------------

    def state(self, arm, name):
        return self.run.get(f"{arm}/state/t"), self.run.get(f"{arm}/state/{name}")

    def torque(self, arm):
        """t, tau_J - g(q)."""
        return self.run.get(f"{arm}/state/t"), self._torques[arm]

    @cached_property
    def _torques(self):
        return {arm: metrics.torque_without_gravity(self.run, arm) for arm in self.arms}

    def control_error(self, arm):
        """t, C_err = tau_J_d - (tau_J - g)."""
        t, tau = self.torque(arm)
        return t, self.run.get(f"{arm}/state/tau_j_d") - tau

    def torque_error(self, arm):
        """t, torque sent one cycle before minus measured torque: delay and tracking together."""
        t, tau = self.torque(arm)
        sent = self.run.get(f"{arm}/command/tau_cmd")
        return t[1:], sent[:-1] - tau[1:]

    def joint_errors(self, arm):
        """t, q_d - q, dq_d - dq of the controllet with a joint set-point; None without one."""
        found = metrics.joint_targets(self.run, arm)
        if not found:
            return None
        entry = found[0]
        rate = self.run.get(f"{entry['topic']}/rate")[: len(entry["t"])]
        t, dq = self.state(arm, "dq")
        rows = np.searchsorted(t, entry["t"])
        return entry["t"], entry["error"], rate - dq[np.minimum(rows, len(t) - 1)]

    def requested_torque(self, arm):
        """t, torque of controllet and features, before the limiter."""
        controllet, feature = (self.run.get(f"{arm}/command/tau_{name}") for name in ("controllet", "feature"))
        return self.run.get(f"{arm}/command/t"), controllet + feature

    def pose(self, arm):
        """t, p_WE (N x 3), quaternion w x y z (N x 4)."""
        q = self.run.get(f"{arm}/model/pose_orientation")
        return self.run.get(f"{arm}/model/t"), self.run.get(f"{arm}/model/pose_position"), q[:, [3, 0, 1, 2]]

    def speed(self, arm):
        return self.run.get(f"{arm}/model/t"), np.linalg.norm(self.run.get(f"{arm}/model/twist_linear"), axis=1)

    def target(self, instance, name):
        """t, set-point (N x ...) of an input; None: not in the log."""
        value = self.run.get(f"{instance}/{name}/value")
        return None if value is None else (self.run.get(f"{instance}/{name}/t"), value)

    def position_errors(self, arm):
        """t, p_d - p (N x 3) of the controllet with a pose set-point; None without one."""
        path = self.measure.get("path")
        # Only in the plane of the surface: along the normal the set-point may lie inside it on purpose.
        if path and path["arm"] == arm:
            t, error = self.path_errors
            return t, error * np.array([1.0, 1.0, 0.0 if path["plane"] == "xy" else 1.0])
        found = metrics.pose_errors(self.run, arm)
        return (found[0]["t"], found[0]["position"]) if found else None

    @cached_property
    def path_errors(self):
        """t, set-point minus end effector (N x 3) of `path`, independent of the controllet's outputs."""
        path = self.measure.get("path")
        if not path:
            return None
        target = self.target(path["instance"], path["input"])
        if target is None:
            return None
        t, p, _ = self.pose(path["arm"])
        rows = np.minimum(np.searchsorted(target[0], t), len(target[0]) - 1)
        found = np.abs(target[0][rows] - t) < 1e-6
        return t[found], target[1][rows[found], :3] - p[found]

    def path_distance(self, errors):
        """Length of path errors (N x 3), along the surface alone if the path is in its plane."""
        return np.linalg.norm(errors[:, :2] if self.measure["path"]["plane"] == "xy" else errors, axis=1)

    def output(self, instance, name):
        """t, values (N) or (N x k) of a controllet's output; None: it has none."""
        values, t = (self.run.get(f"{instance}/outputs/{name}/{leaf}") for leaf in ("values", "t"))
        return None if values is None else (t, values[:, 0] if values.ndim > 1 and values.shape[1] == 1 else values)

    @property
    def main_instance(self):
        """The main controllet: of its force or path, otherwise the longest owner of the first arm."""
        for part in (*(self.measure.get("force") or []), self.measure.get("path"), self.measure.get("grasp")):
            if part:
                return part["instance"]
        spans = self.run.spans(self.arms[0])
        return max(spans, key=lambda span: span.end - span.start).instance if spans else None

    # Objects ---------------------------------------------------------------------------------------------------------

    def object_pose(self, name):
        """t, position (N x 3), quaternion w x y z (N x 4) of a free object; None on arms, which do not know it."""
        if self._objects is None and self.measured:
            return None
        if self._objects is None:
            raise ValueError(f"no object was traced in {self.entry['name']}")
        with np.load(self._objects) as archive:
            rows = archive[f"{name}/pose"]
        return rows[:, 0], rows[:, 1:4], rows[:, 4:8]


def first_touch(t, force, estimated):
    """Time of the first contact by a force along its direction [s]; NaN: never. An estimate must persist."""
    if not estimated:
        touching = np.flatnonzero(force > TOUCHING_N)
        return float(t[touching[0]]) if len(touching) else float("nan")
    rows = max(1, round(TOUCHING_EST_S / float(np.median(np.diff(t)))))
    lasting = np.convolve(np.nan_to_num(force) > TOUCHING_EST_N, np.ones(rows), "valid") >= rows
    return float(t[np.argmax(lasting)]) if lasting.any() else float("nan")


def rotate(q, v):
    """R(q) v for quaternions w x y z (N x 4) and vectors (N x 3, or one for all)."""
    w, u = q[:, :1], q[:, 1:]
    v = np.broadcast_to(v, (len(q), 3))
    return v + 2 * np.cross(u, np.cross(u, v) + w * v)


def rotate_back(q, v):
    """R(q)^T v."""
    return rotate(q * np.array([1.0, -1.0, -1.0, -1.0]), v)
