"""Text for a terminal and for messages."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from typing import Any

#: Largest number of characters of a value in a message.
LONGEST_VALUE = 60


def escaped(text: str) -> str:
    """Escape control characters in a text, as Python does; line breaks are kept.

    Bytes of paths that are not UTF-8 are escaped, too.
    """
    return "".join(c if c.isprintable() or c == "\n" else ascii(c)[1:-1] for c in text)


def shown(value: Any) -> str:
    """Write a value as in a scene file, in one line of at most `LONGEST_VALUE` characters."""
    text = " ".join(_literal(value).split())
    return text if len(text) <= LONGEST_VALUE else f"{text[: LONGEST_VALUE - 3]}..."


def _literal(value: Any) -> str:
    """Write a value as in a scene file; a float has as few digits as represent it exactly."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_literal, value))}]"
    if isinstance(value, float):
        short = f"{value:g}"
        return short if float(short) == value else repr(value)
    return repr(value)


def scatter_text(scatter: float | None, unit: str = "", sign: str = "+-") -> str:
    """Text of a value's scatter over film meshes, `` +- 0.02``; empty without a scatter."""
    return "" if scatter is None else f" {sign} {scatter:.2g}{unit}"


def key_hint(known: Iterable[str], name: str) -> str:
    """Suggest a known key in place of an unknown one, for a message.

    Parameters
    ----------
    known
        Known keys with their sections.
    name
        Unknown key, with or without a section.

    Returns
    -------
    str
        ``"did you mean bearing.clearance?"``, or ``"known: ..."`` with known keys if no key is
        similar. A suggested key has the same last word as `name`, in another section; or a similar
        last word, in the section of `name`, or in any section if the section of `name` is unknown.
    """
    known = list(known)
    section, _, word = name.rpartition(".")
    neighbours = [key for key in known if key.rpartition(".")[0] == section]
    meant = (
        [key for key in known if _word(key) == word and "." in key]
        or _similar(neighbours, word)
        or ([] if section and neighbours else _similar(known, word))
    )
    if meant:
        return f"did you mean {' or '.join(meant)}?"
    return f"known: {', '.join(neighbours or known)}"


#: Largest number of similar names in a message.
MOST_NEAR = 3


def near_names(known: Iterable[str], name: str) -> list[str]:
    """Known names that are similar to an unknown one, at most `MOST_NEAR`.

    They have the same last word, or contain the name, or have a similar spelling or last word.
    """
    names = list(known)
    same = [each for each in names if name and (_word(each) == _word(name) or name in each)]
    spelled = difflib.get_close_matches(name, names) or _similar(names, _word(name))
    return list(dict.fromkeys([*same, *spelled]))[:MOST_NEAR]


def _similar(keys: list[str], word: str) -> list[str]:
    """Keys whose last word is the one most similar to `word`; empty if none is similar."""
    close = difflib.get_close_matches(word, map(_word, keys), n=1)
    return [key for key in keys if _word(key) in close]


def _word(key: str) -> str:
    """Last word of a key: ``clearance`` of ``bearing.clearance``."""
    return key.rpartition(".")[2]
