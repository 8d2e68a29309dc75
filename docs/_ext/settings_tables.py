"""``{scene-settings} TABLE``: keys of a table of a scene file, from the classes that check them."""

import json

import attrs
from docutils import nodes
from docutils.statemachine import StringList
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from fenics_ehd.scenes import schema
from fenics_ehd.scenes.supply_settings import SUPPLIES

#: Tables that have no kinds.
ALONE = {"time": schema.TimeSettings, "output": schema.OutputSettings}

#: Classes by kind.
KINDS = {**schema.KINDS, "supply": SUPPLIES}


def rows(cls: type, path: str = "", where: str = "") -> list[tuple[str, str, str]]:
    """Key, default and meaning, sections after the keys of their parent."""
    own, nested = [], []
    for attribute in attrs.fields(cls):
        name, default = f"{path}{attribute.name}", attribute.default
        section = attribute.metadata.get("section")
        if section:
            listed = f", where `{name}` is listed" if attribute.metadata.get("optional") else where
            nested += rows(section, f"{name}.", listed)
        else:
            if isinstance(default, attrs.Factory):
                default = default.factory()
            told = f"must be given{where}" if default is attrs.NOTHING else f"`{_text(default)}`"
            own.append((f"`{name}`", told, attribute.metadata["help"]))
    return own + nested


def _text(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else json.dumps(value)


class SceneSettings(SphinxDirective):
    """Tables of the keys of a scene's table, one for every kind of entry."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Build the tables from reStructuredText or Markdown, whichever page asks."""
        table, lines = self.arguments[0], []
        kinds = {"": ALONE[table]} if table in ALONE else KINDS[table]
        for kind, cls in kinds.items():
            if kind:
                lines += [f'**`kind = "{kind}"`**: {cls.__doc__.splitlines()[0]}', ""]
            lines += ["| key | default | meaning |", "|---|---|---|"]
            for row in rows(cls):
                lines.append("| " + " | ".join(text.replace("|", r"\|") for text in row) + " |")
            lines.append("")
        parent = nodes.Element()
        self.state.nested_parse(StringList(lines, self.get_source_info()[0]), 0, parent)
        return parent.children


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("scene-settings", SceneSettings)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
