"""Rules of the house: layers, sizes, packing, words.

    python tests/lint_house.py [--all]

prints every breach of a rule and fails if there is one; breaches of rules in `NOT_YET` are counted,
and printed with --all. Each rule is a function that yields one line for each breach. Sizes are
limited by module and by function, never for the package: a ceiling of statements was met by packing
two ideas into a line.
"""

import ast
import re
import sys
from graphlib import CycleError, TopologicalSorter
from itertools import takewhile
from pathlib import Path

PACKAGE = "fenics_ehd"

#: Rooms of the package from the lowest floor to the highest.
ROOMS = (
    "base", "reduction", "fem", "film", "multibody", "analysis", "results", "scenes",
    "plotting", "study", "cli",
)  # fmt: skip

#: Only these import dolfinx.
DOLFINX = ("base.compat", "fem", "film")

#: Lines of docstring a statement, at least; other packages of this field have 0.2 to 1.4.
DOCSTRING_LINES = 0.55

#: Lines of a module at most, and those below which a module is printed without a failure.
LARGEST_MODULE, SMALL_MODULE = 800, 150

#: Statements of a function at most: a page of code; the longest had 47 when the limit was set.
LARGEST_FUNCTION = 50

#: Tuple displays assigned to tuples, in 100 statements, at most; other packages have 0.03 to 0.43.
PACKED = 0.5

#: `for` and `if` in one comprehension, at most.
CLAUSES = 2

#: Sentence by which the head of a module gives the reason for its imports inside functions.
REASON = "Imports inside functions:"

#: Words that are vague or metaphors; a line that means one literally has the mark `EXCEPTED`.
WORDS = re.compile(
    r"\b(told|says|said|beside|worth|luck|theirs|goes on|keeps account|"  # words: literal
    r"stands? for|whatever|nobody|whoever|of old|a while|in the way)\b",  # words: literal
    re.IGNORECASE,
)
EXCEPTED = "words: literal"

#: Names that could hold anything.
EMPTY_NAMES = frozenset(
    "found own place places given said told whole left more".split()  # words: literal
)

#: Files, besides the package, whose words are checked.
WRITTEN = ("tests/**/*.py", "benchmarks/*.py", "demos/**/*.py", "docs/**/*.py", "docs/*.md")

DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)
IMPORTS = (ast.Import, ast.ImportFrom)


def parsed(root):
    """Syntax trees of the modules of a package, by path from the folder of the package."""
    return {
        str(path.relative_to(root.parent)): ast.parse(path.read_text())
        for path in sorted(root.rglob("*.py"))
    }


def imports(tree):
    """Names of modules that a file imports, or imports from."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def floor(module):
    """Index of a module's room, or None for the package itself and its models."""
    name = module.split(".")[1:2]
    return ROOMS.index(*name) if name and name[0] in ROOMS else None


def layers(root):
    """Imports of a room above, of dolfinx where it is not allowed, and in a circle.

    Imports inside functions and for type checkers count: they exist for speed, and do not allow a
    dependence on a room above.
    """
    trees = {
        path.removesuffix(".py").replace("/", ".").removesuffix(".__init__"): tree
        for path, tree in parsed(root).items()
    }
    inside = {}
    for module, tree in trees.items():
        names = set(imports(tree))
        # A package's __init__ is imported before its modules: it may gather them.
        inside[module] = {
            other for other in names & set(trees) if not module.startswith(f"{other}.")
        } - {module}
        if any(name.split(".")[0] == "dolfinx" for name in names) and not module.startswith(
            tuple(f"{PACKAGE}.{name}" for name in DOLFINX)
        ):
            yield f"{module} imports dolfinx"
        if floor(module) is None and module != PACKAGE:
            yield f"{module} is in no room"
        for other in inside[module]:
            floors = floor(module), floor(other)
            if None not in floors and floors[1] > floors[0]:
                yield f"{module} imports {other}, which is in a room above"
    try:
        TopologicalSorter(inside).prepare()
    except CycleError as error:
        yield f"circle: {' -> '.join(error.args[1])}"


def statements(tree):
    """Statements below a node, docstrings excluded."""
    nodes = [node for node in ast.walk(tree) if node is not tree]
    texts = sum(has_docstring(node) for node in ast.walk(tree))
    return sum(isinstance(node, ast.stmt) for node in nodes) - texts


def has_docstring(node):
    """Whether a node is a module, class or function with a docstring."""
    return isinstance(node, DOCUMENTED) and ast.get_docstring(node, clean=False) is not None


def docstrings(root):
    """Too few lines of docstring in the package."""
    trees = parsed(root).values()
    total = sum(map(statements, trees))
    texts = [node.body[0] for tree in trees for node in ast.walk(tree) if has_docstring(node)]
    lines = sum(text.end_lineno - text.lineno + 1 for text in texts)
    if lines < DOCSTRING_LINES * total:
        yield f"{lines / total:.2f} lines of docstring a statement, at least {DOCSTRING_LINES}"


def module_lines(root):
    """Lines of every module, by path."""
    return {
        str(path.relative_to(root.parent)): len(path.read_text().splitlines())
        for path in sorted(root.rglob("*.py"))
    }


