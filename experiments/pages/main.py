#!/usr/bin/env python3
"""Makes figures, verdicts and the page of an experiment from the files of its runner.

main.py PLAN.json          results.json, report.html and pictures next to it
main.py --index LIST.json  index.html next to it
"""

import argparse
import json
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent.parent))


def main(words=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("plan", type=pathlib.Path)
    parser.add_argument("--index", action="store_true", help="PLAN is a list of experiments that have their pages")
    arguments = parser.parse_args(words)
    with open(arguments.plan, encoding="utf-8") as stream:
        plan = json.load(stream)
    if arguments.index:
        from experiments.pages import frame

        print(frame.index(plan, arguments.plan.parent))
        return
    if plan["kind"] == "task":
        from experiments.pages import task_page as kind
    elif plan["kind"] == "performance":
        from experiments.pages import performance as kind
    else:
        sys.exit(f"no page for experiments of the kind {plan['kind']}")
    kind.make(plan, arguments.plan.parent)


if __name__ == "__main__":
    main()
