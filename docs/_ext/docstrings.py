"""Docstrings for the site: formulas become equations, attributes keep their sentences.

Docstrings are written to be read in a terminal. A paragraph indented below a text is a formula, as
in ``int p dh/dphi dA = 0``; here it becomes TeX. Napoleon takes the text before a colon for a type,
and two names for a name and its type: both are prevented.
"""

from __future__ import annotations

import re
from itertools import takewhile
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sphinx.application import Sphinx

GREEK = (
    "alpha", "beta", "gamma", "delta", "eps", "zeta", "eta", "theta", "kappa", "lambda", "mu", "nu",
    "xi", "pi", "rho", "sigma", "tau", "phi", "psi", "omega", "Gamma", "Delta", "Theta", "Sigma",
    "Phi", "Psi", "Omega",
)  # fmt: skip

FUNCTIONS = {
    "sqrt": r"\sqrt", "exp": r"\exp", "log": r"\log", "log10": r"\log_{10}",
    "tr": r"\operatorname{tr}", "det": r"\det", "int": r"\int", "sum": r"\sum",
    "grad": r"\nabla", "inf": r"\infty",
    "sin": r"\sin", "cos": r"\cos", "max": r"\max", "min": r"\min",
}  # fmt: skip

SYMBOLS = {name: rf"\{name}" for name in GREEK} | {"eps": r"\varepsilon"} | FUNCTIONS

OPERATORS = {">=": r"\ge", "<=": r"\le", "...": r"\dots", "->": r"\to", "+-": r"\pm", "%": r"\%"}

#: Short words of English among the symbols of a formula.
WORDS = {"in", "of", "on", "to", "by", "at", "is", "and", "the", "for", "all", "mm2"}

#: Parts of a formula: numbers, names with index and primes, dots, brackets, everything else.
TOKEN = re.compile(
    r"(?P<gap>\s{2,})|(?P<space>\s)|(?P<number>\d+(?:\.\d+)?)"
    r"|(?P<word>[a-z]{3,}_[a-z]{3,}(?=\())|(?P<name>[A-Za-z]+\d*)|(?P<operator>>=|<=|\.\.\.|->|\+-|%)|(?P<other>.)"
)

#: End of a word and start of the next.
JOINT = re.compile(r"(\\text\{[^}]*)\} \\text\{")

#: A section of a docstring, and the names of one entry that describes several attributes.
RULE = re.compile(r"-{3,}$")
NAMES = re.compile(r"\w+(, \w+)+$")


def symbol(name: str) -> str:
    """A name in TeX: Greek letters and functions, differentials, words upright."""
    if name in SYMBOLS:
        return SYMBOLS[name] + " "
    if len(name) > 1 and name[0] == "d" and name[1:] in SYMBOLS:
        return f"d{SYMBOLS[name[1:]]} "
    return rf"\text{{{name}}}" if is_word(name) else name


def is_word(name: str) -> bool:
    """Whether a name is a word of English or a unit, set upright."""
    return name in WORDS or len(re.sub(r"\d", "", name)) > 2


def brackets(text: str, start: int) -> int:
    """Index behind the bracket that closes the one at `start`."""
    depth = 0
    for i in range(start, len(text)):
        depth += (text[i] == "(") - (text[i] == ")")
        if not depth:
            return i + 1
    return len(text)


def script(text: str, start: int) -> int:
    """Index behind what is raised or lowered from `start` on: brackets, a sign and a word."""
    if text[start : start + 1] == "(":
        return brackets(text, start)
    match = re.match(r"-?[A-Za-z0-9]+(?:/\d)?", text[start:])
    return start + (match.end() if match else 1)


