"""``{demo} NAME``: a file of demos/ as a page, in jupytext's light format."""

from pathlib import Path

from docutils import nodes
from docutils.statemachine import StringList
from light_cells import markdown
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

DEMOS = Path(__file__).parents[2] / "demos"


class Demo(SphinxDirective):
    """Text and code of one demo, its headings one level down."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Read the file and parse it as Markdown."""
        path = DEMOS / f"{self.arguments[0]}.py"
        self.env.note_dependency(str(path))
        parent = nodes.Element()
        lines = StringList(markdown(path.read_text()).split("\n"), str(path))
        self.state.nested_parse(lines, 0, parent, match_titles=True)
        return parent.children


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("demo", Demo)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
