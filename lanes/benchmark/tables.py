"""Numbers laid out for people: on the terminal and as markdown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence


def format_table(columns: Sequence[str], rows: Mapping[str, Sequence[str]]) -> str:
    """Lay out texts in columns of equal width: a heading line, then a line for each named row."""
    width = 2 + max(len(text) for texts in (columns, *rows.values()) for text in texts)
    name_width = max(map(len, rows), default=0)
    lines = [("", columns), *rows.items()]
    return "\n".join(name.ljust(name_width) + "".join(text.rjust(width) for text in texts) for name, texts in lines)
