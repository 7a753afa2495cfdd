"""Systems of other programs: one module of the room ``bridges`` for each, loaded by its name when it is asked for."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from kickdrift.errors import InputError


def bridge(package: str, asked: str) -> Any:
    """The module of this room for that package; an InputError tells how to install what is missing."""
    try:
        import_module(package)
    except ImportError:
        raise InputError(f"{asked} needs {package}: pip install kickdrift[{package}]") from None
    return import_module(f"kickdrift.bridges.{package}")
