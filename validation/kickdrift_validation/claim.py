"""What every validation script gives: claims with their bounds, printed as a table.

A script has ``claims(long=False, figures=None)``, which returns or yields Claims: the short set, or with ``long`` all
of them. One that draws saves PNG files in the folder ``figures``, where it is given one; one that does not may leave
that argument out. The script ends with ``main(claims, __doc__)`` and has a row in registry.py. What it prints
is for whoever runs it alone.
"""

import argparse
import inspect
import math
import sys
from collections.abc import Callable, Iterable
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import NoReturn

import numpy as np

from kickdrift_validation.folders import CHECKOUT

Claim = dict[str, object]
Claims = Callable[..., Iterable[Claim]]

INSTALL = f"pip install '{'.' if CHECKOUT else 'kickdrift'}[validation]'"


def claim(text: str, value: object, bound: str, holds: bool, reference: str) -> Claim:
    """A claim that was tried; ``reference`` is where the truth, or the other side of a comparison, comes from."""
    number = not isinstance(value, float) or math.isfinite(value)
    verdict = "pass" if holds and number else "fail"
    return {"claim": text, "value": value, "bound": bound, "reference": reference, "verdict": verdict}


def at_most(text: str, value: float, bound: float, reference: str) -> Claim:
    """A claim that a number is at most another."""
    return claim(text, value, f"at most {bound:g}", value <= bound, reference)


def under(text: str, value: float, bound: float, reference: str) -> Claim:
    """A claim that a number is less than another."""
    return claim(text, value, f"under {bound:g}", value < bound, reference)


def at_least(text: str, value: float, bound: float, reference: str) -> Claim:
    """A claim that a number is another or more."""
    return claim(text, value, f"at least {bound:g}", value >= bound, reference)


def largest(*values: float) -> float:
    """The largest; nan where one is, which ``max`` may pass over."""
    return float(np.max(values))


def not_run(text: str, bound: str, reference: str, needs: str = INSTALL) -> Claim:
    """A claim that could not be tried here; ``needs`` is the line that changes that."""
    return {"claim": text, "value": needs, "bound": bound, "reference": reference, "verdict": "not run"}


def of(claims: Claims, long: bool = False, figures: Path | None = None) -> Iterable[Claim]:
    draws = {"figures": figures} if "figures" in inspect.signature(claims).parameters else {}
    return claims(long=long, **draws)


def show(claims: Iterable[Claim]) -> int:
    """Print the claims; the exit status, 1 where one failed."""
    rows = [
        (str(row["verdict"]), str(row["claim"]), text_of(row["value"]), str(row["bound"]), str(row["reference"]))
        for row in claims
    ]
    table = [("verdict", "claim", "value", "bound", "reference"), *rows]
    widths = [max(len(row[k]) for row in table) for k in range(4)]
    for row in table:
        print("  ".join([*(text.ljust(width) for text, width in zip(row, widths, strict=False)), row[4]]))
    return int(any(row[0] == "fail" for row in rows))


def main(claims: Claims, doc: str | None) -> NoReturn:
    """Run a script by itself: print its claims, and end with the exit status, 1 where one failed."""
    lines = (doc or "").strip().splitlines() or [""]
    parser = argparse.ArgumentParser(description=lines[0])
    parser.add_argument("--long", action="store_true", help="all claims, not the short set")
    parser.add_argument("--figures", type=Path, metavar="FOLDER", help="draw the script's figures there, if it has any")
    given = parser.parse_args()
    if given.figures:
        given.figures.mkdir(parents=True, exist_ok=True)
    print(where("numpy", "scipy"), flush=True)
    sys.exit(show(of(claims, given.long, given.figures)))


def where(*packages: str) -> str:
    """The processor, and the versions of kickdrift, numba and those of ``packages`` that are installed."""
    from kickdrift.analysis.compare.bench import processor  # loads numba, which most scripts' first lines do not need

    found = [name for name in ("kickdrift", "numba", *packages) if find_spec(name)]
    return f"{processor()}; " + ", ".join(f"{name} {version(name)}" for name in found)


def text_of(value: object) -> str:
    """A value as tables show it."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)
