"""What each study of textbooks' words gives: what is said, each way to read it, what we measure, and who is right.

Each reading is a row of its own with two verdicts that have nothing to do with each other. ``agrees``: do the words
hold, read so? ``verdict``, pass or fail: is our measurement what theory says (a closed form, a count, a published
number), so that it may judge the words at all?
"""

import math
import textwrap
from collections.abc import Iterable
from decimal import Decimal
from itertools import groupby
from typing import NamedTuple

from kickdrift_validation.claim import Claim, claim
from kickdrift_validation.report_file import SIGNS, cell

WIDTH = 118  # of the printed table


class Reading(NamedTuple):
    """One way to read the words: what is measured so, whether the words then hold, and our own bound."""

    text: str
    measured: float
    agrees: bool
    bound: str
    met: bool
    reference: str
    unit: str = ""

    @property
    def shown(self) -> str:
        return f"{self.measured:.4g} {self.unit}".strip()


def near(
    text: str, measured: float, agrees: bool, theory: float, within: float, reference: str, unit: str = ""
) -> Reading:
    """A reading whose measured number must be ``theory``'s to a relative ``within``."""
    met = abs(measured - theory) <= within * abs(theory)
    return Reading(text, measured, agrees, f"{theory:.6g} to {within:.0e} of it", met, reference, unit)


def article(said: str, why: str, *readings: Reading) -> list[Claim]:
    """A Claim for each reading, with ``said``, ``reading``, ``measured``, ``agrees``, ``why`` and what becomes of the
    words over all readings, ``words``: "holds", "does not hold", or "holds if" and the readings under which."""
    agreeing = [reading.text for reading in readings if reading.agrees]
    if len(agreeing) == len(readings):
        words = "holds"
    else:
        words = "holds if " + "; or ".join(agreeing) if agreeing else "does not hold"
    return [
        claim(f"“{said}” {'holds' if r.agrees else 'does not hold'}: {r.text}", r.shown, r.bound, r.met, r.reference)
        | {"said": said, "reading": r.text, "measured": r.shown, "agrees": r.agrees, "words": words, "why": why}
        for r in readings
    ]


def digits(measured: float, said: str) -> bool:
    """Whether ``measured``, rounded or cut off, has the digits said."""
    number = Decimal(said)
    unit = Decimal(1).scaleb(number.as_tuple().exponent)  # type: ignore[arg-type]
    return -float(unit) / 2 <= measured - float(number) < float(unit)


def magnitude(measured: float, said: float) -> bool:
    """Whether it is that, to half a power of ten."""
    return abs(math.log10(abs(measured) / said)) <= 0.5


def table(rows: Iterable[Claim]) -> str:
    """Said, verdict and why, and under them the readings."""
    lines = []
    for said, group in groupby(rows, lambda row: row["said"]):
        readings = list(group)
        words, why = (str(readings[0][key]) for key in ("words", "why"))
        for head, text in (("said     ", f"“{said}”"), ("verdict  ", words), ("why      ", why)):
            lines += textwrap.wrap(head + text, WIDTH, subsequent_indent=" " * len(head))
        width = max(len(str(row["reading"])) for row in readings)
        for row in readings:
            lines.append(
                f"  {'yes' if row['agrees'] else 'no':3}  {row['reading']!s:{width}}  {row['measured']!s:24} "
                f"{row['verdict']}: {row['bound']} ({row['reference']})"
            )
        lines.append("")
    return "\n".join(lines)


def markdown(rows: Iterable[Claim]) -> list[str]:
    """The same as lines of a page."""
    lines = []
    for said, group in groupby(rows, lambda row: row["said"]):
        readings = list(group)
        words, why = (str(readings[0][key]) for key in ("words", "why"))
        lines += ["", f"### “{said}”", "", f"**{words[0].upper()}{words[1:]}.** {why}", ""]
        heads = ("read as", "then it", "value", "bound", "reference", "verdict")
        lines += [f"| {' | '.join(heads)} |", "| --- " * len(heads) + "|"]
        for row in readings:
            holds = "holds" if row["agrees"] else "does not hold"
            cells = (row["reading"], holds, row["value"], row["bound"], row["reference"])
            lines.append(f"| {' | '.join(cell(str(each)) for each in cells)} | {SIGNS[str(row['verdict'])]} |")
    return lines
