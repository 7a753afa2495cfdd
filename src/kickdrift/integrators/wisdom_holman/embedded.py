"""`eos`: embedded operator splitting of planets around a star, a word over drifts and two kicks of gravity.

The motion under the star alone is one flow of the outer map, and the planets' mutual kicks are the other. The inner map
follows the star's part by drifts and the star's kicks, so no Kepler's equation is solved, and bodies need not be bound.

Source: Rein 2020, MNRAS 492, 5413, doi:10.1093/mnras/stz3601.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from kickdrift.errors import InputError
from kickdrift.integrators.method import OWN_FORCES
from kickdrift.integrators.options import COMPENSATED, PHI0, PHI1, SUBSTEPS, Option
from kickdrift.integrators.splitting.method import ROWS as WORDS
from kickdrift.integrators.splitting.method import Splitting, composed, in_turn
from kickdrift.integrators.splitting.subflows import DRIFT, KICK
from kickdrift.integrators.wisdom_holman.method import SABA, one_gravity

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.options import Options
    from kickdrift.integrators.stepping.stepper import Stepper
    from kickdrift.model.system import System

_REIN = "Rein 2020, doi:10.1093/mnras/stz3601"
_MCLACHLAN = "McLachlan 1995, SIAM J. Sci. Comput. 16, 151, doi:10.1137/0916010"
_NAMED = {row.name: row for row in WORDS}
MAPS = {  # words of drifts and kicks that begin with a drift, by the names of Rein 2020
    "lf": _NAMED["leapfrog-dkd"],
    "lf4": _NAMED["forest-ruth"],
    "lf6": Splitting(
        "lf6",
        *in_turn("AB", *composed((-0.843265623387734, 0.1294669489134754, 0.5554970237124784, 0.1867))),
        6, f"{_MCLACHLAN}, 9 stages", "",
    ),
    "lf8": Splitting(
        "lf8",
        *in_turn(
            "AB",
            *composed(
                (0.3149566839162949, 0.2783355003936797, 0.1444059410800120, -0.4095523434208514,
                 0.1851469357165877, -0.410175371469850, 0.581514087105251, 0.128865979381443)
            ),
        ),
        8, f"{_MCLACHLAN}, 17 stages", "",
    ),
    "lf4_2": SABA["4,2"],
    "lf8_6_4": SABA["8,6,4"],
}  # fmt: skip


def embedded(outer: Splitting, inner: Splitting, substeps: int) -> tuple[str, tuple[float, ...]]:
    """Word and weights: each drift of ``outer`` is so many steps of ``inner`` under the star, B0, and each of its kicks
    is one by the planets, B1. Drifts that follow one another are one."""
    found: list[tuple[str, float]] = []
    for letter, weight in zip(outer.letters, outer.weights, strict=True):
        if letter == KICK:
            found.append((f"{KICK}1", weight))
            continue
        for _ in range(substeps):
            for each, part in zip(inner.letters, inner.weights, strict=True):
                one = part * weight / substeps
                if each == DRIFT and found and found[-1][0] == DRIFT:
                    found[-1] = (DRIFT, found[-1][1] + one)
                else:
                    found.append((each if each == DRIFT else f"{KICK}0", one))
    return " ".join(letter for letter, _ in found), tuple(weight for _, weight in found)


@dataclass(frozen=True)
class Eos(Splitting):
    """A word over drifts, kicks by the star (B0) and kicks by the planets (B1), which two maps make.

    ``phi0`` splits the planets' kicks from the motion under the star, and ``phi1`` splits that motion, in ``substeps``
    steps, into drifts and kicks. The star is the most massive body. Forces other than gravity join the planets' kicks.
    Errors of phi0 carry the planets' masses. The order is the lower one of the two maps.
    """

    evaluations = 0
    free_because = moves_all_because = "kicks by parts of gravity"
    carries_unknowns = False
    float64_because = OWN_FORCES

    @property
    def declared(self) -> tuple[Option, ...]:
        return PHI0, PHI1, replace(SUBSTEPS, help="Steps of phi1 in each drift of phi0.", default=2), COMPENSATED

    def check(self, system: System) -> None:
        """Raise InputError for a System without a star, without gravity, or with softened gravity."""
        one_gravity(self.name, system)
        if not system.state.masses.any():
            raise InputError(f"{self.name}: needs a central body, but no particle has mass")

    def stepper(self, flow: Flow, options: Options) -> Stepper:
        from kickdrift.forces.gravity.direct import Gravity
        from kickdrift.integrators.wisdom_holman.parted_gravity import Parted

        system = self.system_of(flow)
        gravity = next(force for force in system.forces if isinstance(force, Gravity))
        others = [force for force in system.forces if force is not gravity]
        star = int(np.argmax(system.state.masses))
        parts = [Parted(gravity, star, mutual) for mutual in (False, True)]
        flow.kick_apart([*parts, *others], [0, 1, *(1 for _ in others)])  # type: ignore[union-attr]
        word, weights = embedded(MAPS[options.phi0], MAPS[options.phi1], options[SUBSTEPS.name])
        return Splitting.stepper(replace(self, word=word, weights=weights), flow, options)


ROWS = (
    Eos(
        "eos", *embedded(MAPS[PHI0.default], MAPS[PHI1.default], 2), 2, _REIN,
        "planets around a star, also unbound, without Kepler's equation",
    ),
)  # fmt: skip
