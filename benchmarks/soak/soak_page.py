#!/usr/bin/env python3
"""Makes soak.html of an endurance run from soak.json in FOLDER.

soak_page.py FOLDER
"""

import json
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))

from report import page, style


def faults_over_time(result):
    kinds = [kind for kind, times in result["faults"].items() if times]
    figure, ((axis,),) = style.sheet(height=0.5 + 0.22 * max(len(kinds), 3))
    for row, kind in enumerate(kinds):
        hours = [t / 3600 for t in result["faults"][kind]]
        axis.plot(hours, [row] * len(hours), "|", color=style.BLUE, markersize=7, alpha=0.6)
    for violation in result["violations"]:
        axis.axvline(violation["at_s"] / 3600, color=style.LIMIT, linewidth=1)
    axis.set_yticks(range(len(kinds)), kinds)
    axis.set(ylim=(-0.7, len(kinds) - 0.3), xlabel="simulated time [h]", title="Injected faults")
    figure.tight_layout()
    return figure


def samples_over_time(result):
    samples = result["samples"]
    hours, resident = [s["time_s"] / 3600 for s in samples], [s["resident_mb"] for s in samples]
    figure, ((memory, work),) = style.sheet(1, 2, 2.6)
    memory.plot(hours, resident, color=style.INK)
    memory.set(ylim=(0, 1.2 * max(resident)), title="Resident memory [MB]", xlabel="simulated time [h]")
    for i, arm in enumerate(result["arms"]):
        work.plot(hours, [1e3 * sample["work_difference_j"][i] for sample in samples], label=arm["name"])
    work.set(title="Work: program's sum less the arm's [mJ]", xlabel="simulated time [h]")
    work.legend()
    figure.tight_layout()
    return figure


ARM = {
    "arm": lambda arm: arm["name"],
    "periods": lambda arm: f"{arm['periods']:,}",
    "without a command": lambda arm: f"{arm['periods_missed']:,}",
    "longest in a row": lambda arm: arm["longest_miss"],
    "ended motions": lambda arm: arm["motions_ended"],
    "largest torque rate [N m/s]": lambda arm: page.figures(arm["torque_rate_max_nm_per_s"], 4),
    "work [J]": lambda arm: page.figures(arm["work_j"]),
    "difference of both sums [mJ]": lambda arm: page.figures(1e3 * arm["work_difference_j"]),
}


def make(folder):
    result = json.loads((folder / "soak.json").read_text())
    passed, arms, count = result["passed"], result["arms"], result["violation_count"]
    faults = {kind: len(times) for kind, times in result["faults"].items()}
    violations = [f"{v['at_s']:.3f} s: {v['what']}" for v in result["violations"][:30]]
    verdict = ["No invariant was violated."] if passed else [*violations, f"{count} violations in all."]
    tiles = page.tiles(
        (f"{result['simulated_s'] / 3600 * len(arms):.2f} h", f"arm time, {len(arms)} arms"),
        (f"{result['cycles']:,}", "cycles checked"),
        (f"{sum(faults.values()):,}", "injected faults"),
        (f"{result['switches']:,}", "switches"),
        (f"{result['requests']:,}", "requests"),
        (count, "violations", not passed),
        (f"{result['simulated_s'] / max(result['real_s'], 1e-9):.1f} ×", "faster than real time"),
    )
    fault_times = style.save(faults_over_time(result), folder / "faults.png")
    samples = style.save(samples_over_time(result), folder / "samples.png")
    sections = [
        ("Result", tiles, page.box(verdict, fine=passed)),
        ("Arms", page.columns(arms, ARM)),
        (
            "Faults",
            page.image(fault_times, "Times of the injected faults."),
            page.table("fault | times", [[kind, f"{times:,}"] for kind, times in faults.items()]),
        ),
        ("Memory and work", page.image(samples, "Once a simulated minute.")),
    ]
    lead = f"Seed {result['seed']}; strict virtual arms in simulated time, faults from the seed, every cycle checked."
    page.write(folder / "soak.html", page.page(f"Endurance: {result['scene']}", lead, sections))


if __name__ == "__main__":
    page.run(make, __doc__)
