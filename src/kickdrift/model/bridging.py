"""Systems of other programs: the seam to the room ``bridges``, which knows Systems."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

from kickdrift.errors import InputError

BRIDGES: dict[str, Callable[[], Any]] = {}  # by package, what loads its bridge; the package's ``__init__`` fills it


def bridge(package: str, asked: str) -> Any:
    """The module that knows that package's Systems; an InputError tells how to install what is missing."""
    try:
        import_module(package)
    except ImportError:
        raise InputError(f"{asked} needs {package}: pip install 'kickdrift[{package}]'") from None
    return BRIDGES[package]()
