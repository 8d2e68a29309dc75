"""Tables of the documentation that the program itself knows, written into its pages.

    python docs/tables.py            writes them
    python docs/tables.py --check    fails where a page is not what it would write

A page has them between a line ``<!-- KIND ARGUMENT -->`` and a line ``<!-- end -->``.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import attrs
import click

from fenics_ehd.base.settings import declared
from fenics_ehd.cli.main import cli
from fenics_ehd.scenes import schema
from fenics_ehd.scenes.part_settings import OutputSettings
from fenics_ehd.scenes.schema import SUPPLIES

DOCS = Path(__file__).parent

#: Columns of printed help.
WIDTH = 88

#: Tables of a scene that have no kinds.
ALONE = {"time": schema.TimeSettings, "output": OutputSettings}

#: Classes by kind.
KINDS = {**schema.KINDS, "supply": SUPPLIES}

#: Digits of an exponent, and a space that does not break.
RAISED, SPACE = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"), "\N{NO-BREAK SPACE}"


def command_help(_: str) -> list[str]:
    """What ``--help`` prints for every command, one section each."""
    settings = {**cli.context_settings, "terminal_width": WIDTH, "max_content_width": WIDTH}
    lines = []
    for path, text in _commands(cli, click.Context(cli, info_name="fenics-ehd", **settings)):
        lines += [f"### {path}", "", "```text", *text.splitlines(), "```", ""]
    return lines[:-1]


def _commands(command: click.Command, context: click.Context) -> Iterator[tuple[str, str]]:
    yield context.command_path, command.get_help(context)
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            found = command.get_command(context, name)
            assert found is not None
            yield from _commands(found, click.Context(found, parent=context, info_name=name))


def scene_settings(name: str) -> list[str]:
    """Keys of a table of a scene file, from the classes that check them."""
    lines = []
    for kind, cls in ({"": ALONE[name]} if name in ALONE else KINDS[name]).items():
        if kind:
            lines += [f'**`kind = "{kind}"`**: {cls.__doc__.splitlines()[0]}', ""]
        lines += ["| key | default | meaning |", "|---|---|---|"]
        for row in _settings(cls):
            lines.append("| " + " | ".join(text.replace("|", r"\|") for text in row) + " |")
        lines.append("")
    return lines[:-1]


def _settings(cls: type, path: str = "", where: str = "") -> list[tuple[str, str, str]]:
    """Key, default and meaning, sections after the keys of their parent."""
    keys, nested = [], []
    for attribute in declared(cls):
        name, default = f"{path}{attribute.name}", attribute.default
        section = attribute.metadata.get("section")
        if section:
            listed = f", where `{name}` is listed" if attribute.metadata.get("optional") else where
            nested += _settings(section, f"{name}.", listed)
        else:
            if isinstance(default, attrs.Factory):
                default = default.factory()
            stated = f"must be given{where}" if default is attrs.NOTHING else f"`{_text(default)}`"
            meaning = attribute.metadata["help"] + _needed(attribute)
            keys.append((f"`{name}`", stated, meaning))
    return keys + nested


def _needed(attribute: attrs.Attribute) -> str:
    """Conditions under which a setting has an effect, in a sentence."""
    words = []
    for condition in attribute.metadata.get("needs", ()):
        keys = condition.words or " or ".join(f"`{key}`" for key in condition.keys)
        if condition.among:
            keys += f" {' or '.join(_text(value) for value in condition.among)}"
        words.append(f"{'not with' if condition.absent else 'only with'} {keys}")
    return f"; *{', '.join(words)}*" if words else ""


def _text(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else json.dumps(value)


def validation_figures(group: str) -> list[str]:
    """Figures that the tests assert, or the versions that gave them, as ``make figures`` wrote."""
    recorded = json.loads((DOCS / "validation.json").read_text())
    if group == "versions":
        return [f"Taken with {', '.join(f'{k} {v}' for k, v in recorded['versions'].items())}."]
    worst: dict[str, dict] = {}
    for figure in recorded["figures"]:
        name = figure["name"]
        if figure["group"] == group and (name not in worst or worse(figure, worst[name])):
            worst[name] = figure
    if not worst:
        raise SystemExit(f"docs/validation.json has no figures of {group!r}")
    lines = ["| what | found | asserted | test |", "|---|---|---|---|"]
    for name, figure in worst.items():
        unit = figure["unit"]
        sign = "≤" if "most" in figure else "≥"
        limit = f"{sign}{SPACE}{number(figure.get('most', figure.get('least')), unit)}"
        test = figure["test"].partition("::")[0]
        lines.append(f"| {name} | {number(figure['value'], unit)} | {limit} | `{test}` |")
    return lines


def worse(figure: dict, other: dict) -> bool:
    """Whether it is nearer to its limit than another case of the same figure."""
    larger = figure["value"] > other["value"]
    return larger if "most" in figure else not larger


def number(value: float, unit: str) -> str:
    """Two digits, percent where a share is meant."""
    if unit == "%":
        return f"{100 * value:.2g}{SPACE}%"
    if value < 1e-3:
        mantissa, exponent = f"{value:.1e}".split("e")
        factor = "" if mantissa == "1.0" else f"{mantissa}·"
        return f"{factor}10{str(int(exponent)).translate(RAISED)}"
    return f"{value:.2g}{SPACE}{unit}".strip()


def paper_statements(scene: str) -> list[str]:
    """Statements of the paper about a machine, with the verdicts in ``paper.json``.

    The file is that of ``fenics-ehd paper --statements``.
    """
    from fenics_ehd.study.report.paper_page import STATEMENT_HEADS, STATEMENTS

    recorded = json.loads((DOCS / "paper.json").read_text())
    entries = [entry for figure in recorded["figures"] for entry in figure["statements"]]
    entries += recorded["statements"][scene]
    findings = {(entry["statement"], entry["rule"]): entry for entry in entries}
    lines = ["| " + " | ".join(STATEMENT_HEADS) + " |", "|---" * len(STATEMENT_HEADS) + "|"]
    for each in STATEMENTS[scene]:
        entry = findings.get((each.text, each.rule))
        if entry is None:
            raise SystemExit(f"docs/paper.json has no verdict on {each.text!r}")
        cells = (each.section, each.text, each.rule, entry["measured"], entry["verdict"])
        lines.append("| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |")
    return lines


def paper_verdicts(_: str) -> list[str]:
    """Meanings of the verdicts on statements of the paper."""
    from fenics_ehd.study.report.paper_statement import MEANINGS

    return ["| verdict | |", "|---|---|", *(f"| {k} | {v} |" for k, v in MEANINGS.items())]


WRITERS = {
    "command-help": command_help,
    "paper-statements": paper_statements,
    "paper-verdicts": paper_verdicts,
    "scene-settings": scene_settings,
    "validation-figures": validation_figures,
}

TABLE = re.compile(
    rf"^<!-- ({'|'.join(WRITERS)})(?: ([^\n]*?))? -->\n.*?^<!-- end -->$", re.MULTILINE | re.DOTALL
)


def filled(page: str) -> str:
    """A page with its tables."""

    def table(found: re.Match[str]) -> str:
        kind, argument = found[1], found[2] or ""
        first = found[0].partition("\n")[0]
        return "\n".join([first, "", *WRITERS[kind](argument), "", "<!-- end -->"])

    return TABLE.sub(table, page)


def main(check: bool) -> int:
    """Status: 1 where a page is to be checked and is another."""
    stale = []
    for path in sorted(DOCS.glob("*.md")):
        text = path.read_text()
        if (new := filled(text)) != text:
            stale.append(path.name)
            if not check:
                path.write_text(new)
    if check and stale:
        print(f"{', '.join(stale)}: not what docs/tables.py writes: run it")
    return int(check and bool(stale))


if __name__ == "__main__":
    sys.exit(main("--check" in sys.argv[1:]))
