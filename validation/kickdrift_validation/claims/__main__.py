"""What textbooks and web guides say of integrators, measured: said, verdict and why, every reading beside theory.

python -m kickdrift_validation.claims [--long] [--figures FOLDER]
"""

from pathlib import Path

from kickdrift_validation.claim import of
from kickdrift_validation.claims import (
    evaluations,
    liquid,
    long_runs,
    orbits,
    reversal,
    stiff,
    tolerance,
    unit_oscillator,
)
from kickdrift_validation.claims.article import Claim, main

STUDIES = (unit_oscillator, orbits, liquid, reversal, long_runs, evaluations, stiff, tolerance)


def claims(long: bool = False, figures: Path | None = None) -> list[Claim]:
    """Those of every script here, in the article's order."""
    return [row for study in STUDIES for row in of(study.claims, long, figures)]


if __name__ == "__main__":
    main(claims, __doc__)
