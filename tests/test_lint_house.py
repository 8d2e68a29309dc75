"""Rules of the house: each reports a small bad source, and accepts a good one."""

import textwrap

import lint_house
import pytest


@pytest.fixture
def check(tmp_path):
    """Breaches of a rule in a package that consists of the given sources, by path."""

    def check(rule, sources):
        package = tmp_path / lint_house.PACKAGE
        for path, text in {"__init__.py": "", **sources}.items():
            file = package / path
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(textwrap.dedent(text))
        return list(rule(package))

    return check


def test_a_room_imports_only_from_rooms_below(check):
    sources = {"film/oil.py": "from fenics_ehd.cli import main", "cli/main.py": ""}
    (breach,) = check(lint_house.layers, sources)
    assert breach == "fenics_ehd.film.oil imports fenics_ehd.cli.main, which is in a room above"
    sources = {"film/oil.py": "", "cli/main.py": "from fenics_ehd.film import oil"}
    assert not check(lint_house.layers, sources)


def test_late_imports_count_for_the_layers(check):
    late = "def f():\n    from fenics_ehd.cli import main"
    assert check(lint_house.layers, {"film/oil.py": late, "cli/main.py": ""})


def test_modules_do_not_import_each_other_in_a_circle(check):
    one, other = "from fenics_ehd.film import two", "from fenics_ehd.film import one"
    (breach,) = check(lint_house.layers, {"film/one.py": one, "film/two.py": other})
    assert breach.startswith("circle: ")


def test_dolfinx_is_imported_by_its_rooms_only(check):
    source = "import dolfinx.fem"
    assert check(lint_house.layers, {"study/plan.py": source})
    assert not check(lint_house.layers, {"study/plan.py": "", "film/film.py": source})


def test_a_module_is_in_a_room(check):
    assert check(lint_house.layers, {"attic/box.py": ""}) == ["fenics_ehd.attic.box is in no room"]


def test_a_package_has_docstrings(check):
    (breach,) = check(lint_house.docstrings, {"base/plain.py": "a = 1\nb = 2\n"})
    assert breach.startswith("0.00 lines of docstring a statement")
    documented = '"""First line.\n\nMore.\n"""\na = 1\nb = 2\n'
    assert not check(lint_house.docstrings, {"base/plain.py": documented})


def test_a_module_is_not_too_long(check):
    assert check(lint_house.modules, {"base/long.py": "a = 1\n" * 801})
    assert not check(lint_house.modules, {"base/long.py": "a = 1\n" * 800})


def test_a_function_is_not_too_long(check):
    head = 'def f():\n    """Documented."""\n'
    (breach,) = check(lint_house.functions, {"base/f.py": head + "    a = 1\n" * 51})
    assert breach == "fenics_ehd/base/f.py:1: f has 51 statements, at most 50"
    assert not check(lint_house.functions, {"base/f.py": head + "    a = 1\n" * 50})


def test_two_ideas_are_not_packed_into_a_line(check):
    (breach,) = check(lint_house.packing, {"base/f.py": "a, b = 1, 2"})
    assert breach == "fenics_ehd/base/f.py:1: packed: a, b = (1, 2)"
    for source in ("a, b = b, a", "a, b = f()", "a = 1, 2"):
        assert not check(lint_house.packing, {"base/f.py": source})
    rare = "a, b = 1, 2\n" + "a = 1\n" * 199
    assert not check(lint_house.packing, {"base/f.py": rare})


def test_a_comprehension_has_two_clauses(check):
    nested = "[x for row in rows for x in row if x]"
    assert check(lint_house.comprehensions, {"base/f.py": nested})
    assert check(lint_house.comprehensions, {"base/f.py": "{x for x in row if a if b}"})
    assert not check(lint_house.comprehensions, {"base/f.py": "[x for row in rows for x in row]"})


def test_imports_inside_functions_have_a_reason(check):
    late = "import os\n\ndef f():\n    import numpy\n"
    reason = "# Imports inside functions: numpy is slow to load.\n"
    assert check(lint_house.late_imports, {"base/f.py": late})
    assert check(lint_house.late_imports, {"base/f.py": late + reason})
    assert not check(lint_house.late_imports, {"base/f.py": reason + late})
    docstring = '"""Module.\n\nImports inside\nfunctions: numpy is slow.\n"""\n'
    assert not check(lint_house.late_imports, {"base/f.py": docstring + late})
    assert not check(lint_house.late_imports, {"base/f.py": "import numpy"})


def test_names_of_variables_say_what_they_hold(check):  # words: literal
    for source in ("found = 1", "for place in names: pass", "[own for own in names]"):
        assert check(lint_house.empty_names, {"base/f.py": source})
    marked = "left = 1  # words: literal"
    assert not check(lint_house.empty_names, {"base/f.py": marked})


@pytest.mark.parametrize("path", ["fenics_ehd/base/f.py", "tests/t.py", "docs/a.md", "README.md"])
def test_words_of_the_list_are_reported(check, tmp_path, path):
    file = tmp_path / path
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text("# A run\n# says so\n")  # words: literal
    assert check(lint_house.words, {}) == [f"{path}:2: says: # says so"]  # words: literal
    file.write_text("# says  # words: literal\n# besides\n")
    assert not check(lint_house.words, {})


def test_the_changelog_is_checked_from_this_version_on(check, tmp_path):
    file = tmp_path / "CHANGELOG.md"
    file.write_text("# Changes\n## [Unreleased]\n- told\n## [0.3]\n- told\n")  # words: literal
    assert check(lint_house.words, {}) == ["CHANGELOG.md:3: told: - told"]  # words: literal
