"""Scenes for the tests of LeRobot's arms."""

from harness import FOLDER, ROOT

TIMEOUT_S = 1.0  # of streams: this computer may be busy for a while


def two_arms(active="", name="two_arms_lerobot"):
    """two_arms without a timeline, its arms held at first; bases are turned and moved."""
    text = (ROOT / "config/scenes/two_arms.yaml").read_text(encoding="utf-8").partition("\ntimeline:")[0]
    text = text.replace("duration_s: 20", "duration_s: 0").replace("name: two_arms\n", f"name: {name}\n")
    text = text.replace("active: [left_cartesian, right_cartesian]", f"active: [{active}]" if active else "")
    text = text.replace("position_m: [0, 0.26, 0]}", "position_m: [-0.1, 0.4, 0.05], rpy_rad: [0, 0, 0.4]}")
    for arm in ("left", "right"):
        for kind, quantity in (("joint", "joints"), ("cartesian", "pose")):
            before = f"{{name: {arm}_{kind}, type: {kind}_impedance, arms: {arm}"
            assert before in text
            text = text.replace(before, f"{before}, inputs: {{{quantity}: {{timeout_s: {TIMEOUT_S}}}}}")
    path = FOLDER / f"{name}.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def edited(scene, name, *changes):
    """A shipped scene without its timeline, changed."""
    text = (ROOT / f"config/scenes/{scene}.yaml").read_text(encoding="utf-8").partition("\ntimeline:")[0]
    for before, after in changes:
        assert before in text, before
        text = text.replace(before, after)
    path = FOLDER / f"{name}.yaml"
    path.write_text(text, encoding="utf-8")
    return path
