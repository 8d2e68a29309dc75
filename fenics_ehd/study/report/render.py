"""A report as one self-contained HTML page, and as Markdown."""

from __future__ import annotations

import json
import re
from base64 import b64encode
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from fenics_ehd.study.report import tables


def render(form: str, figures: Path, **content: Any) -> str:
    """The page, which ``templates/report.jinja`` words.

    Parameters
    ----------
    form
        ``"html"``, a page without any other file, or ``"md"``, with links to PNG files.
    figures
        Folder of the figures.
    content
        What the template speaks of.
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
        "base64": lambda name: b64encode((figures / f"{name}.svg").read_bytes()).decode(),
        "json": lambda values: (str if form == "html" else Markup)(
            json.dumps(values, indent=2, ensure_ascii=False)
        ),
        "cell": lambda text: text.replace("|", "\\|").replace("\n", " "),
    }
    template = environment.get_template("report.jinja")
    text = template.render(form=f"{form}.jinja", tables=tables, folder=figures.name, **content)
    return re.sub(r"\n{3,}", "\n\n", text.strip()) + "\n"


def _of_markdown(value: Any) -> Any:
    """Text of a name or a message without what Markdown takes for HTML or a link."""
    if isinstance(value, Markup):
        return value
    return Markup(str(value).replace("&", "&amp;").replace("<", "&lt;").replace("](", "]\\("))
