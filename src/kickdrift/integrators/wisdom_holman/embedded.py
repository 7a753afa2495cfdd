"""`eos`: embedded operator splitting of planets around a star, a word over drifts and two kicks of gravity.

The motion under the star alone is one flow of the outer map, and the planets' mutual kicks are the other. The inner map
follows the star's part by drifts and the star's kicks, so no Kepler's equation is solved, and bodies need not be bound.

Source: Rein 2020, MNRAS 492, 5413, doi:10.1093/mnras/stz3601.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from kickdrift.errors import InputError
from kickdrift.integrators.method import OWN_FORCES
from kickdrift.integrators.options import COMPENSATED, PHI0, PHI1, SUBSTEPS, Option
from kickdrift.integrators.splitting.method import ROWS as WORDS
from kickdrift.integrators.splitting.method import Splitting, composed, in_turn, palindrome
from kickdrift.integrators.splitting.subflows import DRIFT, FLOWS, KICK, MUTUAL, UNDER_STAR, Subflow
from kickdrift.integrators.wisdom_holman.method import SABA, one_gravity
from kickdrift.model.system import System

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.options import Options
    from kickdrift.integrators.stepping.stepper import Stepper
    from kickdrift.integrators.stepping.subflow_code import BoundSubflow
    from kickdrift.model.state import Floats

_REIN = "Rein 2020, doi:10.1093/mnras/stz3601"
_NAMED = {row.name: row for row in WORDS}
Steps = list[tuple[str, float, float]]  # letter, part of the step, and the correction of a kick in cubes of the step


@dataclass(frozen=True)
class Map:
    """Drifts and kicks by turns, which begin with a drift.

    The map may have a ``processor``: it then acts before the steps, and backwards after them. ``corrections`` of the
    word's kicks, and of the processor's, multiply the cube of the step: see `embedded_flows`.
    """

    letters: Sequence[str]
    weights: tuple[float, ...]
    corrections: tuple[float, ...] = ()  # of the kicks, if they have any
    processor: tuple[tuple[str, float, float], ...] = ()

    def steps(self, count: int) -> Steps:
        """``count`` steps of the map in one step."""
        before = [(letter, weight / count, correction / count**3) for letter, weight, correction in self.processor]
        own, left = [], iter(self.corrections)
        for letter, weight in zip(self.letters, self.weights, strict=True):
            correction = next(left, 0.0) if letter == KICK else 0.0
            own.append((letter, weight / count, correction / count**3))
        after = [(letter, -weight, -correction) for letter, weight, correction in reversed(before)]
        return [*before, *own * count, *after]

    @property
    def modifies(self) -> bool:
        """Whether a kick has a correction."""
        return any(self.corrections) or any(correction for _, _, correction in self.processor)


def _plain(row: Splitting) -> Map:
    return Map(row.letters, row.weights)


def _processed(
    word: str, first: tuple[float, ...], second: tuple[float, ...], corrections: tuple[float, ...] = ()
) -> tuple[tuple[str, float, float], ...]:
    letters, weights = in_turn(word, first, second)
    left = iter(corrections)
    return tuple((a, w, next(left, 0.0) if a == KICK else 0.0) for a, w in zip(letters, weights, strict=True))


MAPS = {  # by the names of Rein 2020, whose appendix has the coefficients of the last three
    "lf": _plain(_NAMED["leapfrog-dkd"]),
    "lf4": _plain(_NAMED["forest-ruth"]),
    "lf6": Map(  # McLachlan 1995, SIAM J. Sci. Comput. 16, 151, doi:10.1137/0916010, 9 stages
        *in_turn("AB", *composed((-0.843265623387734, 0.1294669489134754, 0.5554970237124784, 0.1867))),
    ),
    "lf8": Map(  # the same, 17 stages
        *in_turn(
            "AB",
            *composed(
                (0.3149566839162949, 0.2783355003936797, 0.1444059410800120, -0.4095523434208514,
                 0.1851469357165877, -0.410175371469850, 0.581514087105251, 0.128865979381443)
            ),
        ),
    ),
    "lf4_2": _plain(SABA["4,2"]),
    "lf8_6_4": _plain(SABA["8,6,4"]),
    "plf7_6_4": Map(
        *in_turn("AB", palindrome((0.5600879810924619,), 2), palindrome((1.5171479707207228,))),
        processor=_processed(
            "AB",
            (-0.33462222987308, 1.097567990732164, -1.038088746096783, 0.6234776317921379, -1.102753206303191,
             -0.0141183222088869),
            (-1.621810118086801, 0.0061709468110142, 0.8348493592472594, -0.0511253369989315, 0.5633782670698199,
             -0.5),
        ),
    ),
    "pmlf4": Map(
        *in_turn("AB", (0.5, 0.5), (1.0,)), (1.0 / 24.0,),
        processor=_processed(
            "BA", (0.1859353996846055, 0.0731969797858114, -0.1576624269298081),
            (0.8749306155955435, -0.237106680151022, -0.5363539829039128),
        ),
    ),
    "pmlf6": Map(
        *in_turn("AB", palindrome((-0.068261038391863,), 2), palindrome((0.2621129352517028,))),
        (0.0, 0.0164011128160783, 0.0),
        processor=_processed(
            "AB",
            (0.0794328824245542, 0.02974829169467665, -0.7057074964815896, 0.3190423451260838, -0.2869147334299646,
             0.56439871066623948),
            (1.3599424487455264, -0.6505973747535132, -0.033542814598338416, -0.04012991527511503,
             0.044579729809902803, -0.68025207392846265),
            (-0.034841228074994859, 0.031675672097525204, -0.005661054677711889, 0.00426222226902364, 0.005, -0.005),
        ),
    ),
}  # fmt: skip


def _flow(letter: str, name: str, whole: bool) -> Subflow:
    def bind(flow: Flow, options: Options, weights: Floats) -> BoundSubflow:
        from kickdrift.integrators.wisdom_holman.embedded_flows import bind

        return bind(whole, flow, options, weights, MAPS)

    return Subflow(name, moves=whole, whole=whole, bind=bind)


FLOWS[UNDER_STAR] = _flow(UNDER_STAR, "motion under the star, of eos", True)
FLOWS[MUTUAL] = _flow(MUTUAL, "kick by the planets, of eos", False)


def embedded(outer: Map, inner: Map, substeps: int) -> tuple[str, tuple[float, ...]]:
    """Word and weights of plain kicks: each drift of ``outer`` is so many steps of ``inner`` under the star, B0, and
    each of its kicks is one by the planets, B1. Drifts that follow one another are one."""
    found: list[tuple[str, float]] = []
    for letter, weight, _ in outer.steps(1):
        if letter == KICK:
            found.append((f"{KICK}1", weight))
            continue
        for each, part, _ in inner.steps(substeps):
            if each == DRIFT and found and found[-1][0] == DRIFT:
                found[-1] = (DRIFT, found[-1][1] + part * weight)
            else:
                found.append((each if each == DRIFT else f"{KICK}0", part * weight))
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
    carries_unknowns = reflects = False
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

        system = self.system_of(flow)
        self.check(system)
        others, outer = [force for force in system.forces if not isinstance(force, Gravity)], MAPS[options.phi0]
        if others and outer.modifies:
            raise InputError(
                f"phi0: {options.phi0} modifies the kicks by gravity, and {others[0].name!r} has no such kick; take "
                "lf4, lf6 or lf8_6_4"
            )
        flow.kick_apart(others)  # type: ignore[union-attr]
        word: list[tuple[str, float]] = []
        for letter, weight, _ in outer.steps(1):
            word += [(UNDER_STAR, weight)] if letter == DRIFT else [(MUTUAL, weight), (KICK, weight)]
        word = [each for each in word if others or each[0] != KICK]
        made = replace(self, word=" ".join(each for each, _ in word), weights=tuple(weight for _, weight in word))
        return Splitting.stepper(made, flow, options)


ROWS = (
    Eos(
        "eos", *embedded(MAPS[PHI0.default], MAPS[PHI1.default], 2), 2, _REIN,
        "planets around a star, also unbound, without Kepler's equation",
    ),
)  # fmt: skip
