"""The delay of a torque from the controller to the arm, measured in two ways. Times in s, torques (N x n) in N m."""

import numpy as np


def by_correlation(t_sent, sent, t_used, used, window=None, lags=(-0.003, 0.012), step=5e-5):
    """The lag at which the torques in use are most similar to the torques sent [s]; None: no motion.

    Both series are interpolated linearly over the union of their time stamps, then correlated: for each lag L the mean
    over joints of the correlation of sent(t - L) with used(t). First in steps of a millisecond, then finely about the
    best, then by a parabola through the three best. `window`: (first, last) of the stamps that count.
    """
    sent, used = np.asarray(sent, dtype=float), np.asarray(used, dtype=float)
    stamps = np.union1d(t_sent, t_used)
    first, last = window if window is not None else (stamps[0], stamps[-1])
    # Only stamps at which both series are known for every lag.
    first = max(first, t_sent[0] + max(lags[1], 0.0), t_used[0])
    last = min(last, t_sent[-1] + min(lags[0], 0.0), t_used[-1])
    stamps = stamps[(stamps >= first) & (stamps < last)]
    if len(stamps) < 10:
        return None
    joints = []
    for j in range(sent.shape[1]):
        r = np.interp(stamps, t_used, used[:, j])
        r = r - r.mean()
        norm = np.linalg.norm(r)
        if norm > 1e-9 * np.sqrt(len(r)):
            joints.append((j, r / norm))
    if not joints:
        return None

    def likeness(lag):
        total = 0.0
        for j, r in joints:
            c = np.interp(stamps - lag, t_sent, sent[:, j])
            c = c - c.mean()
            norm = np.linalg.norm(c)
            total += float(c @ r) / norm if norm > 0 else 0.0
        return total / len(joints)

    coarse = np.arange(np.ceil(lags[0] * 1e3), np.floor(lags[1] * 1e3) + 1) * 1e-3
    best = coarse[int(np.argmax([likeness(lag) for lag in coarse]))]
    fine = best + np.arange(-round(1e-3 / step), round(1e-3 / step) + 1) * step
    values = np.array([likeness(lag) for lag in fine])
    k = int(np.argmax(values))
    if 0 < k < len(fine) - 1:
        a, b, c = values[k - 1], values[k], values[k + 1]
        bend = a - 2 * b + c
        if bend < 0:
            return float(fine[k] + 0.5 * step * (a - c) / bend)
    return float(fine[k])


def by_correlation_in_windows(t_sent, sent, t_used, used, length=1.0, **options):
    """The same for each whole stretch of `length` [s]: a distribution instead of one number."""
    begin, end = max(t_sent[0], t_used[0]), min(t_sent[-1], t_used[-1])
    count = max(int((end - begin) / length + 0.01), 1)  # the last window may lack its last stamps
    found = [
        by_correlation(t_sent, sent, t_used, used, (begin + i * length, begin + (i + 1) * length), **options)
        for i in range(count)
    ]
    return np.array([lag for lag in found if lag is not None])


def by_sequence(sequence, sent, used, period, largest=20, tolerance=0.0):
    """Per cycle: after how many periods the arm reported the torque that was sent, times the period [s].

    `sequence`: of the arm's packet that the torque of this row answers; `used`: the torque in use that this packet
    reports. A torque that is used at once is reported by the next packet: delay 0. NaN: never (lost, or it came
    after the last packet, or the previous one was identical). The last `largest` + 1 rows are left out.
    `tolerance` [N m], one for all rows or one each: how much smaller the torque sent to the arm may have been.
    """
    sequence = np.asarray(sequence)
    sent, used = np.asarray(sent), np.asarray(used)
    n = max(len(sequence) - largest - 1, 0)
    within = np.broadcast_to(tolerance, len(sequence))[:n, None]
    delay = np.full(n, np.nan)
    unique = np.ones(n, dtype=bool)
    unique[1:] = np.any(sent[1:n] != sent[: max(n - 1, 0)], axis=1) if n > 1 else True
    for packets in range(largest, 0, -1):  # descending, so that the earliest match remains
        rows = np.searchsorted(sequence, sequence[:n] + packets)
        inside = rows < len(sequence)
        rows = np.minimum(rows, len(sequence) - 1)
        same = (
            inside
            & (sequence[rows] == sequence[:n] + packets)
            & np.all(np.abs(used[rows] - sent[:n]) <= within, axis=1)
        )
        delay[same & unique] = (packets - 1) * period
    return delay
