"""Laws of bonds, angles, dihedrals and impropers that ship, written as any user would write one."""

from __future__ import annotations

import math
from typing import NamedTuple

from kickdrift.forces.bonded.law import angle_law, bond_law, dihedral_law, improper_law
from kickdrift.text import shown

DEGREE = math.pi / 180.0
CORE = 2.0 ** (1.0 / 6.0)  # minimum of Lennard-Jones over sigma, where the core of Weeks, Chandler & Andersen 1971 ends


def at_least_zero(**values: float) -> str:
    """The fault that one of these values is negative, as text; "" if none is."""
    wrong = [key for key, value in values.items() if value < 0.0]
    return f"{wrong[0]} must be zero or more, got {shown(values[wrong[0]])}" if wrong else ""


def within(low: float, high: float, reason: str, **values: float) -> str:
    """The fault that one of these angles in degrees lies outside a range, as text; "" if none does."""
    wrong = [key for key, value in values.items() if not low <= value <= high]
    return f"{wrong[0]} must be {low:g} to {high:g} degrees, got {values[wrong[0]]:g}: {reason}" if wrong else ""


def whole_multiplicity(n: float) -> str:
    """The fault that a multiplicity is no whole number from 0 on, as text; "" if it is one."""
    jumps = "" if n == int(n) else ": the energy would jump at 180 degrees"
    return f"multiplicity must be a whole number, zero or more, got {n:g}{jumps}" if n < 0.0 or jumps else ""


@bond_law
class HarmonicBond(NamedTuple):
    """U(r) = k (r - l)^2 / 2. LAMMPS and CHARMM leave out the half: their K is stiffness / 2."""

    stiffness: float
    length: float

    dimensions = {"stiffness": "stiffness", "length": "length"}  # type: ignore[misc]  # noqa: RUF012

    @property
    def problem(p):
        """The fault in these parameters, as text; "" if nothing is."""
        return at_least_zero(stiffness=p.stiffness)

    def law(p, r):
        stretch = r - p.length
        return 0.5 * p.stiffness * stretch * stretch, p.stiffness * stretch


@bond_law
class Fene(NamedTuple):
    """U(r) = -k l^2 ln(1 - (r / l)^2) / 2, and 4 epsilon ((sigma/r)^12 - (sigma/r)^6) + epsilon below 2^(1/6) sigma.

    Both terms are the bond of Kremer & Grest 1990, doi:10.1063/1.458541, and LAMMPS' ``fene``. Beyond the longest
    length l there is no value. With an epsilon, the pair force must leave out bonded particles (``factors = [0, 1, 1]``
    in the topology). With epsilon = 0, the default, the bond only attracts, and the pair force repels.
    """

    stiffness: float = 30.0
    length: float = 1.5
    epsilon: float = 0.0
    sigma: float = 1.0

    dimensions = {  # type: ignore[misc]  # noqa: RUF012
        "stiffness": "stiffness", "length": "length", "epsilon": "energy", "sigma": "length"
    }  # fmt: skip

    @property
    def problem(p):
        """The fault in these parameters, as text; "" if nothing is."""
        alone = p.epsilon == 0.0 and p.sigma != 1.0
        if alone:
            return f"sigma is {p.sigma:g} and epsilon 0: the core has no strength; give epsilon too"
        no_length = f"length must be positive, got {p.length:g}: the bond is always longer" if p.length == 0.0 else ""
        return at_least_zero(stiffness=p.stiffness, epsilon=p.epsilon) or no_length

    def law(p, r):
        left = 1.0 - (r / p.length) ** 2
        left = left if left > 0.0 else math.nan
        energy, slope = -0.5 * p.stiffness * p.length**2 * math.log(left), p.stiffness * r / left
        if p.epsilon != 0.0 and r < CORE * p.sigma:
            s6 = (p.sigma / r) ** 6
            energy += 4.0 * p.epsilon * (s6 * s6 - s6) + p.epsilon
            slope -= 24.0 * p.epsilon * (2.0 * s6 * s6 - s6) / r
        return energy, slope


@bond_law
class MorseBond(NamedTuple):
    """U(r) = depth (1 - exp(-width (r - length)))^2; Morse 1929, doi:10.1103/PhysRev.34.57."""

    depth: float
    width: float
    length: float

    dimensions = {"depth": "energy", "width": "inverse length", "length": "length"}  # type: ignore[misc]  # noqa: RUF012

    @property
    def problem(p):
        """The fault in these parameters, as text; "" if nothing is."""
        return at_least_zero(depth=p.depth, width=p.width)

    def law(p, r):
        e = math.exp(-p.width * (r - p.length))
        return p.depth * (1.0 - e) ** 2, 2.0 * p.depth * p.width * (1.0 - e) * e


@angle_law
class HarmonicAngle(NamedTuple):
    """U = k (angle - rest)^2 / 2, where rest is in degrees and k an energy per square radian. LAMMPS and CHARMM leave
    out the half: their K is stiffness / 2."""

    stiffness: float
    rest: float

    dimensions = {"stiffness": "energy", "rest": "angle"}  # type: ignore[misc]  # noqa: RUF012

    @property
    def problem(p):
        """The fault in these parameters, as text; "" if nothing is."""
        return within(0.0, 180.0, "no angle lies outside", rest=p.rest)

    def law(p, angle):
        bend = angle - p.rest * DEGREE
        return 0.5 * p.stiffness * bend * bend, p.stiffness * bend


