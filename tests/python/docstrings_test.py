#!/usr/bin/env python3
"""Every public name of the package is in the reference with its units and errors. Needs no program."""

import ast
import pathlib
import re
import sys
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "python" / "multipanda"
NATIVE = ROOT / "python" / "multipanda_native"
sys.path.insert(0, str(ROOT / "tools"))

import site_api

# Names that tell their unit: the last part, and what it is divided by.
UNIT = r"(?:m|s|n|nm|kg|rad|hz|us|ns|ms|mbar|n_nm|nm_per_rad|n_per_m|m_per_s|rad_per_s|kg_m2)"
NAMES_ITS_UNIT = re.compile(rf"(?:.*_)?{UNIT}|.*_wxyz|seconds|.*ratio")
NUMBERS = re.compile(r"\b(?:float|Array|NDArray)\b")
ERRORS = {"Refused", "Timeout", "Disconnected", "ValueError", "TypeError", "KeyError", "AttributeError", "Error"}
ASKED = {"Refused", "Timeout", "Disconnected"}  # by whatever asks the run


class Source:
    """Functions of the package by class and name, as they are written."""

    def __init__(self):
        self.functions = {}  # (module, class or "", name) -> node
        self.classes = {}  # (module, class) -> node
        for path in sorted([*PACKAGE.glob("*.py"), *NATIVE.glob("*.py")]):
            for node in ast.parse(path.read_text(encoding="utf-8")).body:
                if isinstance(node, ast.ClassDef):
                    self.classes[path.stem, node.name] = node
                    for member in node.body:
                        if isinstance(member, (ast.FunctionDef, ast.AsyncFunctionDef)):
                            self.functions[path.stem, node.name, member.name] = member
                elif isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
                    self.functions[path.stem, "", node.name] = node

    def public(self):
        """The functions that the reference shows."""
        shown = {name.rpartition(".")[2] for page in site_api.PAGES.values() for name in page.names}
        for (module, owner, name), node in self.functions.items():
            if not name.startswith("_") and ((owner or name) in shown or module == "aio"):
                yield module, owner, name, node

    def public_classes(self):
        shown = {(module, owner) for module, owner, _, _ in self.public()}
        names = {name.rpartition(".")[2] for page in site_api.PAGES.values() for name in page.names}
        return {key: node for key, node in self.classes.items() if key in shown or key[1] in names}

    def text(self, module, owner, node):
        """The docstring of a function, and that of its class with its bases'."""
        texts, waiting = [ast.get_docstring(node) or ""], [owner]
        while waiting:
            name = waiting.pop()
            for (_, known), found in self.classes.items():
                if known == name:
                    texts.append(ast.get_docstring(found) or "")
                    waiting += [base.id for base in found.bases if isinstance(base, ast.Name)]
        return texts[0], "\n".join(texts)

    def errors(self, module, owner, node, seen=()):
        """The errors that a function raises by itself, by private helpers of its module, or by asking the run."""
        found, handled = set(), set()
        for part in ast.walk(node):
            if isinstance(part, ast.Try) and not any(
                isinstance(p, ast.Raise) for h in part.handlers for p in ast.walk(h)
            ):
                handled |= {id(inner) for line in part.body if part.handlers for inner in ast.walk(line)}
        for part in ast.walk(node):
            if id(part) in handled:
                continue
            if isinstance(part, ast.Raise) and isinstance(part.exc, ast.Call) and isinstance(part.exc.func, ast.Name):
                found.add(part.exc.func.id)
            if not isinstance(part, ast.Call):
                continue
            name = part.func.attr if isinstance(part.func, ast.Attribute) else getattr(part.func, "id", "")
            if name == "ask":
                found |= ASKED
            elif name.startswith("_") and name not in seen:
                for helper in ((module, owner, name), (module, "", name)):
                    if helper in self.functions:
                        found |= self.errors(module, owner, self.functions[helper], (*seen, name))
        return found & ERRORS


class Docstrings(unittest.TestCase):
    source = Source()

    def test_every_public_name_has_one(self):
        classes, functions = self.source.public_classes(), list(self.source.public())
        for (_, name), node in classes.items():
            self.assertTrue(ast.get_docstring(node), name)
        for module, owner, name, node in functions:
            self.assertTrue(ast.get_docstring(node), f"{owner or module}.{name}")
        self.assertGreater(len(classes), 15)
        self.assertGreater(len(functions), 80)

    def test_every_attribute_is_described(self):
        count, missing = 0, []
        for (_, owner), node in self.source.public_classes().items():
            text = ast.get_docstring(node) or ""
            fields = [member.target.id for member in node.body if isinstance(member, ast.AnnAssign)]
            for part in ast.walk(node):
                if isinstance(part, (ast.Assign, ast.AnnAssign)):
                    fields += attributes(part)
            for name in sorted({name for name in fields if not name.startswith("_")}):
                count += 1
                if not re.search(rf"(?m)^\s*{name}: ", text):
                    missing.append(f"{owner}.{name}")
        self.assertEqual(missing, [])
        self.assertGreater(count, 50)

    def test_numbers_have_units(self):
        count = 0
        for module, owner, name, node in self.source.public():
            own_text, _ = self.source.text(module, owner, node)
            arguments = node.args.args + node.args.kwonlyargs
            for argument in arguments:
                if argument.annotation is None or not NUMBERS.search(ast.unparse(argument.annotation)):
                    continue
                count += 1
                place = f"{owner or module}.{name}({argument.arg})"
                if not NAMES_ITS_UNIT.fullmatch(argument.arg):
                    self.assertRegex(own_text, r"\[[^\]]+\]", f"{place}: neither name nor docstring tells the unit")
            if node.returns is not None and NUMBERS.search(ast.unparse(node.returns)) and module in ("state", "goal"):
                if not NAMES_ITS_UNIT.fullmatch(name) and name != "rotation":
                    self.assertRegex(own_text, r"\[[^\]]+\]", f"{owner}.{name}: its docstring does not tell the unit")
        self.assertGreater(count, 25)

    def test_errors_are_named(self):
        count, missing = 0, []
        for module, owner, name, node in self.source.public():
            _, text = self.source.text(module, owner, node)
            for error in sorted(self.source.errors(module, owner, node)):
                count += 1
                if not re.search(rf"\b{error}\b|[Ee]rrors (?:are those )?of", text):
                    missing.append(f"{owner or module}.{name}: {error}")
        self.assertEqual(missing, [])
        self.assertGreater(count, 60)


def attributes(assignment):
    """The names of self.NAME that an assignment makes."""
    targets = assignment.targets if isinstance(assignment, ast.Assign) else [assignment.target]
    targets = [part for target in targets for part in (target.elts if isinstance(target, ast.Tuple) else [target])]
    return [t.attr for t in targets if isinstance(t, ast.Attribute) and getattr(t.value, "id", "") == "self"]


if __name__ == "__main__":
    unittest.main()
