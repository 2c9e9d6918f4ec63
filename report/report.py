#!/usr/bin/env python3
"""Makes the report of a run: report.html, which needs nothing else, and its plots as PNG next to it.

    report.py NPZ --out DIR [--pictures PNG ...] [--meta FILE]

NPZ is the output of `multipanda export LOG --npz`. docs/report.md describes FILE. No other files are read.
"""

import argparse
import concurrent.futures
import multiprocessing
import os
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent))

from report import loading, page, plots, sections, style  # noqa: E402
from report.page import Raw  # noqa: E402

PER_ARM = (
    ("q", "joint_positions", "Joint positions", "targets dashed where a controllet had one"),
    ("dq", "joint_velocities", "Joint velocities", ""),
    ("tau", "torques", "Joint torques", ""),
    ("pose", "pose", "End effector", "pose against target"),
    (
        "wrench",
        "wrench",
        "Wrench on the environment",
        "about the stiffness frame K, in world axes; an arm resting on a table shows a negative z force",
    ),
)
ABSENT = {
    "q": "Joint positions are not in the log.",
    "dq": "Joint velocities are not in the log.",
    "tau": "Torques are not in the log.",
    "pose": "Neither the end effector's pose nor its error is in the log.",
    "wrench": "Wrench: not available. The backend gave neither an estimate nor the simulator's contact forces.",
}

_job_state = {}  # of one worker process: run, colors, folder


def _draw(job):
    """Draws one picture into the folder. Returns its file name, or None if the log has nothing to show."""
    name, function, arguments = job
    figure = getattr(plots, function)(_job_state["run"], *arguments)
    if figure is None:
        return None
    file = _job_state["out"] / f"{name}.png"
    figure.savefig(file, dpi=style.DPI)
    plots.plt.close(figure)
    return file.name


def _draw_all(jobs):
    """Draws all pictures, on as many cores as this process may use. Forked workers share the loaded data."""
    workers = min(len(os.sched_getaffinity(0)), 4, len(jobs))
    if workers < 2:
        return [_draw(job) for job in jobs]
    with concurrent.futures.ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("fork")) as pool:
        return list(pool.map(_draw, jobs))


def _file_name(text):
    return "".join(c if c.isalnum() or c in "-_" else "_" for c in text)


def _scene_pictures(run, pictures):
    captions = {entry["file"]: entry.get("caption", "") for entry in run.meta.get("pictures") or []}
    shown = [
        page.image(path, captions.get(pathlib.Path(path).name) or pathlib.Path(path).stem.replace("_", " "))
        for path in pictures
    ]
    if shown:
        parts = [Raw('<div class="pictures">' + "".join(shown) + "</div>")]
        if run.meta.get("pictures_note"):
            parts.append(page.paragraph(run.meta["pictures_note"]))
        return parts
    return [page.absent("No pictures of the scene: " + (run.meta.get("pictures_missing") or "none were given") + ".")]


def make_report(run, out, pictures=()):
    """Writes DIR/report.html and its plots. Returns the page's path."""
    out = pathlib.Path(out)
    out.mkdir(parents=True, exist_ok=True)
    colors = style.band_colors(run.instances)
    jobs, has_time = [], run.time_range is not None
    if has_time:
        jobs = [
            (f"{_file_name(arm)}_{name}", function, (arm, colors))
            for arm in run.arms
            for name, function, _, _ in PER_ARM
        ]
        jobs += [
            (f"{_file_name(name)}_task", "shared_task", (name, colors))
            for name, entry in run.instances.items()
            if len(entry["arms"]) > 1
        ]
        jobs += [
            ("overview", "overview", (colors,)),
            ("cycle_histogram", "cycle_histogram", ()),
            ("cycle_times", "cycle_times_over_time", ()),
        ]
    # Read before the fork, once for all workers.
    for arm in run.arms:
        run.spans(arm)
    _job_state.update(run=run, out=out)
    drawn = dict(zip((job[0] for job in jobs), _draw_all(jobs) if jobs else []))

    def shown(name, caption, otherwise):
        return page.image(out / drawn[name], caption) if drawn.get(name) else page.absent(otherwise)

    parts = [
        (
            "glance",
            "At a glance",
            [
                *sections.glance(run),
                *_scene_pictures(run, pictures),
                shown(
                    "overview",
                    "Owner of each arm, and events.",
                    "No command is in the log: the owners of the arms are unknown.",
                ),
                *sections.largest_errors(run),
                *sections.effort(run),
            ],
        )
    ]
    parts.append(("switches", "Switches", sections.switches(run, colors)))
    parts.append(("interventions", "Interventions", sections.interventions(run)))
    parts.append(("tracking", "Tracking", sections.tracking(run, colors)))
    for n, arm in enumerate(run.arms):
        body = [sections.decimation_note()] if n == 0 else []
        for name, _, title, note in PER_ARM:
            body.append(Raw(f"<h3>{page.escape(title)}</h3>"))
            body.append(
                shown(f"{_file_name(arm)}_{name}", f"{title} of {arm}" + (f": {note}." if note else "."), ABSENT[name])
            )
        parts.append((f"arm-{_file_name(arm)}", f"Arm {arm}", body))
    tasks = [(name, f"{_file_name(name)}_task") for name in run.instances if drawn.get(f"{_file_name(name)}_task")]
    if tasks:
        parts.append(
            (
                "tasks",
                "Several arms together",
                [
                    page.image(
                        out / drawn[file],
                        f"Errors of {name} ({', '.join(run.instances[name]['arms'])}) in its own coordinates.",
                    )
                    for name, file in tasks
                ],
            )
        )
    parts.append(
        (
            "timing",
            "Cycle times",
            [
                shown(
                    "cycle_histogram",
                    "All recorded cycles, the first included; percentiles by nearest rank.",
                    "Cycle times are not in the log.",
                ),
                shown("cycle_times", "Cycle and stages over the run.", "Cycle times over the run are not in the log."),
            ],
        )
    )
    parts.append(("events", "Events", sections.events(run)))
    parts.append(("plant", "Plant", sections.plant(run)))
    parts.append(("machine", "Machine and versions", sections.machine(run)))

    info = run.meta.get("run") or {}
    name = run.meta.get("scene_name") or info.get("scene") or pathlib.Path(run.path).stem
    lead = [
        run.meta.get("scene_description") or "",
        f"Arms: {', '.join(run.arms) or 'none'}",
        f"Plant: {run.meta['plant'].get('name')}" if run.meta.get("plant") else "",
        f"Seed: {info['seed']}" if "seed" in info else "",
    ]
    target = out / "report.html"
    temporary = out / "report.html.part"  # a reader never sees half a page
    temporary.write_text(
        page.page(f"Run of {name}", " · ".join(x.strip().rstrip(".") for x in lead if x.strip()), parts),
        encoding="utf-8",
    )
    temporary.replace(target)
    return target


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
