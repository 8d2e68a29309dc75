"""Pages of reports: tables of texts, and templates that are rendered as HTML or Markdown.

An HTML page is self-contained: its figures are embedded as SVG, and it loads nothing.
"""

from __future__ import annotations

import json
import math
import re
import shlex
from base64 import b64encode
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup


@dataclass(frozen=True)
class Table:
    """A table of texts for the report.

    Attributes
    ----------
    heads
        Headings of the columns.
    rows
        Texts of the cells, row by row.
    words
        Number of leading columns with words; the other columns have numbers and are right-aligned.
    """

    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    words: int = 1


def percent(value: float) -> str:
    """Text of a ratio in per cent with two significant digits; ``?`` if it is unknown."""
    if not math.isfinite(value):
        return "?"
    return f"{100 * value:.0f} %" if abs(value) >= 0.995 else f"{100 * value:.2g} %"


def render(
    template: str, form: str, figures: Mapping[str, bytes], folder: str = "", **content: Any
) -> str:
    """Text of a page, from a template in the folder ``templates``.

    Parameters
    ----------
    template
        Name of the template, such as ``report.jinja``.
    form
        ``"html"`` for a self-contained page, or ``"md"`` for Markdown with links to PNG files.
    figures
        Figures as SVG, by name.
    folder
        Name of the folder with the PNG files.
    content
        Variables of the template.
    """
    environment = Environment(
        loader=PackageLoader("fenics_ehd.study.report", "templates"),
        autoescape=True,
        finalize=None if form == "html" else _of_markdown,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {
        "base64": lambda name: b64encode(figures[name]).decode(),
        "base64_of": lambda content: b64encode(content).decode(),
        "quoted": shlex.quote,
        "json": lambda values: (str if form == "html" else Markup)(
            json.dumps(values, indent=2, ensure_ascii=False)
        ),
        "cell": lambda text: text.replace("|", "\\|").replace("\n", " "),
    }
    page = environment.get_template(template)
    text = page.render(form=f"{form}.jinja", folder=folder, drawn=figures, **content)
    return re.sub(r"\n{3,}", "\n\n", text.strip()) + "\n"


def _of_markdown(value: Any) -> Any:
    """Escape characters of a text that Markdown would read as HTML or as a link."""
    if isinstance(value, Markup):
        return value
    return Markup(str(value).replace("&", "&amp;").replace("<", "&lt;").replace("](", "]\\("))
