"""First correction of general relativity to the gravity of one central body."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from kickdrift.errors import InputError
from kickdrift.forces.central import (
    Attraction,
    Central,
    central_body,
    check_central,
    check_open,
    check_positive,
    gravitational_constant,
)
from kickdrift.forces.group import Grouped
from kickdrift.model.arguments import checked_arguments
from kickdrift.text import shown

if TYPE_CHECKING:
    from kickdrift.model.subject import Subject

FORMS = ("full", "potential")


@checked_arguments
@dataclass(frozen=True)
class PostNewtonian(Grouped):
    """First post-Newtonian (1PN) force of the central body on every other body, in addition to ``gravity``.

    The full form is Schwarzschild's field in harmonic coordinates, for r and v from the central body of mass M:
    a = G M / (c^2 r^3) [(4 G M / r - v^2) r + 4 (r . v) v] (Anderson et al. 1975, doi:10.1086/153779; the terms of the
    Sun alone in the Einstein-Infeld-Hoffmann equations, Newhall, Standish & Williams 1983, A&A 125, 150, eq. 1). The
    pericentre advances by 6 pi G M / (c^2 a (1 - e^2)) a revolution (Will 1993, Theory and Experiment in Gravitational
    Physics, section 7.3). It depends on velocity, so methods for velocity-independent forces refuse it.

    The potential form, U = -3 m (G M / (c r))^2, depends only on position and has the same advance to first order. It
    has neither the orbit's small periodic changes nor its period (Nobili & Roxburgh 1986, IAU Symposium 114, 105).

    The central body takes the opposite force, so the sum of m v is conserved. The potential energy includes the full
    form's addition to E: per mass, 3 v^4 / 8 + G M (3 v^2 + G M / r) / (2 r), over c^2, for a massless body, with
    weights for a massive one (see ``relativity_kernel``). Then the energy of one body around the central body is
    constant to order c^-4, and the energy of several attracting bodies to m / M of c^-2. Relativity does not conserve
    the sum of m x × v: on an eccentric orbit this sum oscillates by about e G M / (c^2 r) of its value.

    Attributes
    ----------
    c : float, optional
        Speed of light in the system's units; default the unit system's own.
    central : str or int, optional
        The central body's name or number; default the most massive body.
    form : "full" or "potential"
    G : float, optional
        Default the unit system's own.
    """

    c: float | None = None
    central: Central = None
    form: str = "full"
    G: float | None = None

    name: ClassVar[str] = "relativity-1pn"
    by_mass: ClassVar[bool] = True
    dimensions: ClassVar[dict[str, str]] = {"c": "velocity", "G": "gravitational constant"}

    def __post_init__(self) -> None:
        check_positive(self.name, c=self.c, G=self.G)
        check_central(self.name, self.central)
        if self.form not in FORMS:
            raise InputError(f"{self.name}: form: expected one of {', '.join(FORMS)}, got {shown(self.form)}")

    @property
    def velocity_dependent(self) -> bool:
        """Tell whether this is the full form, which a splitting method refuses."""
        return self.form == "full"

    def reversed(self) -> PostNewtonian:
        """The force of the motion backwards in time: the same, since it has even powers of v alone."""
        return self

    def light(self, system: Subject) -> float:
        """Speed of light in the system's units."""
        value = self.c if self.c is not None else system.units.light
        if value is None:
            raise InputError(f"{self.name}: units {system.units.name!r} define no speed of light; give c")
        return value

    def check(self, system: Subject) -> None:
        """Raise InputError for a system that this force cannot run."""
        check_open(self.name, system)
        central_body(self.name, self.central, system)
        gravitational_constant(self.name, self.G, system)
        self.light(system)

    def bind(self, system: Subject, threads: int = 1) -> Any:
        """Bind this force to a System: a NamedTuple with a compiled body."""
        from kickdrift.forces.relativity_kernel import RelativityKernel

        central, gm, share, masses = Attraction.of(self, system)
        return RelativityKernel(central, gm, self.light(system) ** 2, self.form == "full", share, masses)
