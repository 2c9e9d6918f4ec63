"""Types of one scene's controllets, for editors and type checkers.

python -m multipanda.stubs SCENE > scene_types.py
"""

from __future__ import annotations

import sys

from .client import Client
from .controllet import Controllet
from .parameters import Parameter


def _kind(parameter: Parameter) -> str:
    if parameter.is_switch:
        return "bool"
    if parameter.choices:
        return "Literal[" + ", ".join(f'"{choice}"' for choice in parameter.choices) + "]"
    return "float" if parameter.count == 1 else "Any  # an array; one number sets all"


def _class_name(name: str) -> str:
    return "".join(part.capitalize() for part in name.replace("-", "_").split("_"))


def _members(parameters: dict[str, Parameter]) -> list[str]:
    lines = []
    for name, parameter in parameters.items():
        text = parameter.describe().replace("\\", "\\\\").replace('"', "'")
        lines += ["", f"    {name}: {_kind(parameter)}", f'    """{text}"""']
    return lines


def _class_of(controllet: Controllet) -> list[str]:
    name = _class_name(controllet.name)
    own = {key: p for key, p in vars(type(controllet)).items() if isinstance(p, Parameter)}
    lines, features = [], []
    for feature in controllet.features:
        prefix = feature + "."
        parameters = {key[len(prefix) :]: p for key, p in controllet.descriptors.items() if key.startswith(prefix)}
        lines += ["", "", f"class {name}{_class_name(feature)}(Feature):"]
        lines += [f'    """The feature {feature} of {controllet.name}."""', *_members(parameters)]
        features += ["", f"    {feature}: {name}{_class_name(feature)}"]
    lines += ["", "", f"class {name}(mp.Controllet):"]
    lines += [f'    """{controllet.name}: {controllet.type} of {", ".join(controllet.arms)}."""']
    return lines + _members(own) + features


def stubs(client: Client) -> str:
    """A module with a class per controllet of the scene, its parameters with units and bounds.

    `law: LeftCartesian = run["left_cartesian"]` then completes and checks the names. Asks the run: errors are those of
    Client.
    """
    lines = [
        f'"""Controllets of the scene {client.scene}, made by multipanda.stubs."""',
        "",
        "from typing import Any, Literal",
        "",
        "import multipanda as mp",
        "from multipanda.controllet import Feature",
    ]
    for controllet in client.controllets.values():
        lines += _class_of(controllet)
    return "\n".join(lines) + "\n"


def main() -> int:
    """Prints the types of a scene."""
    if len(sys.argv) != 2 or sys.argv[1].startswith("-"):
        print("usage: python -m multipanda.stubs SCENE > scene_types.py", file=sys.stderr)
        return 2
    from .started import run

    with run(sys.argv[1]) as scene:
        print(stubs(scene), end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
