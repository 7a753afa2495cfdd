"""What came of a validation script."""

from collections import Counter
from pathlib import Path
from typing import NamedTuple

from kickdrift_validation.claim import Claim
from kickdrift_validation.registry import Script


class Outcome(NamedTuple):
    """A script's claims, its seconds and the figures that it saved."""

    script: Script
    claims: list[Claim]
    seconds: float
    figures: list[Path]

    def count(self) -> Counter[str]:
        """The number of claims by their verdict."""
        return Counter(str(row["verdict"]) for row in self.claims)
