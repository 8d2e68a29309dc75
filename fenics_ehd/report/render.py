"""A document to one self-contained HTML page, and to Markdown."""

from __future__ import annotations

import re
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from fenics_ehd.report.document import Document

#: Largest size of a figure on the page over that in its file.
MAGNIFICATION = 1.16


def _environment(*, html: bool) -> Environment:
    return Environment(
        loader=PackageLoader("fenics_ehd.report", "templates"),
        autoescape=html,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )


def to_html(document: Document, figures: Path) -> str:
    """One page without any other file: the figures' SVG stands in it.

    Parameters
    ----------
    document
        The report.
    figures
        Folder of the SVG files.
    """
    environment = _environment(html=True)
    environment.filters["svg"] = lambda name, caption: inline_svg(
        figures / f"{name}.svg", name, caption
    )
    return environment.get_template("report.html").render(document=document)


def to_markdown(document: Document, figures: str) -> str:
    """The same as Markdown; pictures are links to PNG files in `figures`."""
    environment = _environment(html=False)
    environment.filters["cell"] = lambda text: text.replace("|", "\\|").replace("\n", " ")
    text = environment.get_template("report.md").render(document=document, figures=figures)
    return re.sub(r"\n{3,}", "\n\n", text)


def inline_svg(path: Path, name: str, caption: str) -> Markup:
    """An SVG file as an element of a page: no header, ids that no other figure has."""
    text = path.read_text(encoding="utf-8")
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r'(\sid=")', rf"\g<1>{name}-", text)
    text = re.sub(r'(href="#)', rf"\g<1>{name}-", text)
    text = re.sub(r"(url\(#)", rf"\g<1>{name}-", text)
    text = re.sub(r'(<svg[^>]*?)\sheight="[^"]*"', r"\1", text, count=1)

    def sized(match: re.Match) -> str:
        width = MAGNIFICATION * float(match[2])
        label = escape(caption)
        return f'{match[1]} role="img" aria-label="{label}" style="max-width: {width:.0f}pt"'

    return Markup(re.sub(r'(<svg[^>]*?)\swidth="([\d.]+)pt"', sized, text, count=1))
