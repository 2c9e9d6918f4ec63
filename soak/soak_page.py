#!/usr/bin/env python3
"""Makes soak.html of an endurance run from soak.json in FOLDER.

soak_page.py FOLDER
"""

import json
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent))

import matplotlib.pyplot as plt  # noqa: E402  the path comes first

from report import page, style  # noqa: E402


def faults_over_time(result):
    kinds = [kind for kind, times in result["faults"].items() if times]
    figure, axis = plt.subplots(figsize=(style.WIDTH_IN, 0.5 + 0.22 * max(len(kinds), 3)), dpi=style.DPI)
    for row, kind in enumerate(kinds):
        hours = [t / 3600 for t in result["faults"][kind]]
        axis.plot(hours, [row] * len(hours), "|", color="#4477aa", markersize=7, alpha=0.6)
    for violation in result["violations"]:
        axis.axvline(violation["at_s"] / 3600, color="#b42318", linewidth=1)
    axis.set_yticks(range(len(kinds)), kinds)
    axis.set_ylim(-0.7, len(kinds) - 0.3)
    axis.set_xlabel("simulated time [h]")
    axis.set_title("Injected faults")
    figure.tight_layout()
    return figure


def samples_over_time(result):
    hours = [sample["time_s"] / 3600 for sample in result["samples"]]
    figure, (memory, work) = plt.subplots(1, 2, figsize=(style.WIDTH_IN, 2.6), dpi=style.DPI)
    memory.plot(hours, [sample["resident_mb"] for sample in result["samples"]], color="#1f2933")
    memory.set_ylim(0, 1.2 * max(sample["resident_mb"] for sample in result["samples"]))
    memory.set_title("Resident memory [MB]")
    for i, arm in enumerate(result["arms"]):
        work.plot(hours, [1e3 * sample["work_difference_j"][i] for sample in result["samples"]], label=arm["name"])
    work.set_title("Work: program's book less the arm's [mJ]")
    work.legend(frameon=False, fontsize=8)
    for axis in (memory, work):
        axis.set_xlabel("simulated time [h]")
    figure.tight_layout()
    return figure


def save(figure, path):
    figure.savefig(path, dpi=style.DPI)
    plt.close(figure)
    return path


def arms_table(result):
    rows = [
        [
            arm["name"],
            f"{arm['periods']:,}",
            f"{arm['periods_missed']:,}",
            str(arm["longest_miss"]),
            str(arm["motions_ended"]),
            page.figures(arm["torque_rate_max_nm_per_s"], 4),
            page.figures(arm["work_j"]),
            page.figures(1e3 * arm["work_difference_j"]),
        ]
        for arm in result["arms"]
    ]
    head = [
        "arm",
        "periods",
        "without a command",
        "longest in a row",
        "motions it ended",
        "largest torque rate [N m/s]",
        "work [J]",
        "books differ by [mJ]",
    ]
    return page.table(head, rows, numeric=range(1, 8))


def main():
    folder = pathlib.Path(sys.argv[1])
    result = json.loads((folder / "soak.json").read_text())
    passed = result["passed"]
    hours = result["simulated_s"] / 3600
    total = sum(len(times) for times in result["faults"].values())
    verdict = page.box(
        ["No invariant was violated."]
        if passed
        else [f"{v['at_s']:.3f} s: {v['what']}" for v in result["violations"][:30]]
        + [f"{result['violation_count']} violations in all."],
        fine=passed,
    )
    tiles = page.tiles(
        [
            (f"{hours * len(result['arms']):.2f} h", f"arm time, {len(result['arms'])} arms", False),
            (f"{result['cycles']:,}", "cycles checked", False),
            (f"{total:,}", "injected faults", False),
            (f"{result['switches']:,}", "switches", False),
            (f"{result['requests']:,}", "requests", False),
            (f"{result['violation_count']}", "violations", not passed),
            (f"{result['simulated_s'] / max(result['real_s'], 1e-9):.1f} ×", "faster than real time", False),
        ]
    )
    sections = [
        ("result", "Result", [tiles, verdict]),
        ("arms", "Arms", [arms_table(result)]),
        (
            "faults",
            "Faults",
            [
                page.image(save(faults_over_time(result), folder / "faults.png"), "When each fault was injected."),
                page.table(
                    ["fault", "times"], [[kind, f"{len(times):,}"] for kind, times in result["faults"].items()], (1,)
                ),
            ],
        ),
        (
            "books",
            "Memory and work",
            [page.image(save(samples_over_time(result), folder / "samples.png"), "Once a simulated minute.")],
        ),
    ]
    lead = f"Seed {result['seed']}; strict virtual arms in simulated time, faults from the seed, every cycle checked."
    text = page.page(f"Endurance: {result['scene']}", lead, sections)
    (folder / "soak.html").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
