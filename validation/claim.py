"""What every validation script gives: claims with their bounds, printed as a table."""

from __future__ import annotations

from collections.abc import Iterable
from importlib.metadata import version

from kickdrift.bench import processor

Claim = dict[str, object]


def claim(text: str, value: object, bound: str, holds: bool, reference: str) -> Claim:
    """A claim that was tried; ``reference`` is where the truth, or the other side of a comparison, comes from."""
    verdict = "pass" if holds else "fail"
    return {"claim": text, "value": value, "bound": bound, "reference": reference, "verdict": verdict}


def not_run(text: str, bound: str, reference: str, needs: str) -> Claim:
    """A claim that could not be tried here; ``needs`` is the line that changes that."""
    return {"claim": text, "value": needs, "bound": bound, "reference": reference, "verdict": "not run"}


def show(claims: Iterable[Claim]) -> int:
    """Print the claims; the exit status, 1 where one failed."""
    rows = [
        (str(row["verdict"]), str(row["claim"]), _text(row["value"]), str(row["bound"]), str(row["reference"]))
        for row in claims
    ]
    table = [("verdict", "claim", "value", "bound", "reference"), *rows]
    widths = [max(len(row[k]) for row in table) for k in range(4)]
    for row in table:
        print("  ".join([*(text.ljust(width) for text, width in zip(row, widths, strict=False)), row[4]]))
    return int(any(row[0] == "fail" for row in rows))


def where(*packages: str) -> str:
    """The processor, and the versions of kickdrift, numba and ``packages``."""
    return f"{processor()}; " + ", ".join(f"{name} {version(name)}" for name in ("kickdrift", "numba", *packages))


def _text(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
