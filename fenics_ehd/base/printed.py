"""Text for a terminal."""


def escaped(text: str) -> str:
    """Text whose control characters, in names say, are written as Python writes them.

    Bytes of a path that are not UTF-8 are among them. Ends of lines stay.
    """
    return "".join(c if c.isprintable() or c == "\n" else ascii(c)[1:-1] for c in text)
