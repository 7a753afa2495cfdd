"""Methods of constant temperature: words over drift, kick and the flow of a heat bath."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import sqrt
from typing import TYPE_CHECKING, Any

import numpy as np

from kickdrift.integrators.options import OF_PRESSURE, SPLITTING, Option
from kickdrift.integrators.splitting import method as splitting
from kickdrift.integrators.splitting.method import Splitting, even_weights
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.options import Options
    from kickdrift.integrators.stepping.stepper import Stepper


@dataclass(frozen=True)
class Overdamped(Splitting):
    """Motion without inertia, as a word with all velocities drawn anew in each step.

    In Langevin dynamics of step h and infinite friction, BAOA has the positions of Leimkuhler & Matthews' limit method,
    x <- x + (dt / g) a + sqrt(dt k_B T / (2 g m)) (R_n + R_n+1), for h = sqrt(2 dt / g) and friction g. So kicks and
    drifts act for h, and the clock goes by dt."""

    overdamped = True
    free_because = "has no momenta, and the drift of its noise would need the curvature of the manifold"

    @property
    def declared(self) -> tuple[Option, ...]:
        """Options without those of a barostat, which needs the momenta."""
        return tuple(option for option in super().declared if option not in OF_PRESSURE)

    def timed(self, options: Options) -> Any:
        """The rows for steps of ``options.dt``."""
        assert options.dt is not None
        stretch = sqrt(2.0 / (options.friction * options.dt)) if options.get("friction") else 1.0  # else bind refuses
        return Stretched(self, stretch)

    def stepper(self, flow: Flow, options: Options) -> Stepper:
        from kickdrift.integrators.splitting.stepper import SplittingStepper

        made = SplittingStepper(flow, self.timed(options), options)
        made.warnings = []  # a large friction is meant
        return made


@dataclass(frozen=True)
class Stretched:
    """Rows of a word whose kicks and drifts act ``stretch`` times as long as the clock goes."""

    row: Splitting
    stretch: float

    @property
    def stages(self) -> Floats:
        return self.row.stages * np.array([[self.stretch], [self.stretch], [1.0]])

    def mirrored(self) -> Stretched:
        """See Splitting."""
        return replace(self, row=self.row.mirrored())

    def __getattr__(self, name: str) -> Any:
        return getattr(self.row, name)


@dataclass(frozen=True)
class Thermostats(Splitting):
    """A thermostat around kicks and drifts, in a step that reads the same from both ends, and compositions of it.

    Such steps in a row, of the lengths that make leapfrog steps a method of order 4, 6 or 8, are of that order too
    (Yoshida 1990, doi:10.1016/0375-9601(90)90092-3): their errors are of odd powers of the step alone."""

    @property
    def declared(self) -> tuple[Option, ...]:
        return *super().declared, SPLITTING

    def composed(self, name: str) -> Splitting:
        """The word for a splitting that is a row of leapfrog steps."""
        lengths = next(row.drift for row in splitting.ROWS if row.name == name)
        weights = tuple(length * weight for length in lengths for weight in self.weights)
        order = next(row.order for row in splitting.ROWS if row.name == name)
        return replace(self, word=self.word * len(lengths), weights=weights, order=order)

    def stepper(self, flow: Flow, options: Options) -> Stepper:
        from kickdrift.integrators.splitting.stepper import SplittingStepper

        name = options.get(SPLITTING.name) or SPLITTING.default
        return SplittingStepper(flow, self if name == SPLITTING.default else self.composed(name), options)


_LANGEVIN = "Leimkuhler & Matthews 2013, Appl. Math. Res. Express 2013, 34, doi:10.1093/amrx/abs010"

ROWS = (
    Splitting(
        "baoab", "BAOAB", even_weights("BAOAB"), 2, _LANGEVIN,
        "constant temperature; exact positions in a harmonic well",
    ),
    Splitting(
        "obabo", "OBABO", even_weights("OBABO"), 2, "Bussi & Parrinello 2007, Phys. Rev. E 75, 056707, "
        "doi:10.1103/PhysRevE.75.056707", "constant temperature; comparisons",
    ),
    Splitting("aboba", "ABOBA", even_weights("ABOBA"), 2, _LANGEVIN, "constant temperature; comparisons"),
    Splitting("oabao", "OABAO", even_weights("OABAO"), 2, _LANGEVIN, "constant temperature; comparisons"),
    Splitting("baoa", "BAOA", even_weights("BAOA"), 1, "Fass et al. 2018, Entropy 20, 318, doi:10.3390/e20050318; "
        "Kieninger & Keller 2022, J. Chem. Theory Comput. 18, 7295, doi:10.1021/acs.jctc.2c00585",
        "constant temperature; both averages of a harmonic well are exact"),
    Splitting(  # the exact Ornstein-Uhlenbeck process of BAOAB by the rule of the midpoint
        "gjf", "BAGAB", even_weights("BAGAB"), 2,
        "Gronbech-Jensen & Farago 2013, Mol. Phys. 111, 983, doi:10.1080/00268976.2012.760055",
        "constant temperature; comparisons with other programs",
    ),
    Overdamped(
        "brownian", "BAMA", even_weights("BAMA"), 1,
        "Leimkuhler & Matthews 2013, Appl. Math. Res. Express 2013, 34, doi:10.1093/amrx/abs010",
        "constant temperature without inertia: large friction",
    ),
    Splitting(
        "csvr", "CBABC", even_weights("CBABC"), 2,
        "Bussi, Donadio & Parrinello 2007, J. Chem. Phys. 126, 014101, doi:10.1063/1.2408420",
        "constant temperature; hardly disturbs motion",
    ),
    Thermostats(
        "nose-hoover", "NBABN", even_weights("NBABN"), 2,
        "Martyna, Klein & Tuckerman 1992, J. Chem. Phys. 97, 2635, doi:10.1063/1.463940; "
        "Martyna et al. 1996, doi:10.1080/00268979600100761", "constant temperature without random numbers",
    ),
    Splitting(
        "andersen", "BABD", even_weights("BABD"), 2,
        "Andersen 1980, J. Chem. Phys. 72, 2384, doi:10.1063/1.439486", "constant temperature; no diffusion",
    ),
)  # fmt: skip
ALIASES = {"langevin": "baoab"}
