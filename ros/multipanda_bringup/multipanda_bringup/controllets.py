"""The controllets that launch files offer unless a file lists its own: every law, for every arm and every pair.

Keys and values as in scene files (docs/scene_reference.md). Features are switched on and off while running, so every
feature is available for each of them.
"""


def controllets_for(arms):
    """Returns controllets by name for arms of these names: single laws for each arm, laws of two arms for each pair.

    Pairs are the first and the second arm, the third and the fourth, and so on.
    """
    found = {}
    for arm in arms:
        for law, type_name in (
            ("cartesian", "cartesian_impedance"),
            ("joint", "joint_impedance"),
            ("guide", "gravity_compensation"),
            ("force", "force"),  # presses with a given force
            ("hybrid", "hybrid_force"),  # forces and moments along the axes that are selected
            ("ufic", "ufic"),  # force and impedance at once
        ):
            found[f"{arm}_{law}"] = {"type": type_name, "arms": [arm]}
        found[f"{arm}_cartesian"]["features"] = ["joint_limits"]
    pairs = list(zip(arms[::2], arms[1::2]))
    for pair in pairs:
        prefix = _prefix(*pair) if len(arms) > 2 else ""
        for law, type_name in (
            ("dual", "dual_cartesian_impedance"),
            ("coupled", "coupled_dual_cartesian_impedance"),
            ("coupled_ufic", "coupled_ufic"),  # both squeeze an object and move it
        ):
            found[f"{prefix}{law}"] = {"type": type_name, "arms": list(pair)}
            if law != "coupled_ufic":
                found[f"{prefix}{law}"]["features"] = ["joint_limits"]
    return found


def _prefix(first, second):
    """near_left and near_right give near_; names without a common first word are both used."""
    one, other = first.split("_"), second.split("_")
    shared = [a for a, b in zip(one, other) if a == b]
    words = shared if shared and one[: len(shared)] == shared else [first, second]
    return "_".join(words) + "_"
