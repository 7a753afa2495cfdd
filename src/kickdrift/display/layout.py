"""Lines, pages of keys and tables, laid out for a terminal's width. Text wraps between words; no word is ever cut."""

import unicodedata
from collections.abc import Iterable, Sequence

# Columns that a table leaves out where it is too wide, the first one first. A table's first column always stays.
SPARE = (
    "largest", "steps/s", "skin", "over", "precision", "position error", "peers", "energy error", "type", "unit",
    "parameters", "evaluations", "family", "group", "adaptive", "reversible", "symplectic",
)  # fmt: skip
GAP = 2  # cells between two columns
NARROWEST = 24  # cells of a last column that wraps; a table whose last column would be narrower becomes a list
ROOMY = 40  # cells of a last column that wraps, which spare columns make place for
INDENT = "  "


def cells(text: str) -> int:
    """Number of a terminal's cells that a text takes: two for a wide letter, none for a combining mark."""
    if text.isascii():
        return len(text)
    wide = sum(unicodedata.east_asian_width(each) in "WF" for each in text)
    return len(text) + wide - sum(unicodedata.combining(each) > 0 for each in text)


def folded(text: str, width: int | None) -> list[str]:
    """The text in lines of at most ``width`` cells, or in one line without a width. A longer word has its own line."""
    if width is None or cells(text) <= width:
        return [text]
    lines = [""]
    for word in text.split(" "):
        if lines[-1] and cells(lines[-1]) + 1 + cells(word) > width:
            lines.append(word)
        else:
            lines[-1] = f"{lines[-1]} {word}" if lines[-1] else word
    return lines


def beside(key: str, text: str, column: int, width: int | None) -> list[str]:
    """A key, and its text from ``column`` on. A longer key has its own line on a terminal."""
    lines = folded(text, None if width is None else max(width - column, NARROWEST))
    if width is not None and cells(key) >= column:
        return [key, *(f"{'':{column}}{line}" for line in lines)]
    head = padded(key, column - 1) + " "
    return [(head + lines[0]).rstrip(), *(f"{'':{column}}{line}".rstrip() for line in lines[1:])]


def padded(text: str, width: int) -> str:
    """The text and spaces up to ``width`` cells."""
    return text + " " * (width - cells(text))


def table(
    columns: Sequence[str], rows: Sequence[Sequence[str]], width: int | None, whole: bool = False
) -> tuple[list[str], list[str]]:
    """Lines of a table, and the names of the columns that it leaves out.

    Without a width, each row is a line of every column. With a width, only the last column wraps. A table that is too
    wide leaves out columns of ``SPARE``, unless it must be ``whole``. Where that is not enough, the table becomes a
    list of all cells: the first cell of a row is a line, and an indented line follows for each further cell.
    """
    kept, left_out = list(range(len(columns))), list[str]()
    widths = [max(map(cells, column)) for column in zip(columns, *rows, strict=True)]
    if width is not None:
        for name in () if whole else [each for each in SPARE if each in columns[1:]]:
            if _fits(widths, kept, width, rows, ROOMY):
                break
            kept.remove(columns.index(name))
            left_out.append(name)
        if not _fits(widths, kept, width, rows, NARROWEST):
            return _list(columns, rows, width), []
    last = sum(widths[i] + GAP for i in kept[:-1])
    lines, heads = [], [list(columns)]
    if width is not None:
        heads.append(["-" * min(each, width - last) for each in widths])
    for row in [*heads, *rows]:
        head = "".join(padded(row[i], widths[i] + GAP) for i in kept[:-1])
        text = folded(row[kept[-1]], None if width is None else width - last)
        lines += [(head + text[0]).rstrip(), *(" " * last + line for line in text[1:])]
    return lines, left_out


def _fits(widths: Sequence[int], kept: Sequence[int], width: int, rows: Iterable[Sequence[str]], least: int) -> bool:
    """Whether the columns fit, with at least so many cells for a last column that wraps."""
    last = kept[-1]
    longest = max((cells(word) for row in rows for word in row[last].split(" ")), default=0)
    return sum(widths[i] + GAP for i in kept[:-1]) + min(widths[last], max(least, longest)) <= width


def _list(columns: Sequence[str], rows: Iterable[Sequence[str]], width: int) -> list[str]:
    lines = []
    column = len(INDENT) + max(map(cells, columns[1:]), default=0) + GAP
    for row in rows:
        lines += folded(row[0], width)
        for key, cell in zip(columns[1:], row[1:], strict=True):
            if cell:
                lines += beside(INDENT + key, cell, column, width)
    return lines