def tex(formula: str) -> str:
    """One line of a formula in TeX."""
    pieces, i = [], 0
    while i < len(formula):
        if formula[i] in "_^":
            end = script(formula, i + 1)
            inner = formula[i + 1 : end]
            inner = inner[1:-1] if inner.startswith("(") else inner
            pieces.append(f"{formula[i]}{{{tex(inner)}}}")
        elif formula.startswith("sqrt(", i):
            end = brackets(formula, i + 4)
            pieces.append(rf"\sqrt{{{tex(formula[i + 5 : end - 1])}}}")
        elif formula.startswith(" . ", i):
            end = i + 3
            pieces.append(r" \cdot ")
        else:
            match = TOKEN.match(formula, i)
            end = match.end()
            pieces.append(piece(match.lastgroup, match.group()))
        i = end
    line = "".join(pieces).strip()
    while (joined := JOINT.sub(r"\1 ", line)) != line:
        line = joined
    # Spaces are lost between symbols, and needed around words.
    line = re.sub(r" +(\\text\{)", r"\\ \1", line.replace(r"\qquad \text", r"\qquad\text"))
    return re.sub(r"(\\text\{[^}]*\}) +(?!\\qquad)", r"\1\\ ", line)


def piece(kind: str, text: str) -> str:
    """A token in TeX."""
    if kind == "gap":
        return r" \qquad "
    if kind == "name":
        return symbol(text)
    if kind == "word":
        first, _, last = text.partition("_")
        greek = first in SYMBOLS
        return rf"{symbol(first)}_{{{symbol(last)}}}" if greek else rf"\text{{{first}\_{last}}}"
    return OPERATORS[text] if kind == "operator" else text


def equation(lines: list[str]) -> list[str]:
    """Directive of the lines of a formula, aligned at their first equals signs."""
    rows = [tex(re.sub(r" +(=|>=|->) +", r" \1 ", line.strip().rstrip(":"))) for line in lines]
    if len(rows) > 1:
        rows = [row.replace("=", "&=", 1) if "=" in row else f"& {row}" for row in rows]
        rows = [r"\begin{aligned}", " \\\\\n".join(rows), r"\end{aligned}"]
    return ["", ".. math::", "", *(f"   {line}" for row in rows for line in row.split("\n")), ""]


def depth(line: str) -> int:
    """Spaces before a line."""
    return len(line) - len(line.lstrip())


def with_equations(lines: list[str]) -> list[str]:
    """Docstring with its indented paragraphs as equations; literal blocks stay."""
    changed, i, above = [], 0, ""
    while i < len(lines):
        line = lines[i]
        below_text = i > 0 and not lines[i - 1].strip() and above
        if line.strip() and below_text and depth(line) == depth(above) + 4:
            block = list(takewhile(str.strip, lines[i:]))
            pad = " " * depth(above)
            made = block if above.endswith("::") else equation(block)
            changed += made if made is block else [(pad + row).rstrip() for row in made]
            i += len(block)
            continue
        above = line if line.strip() else above
        changed.append(line)
        i += 1
    return changed


def with_single_names(lines: list[str]) -> list[str]:
    """Docstring whose sections describe one name an entry, several of them with the same text."""
    changed, i, inside = [], 0, False
    while i < len(lines):
        inside |= bool(RULE.match(lines[i]))
        if inside and NAMES.match(lines[i]):
            text = list(takewhile(lambda line: not line or line[0] == " ", lines[i + 1 :]))
            for name in lines[i].split(", "):
                changed += [name, *text]
            i += 1 + len(text)
        else:
            changed.append(lines[i])
            i += 1
    return changed


def prepare(
    _app: Sphinx, what: str, _name: str, _object: object, _options: object, lines: list[str]
) -> None:
    """Change a docstring before napoleon reads it."""
    lines[:] = with_single_names(with_equations(lines))
    # Napoleon looks for a type in the first line of an attribute's docstring, here an empty text.
    if what in ("attribute", "data", "property") and lines:
        lines.insert(0, r"\ ")


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the change, before napoleon's of priority 500."""
    app.connect("autodoc-process-docstring", prepare, priority=400)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