def modules(root):
    """Modules that are too long."""
    for path, lines in module_lines(root).items():
        if lines > LARGEST_MODULE:
            yield f"{path} has {lines} lines, at most {LARGEST_MODULE}"


def functions(root):
    """Functions that are too long."""
    for path, tree in parsed(root).items():
        for node in ast.walk(tree):
            if isinstance(node, FUNCTIONS) and statements(node) > LARGEST_FUNCTION:
                counts = f"{statements(node)} statements, at most {LARGEST_FUNCTION}"
                yield f"{path}:{node.lineno}: {node.name} has {counts}"


def is_packed(node):
    """Whether a statement assigns a tuple display to a tuple and is no swap of its targets."""
    if not (isinstance(node, ast.Assign) and isinstance(node.value, ast.Tuple)):
        return False
    targets = [target for target in node.targets if isinstance(target, ast.Tuple)]
    values = {ast.unparse(element) for element in node.value.elts}
    return any({ast.unparse(element) for element in target.elts} != values for target in targets)


def packing(root):
    """Tuple displays assigned to tuples, if the package has too many of them."""
    trees = parsed(root)
    packed = [
        f"{path}:{node.lineno}: packed: {ast.unparse(node)}"
        for path, tree in trees.items()
        for node in filter(is_packed, ast.walk(tree))
    ]
    if 100 * len(packed) > PACKED * sum(map(statements, trees.values())):
        yield from packed


def comprehensions(root):
    """Comprehensions with too many `for` and `if`."""
    for path, tree in parsed(root).items():
        for node in ast.walk(tree):
            parts = getattr(node, "generators", [])
            clauses = sum(1 + len(part.ifs) for part in parts)
            if clauses > CLAUSES:
                yield f"{path}:{node.lineno}: {clauses} for and if in a comprehension"


def late_imports(root):
    """Modules that import inside functions and do not give the reason at their head."""
    for path, tree in parsed(root).items():
        bodies = [node for node in ast.walk(tree) if isinstance(node, FUNCTIONS)]
        late = any(isinstance(node, IMPORTS) for body in bodies for node in ast.walk(body))
        if late and REASON not in " ".join(head(root.parent / path, tree).split()):
            yield f'{path} imports inside functions, its head has no "{REASON} ..."'


def head(path, tree):
    """Text of a module before its first statement, docstring and comments."""
    first = next((node for node in tree.body[has_docstring(tree) :]), None)
    lines = path.read_text().splitlines()
    return "\n".join(lines[: first.lineno - 1] if first else lines)


def empty_names(root):
    """Variables of the package whose names could hold anything."""
    for path, tree in parsed(root).items():
        lines = (root.parent / path).read_text().splitlines()
        for node in ast.walk(tree):
            stored = isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
            if stored and node.id in EMPTY_NAMES and EXCEPTED not in lines[node.lineno - 1]:
                yield f"{path}:{node.lineno}: empty name: {lines[node.lineno - 1].strip()}"


def words(root):
    """Words of the lint list in the package, in tests, benchmarks, demos and documentation."""
    project = root.parent
    others = [path for pattern in WRITTEN for path in project.glob(pattern)]
    for path in sorted([*root.rglob("*.py"), *others, *project.glob("README.md")]):
        yield from lint_words(path.read_text().splitlines(), path.relative_to(project))
    changelog = project / "CHANGELOG.md"
    if changelog.exists():
        yield from lint_words(unreleased(changelog.read_text()), "CHANGELOG.md")


def unreleased(text):
    """Lines of the changelog that belong to no version yet, earlier ones left empty."""
    lines = text.splitlines()
    start = next((n for n, line in enumerate(lines) if line == "## [Unreleased]"), len(lines))
    entries = takewhile(lambda line: not line.startswith("## "), lines[start + 1 :])
    return [""] * (start + 1) + list(entries)


def lint_words(lines, path):
    """One line for each word of the lint list, in lines without the mark `EXCEPTED`."""
    for number, line in enumerate(lines, 1):
        if EXCEPTED not in line:
            for match in WORDS.finditer(line):
                yield f"{path}:{number}: {match.group()}: {line.strip()}"


RULES = (
    layers, docstrings, modules, functions, packing, comprehensions, late_imports, empty_names,
    words,
)  # fmt: skip

#: Rules whose breaches are counted and do not fail.
NOT_YET: set = set()


def main():
    """Print breaches and small modules; whether a rule fails."""
    root = Path(__file__).parents[1] / PACKAGE
    show_all = "--all" in sys.argv
    failed = False
    for rule in RULES:
        breaches = list(rule(root))
        if rule in NOT_YET:
            print(f"{rule.__name__}: {len(breaches)}, not enforced")
        else:
            failed |= bool(breaches)
        if show_all or rule not in NOT_YET:
            print(*breaches, sep="\n", end="\n" if breaches else "")
    small = [f"{path} ({n})" for path, n in module_lines(root).items() if 1 < n < SMALL_MODULE]
    print(f"below {SMALL_MODULE} lines: {', '.join(small)}")
    return failed


if __name__ == "__main__":
    sys.exit(main())
