"""Words of the field lead to a page, and every command begins with the question that it answers."""

import re
from pathlib import Path

import click
import pytest

from fenics_ehd.cli.main import cli

DOCS = Path(__file__).parents[1] / "docs"

#: Words that the help of the program itself has, so that a search in a package index finds it.
HELP = ("EHD", "EHL", "elastohydrodynamic", "hydrodynamic", "journal bearing", "big end",
        "multibody", "cavitation", "component mode synthesis")  # fmt: skip

CONTEXT = click.Context(cli, info_name="fenics-ehd", terminal_width=80)
COMMANDS = cli.list_commands(CONTEXT)


def plain(text):
    return " ".join(text.split()).lower()


def listed():
    """Search words of the glossary with the files of the pages to which they point."""
    section = (DOCS / "glossary.md").read_text().partition("## Search words")[2]
    for line in section.partition("\n## ")[0].splitlines():
        cells = [cell.strip() for cell in line.split("|")[1:-1]]
        pages = re.findall(r"\]\(([\w-]+\.md)(?:#[\w-]+)?\)", cells[1]) if cells else []
        if pages:
            yield from ((word, tuple(pages)) for word in cells[0].split(", "))


def test_the_list_has_the_words_of_the_field():
    words = {word for word, _ in listed()}
    assert {"EHL", "EHD", "MOFT", "POFP", "Sommerfeld", "Ocvirk", "Campbell", "whip"} <= words
    assert len(words) > 70


@pytest.mark.parametrize(("word", "pages"), list(listed()))
def test_a_search_word_occurs_on_its_page(word, pages):
    assert any(plain(word) in plain((DOCS / page).read_text()) for page in pages)


def test_the_program_is_found_by_the_words_of_the_field():
    text = plain(cli.get_help(CONTEXT))
    assert [word for word in HELP if word.lower() not in text] == []
    # Each question has room in its line of the list.
    commands = text.partition("commands:")[2]
    assert commands.count("?") == len(COMMANDS)
    assert "..." not in commands


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_and_its_section_begin_with_their_question(name):
    command = cli.get_command(CONTEXT, name)
    question, _, description = command.help.partition("\n\n")
    assert re.fullmatch(r"[A-Z][^?]*\?", question)
    assert description
    page = (DOCS / "command-line.md").read_text()
    section = page.partition(f"### fenics-ehd {name}\n")[2]
    usage, first = section.lstrip().split("\n\n")[:2]
    assert usage.startswith(f"```text\nUsage: fenics-ehd {name} ")
    assert plain(first) == plain(question)


#: Page of the guides that is about one command.
PAGES = {"paper": "paper", "part": "own-part", "plot": "pictures", "reduce": "reduction",
         "report": "report", "rotor": "rotor-maps", "run": "results",
         "sensitivity": "sensitivity", "stress": "stress", "study": "study",
         "sweep": "sweeps"}  # fmt: skip


@pytest.mark.parametrize(("name", "page"), list(PAGES.items()))
def test_the_page_of_a_command_begins_with_its_question(name, page):
    question = cli.get_command(CONTEXT, name).help.partition("\n\n")[0]
    title, first = (DOCS / f"{page}.md").read_text().split("\n\n")[:2]
    assert title.startswith("# ")
    assert first == f"**{question}**"
