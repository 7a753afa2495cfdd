"""Where kickdrift keeps what it can make again: compiled code, font lists."""

from __future__ import annotations

import os
import tempfile
from functools import cache
from pathlib import Path


@cache
def folder() -> Path:
    """A writable folder: the package's own ``__pycache__``, else one in the user's cache; made if it is not there."""
    per_user = Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser()) / "kickdrift"
    for candidate in (Path(__file__).resolve().parent / "__pycache__", per_user):
        try:
            candidate.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=candidate):
                return candidate
        except OSError:
            continue
    return Path(tempfile.mkdtemp(prefix="kickdrift-"))
