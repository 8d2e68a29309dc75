"""Sphinx configuration of the documentation site; `make docs` builds it into build/site."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

from fenics_ehd import __version__

project = "fenics_ehd"
copyright = "fenics_ehd developers, LGPL-3.0-or-later"
version = release = __version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "demo_pages",
    "docstrings",
    "drawings",
    "katex",
]
exclude_patterns = ["_ext"]

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
# Commands, tables of figures and drawings in plain text are no Python.
highlight_language = "none"

autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False
# Single backquotes in docstrings name objects of this package or pieces of code.
default_role = "code"

html_theme = "furo"
html_title = f"fenics_ehd {__version__}"
html_copy_source = False
html_static_path = ["_static"]
html_css_files = ["narrow.css"]
