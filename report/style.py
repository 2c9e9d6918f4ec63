"""How all plots look and are drawn: colors that keep their meaning, few and thin lines, sheets as wide as the page."""

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from matplotlib.transforms import Bbox

from report import series

INK, FAINT, GRID = "#1f2933", "#6b7785", "#e3e7ec"
INTERVENTION = "#d9480f"
LIMIT = "#b42318"
AXES_XYZ = ("#c0392b", "#2e8b57", "#2b5fb8")  # x, y, z in the usual colors of robotics
BLUE, DARK_BLUE, PALE_BLUE, PURPLE = "#4477aa", "#1d4f91", "#b9cde3", "#7b3fa0"
# One color per joint, distinct for color-blind readers (after Paul Tol), then variants for longer arms.
JOINTS = (
    "#4477aa #ee6677 #228833 #b8a81f #33a9cc #aa3377 #7a7a7a #8a5a2b "
    "#223f66 #993344 #115522 #7a6f10 #116677 #661a44 #3d3d3d #c79a63"
).split()
STAGES = "#9db9d6 #4477aa #88bb88 #e0b050 #b48fc0".split()
BANDS = "#cfe0f3 #fbdcb8 #d2ead0 #e5d6f1 #f8d0d6 #cdebea #f2edb9 #e6d5c3".split()
HOLD_BAND = "#e2e5e9"
DASHED, SET_POINT = (0, (4, 3)), (0, (2, 2))

WIDTH_IN, DPI = 9.4, 115
LEFT_IN, RIGHT_IN = 0.75, 0.95

matplotlib.rcParams.update(
    {
        "font.family": "DejaVu Sans",
        "font.size": 8.5,
        "axes.titlesize": 9,
        "axes.labelsize": 8.5,
        "axes.titlelocation": "left",
        "axes.titlepad": 4,
        "axes.titlecolor": INK,
        "axes.labelcolor": INK,
        "axes.edgecolor": "#9aa5b1",
        "axes.linewidth": 0.7,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.grid": True,
        "grid.color": GRID,
        "grid.linewidth": 0.7,
        "axes.axisbelow": True,
        "xtick.color": FAINT,
        "ytick.color": FAINT,
        "xtick.labelcolor": INK,
        "ytick.labelcolor": INK,
        "xtick.major.width": 0.7,
        "ytick.major.width": 0.7,
        "lines.linewidth": 1.1,
        "lines.solid_joinstyle": "round",
        "legend.frameon": False,
        "legend.fontsize": 8,
        "legend.handlelength": 1.4,
        "legend.borderaxespad": 0,
        "figure.facecolor": "white",
        "figure.dpi": DPI,
        "axes.formatter.useoffset": False,
        "path.simplify_threshold": 0.5,
    }
)


def band_colors(instances):
    """The color of each controllet instance in all pictures of one report; all holds are gray."""
    holds = [name for name, entry in instances.items() if entry.get("type") == "hold" or name.endswith("_hold")]
    others = [name for name in instances if name not in holds]
    return dict.fromkeys(holds, HOLD_BAND) | {name: BANDS[i % len(BANDS)] for i, name in enumerate(others)}


def save(figure, path):
    """Saves and closes the figure, wider where long numbers push a label over its edge; returns the path."""
    figure.savefig(path, bbox_inches=Bbox.union([figure.bbox_inches, figure.get_tightbbox()]))
    plt.close(figure)
    return path


def sheet(rows=1, columns=1, height=2.8, width=WIDTH_IN, **how):
    """Figure of that height [in] and as wide as the page; its axes in two dimensions."""
    return plt.subplots(rows, columns, figsize=(width, height), squeeze=False, **how)


def panels(count, columns, height, top=0.55):
    """Figure with rows of `height` [in] and the axes that are used; the others are empty."""
    rows = -(-count // columns)
    figure, axes = sheet(rows, columns, rows * height + top)
    for axis in axes.flat[count:]:
        axis.set_visible(False)
    return figure, list(axes.flat[:count])


def legend_below(figure, handles, labels, lines=1, **fit):
    """One legend under all panels, which make room for it."""
    figure.legend(handles, labels, loc="lower center", ncols=-(-len(labels) // lines), bbox_to_anchor=(0.5, 0.0))
    figure.tight_layout(rect=(0, (0.1 + 0.2 * lines) / figure.get_size_inches()[1], 1, 1), **fit)


def line(axis, t, y, **how):
    """Draws a line; draws a noisy series as its mean with a pale band from minimum to maximum."""
    jitter = series.band_and_mean(t, y)
    if jitter is None:
        axis.plot(*series.drawable(t, y), **how)
        return
    times, low, high, mean = jitter
    axis.fill_between(times, low, high, facecolor=how["color"], edgecolor="none", alpha=0.22, zorder=1.5)
    axis.plot(times, mean, **how)


def level(axis, y, color=LIMIT, **how):
    """A dashed horizontal line: a limit, or a figure of the paper."""
    axis.axhline(y, color=color, linewidth=0.9, linestyle=DASHED, **how)


def note(axis, text, x=0.5, y=0.5, **how):
    """Faint text in the middle of an empty panel: the reason."""
    axis.text(x, y, text, transform=axis.transAxes, ha="center", va="center", color=FAINT, **how)


def name_places(axis, names):
    """Labels the bars 0, 1, ... of a chart instead of a scale."""
    axis.set_xticks(range(len(names)), names)
    axis.tick_params(axis="x", length=0)
    axis.grid(False, axis="x")


def log_scale(axis):
    """A logarithmic scale with plain numbers at 1, 2 and 5, for example of `plot.xaxis`."""
    axis.axes.set(**{f"{axis.axis_name}scale": "log"})
    axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())
