"""Rooms of the package know only those before them, modules not each other in circles.

python tests/lint_rooms.py  prints what breaks this, and fails then. Imports inside functions and
for type checkers count too: they are for speed, not for going upstairs.

Rooms only get smaller: `[tool.fenics_ehd.sizes]` in pyproject.toml has at most how many modules
and statements each has, docstrings not counted, and for the package how many syntax nodes a
statement may have at most, in hundreds, and lines of docstring at least: statements are not saved
by packing them or by leaving out what they mean. --lower writes what is there where that is less.
"""

import ast
import re
import sys
import tomllib
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

#: Kinds of sizes that have a floor, not a ceiling.
FLOORS = ("docstring_lines",)


def measured(path):
    """Statements without docstrings, syntax nodes, and lines of docstring of a module."""
    tree = ast.parse(path.read_text())
    nodes = list(ast.walk(tree))
    texts = [
        node.body[0]
        for node in nodes
        if isinstance(node, DOCUMENTED) and ast.get_docstring(node, clean=False) is not None
    ]
    statements = sum(isinstance(node, ast.stmt) for node in nodes) - len(texts)
    return statements, len(nodes), sum(text.end_lineno - text.lineno + 1 for text in texts)


def sizes(root):
    """Sizes by name, as in pyproject.toml: of every room, and of the package."""
    found = {}
    paths = sorted(root.rglob("*.py"))
    total = [sum(column) for column in zip(*map(measured, paths), strict=True)]
    for name in ROOMS:
        inside = [path for path in paths if path.relative_to(root).parts[0] == name]
        statements = sum(measured(path)[0] for path in inside)
        found[name] = {"modules": len(inside), "statements": statements}
    found["package"] = {
        "modules": len(paths),
        "statements": total[0],
        "nodes_of_100_statements": round(100 * total[1] / total[0]),
        "docstring_lines_of_100_statements": round(100 * total[2] / total[0]),
    }
    return found


def exceeded(found, allowed):
    """One line for each size that is past its limit, or has none."""
    for name, own in found.items():
        for kind, size in own.items():
            limit = allowed.get(name, {}).get(kind, 0)
            if size < limit if kind.startswith(FLOORS) else size > limit:
                yield f"{name}: {size} {kind}, limit {limit} (sizes in pyproject.toml)"


def lowered(text, found, allowed):
    """The text of pyproject.toml with limits that are no wider than what is there."""
    for name, own in found.items():
        entries = []
        for kind, size in own.items():
            limit = allowed.get(name, {}).get(kind, size)
            kept = max(size, limit) if kind.startswith(FLOORS) else min(size, limit)
            entries.append(f"{kind} = {kept}")
        line = f"{name} = {{{', '.join(entries)}}}"
        text = re.sub(rf"^{name} = {{.*}}$", line, text, flags=re.MULTILINE)
    return text


if __name__ == "__main__":
    top = Path(__file__).parents[1]
    settings = top / "pyproject.toml"
    allowed = tomllib.loads(settings.read_text())["tool"][PACKAGE]["sizes"]
    found = sizes(top / PACKAGE)
    if sys.argv[1:] == ["--lower"]:
        settings.write_text(lowered(settings.read_text(), found, allowed))
        sys.exit()
    lines = [*sorted(complaints(top / PACKAGE)), *exceeded(found, allowed)]
    for line in lines:
        print(line)
    sys.exit(bool(lines))
