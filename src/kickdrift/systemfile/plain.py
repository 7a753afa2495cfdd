"""Conversion of Python values that stand in for a file's tables to the types of TOML."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from kickdrift.errors import InputError

DEEPEST = 32  # tables and lists within one another, and parts of a key


def plain(value: Any, depth: int = 0) -> Any:
    """Convert mappings to dicts, tuples and arrays to lists, NumPy's numbers to Python's; keep everything else. Raises
    InputError for a value that is nested too deeply, as one that holds itself is."""
    if depth > DEEPEST:
        raise InputError(f"nested more than {DEEPEST} deep")
    if isinstance(value, Mapping):
        return {key: plain(item, depth + 1) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist(), depth)
    if isinstance(value, (list, tuple)):
        return [plain(item, depth + 1) for item in value]
    return value.item() if isinstance(value, np.generic) else value
