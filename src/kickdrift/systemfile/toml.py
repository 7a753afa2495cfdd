"""Tables as TOML text, with numbers that read back to the same bits."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from typing import Any

from kickdrift.errors import InputError
from kickdrift.text import shown

_BARE = re.compile(r"[A-Za-z0-9_-]+")
WIDE = 100  # longest list on one line, in characters


def toml_text(table: Mapping[str, Any]) -> str:
    """TOML text of a table of tables. In a list of tables under a top key, each table has a heading."""
    return "\n".join(_lines(table)).lstrip("\n") + "\n"


def _lines(table: Mapping[str, Any]) -> Iterator[str]:
    for key, value in table.items():
        if not _headed(value):
            yield f"{_key(key)} = {_value(value, key)}"
    for key, value in table.items():
        if _headed(value):
            for one in [value] if isinstance(value, Mapping) else value:
                yield ""
                yield f"[{_key(key)}]" if isinstance(value, Mapping) else f"[[{_key(key)}]]"
                for inner, each in one.items():
                    yield f"{_key(inner)} = {_value(each, f'{key}.{inner}')}"


def _headed(value: Any) -> bool:
    several = isinstance(value, list) and bool(value) and all(isinstance(each, Mapping) for each in value)
    return isinstance(value, Mapping) or several


def _key(key: Any) -> str:
    return key if isinstance(key, str) and _BARE.fullmatch(key) else _quoted(str(key))


def _value(value: Any, where: str) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, str):
        return _quoted(value)
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_key(key)} = {_value(each, where)}" for key, each in value.items()) + " }"
    if isinstance(value, list):
        items = [_value(each, where) for each in value]
        line = f"[{', '.join(items)}]"
        return line if len(line) <= WIDE else "[\n" + "".join(f"  {item},\n" for item in items) + "]"
    raise InputError(f"{where}: a system file cannot hold {shown(value)}")


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
