"""Multiple time steps (r-RESPA): slow forces act once while fast forces act several times."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from kickdrift.integrators.options.option import SUBSTEPS, Option
from kickdrift.integrators.splitting.method import Splitting, even_weights
from kickdrift.integrators.splitting.subflows import nested

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.options.options import Options
    from kickdrift.integrators.stepping.stepper import Stepper


@dataclass(frozen=True)
class Respa(Splitting):
    """A splitting with groups of forces whose word depends on the option ``substeps`` and the number of groups.

    inner : palindrome of the fastest steps, with plain kicks
    """

    inner: str = "BAB"

    @property
    def declared(self) -> tuple[Option, ...]:
        return *super().declared, SUBSTEPS

    @property
    def evaluations(self) -> int:
        """0: the number depends on ``substeps``."""
        return 0

    def stepper(self, flow: Flow, options: Options) -> Stepper:
        subject: Any = flow.subject
        slowest = max((getattr(force, "group", 0) for force in getattr(subject, "forces", ())), default=0)
        row = _row(self.name, self.inner, options[SUBSTEPS.name], max(1, slowest) + 1, self.source, self.use)
        return Splitting.stepper(row, flow, options)


def _row(name: str, inner: str, substeps: int, groups: int, source: str, use: str) -> Respa:
    word = nested(inner, substeps, groups)
    return Respa(name, word, even_weights(word), 2, source, use, inner)


_SOURCE = "Tuckerman, Berne & Martyna 1992, J. Chem. Phys. 97, 1990, doi:10.1063/1.463137"
RESPA = (
    _row("respa", "BAB", SUBSTEPS.default, 2, _SOURCE, "fast and slow forces, such as bonds and pairs"),
    _row(
        "respa-baoab", "BAOAB", SUBSTEPS.default, 2,
        f"{_SOURCE}; Leimkuhler & Matthews 2013, doi:10.1093/amrx/abs010", "constant temperature; fast and slow forces",
    ),
)  # fmt: skip
