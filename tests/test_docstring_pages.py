"""Docstrings on the site: formulas become equations, no sentence is taken for a type."""

from types import SimpleNamespace

import docstrings
import pytest


def prepared(text, what="module"):
    lines = text.split("\n")
    docstrings.prepare(None, what, "name", None, None, lines)
    return lines


@pytest.mark.parametrize(
    ("formula", "expected"),
    [
        ("h = c - n . e", r"h = c - n \cdot e"),
        ("dh/dphi >= 0", r"dh/d\phi  \ge 0"),
        ("u_(k-1) + x_bore^T", r"u_{k-1} + x_{\text{bore}}^{T}"),
        ("sqrt(R_1^2 - e_t^2)", r"\sqrt{R_{1}^{2} - e_{t}^{2}}"),
        ("delta_bore(phi, z)", r"\delta _{\text{bore}}(\phi , z)"),
        ("int p dA on the bore", r"\int  p dA\ \text{on the bore}"),
    ],
)
def test_a_formula_becomes_tex(formula, expected):
    assert docstrings.tex(formula) == expected


def test_an_indented_paragraph_is_an_equation():
    lines = prepared("The balance\n\n    a = b,\n    c + d = e\n\nholds.")
    assert ".. math::" in lines
    assert "   a &= b, \\\\" in lines
    assert lines[-1] == "holds."


def test_literal_blocks_and_second_paragraphs_stay():
    for text in ("Call::\n\n    a = b", "Parameters\n----------\nx\n    First.\n\n    Second."):
        assert prepared(text) == text.split("\n")


def test_attributes_described_together_are_two_entries():
    lines = prepared("Grid.\n\nAttributes\n----------\nradius, width\n    Of the bore [m].")
    assert lines[4:] == ["radius", "    Of the bore [m].", "width", "    Of the bore [m]."]


def test_no_type_is_read_from_the_sentence_of_an_attribute():
    sphinx = pytest.importorskip("sphinx.ext.napoleon")
    lines = prepared("Of the last update: gaps are relative.", "data")
    result = str(sphinx.NumpyDocstring(lines, what="data", name="x", obj=1))
    assert ":type:" not in result
    assert "Of the last update: gaps are relative." in result


def test_docstrings_are_changed_before_napoleon_reads_them():
    calls = []
    app = SimpleNamespace(connect=lambda *arguments, priority: calls.append(priority))
    docstrings.setup(app)
    assert calls[0] < 500
