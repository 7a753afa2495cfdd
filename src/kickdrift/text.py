"""Text for people: text from files and from the command line, on one line, without control characters, shortened."""

from __future__ import annotations

import math
import unicodedata
from collections.abc import Iterable
from typing import Any

LINE = 2000  # most characters of a line of a report
MESSAGE = 700  # most characters of a message
CELL = 200  # most characters of a table's cell
VALUE = 60  # most characters of a key or a value in a message
MANY, FEW = 16, 6  # names that a message lists, and how many of a longer list
LIST = 400  # most characters of these names
UNSEEN = ("Cc", "Cf", "Cs", "Zl", "Zp")  # Unicode's control, format, surrogate and separator characters


def clean(text: str, most: int = LINE) -> str:
    """Return the text on one line, with control characters escaped and the middle of a long text left out.

    Letters of any script stay. Terminal codes, line ends, zero-width and direction marks are escaped, and so are bytes
    of a file's name that are not UTF-8. Clean text is returned unchanged.
    """
    text = _cut(text, most)
    if text.isascii() and text.isprintable():
        return text
    return _cut("".join(escaped(each) if unicodedata.category(each) in UNSEEN else each for each in text), most)


def _cut(text: str, most: int) -> str:
    if len(text) <= most:
        return text
    if most < CELL:
        return f"{text[: most - 3]}..."
    head, tail = most * 2 // 3, most // 3 - 40
    return f"{text[:head]} … {len(text) - head - tail} characters more … {text[-tail:]}"


def escaped(character: str) -> str:
    """A character in Python's escaped form; for a byte that is not UTF-8, the byte."""
    code = ord(character)
    if 0xDC80 <= code <= 0xDCFF:  # Python's form of such a byte
        return f"\\x{code - 0xDC00:02x}"
    return character.encode("unicode_escape").decode("ascii")


def shown(value: object) -> str:
    """A value as one short line, for a message."""
    try:
        text = repr(value)
    except (RecursionError, ValueError):  # nested without end, or with more digits than Python writes
        text = f"a {type(value).__name__} too large to show"
    text = " ".join(text.split())
    if len(text) > VALUE and "/" in text[-VALUE:] and isinstance(value, str):  # a path, which ends in the file's name
        return f"{text[0]}...{text[4 - VALUE :]}"
    return _cut(text, VALUE)


def choices(known: Iterable[Any], word: object = "") -> str:
    """Known names as text, "a, b, c"; of more than MANY, those nearest to a word, and how many there are."""
    import difflib

    names = [_cut(" ".join(str(each).split()), VALUE) for each in known]
    if len(names) <= MANY and sum(map(len, names)) <= LIST:
        return ", ".join(names)
    near = difflib.get_close_matches(str(word)[:VALUE], names, n=FEW, cutoff=0.3) if word else []
    return f"{', '.join(near or names[:FEW])}, … ({len(names):,} in all)"


def suggestion(word: object, known: Iterable[Any]) -> str:
    """Text ``; did you mean 'x'?`` if a known word is near, else ""."""
    import difflib

    if len(str(word)) > VALUE:
        return ""
    near = difflib.get_close_matches(str(word).lower(), {str(k).lower(): k for k in known}, n=1, cutoff=0.6)
    return f"; did you mean {next(str(k) for k in known if str(k).lower() == near[0])!r}?" if near else ""


def counted(number: int, noun: str, style: str = "") -> str:
    """A number with its noun: "1 thread", "2 threads"; with the style ",", "2,000 threads"."""
    return f"{number:{style}} {noun}" if number == 1 else f"{number:{style}} {noun}s"


def measured(number: str, unit: str) -> str:
    """A number with its unit, "70 τ", or "70" if the unit has no name. Without a number, the text to append: " τ" or
    ""."""
    return f"{number} {unit}" if unit else number


def with_error(mean: float, error: float) -> str:
    """A mean and its standard error, to two digits of the error."""
    if not error > 0:
        return f"{mean:.6g}"
    decimals = 1 - math.floor(math.log10(error))
    if 0 <= decimals <= 6:
        return f"{mean:.{decimals}f} ± {error:.{decimals}f}"
    return f"{mean:.4g} ± {error:.1e}"


def duration(seconds: float) -> str:
    """A duration in seconds as text for people."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
