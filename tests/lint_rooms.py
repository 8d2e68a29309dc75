"""Rooms of the package know only those before them, modules not each other in circles.

python tests/lint_rooms.py  prints what breaks this, and fails then. Imports inside functions and
for type checkers count too: they are for speed, not for going upstairs.
"""

import ast
import sys
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

PACKAGE = "fenics_ehd"

#: From the ground up.
ROOMS = (
    "base", "reduction", "fem", "film", "bearing", "multibody", "results", "scenes", "plotting",
    "study", "cli",
)  # fmt: skip

#: Only these import dolfinx.
DOLFINX = ("base.compat", "fem", "film")


def imports(path):
    """Names of modules that a file imports, or imports from."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def room(module):
    """Floor of a module, or nothing for the package itself and its models."""
    name = module.split(".")[1:2]
    return ROOMS.index(*name) if name and name[0] in ROOMS else None


def complaints(root):
    """One line for each import that is not allowed."""
    files = {
        ".".join(path.relative_to(root.parent).with_suffix("").parts).removesuffix(
            ".__init__"
        ): path
        for path in root.rglob("*.py")
    }
    inside = {}
    for module, path in files.items():
        found = set(imports(path))
        # A package's own __init__ is there before its modules: it may gather them.
        inside[module] = {
            other for other in found & set(files) if not module.startswith(f"{other}.")
        } - {module}
        if any(name.split(".")[0] == "dolfinx" for name in found) and not module.startswith(
            tuple(f"{PACKAGE}.{name}" for name in DOLFINX)
        ):
            yield f"{module} imports dolfinx"
        if room(module) is None and module != PACKAGE:
            yield f"{module} is in no room"
        for other in inside[module]:
            floors = room(module), room(other)
            if None not in floors and floors[1] > floors[0]:
                yield f"{module} imports {other}, a room above its own"
    try:
        TopologicalSorter(inside).prepare()
    except CycleError as error:
        yield f"circle: {' -> '.join(error.args[1])}"


if __name__ == "__main__":
    lines = sorted(complaints(Path(__file__).parents[1] / PACKAGE))
    print("\n".join(lines))
    sys.exit(bool(lines))
