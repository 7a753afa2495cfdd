"""Access to later layers, which import System: bridges to other programs, and system files."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

from kickdrift.errors import InputError

BRIDGES: dict[str, Callable[[], Any]] = {}  # loader of each package's bridge; filled by the package's ``__init__``
SYSTEM_FILES: dict[str, Callable[..., Any]] = {}  # functions of system files for a System, filled in the same way


def bridge(package: str, asked: str) -> Any:
    """Return the bridge module for a package. If the package is missing, raises an InputError that says how to install
    it."""
    try:
        import_module(package)
    except ImportError:
        raise InputError(f"{asked} needs {package}: pip install 'kickdrift[{package}]'") from None
    return BRIDGES[package]()
