#!/usr/bin/env python3
"""Makes the report of a run: a self-contained report.html, and its plots as PNG next to it.

    report.py NPZ --out DIR [--pictures PNG ...] [--meta FILE]

NPZ is the output of `multipanda export LOG --npz`. docs/logs.md describes FILE. No other files are read.
"""

import argparse
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent))

from report import loading, page, plots, pool, sections, style

# Pictures of each arm: name, the function that draws it, heading, note, and the sentence without data.
PER_ARM = (
    ("q", "joint_positions", "Joint positions", "targets dashed where a controllet had one", "Joint positions are"),
    ("dq", "joint_velocities", "Joint velocities", "", "Joint velocities are"),
    ("tau", "torques", "Joint torques", "", "Torques are"),
    ("pose", "pose", "End effector", "pose against target", "Neither the end effector's pose nor its error is"),
    (
        "wrench",
        "wrench",
        "Wrench on the environment",
        "about the stiffness frame K, in world axes; an arm resting on a table shows a negative z force",
        "Wrench: not available. The backend provided neither an estimate nor simulated contact forces.",
    ),
)


def _file_name(text):
    return "".join(c if c.isalnum() or c in "-_" else "_" for c in text)


def _scene_pictures(run, pictures):
    captions = {entry["file"]: entry.get("caption", "") for entry in run.meta.get("pictures") or []}
    if not pictures:
        reason = run.meta.get("pictures_missing") or "none were given"
        return page.absent(f"No pictures of the scene: {reason}.")
    shown = [
        page.image(path, captions.get(pathlib.Path(path).name) or pathlib.Path(path).stem.replace("_", " "))
        for path in pictures
    ]
    return [page.Raw(f'<div class="pictures">{"".join(shown)}</div>'), run.meta.get("pictures_note")]


def _draw(job, run, out):
    """Draws one picture into the folder. Returns its path, or None if the log has nothing to show."""
    name, function, *arguments = job
    figure = getattr(plots, function)(run, *arguments)
    return None if figure is None else style.save(figure, out / f"{name}.png")


def _pictures(run, out):
    """Draws all pictures: paths by name."""
    if run.time_range is None:
        return {}
    colors = style.band_colors(run.instances)
    jobs = [(f"{arm}_{name}", function, arm, colors) for arm in run.arms for name, function, *_ in PER_ARM]
    shared = [name for name, entry in run.instances.items() if len(entry["arms"]) > 1]
    jobs += [(f"{name}_task", "shared_task", name, colors) for name in shared]
    jobs += [
        ("overview", "overview", colors),
        ("cycle_histogram", "cycle_histogram"),
        ("cycle_times", "cycle_times_over_time"),
    ]
    for arm in run.arms:  # read once, before the processes fork
        run.spans(arm)
    drawn = pool.forked(_draw, [(_file_name(name), *rest) for name, *rest in jobs], run, out)
    return dict(zip((job[0] for job in jobs), drawn))


def make_report(run, out, pictures=()):
    """Writes DIR/report.html and its plots. Returns the page's path."""
    out = pathlib.Path(out)
    out.mkdir(parents=True, exist_ok=True)
    colors, drawn = style.band_colors(run.instances), _pictures(run, out)

    def shown(name, caption, absent):
        return page.image(drawn[name], caption) if drawn.get(name) else page.absent(absent)

    def of_arm(arm):
        for name, _, title, note, absent in PER_ARM:
            yield page.heading(title)
            caption = f"{title} of {arm}" + (f": {note}." if note else ".")
            yield shown(f"{arm}_{name}", caption, absent if absent.endswith(".") else f"{absent} not in the log.")

    histogram = "All recorded cycles, the first included; percentiles by nearest rank."
    owners_unknown = "The log has no commands: the owners of the arms are unknown."
    tasks = {name: entry["arms"] for name, entry in run.instances.items() if drawn.get(f"{name}_task")}
    parts = [
        (
            "At a glance",
            sections.glance(run),
            _scene_pictures(run, pictures),
            shown("overview", "Owner of each arm, and events.", owners_unknown),
            sections.largest_errors(run),
            sections.effort(run),
        ),
        ("Switches", sections.switches(run, colors)),
        ("Interventions", sections.interventions(run)),
        ("Tracking", sections.tracking(run, colors)),
        *((f"Arm {arm}", sections.DECIMATION if arm == run.arms[0] else None, list(of_arm(arm))) for arm in run.arms),
        (
            "Several arms together",
            *(
                page.image(drawn[f"{name}_task"], f"Errors of {name} ({', '.join(arms)}) in its own coordinates.")
                for name, arms in tasks.items()
            ),
        ),
        (
            "Cycle times",
            shown("cycle_histogram", histogram, "Cycle times are not in the log."),
            shown("cycle_times", "Cycle and stages over the run.", "Cycle times over the run are not in the log."),
        ),
        ("Events", sections.events(run)),
        ("Plant", sections.plant(run)),
        ("Machine and versions", sections.machine(run)),
    ]
    info, plant = run.meta.get("run") or {}, run.meta.get("plant")
    name = run.meta.get("scene_name") or info.get("scene") or pathlib.Path(run.path).stem
    lead = [
        run.meta.get("scene_description") or "",
        f"Arms: {', '.join(run.arms) or 'none'}",
        f"Plant: {plant.get('name')}" if plant else "",
        f"Seed: {info['seed']}" if "seed" in info else "",
    ]
    text = page.page(f"Run of {name}", " · ".join(x.strip().rstrip(".") for x in lead if x.strip()), parts)
    return page.write(out / "report.html", text)


def main(words=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("npz", type=pathlib.Path)
    parser.add_argument("--out", type=pathlib.Path, required=True, help="folder for report.html and the plots")
    parser.add_argument("--pictures", type=pathlib.Path, nargs="*", default=[], help="PNG pictures of the scene")
    parser.add_argument("--meta", type=pathlib.Path, help="JSON: scene, versions, machine, limits, what is missing")
    arguments = parser.parse_args(words)
    try:
        print(make_report(loading.load(arguments.npz, arguments.meta), arguments.out, arguments.pictures))
    except (OSError, ValueError, KeyError) as error:
        sys.exit(f"no report of {arguments.npz}: {type(error).__name__}: {error}")


if __name__ == "__main__":
    main()
