"""Draw 60 docstrings and 20 messages of the package for a reader who has not seen the code.

    python tests/draw_sentences.py [REVISION]

prints them numbered, each with file and line. The hash of the last commit, or of another revision,
seeds the generator: the same commit gives the same sentences.
"""

import ast
import random
import subprocess
import sys
import textwrap
from pathlib import Path

ROOT = Path(__file__).parents[1]

DOCSTRINGS, MESSAGES = 60, 20

DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)

#: A message has at least so many words; shorter texts are labels and keys.
WORDS_OF_A_MESSAGE = 4

#: Calls that give a text to the user, besides constructors of errors.
REPORTS = ("warn", "warning", "info", "echo", "secho")


def docstrings(path):
    """Line and text of the docstrings of a module, each one with what it documents."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, DOCUMENTED) and (text := ast.get_docstring(node)):
            name = getattr(node, "name", path.stem)
            yield node.body[0].lineno, f"{name}: {text}"


def messages(path):
    """Line and text of what a module raises or reports, its values in braces."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Call) and reports(node):
            for argument in node.args:
                text = text_of(argument)
                if len(text.split()) >= WORDS_OF_A_MESSAGE:
                    yield argument.lineno, text


def reports(call):
    """Whether a call makes an error or gives a text to the user."""
    name = ast.unparse(call.func).rpartition(".")[2]
    return name.endswith("Error") or name in REPORTS


def text_of(node):
    """Text of a string or an f-string, empty for other expressions."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(
            part.value if isinstance(part, ast.Constant) else f"{{{ast.unparse(part.value)}}}"
            for part in node.values
        )
    return ""


def draw(source, number, paths, generator):
    """Texts drawn from those of all modules, in the order of the files."""
    texts = [
        (str(path.relative_to(ROOT)), line, text) for path in paths for line, text in source(path)
    ]
    return sorted(generator.sample(texts, number))


def main(revision="HEAD"):
    """Print what is drawn."""
    command = ["git", "rev-parse", revision]
    commit = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    generator = random.Random(commit.stdout.strip())
    paths = sorted((ROOT / "fenics_ehd").rglob("*.py"))
    drawn = [
        *draw(docstrings, DOCSTRINGS, paths, generator),
        *draw(messages, MESSAGES, paths, generator),
    ]
    print(f"commit {commit.stdout.strip()}")
    for number, (path, line, text) in enumerate(drawn, 1):
        print(f"\n{number}. {path}:{line}\n{textwrap.indent(text, '   ')}")


if __name__ == "__main__":
    main(*sys.argv[1:])
