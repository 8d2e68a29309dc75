"""Rooms of the package know only those before them, modules not each other in circles.

python tests/lint_rooms.py  prints what breaks this, and fails then. Imports inside functions and
for type checkers count too: they are for speed, not for going upstairs.

The package keeps at least `DOCSTRING_LINES` lines of docstring a statement. There is no ceiling of
statements: one was met by packing two ideas into a line.
"""

import ast
import sys
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

PACKAGE = "fenics_ehd"

#: From the ground up.
ROOMS = (
    "base", "reduction", "fem", "film", "multibody", "analysis", "results", "scenes",
    "plotting", "study", "cli",
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


#: What has a docstring.
DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)

#: Lines of docstring a statement, at least; other packages of this field have 0.2 to 1.4.
DOCSTRING_LINES = 0.55


def measured(path):
    """Statements without docstrings, and lines of docstring, of a module."""
    nodes = list(ast.walk(ast.parse(path.read_text())))
    texts = [
        node.body[0]
        for node in nodes
        if isinstance(node, DOCUMENTED) and ast.get_docstring(node, clean=False) is not None
    ]
    statements = sum(isinstance(node, ast.stmt) for node in nodes) - len(texts)
    return statements, sum(text.end_lineno - text.lineno + 1 for text in texts)


def undocumented(root):
    """One line if the package has too few lines of docstring."""
    counts = [measured(path) for path in sorted(root.rglob("*.py"))]
    statements, lines = (sum(column) for column in zip(*counts, strict=True))
    if lines < DOCSTRING_LINES * statements:
        yield f"{lines / statements:.2f} lines of docstring a statement, at least {DOCSTRING_LINES}"


if __name__ == "__main__":
    package = Path(__file__).parents[1] / PACKAGE
    problems = [*sorted(complaints(package)), *undocumented(package)]
    for line in problems:
        print(line)
    sys.exit(bool(problems))
