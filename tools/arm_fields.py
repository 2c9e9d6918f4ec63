#!/usr/bin/env python3
"""Compares messages and docs with the quantities that core/state/arm_sample.hpp declares; prints faults, ends with 1.

arm_fields.py           checks that the messages of logs and ROS hold each quantity, with its type and unit
arm_fields.py --write   appends what a message lacks, and writes the table of docs/live_input.md
"""

import ast
import re
import sys
import textwrap
from typing import NamedTuple

from project_files import ROOT

sys.path.insert(0, str(ROOT / "logs"))
from generate_messages import UNIT, Message

HEADER = "core/state/arm_sample.hpp"
MESSAGES = ROOT / "ros/multipanda_msgs/msg"
PAGE, BEGIN, END = ROOT / "docs/live_input.md", "<!-- written by tools/arm_fields.py -->", "<!-- end of quantities -->"
TYPES = {  # of a message's field
    **{f"std::{name}_t": name for name in ("uint8", "uint16", "uint32", "uint64", "int64")},
    "bool": "bool",
    "double": "float64",
    "JointArray": "float64[]",
    "WrenchArray": "geometry_msgs/Wrench",
    "PoseArray": "geometry_msgs/Pose",
    "ElbowArray": "float64[2]",
    "JointFlags": "bool[]",
    "AxisFlags": "bool[6]",
}
# Quantities with another name in a message. Robot states have poses in the world, and only messages for robots
# say `has_report`.
NAMES = {
    ("ArmWrench", "wrench"): "estimated",
    ("RobotState", "x_be_d"): "pose_desired",
    ("RobotState", "x_be_c"): "pose_commanded",
}


class Field(NamedTuple):
    """One line of the tables."""

    type: str
    member: str
    name: str
    message: str
    known: str
    doc: str
    commanded: bool

    @property
    def log(self) -> str:
        """The log's message that holds it."""
        if self.commanded:
            return "ArmCommand"
        groups = {"has_report": "ArmReport", "has_wrench_estimate": "ArmWrench", "has_contact_truth": "ArmWrench"}
        return groups.get(self.known, "ArmState")


def fields(text: str) -> list[Field]:
    """The lines of the tables in the header."""
    found = []
    for part in re.split(r"#define MULTIPANDA_(?=MEASURED|REPORTED|COMMANDED)", text)[1:]:
        lines = part.split("\n\n")[0].replace("\\\n", "\n")
        for line in re.finditer(r"FIELD\(([\w:]+), (\w+), (\w+), (\w+), (\w+),\s*(\".*?\")\)\s", lines + "\n"):
            *words, doc = line.groups()
            found.append(Field(*words, ast.literal_eval(doc), part.startswith("COMMANDED")))
    return found


def kinds(message: Message) -> dict[str, tuple[str, str]]:
    """Type and unit of each field of a message."""
    raw = {}
    for line in message.text.splitlines():
        words, _, comment = line.partition("#")
        unit = UNIT.match(comment)
        if len(words.split()) == 2:
            raw[words.split()[1]] = (words.split()[0], unit[1] if unit else "")
    return raw


def expected(field: Field) -> list[str]:
    """The messages that hold a quantity. Logs do not need a flag for reports: without a report there is no message."""
    if field.message == "no_message":
        return []
    return ["RobotState"] if field.member == "has_report" else [field.log, "RobotState"]


def faults(declared: list[Field], write: bool) -> list[str]:
    """Missing fields of the messages; appended if `write`."""
    wrong = []
    for field in declared:
        kind = TYPES[field.type]
        unit = UNIT.match(field.doc)
        for name in expected(field):
            path = MESSAGES / f"{name}.msg"
            place = NAMES.get((name, field.message), field.message)
            found = kinds(Message(path)).get(place)
            where = f"{path.relative_to(ROOT)}: {place}"
            if found is None and write:
                path.write_text(f"{path.read_text()}{f'{kind} {place}':<31} # {field.doc}\n")
            elif found is None:
                wrong.append(f"{where} is missing; {HEADER} declares {kind}: run tools/arm_fields.py --write")
            elif found != (kind, unit[1] if unit else ""):
                wrong.append(f"{where} is {' in '.join(found)}; {HEADER} declares {kind} in {unit[1] if unit else ''}")
    return wrong


def names(declared: list[Field]) -> str:
    """The names of all quantities, for the page."""
    words = [f"`{field.name}`" for field in declared]
    return "\n\n" + textwrap.fill(", ".join(words) + ".", 150, break_long_words=False) + "\n\n"


def main() -> int:
    write = "--write" in sys.argv
    declared = fields((ROOT / HEADER).read_text())
    if len(declared) != len(re.findall(r"^  FIELD\(", (ROOT / HEADER).read_text(), re.MULTILINE)):
        print(f"{HEADER}: a line of the tables does not read as FIELD(type, member, name, message, known, doc)")
        return 1
    wrong = faults(declared, write)
    page = PAGE.read_text()
    head, _, rest = page.partition(BEGIN)
    _, _, tail = rest.partition(END)
    new = f"{head}{BEGIN}{names(declared)}{END}{tail}"
    if write:
        PAGE.write_text(new)
    elif new != page:
        wrong.append(f"{PAGE.relative_to(ROOT)}: the list of quantities is old: run tools/arm_fields.py --write")
    print("\n".join(wrong) if wrong else f"{len(declared)} quantities of an arm are in messages and docs")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
