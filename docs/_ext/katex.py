"""Equations by Debian's KaTeX, copied into the site: it works without a network."""

from pathlib import Path

from sphinx.application import Sphinx
from sphinx.ext.mathjax import html_visit_displaymath, html_visit_math

KATEX = Path("/usr/share/javascript/katex")
SCRIPTS = ("katex.min.js", "contrib/auto-render.js")
STYLE = "katex.min.css"

RENDER = """
document.addEventListener("DOMContentLoaded", () =>
  document.querySelectorAll(".math").forEach(element => renderMathInElement(element)));
"""


def copy_files(app: Sphinx) -> None:
    """Scripts, style and fonts to the site's static folder."""
    if app.builder.format != "html":
        return
    target = Path(app.outdir) / "_static" / "katex"
    for name in (*SCRIPTS, STYLE, *(f"fonts/{f.name}" for f in (KATEX / "fonts").glob("*.woff2"))):
        file = target / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes((KATEX / name).read_bytes())


def add_scripts(app: Sphinx, page: str, _template: str, _context: dict, _doctree: object) -> None:
    """Only to pages with equations."""
    if app.builder.format == "html" and app.env.get_domain("math").has_equations(page):
        app.add_css_file(f"katex/{STYLE}")
        for name in SCRIPTS:
            app.add_js_file(f"katex/{name}")
        app.add_js_file(None, body=RENDER)


def setup(app: Sphinx) -> dict[str, object]:
    """Register the renderer; its markup is that of Sphinx's own for MathJax."""
    app.add_html_math_renderer("katex", (html_visit_math, None), (html_visit_displaymath, None))
    app.connect("builder-inited", copy_files)
    app.connect("html-page-context", add_scripts)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
