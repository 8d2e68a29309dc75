"""``{command-help}``: what ``--help`` prints for every command, one section each."""

from collections.abc import Iterator

import click
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from fenics_ehd.cli.main import cli

#: Columns of the page.
WIDTH = 88


def commands(command: click.Command, context: click.Context) -> Iterator[tuple[str, str]]:
    """Path and help text of a command and of those below it."""
    yield context.command_path, command.get_help(context)
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            found = command.get_command(context, name)
            assert found is not None
            yield from commands(found, click.Context(found, parent=context, info_name=name))


class CommandHelp(SphinxDirective):
    """Sections of literal text."""

    def run(self) -> list[nodes.Node]:
        """Ask the program itself."""
        settings = {**cli.context_settings, "terminal_width": WIDTH, "max_content_width": WIDTH}
        context = click.Context(cli, info_name="fenics-ehd", **settings)
        found = []
        for path, text in commands(cli, context):
            section = nodes.section(ids=[nodes.make_id(path)], names=[path])
            section += nodes.title(text=path)
            section += nodes.literal_block(text=text, language="none")
            self.state.document.note_implicit_target(section)
            found.append(section)
        return found


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("command-help", CommandHelp)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
