"""What textbooks and web guides say of integrators, measured: said, verdict and why, every reading beside theory.

python validation/claims [--long] [--figures FOLDER]
"""

from __future__ import annotations

import sys
from pathlib import Path

import evaluations
import liquid
import long_runs
import orbits
import reversal
import stiff
import tolerance
import unit_oscillator
from article import Claim, main

STUDIES = (unit_oscillator, orbits, liquid, reversal, long_runs, evaluations, stiff, tolerance)


def claims(long: bool = False, figures: Path | None = None) -> list[Claim]:
    """Those of every script here, in the article's order."""
    return [row for study in STUDIES for row in study.claims(long, figures)]


if __name__ == "__main__":
    sys.exit(main(claims, __doc__))
