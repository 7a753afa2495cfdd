"""Planets around a star: splittings into Kepler motion and the rest, whose errors carry the planets' masses."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from kickdrift.errors import InputError
from kickdrift.integrators.method import OWN_FORCES, Method
from kickdrift.integrators.options import (
    COMPENSATED,
    COMPOSITION,
    COORDINATES,
    CORRECTOR,
    JACOBI,
    KERNEL,
    MODIFIED_KICK,
    ORDER,
    STANDARD,
    Option,
)
from kickdrift.integrators.splitting.method import Splitting, in_turn, palindrome

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.options import Options
    from kickdrift.integrators.stepping.batch_loops import LaneStepper, Members
    from kickdrift.integrators.stepping.stepper import Stepper
    from kickdrift.model.system import System

DOMINANT = 0.2  # largest total mass of the others, relative to the central body's

_LASKAR = "Laskar & Robutel 2001, doi:10.1023/A:1012098603882"
_MCLACHLAN = "McLachlan 1995, BIT 35, 258, doi:10.1007/BF01737165"
_KERNELS = "Wisdom, Holman & Touma 1996; Rein, Tamayo & Brown 2019, doi:10.1093/mnras/stz2503"
_BLANES = "Blanes et al. 2013, doi:10.1016/j.apnum.2013.01.003"


# The kicks around the middle one are a commutator, which does what the correction of a modified kick does.
COMPOSED = Splitting(
    "wisdom-holman composition",
    *in_turn(
        "AB", (5 / 8, -1 / 4, 1 / 8, -1 / 8, 1 / 4, 3 / 8), (-1 / 6, 1 / 6, 1.0, -1 / 6, 1 / 6),
    ),
    2, _KERNELS,
)  # fmt: skip


# In these words A is the Kepler motion of each planet, and B its kick by the other planets.
def _gauss(count: int) -> Splitting:
    """Drifts to the nodes of Gauss-Legendre quadrature and kicks by its weights. The error is of order 2 ``count`` in
    the terms linear in the planets' masses, and of order 2 in the quadratic terms."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    at = [0.0, *(0.5 * (1.0 + nodes)).tolist(), 1.0]
    half = tuple(after - before for before, after in pairwise(at[: count // 2 + 1]))
    drift = palindrome(half, 1 + count % 2)
    kick = palindrome(tuple(0.5 * weights[: (count - 1) // 2]), 2 - count % 2)
    return Splitting(f"saba {2 * count},2", *in_turn("AB", drift, kick), 2, _LASKAR)


# The orders are the powers of dt in the error terms with the planets' masses to the powers 1, 2, 3.
LEAPFROG = Splitting("wisdom-holman", "ABA", (0.5, 1.0, 0.5), 2, "Wisdom & Holman 1991, doi:10.1086/115978")
SABA = {f"{2 * count},2": _gauss(count) for count in (2, 3, 4, 5)} | {
    "8,4": Splitting(
        "saba 8,4",
        *in_turn(
            "AB", palindrome((0.07534696026989288842, 0.51791685468825678230), 2),
            palindrome((0.19022593937367661925, 0.84652407044352625706)),
        ),
        4, _MCLACHLAN,
    ),
    "10,4": Splitting(
        "saba 10,4",
        *in_turn(
            "AB",
            palindrome((0.0470671006459725061294789, 0.1847569354170881069247376, 0.2827060056798362053243616), 2),
            palindrome((0.1188819173681970199453504, 0.2410504605515015657441668, -0.2732866667053238060543114)),
        ),
        4, _BLANES,
    ),
    "8,6,4": Splitting(
        "saba 8,6,4",
        *in_turn(
            "AB",
            palindrome((0.0711334264982231177779387, 0.2411534279566400987364878, 0.5214117617728147892121361), 2),
            palindrome((0.1830836874721972219617038, 0.3107828598985748695075223, -0.0265646185119588006972122)),
        ),
        4, _BLANES,
    ),
    "10,6,4": Splitting(
        "saba 10,6,4",
        *in_turn(
            "AB",
            palindrome(
                (0.0380944974224121954569753, 0.1452987161169137492940201, 0.2076276957255412507162056,
                 0.4359097036515261592231549),
            ),
            palindrome((0.0958588808370752106107715, 0.2044461531429987806805078, 0.2170703479789911017143386), 2),
        ),
        4, _BLANES,
    ),
}  # fmt: skip
SABA_ORDER = replace(ORDER, default="10,6,4", choices=("10,6,4", *(name for name in SABA if name != "10,6,4")))


def one_gravity(name: str, system: System) -> None:
    """Raise InputError unless the System has one force of gravity, without softening."""
    from kickdrift.forces.gravity.direct import Gravity

    gravities = [force for force in system.forces if isinstance(force, Gravity)]
    if len(gravities) != 1:
        count = len(gravities) or "none"
        raise InputError(f"{name}: needs one force 'gravity', and {system.name!r} has {count}")
    if gravities[0].softening:
        raise InputError(f"{name}: needs gravity without softening")


@dataclass(frozen=True)
class WisdomHolman(Method):
    """Drifts along Kepler orbits, and kicks by the mutual forces of the bodies around the central one.

    The central body is the most massive. The others keep the order of the list, on which Jacobi's coordinates depend:
    each body is measured from the centre of mass of the central one and the massive ones before it (also a massless
    body, wherever it stands). ``coordinates="democratic-heliocentric"`` does not depend on the order, and allows bodies
    that change places. Other velocity-independent forces join the kicks. Consecutive half drifts are joined. A sample
    is a copy with the last half drift, and the corrector, done, so it never changes a run.
    """

    name: str
    order: int
    source: str
    use: str = ""

    family = "Kepler splitting"
    moves_all_because = "moves bodies along orbits around a central one"
    symplectic = True
    reversible = True
    separable = carries_unknowns = True
    particles_only = True
    batched = True
    evaluations = 1
    float64_because = OWN_FORCES
    declared: ClassVar[tuple[Option, ...]] = (COORDINATES, CORRECTOR, KERNEL, COMPENSATED)

    def table(self, options: Options) -> Splitting:
        """Row of weights."""
        return COMPOSED if options is not None and options.get(KERNEL.name) == COMPOSITION else LEAPFROG

    def checked(self, given: Options, asked: Options) -> Options:
        """See Method. Also refuse a kernel in coordinates for which it is not made."""
        options = super().checked(given, asked)
        kernel = options.get(KERNEL.name) or STANDARD
        if kernel != STANDARD and options.coordinates != JACOBI:
            raise InputError(
                f"kernel: {kernel} needs coordinates = {JACOBI!r}, and coordinates is {options.coordinates!r}"
            )
        return options

    def check(self, system: System) -> None:
        """Raise InputError for a System without a central body, without gravity, or with softened gravity."""
        one_gravity(self.name, system)
        masses = system.state.masses
        heaviest = int(np.argmax(masses))
        if masses[heaviest] == 0.0:
            raise InputError(f"{self.name}: needs a central body, but no particle has mass")
        rest = float(np.delete(masses, heaviest).sum() / masses[heaviest])
        if rest > DOMINANT:
            raise InputError(
                f"{self.name}: no body dominates: beside the heaviest, {system.body(heaviest)}, the others have "
                f"{rest:.3g} of its mass, and at most {DOMINANT:g} fits; gauss-radau15 takes any few bodies, hermite4 "
                "or velocity-verlet clusters"
            )

    def stepper(self, flow: Flow, options: Options) -> Stepper:
        system = self.system_of(flow)
        others = [force.name for force in system.forces if force.name != "gravity"]
        if others and options.get(KERNEL.name) == MODIFIED_KICK:
            raise InputError(
                f"kernel: {MODIFIED_KICK} needs the gradient of each force, and {others[0]!r} has none; lazy needs none"
            )
        if getattr(flow, "carries", False):
            self._check_unknowns(flow, options)
        from kickdrift.integrators.wisdom_holman.stepper import WisdomHolmanStepper

        return WisdomHolmanStepper(flow, self.table(options), options)

    def _check_unknowns(self, flow: Any, options: Options) -> None:
        """Refuse unknowns beside the bodies with options that are made for gravity alone, and rates that depend on
        velocities, which the kicks do not know."""
        for key in (CORRECTOR.name, KERNEL.name):
            if (value := options.get(key)) and value != STANDARD:
                raise InputError(f"{key}: {value} does not go with unknowns beside the bodies; leave it out")
        for force in flow.subject.forces:
            if getattr(force, "unknowns", 0) and force.reads_velocities(flow.subject):
                raise InputError(
                    f"{self.name}: kicks know positions alone, and f of force {force.name!r} depends on velocities; "
                    "velocity-verlet and gauss-radau15 take it"
                )

    def in_lanes(self, members: Members, options: Options) -> LaneStepper:
        from kickdrift.integrators.wisdom_holman.batch import WisdomHolmanLanes

        return WisdomHolmanLanes(members, self.table(options), options)


@dataclass(frozen=True)
class Saba(WisdomHolman):
    """The same drifts and kicks with more of them in a step."""

    evaluations = 0
    declared: ClassVar[tuple[Option, ...]] = (COORDINATES, SABA_ORDER, COMPENSATED)

    def table(self, options: Options) -> Splitting:
        row: Splitting = SABA[options.order]
        return row


ROWS = (
    WisdomHolman(
        "wisdom-holman", 2,
        "Wisdom & Holman 1991, doi:10.1086/115978; Wisdom, Holman & Touma 1996; Rein & Tamayo 2015, "
        "doi:10.1093/mnras/stv1257",
        "planets around a star, no close encounters",
    ),
    Saba("saba", 4, f"{_LASKAR}; {_BLANES}", "the same to high accuracy"),
)  # fmt: skip
