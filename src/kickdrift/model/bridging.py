"""What a System asks of later layers, which know Systems: other programs' systems, and system files."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

from kickdrift.errors import InputError

BRIDGES: dict[str, Callable[[], Any]] = {}  # by package, what loads its bridge; the package's ``__init__`` fills it
SYSTEM_FILES: dict[str, Callable[..., Any]] = {}  # what system files can do for a System; filled likewise


def bridge(package: str, asked: str) -> Any:
    """The module that knows that package's Systems; an InputError tells how to install what is missing."""
    try:
        import_module(package)
    except ImportError:
        raise InputError(f"{asked} needs {package}: pip install 'kickdrift[{package}]'") from None
    return BRIDGES[package]()
