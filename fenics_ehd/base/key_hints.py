"""Which key is meant perhaps by one that does not exist."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

import attrs


def setting_names(cls: type, path: str = "") -> dict[str, attrs.Attribute]:
    """Every key of a settings class, those of its sections as ``section.key``."""
    names = {}
    for attribute in attrs.fields(cls):
        name = f"{path}{attribute.name}"
        names[name] = attribute
        if "section" in attribute.metadata:
            names |= setting_names(attribute.metadata["section"], f"{name}.")
    return names


def key_hint(known: Iterable[str], name: str) -> str:
    """What to write in place of an unknown key.

    Parameters
    ----------
    known
        Keys with their sections.
    name
        The unknown one, with or without a section.

    Returns
    -------
    str
        ``"did you mean bearing.clearance?"``: the same word in another section, a similar one in
        the same section or, where there is no such section, in any; else what there is.
    """
    known = list(known)
    section, _, word = name.rpartition(".")
    own = [key for key in known if key.rpartition(".")[0] == section]
    meant = (
        [key for key in known if _word(key) == word and "." in key]
        or _similar(own, word)
        or ([] if section and own else _similar(known, word))
    )
    return f"did you mean {' or '.join(meant)}?" if meant else f"known: {', '.join(own or known)}"


def _similar(keys: list[str], word: str) -> list[str]:
    close = difflib.get_close_matches(word, map(_word, keys), n=1)
    return [key for key in keys if _word(key) in close]


def _word(key: str) -> str:
    return key.rpartition(".")[2]
