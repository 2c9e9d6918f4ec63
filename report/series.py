"""Statistics of samples, the same for all pages; and long series for plots.

No peak is lost, and no line is drawn where nothing was recorded.
"""

import math

import numpy as np

COLUMNS = 1000  # about one per pixel column


def envelope(t, y, columns=COLUMNS):
    """(t, y) with the smallest and the largest value of each of `columns` equal runs of samples, in order of time.

    y is (N,). Short series are returned unchanged. A run without a finite value becomes NaN.
    """
    n = len(t)
    if n <= 2 * columns:
        return t, y
    grid, length = _grid(y, columns)
    finite = np.isfinite(grid)
    low = np.where(finite, grid, np.inf).argmin(axis=1)
    high = np.where(finite, grid, -np.inf).argmax(axis=1)
    pick = np.sort(np.stack([low, high], axis=1), axis=1) + (np.arange(len(grid)) * length)[:, None]
    pick = np.minimum(pick.ravel(), n - 1)
    return t[pick], np.where(np.repeat(finite.any(axis=1), 2), y[pick], np.nan)


def _grid(y, columns):
    """Rows of equal length, the last one filled up with NaN."""
    length = -(-len(y) // columns)
    rows = -(-len(y) // length)
    return np.concatenate([y, np.full(rows * length - len(y), np.nan)]).reshape(rows, length), length


def pieces(t, y):
    """Cut wherever the time between two samples is more than five times the usual one."""
    if len(t) < 3:
        return [(t, y)]
    step = np.diff(t)
    cuts = np.flatnonzero(step > 5 * np.median(step)) + 1
    return list(zip(np.split(t, cuts), np.split(y, cuts)))


def _joined(parts):
    """Joins pieces to one series, with a NaN at each line break."""
    t = np.concatenate([np.append(t, t[-1]) for t, _ in parts])[:-1]
    y = np.concatenate([np.append(y, np.nan) for _, y in parts])[:-1]
    return t, y


def _columns_of(part, total, columns):
    return max(2, round(columns * len(part) / total))


def drawable(t, y, columns=COLUMNS):
    """The line to draw: broken at gaps, thinned to its envelope."""
    parts = pieces(t, y)
    return _joined([envelope(a, b, _columns_of(a, len(t), columns)) for a, b in parts])


def band_and_mean(t, y, columns=COLUMNS // 2):
    """(t, low, high, mean) of equal runs of samples, for a series that jitters; None if a plain line is enough.

    It jitters when, within one run, it typically moves back and forth by more than 4 % of its whole range.
    """
    y = np.asarray(y, dtype=float)
    if len(t) <= 4 * columns or not np.isfinite(y).any():
        return None
    jump = np.abs(y[2:] - 2 * y[1:-1] + y[:-2])  # nearly zero for a smooth motion
    whole = np.nanmax(y) - np.nanmin(y)
    if whole == 0 or not np.nanmedian(jump) > 0.02 * whole:
        return None
    out = []
    for a, b in pieces(t, y):
        grid, length = _grid(b, _columns_of(a, len(t), columns))
        finite = np.isfinite(grid)
        count = finite.sum(axis=1)
        middle = a[np.minimum(np.arange(len(grid)) * length + length // 2, len(a) - 1)]
        empty = count == 0
        low = np.where(empty, np.nan, np.where(finite, grid, np.inf).min(axis=1))
        high = np.where(empty, np.nan, np.where(finite, grid, -np.inf).max(axis=1))
        mean = np.where(empty, np.nan, np.where(finite, grid, 0.0).sum(axis=1) / np.maximum(count, 1))
        out.append((middle, low, high, mean))
    times = _joined([(m, low) for m, low, _, _ in out])[0]
    return (times, *(_joined([(part[0], part[k]) for part in out])[1] for k in (1, 2, 3)))


def per_bin(t, y, edges, reduce):
    """reduce(values of y in [edges[i], edges[i + 1])) for each bin; NaN for an empty one. t ascending."""
    bounds = np.searchsorted(t, edges)
    return np.array([reduce(y[a:b]) if b > a else np.nan for a, b in zip(bounds[:-1], bounds[1:])])


def rms(values):
    """Root of the mean square; None without a value."""
    values = np.asarray(values, dtype=float)
    return float(np.sqrt(np.mean(values**2))) if values.size else None


def percentile(values, share):
    """Quantile by nearest rank, as in the live summary: the smallest value that a fraction `share` does not exceed."""
    rank = max(1, math.ceil(share * len(values) - 1e-6))  # rounding: 0.999 * 4000 is 3996, not slightly more
    return float(np.partition(values, rank - 1)[rank - 1])


def spread(values):
    """Median, mean, tails and number of the finite values; None if there is none. Percentiles are interpolated."""
    values = np.asarray(values, dtype=float)
    values = values[np.isfinite(values)]
    if not values.size:
        return None
    shares = {"p1": 1, "p25": 25, "median": 50, "p75": 75, "p95": 95, "p99": 99, "p999": 99.9}
    return {
        **dict(zip(shares, np.percentile(values, list(shares.values())).tolist())),
        "mean": float(values.mean()),
        "deviation": float(values.std()),
        "worst": float(values.max()),
        "least": float(values.min()),
        "count": int(values.size),
    }
