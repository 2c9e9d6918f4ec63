#!/usr/bin/env python3
"""Makes figures, verdicts and the page of an experiment from the files of its runner.

main.py PLAN.json          results.json, report.html and pictures next to it
main.py --index LIST.json  index.html next to it
"""

import argparse
import json
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))

from experiments.pages import frame, performance, task_page

KINDS = {"task": task_page, "performance": performance}


def main(words=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("plan", type=pathlib.Path)
    parser.add_argument("--index", action="store_true", help="PLAN is a list of experiments that have their pages")
    arguments = parser.parse_args(words)
    plan = json.loads(arguments.plan.read_text(encoding="utf-8"))
    if arguments.index:
        print(frame.index(plan, arguments.plan.parent))
    elif plan["kind"] in KINDS:
        KINDS[plan["kind"]].make(plan, arguments.plan.parent)
    else:
        sys.exit(f"no page for experiments of the kind {plan['kind']}")


if __name__ == "__main__":
    main()