@angle_law
class CosineAngle(NamedTuple):
    """U = k (1 + cos(angle)): zero for three particles in a line, the stiffness of semiflexible chains; Faller,
    Kolb & Mueller-Plathe 1999, doi:10.1039/a809796i."""

    stiffness: float

    dimensions = {"stiffness": "energy"}  # type: ignore[misc]  # noqa: RUF012

    def law(p, angle):
        return p.stiffness * (1.0 + math.cos(angle)), -p.stiffness * math.sin(angle)


@dihedral_law
class PeriodicDihedral(NamedTuple):
    """U = k (1 + cos(n angle - phase)), the proper dihedral of AMBER and CHARMM; phase in degrees."""

    barrier: float
    multiplicity: float = 1.0
    phase: float = 0.0

    dimensions = {"barrier": "energy", "phase": "angle"}  # type: ignore[misc]  # noqa: RUF012

    @property
    def problem(p):
        """The fault in these parameters, as text; "" if nothing is."""
        return whole_multiplicity(p.multiplicity)

    def law(p, angle):
        at = p.multiplicity * angle - p.phase * DEGREE
        return p.barrier * (1.0 + math.cos(at)), -p.multiplicity * p.barrier * math.sin(at)


@dihedral_law
class RyckaertBellemans(NamedTuple):
    """U = sum of c_n cos(angle - pi)^n, n = 0 to 5; Ryckaert & Bellemans 1975, doi:10.1016/0009-2614(75)85513-8."""

    c0: float
    c1: float = 0.0
    c2: float = 0.0
    c3: float = 0.0
    c4: float = 0.0
    c5: float = 0.0

    dimensions = dict.fromkeys(("c0", "c1", "c2", "c3", "c4", "c5"), "energy")  # type: ignore[misc]

    def law(p, angle):
        c = -math.cos(angle)
        energy = p.c0 + c * (p.c1 + c * (p.c2 + c * (p.c3 + c * (p.c4 + c * p.c5))))
        slope = p.c1 + c * (2.0 * p.c2 + c * (3.0 * p.c3 + c * (4.0 * p.c4 + c * 5.0 * p.c5)))
        return energy, slope * math.sin(angle)


@dihedral_law
class OplsDihedral(NamedTuple):
    """U = sum of v_n (1 - (-1)^n cos(n angle)) / 2, n = 1 to 4; Jorgensen, Maxwell & Tirado-Rives 1996,
    doi:10.1021/ja9621760."""

    v1: float = 0.0
    v2: float = 0.0
    v3: float = 0.0
    v4: float = 0.0

    dimensions = dict.fromkeys(("v1", "v2", "v3", "v4"), "energy")  # type: ignore[misc]

    def law(p, angle):
        one, two, three, four = math.cos(angle), math.cos(2 * angle), math.cos(3 * angle), math.cos(4 * angle)
        energy = p.v1 * (1.0 + one) + p.v2 * (1.0 - two) + p.v3 * (1.0 + three) + p.v4 * (1.0 - four)
        odd = p.v1 * math.sin(angle) + 3.0 * p.v3 * math.sin(3 * angle)
        even = 2.0 * p.v2 * math.sin(2 * angle) + 4.0 * p.v4 * math.sin(4 * angle)
        return 0.5 * energy, 0.5 * (even - odd)


@improper_law
class HarmonicImproper(NamedTuple):
    """U = k (|angle| - rest)^2 / 2, where rest is in degrees and k an energy per square radian.

    This is LAMMPS' ``improper_style harmonic``, whose K is stiffness / 2. With rest = 0 the force keeps four particles
    in a plane, as CHARMM's impropers do. The sign of the angle does not count, so a rest above 0 does not tell mirror
    images apart.
    """

    stiffness: float
    rest: float = 0.0

    dimensions = {"stiffness": "energy", "rest": "angle"}  # type: ignore[misc]  # noqa: RUF012

    @property
    def problem(p):
        """The fault in these parameters, as text; "" if nothing is."""
        return within(0.0, 180.0, "the sign of the angle does not count", rest=p.rest)

    def law(p, angle):
        bend = abs(angle) - p.rest * DEGREE
        return 0.5 * p.stiffness * bend * bend, p.stiffness * (bend if angle >= 0.0 else -bend)


@improper_law
class PeriodicImproper(NamedTuple):
    """U = k (1 + cos(n angle - phase)), AMBER's improper dihedral, which lists the central particle third.

    The phase is in degrees. LAMMPS' ``improper_style cvff`` has the phases 0 and 180.
    """

    barrier: float
    multiplicity: float = 2.0
    phase: float = 180.0

    dimensions = {"barrier": "energy", "phase": "angle"}  # type: ignore[misc]  # noqa: RUF012

    @property
    def problem(p):
        """The fault in these parameters, as text; "" if nothing is."""
        return whole_multiplicity(p.multiplicity)

    law = PeriodicDihedral.Parameters.law  # type: ignore[attr-defined, misc]
