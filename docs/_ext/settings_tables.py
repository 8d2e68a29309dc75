"""``{scene-settings} NAME``: every key of a scene file, from the classes that check it."""

import json

import attrs
from docutils import nodes
from docutils.statemachine import StringList
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from fenics_ehd.scenes.loaded_journal_settings import LoadedJournalSettings
from fenics_ehd.scenes.rotor_settings import RotorSettings
from fenics_ehd.scenes.slider_crank_settings import SliderCrankSettings

SCENES = {
    "slider-crank": SliderCrankSettings,
    "rotor": RotorSettings,
    "loaded-journal": LoadedJournalSettings,
}


def rows(cls: type, path: str = "") -> list[tuple[str, str, str]]:
    """Key, default and meaning, sections after the keys of their parent."""
    own, nested = [], []
    for attribute in attrs.fields(cls):
        name, value = f"{path}{attribute.name}", getattr(cls(), attribute.name)
        section = attribute.metadata.get("section")
        if section:
            nested += rows(section, f"{name}.")
        else:
            default = f"{value:g}" if isinstance(value, float) else json.dumps(value)
            own.append((name, default, attribute.metadata["help"]))
    return own + nested


class SceneSettings(SphinxDirective):
    """Table of a scene's keys."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Build the table from reStructuredText or Markdown, whichever page asks."""
        lines = ["| key | default | meaning |", "|---|---|---|"]
        for row in rows(SCENES[self.arguments[0]]):
            key, default, meaning = (text.replace("|", r"\|") for text in row)
            lines.append(f"| `{key}` | `{default}` | {meaning} |")
        parent = nodes.Element()
        self.state.nested_parse(StringList(lines, self.get_source_info()[0]), 0, parent)
        return parent.children


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("scene-settings", SceneSettings)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
