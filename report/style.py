"""Style shared by all plots: colors that keep their meaning, and few, thin lines."""

import matplotlib

matplotlib.use("Agg")

INK, FAINT, GRID = "#1f2933", "#6b7785", "#e3e7ec"
INTERVENTION = "#d9480f"
LIMIT = "#b42318"
AXES_XYZ = ("#c0392b", "#2e8b57", "#2b5fb8")  # x, y, z, as everywhere in robotics
NORM = "#1f2933"
# One color per joint; told apart by color-blind readers, too (after Paul Tol), then variants for longer arms.
JOINTS = (
    "#4477aa",
    "#ee6677",
    "#228833",
    "#b8a81f",
    "#33a9cc",
    "#aa3377",
    "#7a7a7a",
    "#8a5a2b",
    "#223f66",
    "#993344",
    "#115522",
    "#7a6f10",
    "#116677",
    "#661a44",
    "#3d3d3d",
    "#c79a63",
)
STAGES = ("#9db9d6", "#4477aa", "#88bb88", "#e0b050", "#b48fc0")
BANDS = ("#cfe0f3", "#fbdcb8", "#d2ead0", "#e5d6f1", "#f8d0d6", "#cdebea", "#f2edb9", "#e6d5c3")
HOLD_BAND = "#e2e5e9"

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
        "axes.formatter.useoffset": False,
        "path.simplify_threshold": 0.5,
    }
)


def band_colors(instances):
    """The color of each controllet instance in all pictures of one report; all holds are gray."""
    colors, used = {}, 0
    for name, entry in instances.items():
        if entry.get("type") == "hold" or name.endswith("_hold"):
            colors[name] = HOLD_BAND
        else:
            colors[name] = BANDS[used % len(BANDS)]
            used += 1
    return colors
