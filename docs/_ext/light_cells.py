"""Cells of a Python file in jupytext's light format."""

from itertools import groupby

#: Marks of the beginning and the end of a cell.
MARKS = ("# +", "# -")


def markdown(source: str) -> str:
    """Paragraphs of comments that start a line are text, all else is code."""
    paragraphs, lines = [], source.split("\n")
    for blank, group in groupby(lines, key=lambda line: not line.strip()):
        text = [line for line in group if line not in MARKS]
        if blank or not text:
            continue
        comment = all(line.startswith("#") for line in text)
        paragraphs.append((comment, [line[2:] for line in text] if comment else text))
    cells = []
    for comment, group in groupby(paragraphs, key=lambda paragraph: paragraph[0]):
        text = "\n\n".join("\n".join(lines) for _, lines in group)
        cells.append(text if comment else f"```python\n{text}\n```")
    return "\n\n".join(cells)
