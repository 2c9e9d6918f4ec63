#!/usr/bin/env python3
"""The page for those who come from other libraries: every call in our column exists, with its arguments."""

import ast
import inspect
import pathlib
import re
import sys
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "python"))

import multipanda as mp

PAGE = (ROOT / "docs" / "coming_from.md").read_text(encoding="utf-8")
TYPES = {"run": mp.Run, "arm": mp.Arm, "law": mp.Controllet, "pose": mp.Stream, "goal": mp.Goal}
ATTRIBUTES = {  # of objects that only a run has
    (mp.Arm, "state"): mp.ArmState,
    (mp.Arm, "gripper"): mp.Gripper,
    (mp.ArmState, "pose"): mp.Pose,
    (mp.Run, "arms"): {},
}
SCENE = (ROOT / "config" / "scenes" / "one_arm.yaml").read_text(encoding="utf-8")


def our_column(heading):
    """The code in the last cells of a section's table."""
    section = re.search(rf"^## {heading}$(.*?)(?=^## |\Z)", PAGE, re.M | re.S).group(1)
    rows = [line for line in section.splitlines() if line.startswith("| ")][2:]
    return [code for row in rows for code in re.findall(r"`([^`]+)`", row.strip(" |").split(" | ")[-1])]


def type_of(node):
    """The class of an expression, the module, or None if it is a value of its own."""
    if isinstance(node, ast.Name):
        return mp if node.id == "mp" else TYPES.get(node.id)
    if isinstance(node, ast.Subscript):
        whole = type_of(node.value)
        return mp.Controllet if whole is mp.Run else mp.Arm if whole == {} else None
    if isinstance(node, ast.Attribute):
        owner = type_of(node.value)
        return ATTRIBUTES.get((owner, node.attr)) or (getattr(mp, node.attr, None) if owner is mp else None)
    if isinstance(node, ast.Call):
        made = {"goal": mp.Goal, "stream": mp.Stream}
        return made.get(node.func.attr) if isinstance(node.func, ast.Attribute) else None
    return None


class ComingFrom(unittest.TestCase):
    def check_member(self, node, code):
        owner = type_of(node.value)
        if owner in (None, {}):
            return 0
        texts = [base.__doc__ or "" for base in getattr(owner, "__mro__", ())]  # attributes of objects are in them
        texts += [self.law] if owner is mp.Controllet else []
        documented = any(re.search(rf"^\s*(?:- `)?{node.attr}(?:: |` \()", text, re.M) for text in texts)
        self.assertTrue(hasattr(owner, node.attr) or documented, f"{code}: there is no {node.attr}")
        return 1

    def check_arguments(self, node, code):
        if not isinstance(node.func, ast.Attribute) or type_of(node.func.value) in (None, {}):
            return
        called = getattr(type_of(node.func.value), node.func.attr)
        given = {keyword.arg: None for keyword in node.keywords}
        first = [] if inspect.ismodule(type_of(node.func.value)) or inspect.ismethod(called) else [None]
        inspect.signature(called).bind(*first, *node.args, **given)  # raises TypeError with the argument

    def test_python(self):
        reference = (ROOT / "docs" / "scene_reference.md").read_text(encoding="utf-8")
        self.law = re.search(r"^### cartesian_impedance$(.*?)^### ", reference, re.M | re.S).group(1)
        count = 0
        for library in ("franky", "panda-py", "crisp_py"):
            for code in our_column(library):
                if code.startswith("./") or re.fullmatch(r"with|[\w ]+", code):
                    continue
                for node in ast.walk(ast.parse(code + " pass" if code.endswith(":") else code)):
                    if isinstance(node, ast.Attribute):
                        count += self.check_member(node, code)
                    if isinstance(node, ast.Call):
                        self.check_arguments(node, code)
        self.assertGreater(count, 50)

    def test_instances_are_those_of_the_scene(self):
        names = set(re.findall(r'run(?:\.switch\(|\[)"(\w+)"', PAGE))
        self.assertGreater(len(names), 2)
        for name in names - {"press"}:  # an instance that the page asks for
            self.assertRegex(SCENE, rf"- name: {name}\n")

    def test_ros_names(self):
        known = (ROOT / "docs" / "ros_interfaces.md").read_text(encoding="utf-8")
        ours = [code for code in our_column("franka_ros2") if code.startswith(("<arm>", "~/", "multipanda_msgs"))]
        self.assertGreater(len(ours), 1)
        for name in ours:
            self.assertIn(name, known)
        plugins = (ROOT / "docs" / "ros2_control.md").read_text(encoding="utf-8")
        for name in our_column("franka_ros2"):
            if name.startswith("multipanda_hardware"):
                self.assertIn(name, plugins)


if __name__ == "__main__":
    unittest.main()
