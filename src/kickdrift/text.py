"""Text for people: what came from a file or the command line, on one line, without control characters, cut short."""

from __future__ import annotations

import math
import unicodedata
from collections.abc import Iterable
from typing import Any

LINE = 2000  # characters of a message or a line of a report
CELL = 200  # characters of a table's cell
VALUE = 60  # characters of a key or a value that a message quotes
UNSEEN = ("Cc", "Cf", "Cs", "Zl", "Zp")  # Unicode's control, format, surrogate and separator characters


def clean(text: str, most: int = LINE) -> str:
    """The text on one line: control characters are escaped, and the middle of a long text is left out.

    Letters of any script stay. Escaped are terminal codes, line ends, zero-width and direction marks, and the bytes of
    a file's name that are no UTF-8. Text that is clean already stays as it is.
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
    """A character as Python would write it; of a byte that is no UTF-8 the byte."""
    code = ord(character)
    if 0xDC80 <= code <= 0xDCFF:  # what Python makes of such a byte
        return f"\\x{code - 0xDC00:02x}"
    return character.encode("unicode_escape").decode("ascii")


def shown(value: object) -> str:
    """The value as one short line, for a message."""
    try:
        text = repr(value)
    except (RecursionError, ValueError):  # nested without end, or of more digits than Python writes
        text = f"a {type(value).__name__} too large to show"
    text = " ".join(text.split())
    return _cut(text, VALUE)


def suggestion(word: object, known: Iterable[Any]) -> str:
    """``; did you mean 'x'?`` if a known word is near, else nothing."""
    import difflib

    if len(str(word)) > VALUE:
        return ""
    near = difflib.get_close_matches(str(word).lower(), {str(k).lower(): k for k in known}, n=1, cutoff=0.6)
    return f"; did you mean {next(str(k) for k in known if str(k).lower() == near[0])!r}?" if near else ""


def counted(number: int, noun: str) -> str:
    """ "1 thread", "2 threads"."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def measured(number: str, unit: str) -> str:
    """ "70 τ", or "70" where the unit has no name. Without a number, what to append to one: " τ" or ""."""
    return f"{number} {unit}" if unit else number


def with_error(mean: float, error: float) -> str:
    """A mean and its standard error, to two digits of that."""
    if not error > 0:
        return f"{mean:.6g}"
    decimals = 1 - math.floor(math.log10(error))
    if 0 <= decimals <= 6:
        return f"{mean:.{decimals}f} ± {error:.{decimals}f}"
    return f"{mean:.4g} ± {error:.1e}"


def duration(seconds: float) -> str:
    """Seconds as a person says them."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
