"""A version of dolfinx that was not tried is used with a warning, or refused for what it lacks."""

import warnings
from types import SimpleNamespace

import dolfinx
import pytest

from fenics_ehd.base import compat  # noqa: F401  (imports dolfinx without foreign options)
from fenics_ehd.base.dolfinx_version import NEEDED, UntriedVersionWarning, require_version
from fenics_ehd.base.errors import LibraryError


def as_version(version, **names):
    return SimpleNamespace(__version__=version, **names)


def whole(version):
    """The installed dolfinx under another version's name."""
    names = {name.partition(".")[0] for names in NEEDED for name in names.split("|")}
    return as_version(version, **{name: getattr(dolfinx, name) for name in names})


@pytest.mark.parametrize("version", ["0.5.2", "0.9.0", "0.9.0.post1", "0.11.0.dev0", "0.11"])
def test_a_tried_version_is_used_without_a_word(version):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        require_version(as_version(version))


@pytest.mark.parametrize("version", ["0.10.0", "0.7.2", "0.12.0", "1.0", "0.50.2"])
def test_an_untried_version_is_named(version):
    with pytest.warns(UntriedVersionWarning, match=f"^dolfinx {version} was not tried .*0.5, 0.9"):
        require_version(whole(version))


def test_an_untried_version_without_a_needed_name_is_refused():
    module = whole("0.12.0")
    module.mesh = SimpleNamespace()
    with pytest.raises(LibraryError, match=r"lacks mesh\.create_mesh, which") as error:
        require_version(module)
    assert "dolfinx 0.12.0" in str(error.value)
    assert "\n" not in str(error.value)
    module = whole("0.12.0")
    del module.fem
    with pytest.raises(LibraryError, match=r"lacks fem\.Constant"):
        require_version(module)
