"""Turns a recording of another program into the tables that multipanda reads: others.py FILE FOLDER.

Writes FOLDER/ARM.csv per arm ("-" for an arm without a name): t, q1.., dq1.., tau1.. and what else is known. FILE is an
archive of numpy (.npz; .npy with named fields), or a bag of ROS 1 or 2 with sensor_msgs/JointState or the
FrankaRobotState of franka_ros2. Prints one sentence and ends with 1 if it holds no arm.
"""

import pathlib
import re
import sys

import numpy as np

CURE = "in the source tree run ./multipanda setup, elsewhere pip install rosbags"


def arrays_of(path):
    """The arrays of an archive by arm; those of `multipanda export --npz` are named ARM/state/q."""
    data = np.load(path, allow_pickle=False)
    names = data.dtype.names if isinstance(data, np.ndarray) else data.files
    if not names:
        sys.exit("one array without names, expected an archive with t, q, dq and tau: numpy.savez(FILE, t=t, q=q, ...)")
    exported = [name.removesuffix("/state/q") for name in names if name.endswith("/state/q")]
    if not exported:
        return {"-": {name: data[name] for name in names}}
    fields = {"t": "t", "q": "q", "dq": "dq", "tau": "tau_j", "tau_d": "tau_j_d", "tau_ext": "tau_ext"}
    arms = {}
    for arm in exported:
        arms[arm] = {
            ours: data[f"{arm}/state/{name}"] for ours, name in fields.items() if f"{arm}/state/{name}" in names
        }
        cycles = [data[f"{arm}/{topic}/cycle"] for topic in ("state", "command") if f"{arm}/{topic}/cycle" in names]
        if len(cycles) == 2 and np.array_equal(*cycles):
            arms[arm]["tau_cmd"] = data[f"{arm}/command/tau_cmd"]
    return arms


def joints_of(names):
    """Arm -> places of its joints, whose names end in a number from 1: fer_joint1 to fer_joint7 are those of `fer`."""
    found = {}
    for place, name in enumerate(names):
        if match := re.fullmatch(r"(.*?)[_/]*joint_?(\d+)", name):
            if "finger" not in name:
                found.setdefault(match[1] or "-", {})[int(match[2])] = place
    return {arm: [at[k] for k in sorted(at)] for arm, at in found.items() if sorted(at) == list(range(1, len(at) + 1))}


def seconds(stamp):
    return stamp.sec + 1e-9 * stamp.nanosec


def joint_states(message, places):
    """Rows of a JointState, by arm."""
    names = tuple(message.name) or tuple(f"joint{k + 1}" for k in range(len(message.position)))
    if names not in places:
        places[names] = joints_of(names)
    columns = {"q": message.position, "dq": message.velocity, "tau": message.effort}
    if places[names] and any(len(values) != len(names) for values in columns.values()):
        counts = ", ".join(str(len(values)) for values in columns.values())
        raise ValueError(f"it names {len(names)} joints and has {counts} positions, velocities and efforts")
    return {
        arm: {"t": seconds(message.header.stamp), **{key: values[at] for key, values in columns.items()}}
        for arm, at in places[names].items()
    }


def robot_state(message, places):
    """Rows of a FrankaRobotState; that of the first releases has plain arrays, of an arm without a name."""
    if not hasattr(message, "measured_joint_state"):
        fields = {name.lower(): name for name in message.__dataclass_fields__}
        names = {"q": "q", "dq": "dq", "tau": "tau_j", "tau_d": "tau_j_d", "tau_ext": "tau_ext_hat_filtered"}
        return {"-": {"t": message.time, **{key: getattr(message, fields[name]) for key, name in names.items()}}}
    rows = joint_states(message.measured_joint_state, places)
    for row in rows.values():
        row["t"] = message.time or seconds(message.header.stamp)  # the arm's own clock has no jitter
        row["tau_d"], row["tau_ext"] = message.desired_joint_state.effort, message.tau_ext_hat_filtered.effort
    return rows


def bag(path):
    """The arms of a bag: of several topics with the same arm, the state of the arm, then the one with most messages."""
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        sys.exit(f"bags of ROS are read with the Python package rosbags, which is missing: {CURE}")
    states, faults = {}, []
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        kinds = {"sensor_msgs/msg/JointState": joint_states}
        kinds |= {f"franka_msgs/msg/Franka{kind}": robot_state for kind in ("RobotState", "State")}
        chosen = [c for c in reader.connections if c.msgtype in kinds and not re.search("desired|external", c.topic)]
        for connection in chosen:
            read, places, rows = kinds[connection.msgtype], {}, {}
            try:
                for _, _, raw in reader.messages(connections=[connection]):
                    for arm, row in read(reader.deserialize(raw, connection.msgtype), places).items():
                        rows.setdefault(arm, []).append(row)
            except KeyError:
                faults.append(
                    f"it lacks the definition of {connection.msgtype}, as bags of sqlite before ROS 2 Iron do; "
                    "run `ros2 bag convert` to storage mcap where the message is installed"
                )
            except ValueError as error:
                faults.append(str(error))
            else:
                for arm, found in rows.items():
                    rank = (read is robot_state, len(found))
                    states[arm] = max(states.get(arm, ((False, 0), [])), (rank, found), key=lambda entry: entry[0])
        topics = ", ".join(f"{c.topic} ({c.msgtype})" for c in reader.connections) or "none"
    if not states:
        sys.exit(
            "; ".join(faults)
            or "no states of an arm: expected those of multipanda, franka_msgs/msg/FrankaRobotState, or "
            f"sensor_msgs/msg/JointState of joints that are numbered from 1, like fer_joint1; its topics: {topics}"
        )
    return {arm: {key: np.array([row[key] for row in rows]) for key in rows[0]} for arm, (_, rows) in states.items()}


def write(arrays, file):
    """One table: an array of shape (N, k) is k columns with numbers from 1. Arrays of other lengths are left out."""
    rows = max(len(values) for values in arrays.values() if values.ndim > 0)
    names, columns = [], []
    for name, values in arrays.items():
        if values.ndim not in (1, 2) or len(values) != rows or values.dtype.kind not in "fiub":
            continue
        wide = values.reshape(rows, -1)
        names += [name] if values.ndim == 1 else [f"{name}{k}" for k in range(1, wide.shape[1] + 1)]
        columns.append(wide)
    np.savetxt(file, np.hstack(columns), "%.17g", ",", header=",".join(names), comments="")


def main(path, folder):
    try:
        arms = arrays_of(path) if path.suffix in (".npz", ".npy") else bag(path)
        for arm, arrays in arms.items():
            write(arrays, folder / f"{arm.replace('/', '_')}.csv")
    except Exception as error:  # noqa: BLE001 (whatever a reader says of a damaged file)
        sys.exit(f"cannot be read: {error}")


if __name__ == "__main__":
    main(pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2]))
