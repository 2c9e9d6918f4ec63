"""Long series made fit for a picture: no peak is lost, and no line is drawn where nothing was recorded."""

import numpy as np

COLUMNS = 1000  # about one per pixel column


def envelope(t, y, columns=COLUMNS):
    """(t, y) with the smallest and the largest value of each of `columns` equal runs of samples, in order of time.

    y is (N,). Short series come back as they are. A run of which no value is finite becomes one NaN.
    """
    n = len(t)
    if n <= 2 * columns:
        return t, y
    length = -(-n // columns)
    rows = -(-n // length)
    pad = rows * length - n
    y_grid = np.concatenate([y, np.full(pad, np.nan)]).reshape(rows, length)
    finite = np.isfinite(y_grid)
    low = np.where(finite, y_grid, np.inf).argmin(axis=1)
    high = np.where(finite, y_grid, -np.inf).argmax(axis=1)
    pick = np.sort(np.stack([low, high], axis=1), axis=1) + (np.arange(rows) * length)[:, None]
    pick = np.minimum(pick.ravel(), n - 1)
    return t[pick], np.where(np.repeat(finite.any(axis=1), 2), y[pick], np.nan)


def broken_at_gaps(t, y):
    """The same with a NaN wherever the time between two samples is more than five times the usual one."""
    if len(t) < 3:
        return t, y
    step = np.diff(t)
    gaps = np.flatnonzero(step > 5 * np.median(step))
    if len(gaps) == 0:
        return t, y
    return np.insert(t, gaps + 1, t[gaps] + 1e-9), np.insert(y.astype(float), gaps + 1, np.nan)


def drawable(t, y, columns=COLUMNS):
    return envelope(*broken_at_gaps(t, y), columns)


def per_bin(t, y, edges, reduce):
    """reduce(values of y in [edges[i], edges[i + 1])) for each bin; NaN for an empty one. t ascending."""
    bounds = np.searchsorted(t, edges)
    return np.array([reduce(y[a:b]) if b > a else np.nan for a, b in zip(bounds[:-1], bounds[1:])])
