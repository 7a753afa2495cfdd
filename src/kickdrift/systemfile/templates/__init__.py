"""Commented system files to start from."""

from __future__ import annotations

from pathlib import Path

from kickdrift.errors import InputError
from kickdrift.text import shown, suggestion

HERE = Path(__file__).parent


def kinds() -> list[str]:
    """Names of the system files to start from."""
    return sorted(path.stem for path in HERE.glob("*.toml") if "." not in path.stem)


def models(kind: str) -> list[str]:
    """Names of further models of this kind."""
    return sorted(path.stem.partition(".")[2] for path in HERE.glob(f"{kind}.*.toml"))


def template(kind: str = "liquid", model: str | None = None) -> str:
    """Text of a commented system file: "liquid", "bath", "mixture", "polymer", "water", "planets", "cluster"
    or "ode".

    ``model`` is another model of the kind: "tip4p2005" for water, which is SPC/E without it, and "king" for cluster.
    ``kd.load`` takes a file with this text. Raises InputError for another kind or model."""
    known = kinds()
    if kind not in known:
        raise InputError(f"kind: expected one of {', '.join(known)}, got {shown(kind)}{suggestion(str(kind), known)}")
    if model is None:
        return (HERE / f"{kind}.toml").read_text(encoding="utf-8")
    if model not in models(kind):
        expected = f"expected {' or '.join(models(kind))}" if models(kind) else f"{kind} has one model alone"
        raise InputError(f"model: {expected}, got {shown(model)}")
    return (HERE / f"{kind}.{model}.toml").read_text(encoding="utf-8")
