"""``{validation-figures} GROUP``: numbers that the tests assert, from docs/validation.json."""

import json
from pathlib import Path

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError
from sphinx.util.docutils import SphinxDirective

FIGURES = Path(__file__).parents[1] / "validation.json"


#: Digits of an exponent, and a space that does not break.
RAISED, SPACE = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"), "\N{NO-BREAK SPACE}"


def number(value: float, unit: str) -> str:
    """Two digits, percent where a share is meant."""
    if unit == "%":
        return f"{100 * value:.2g}{SPACE}%"
    if value < 1e-3:
        mantissa, exponent = f"{value:.1e}".split("e")
        factor = "" if mantissa == "1.0" else f"{mantissa}·"
        return f"{factor}10{str(int(exponent)).translate(RAISED)}"
    return f"{value:.2g}{SPACE}{unit}".strip()


def worse(figure: dict, other: dict) -> bool:
    """Whether it is nearer to its limit than another case of the same figure."""
    larger = figure["value"] > other["value"]
    return larger if "most" in figure else not larger


def table(figures: list[dict]) -> list[str]:
    """Markdown rows; several cases of one test are one row, the worst of them."""
    worst: dict[str, dict] = {}
    for figure in figures:
        name = figure["name"]
        if name not in worst or worse(figure, worst[name]):
            worst[name] = figure
    lines = ["| what | found | asserted | test |", "|---|---|---|---|"]
    for name, figure in worst.items():
        unit = figure["unit"]
        sign = "≤" if "most" in figure else "≥"
        limit = f"{sign}{SPACE}{number(figure.get('most', figure.get('least')), unit)}"
        test = figure["test"].partition("::")[0]
        lines.append(f"| {name} | {number(figure['value'], unit)} | {limit} | `{test}` |")
    return lines


class ValidationFigures(SphinxDirective):
    """Table of the figures of one group, or of the versions that gave them."""

    required_arguments = 1
    final_argument_whitespace = True

    def run(self) -> list[nodes.Node]:
        """Read the file that ``make figures`` writes."""
        self.env.note_dependency(str(FIGURES))
        recorded = json.loads(FIGURES.read_text())
        group = self.arguments[0]
        if group == "versions":
            versions = ", ".join(f"{k} {v}" for k, v in recorded["versions"].items())
            lines = [f"Taken with {versions}."]
        else:
            chosen = [f for f in recorded["figures"] if f["group"] == group]
            if not chosen:
                raise ExtensionError(f"docs/validation.json has no figures of {group!r}")
            lines = table(chosen)
        parent = nodes.Element()
        self.state.nested_parse(StringList(lines, str(FIGURES)), 0, parent)
        return parent.children


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("validation-figures", ValidationFigures)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
