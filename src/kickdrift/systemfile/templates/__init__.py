"""Commented system files to start from."""

from __future__ import annotations

from pathlib import Path

from kickdrift.errors import InputError
from kickdrift.text import shown, suggestion


def kinds() -> list[str]:
    """Names of the system files to start from."""
    return sorted(path.stem for path in Path(__file__).parent.glob("*.toml"))


def template(kind: str = "liquid") -> str:
    """Text of a commented system file: "liquid", "bath", "mixture", "water", "planets" or "ode".

    ``kd.load`` takes a file with this text. Raises InputError for another kind."""
    known = kinds()
    if kind not in known:
        raise InputError(f"kind: expected one of {', '.join(known)}, got {shown(kind)}{suggestion(str(kind), known)}")
    return (Path(__file__).parent / f"{kind}.toml").read_text(encoding="utf-8")
