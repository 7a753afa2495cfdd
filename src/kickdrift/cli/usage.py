"""Messages for errors of the command line's own parser."""

from __future__ import annotations

import re

_INVALID = re.compile(r"Invalid value for '(?P<name>[^']*)': (?:Value error, )?(?P<text>.*)")
_WORDS = (
    (r", unable to parse string as an? \w+", ""),
    (r"Input should be a valid integer", "expected a whole number"),
    (r"Input should be a valid number", "expected a number"),
    (r"Input should be greater than or equal to (\S+)", r"expected \1 or more"),
    (r"Input should be less than or equal to (\S+)", r"expected \1 or less"),
    (r"Input should be", "expected"),
    (r"(.*) is not one of (.*)", r"expected one of \2, got \1"),
)


def plain(text: str) -> str:
    """Return a parser's message as "option: what it expects"."""
    text = " ".join(text.split()).rstrip(".")
    found = _INVALID.match(text)
    if not found:
        return text
    words = found["text"]
    for pattern, ours in _WORDS:
        words = re.sub(pattern, ours, words)
    return f"{found['name']}: {words}"
