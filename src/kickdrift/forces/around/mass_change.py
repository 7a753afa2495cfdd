"""Bodies that lose or gain mass: the gravity of the difference."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from kickdrift.errors import InputError
from kickdrift.forces.laws.body_law import body_law
from kickdrift.forces.laws.central import check_open, check_positive, column, gravitational_constant
from kickdrift.model.state import Floats
from kickdrift.text import shown

FORMS = ("exponential", "linear")


class Changes(NamedTuple):
    """Changing masses of a System's bodies."""

    gm: Floats  # (n,) G m at t = 0
    rate: Floats  # (n,)
    exponential: bool


@body_law
class MassChange(NamedTuple):
    """The gravity of masses that bodies have gained or lost since t = 0, in addition to ``gravity``.

    A body's mass is m exp(rate t), or m (1 + rate t), and never below zero. The masses of the system stay those of t =
    0. This force adds to each body the acceleration by the others' difference, G (m(t) - m) / r^2, so that orbits are
    those around bodies of the mass m(t). Mass leaves and arrives with the velocity of its body, so there is no thrust.
    Slow loss by the central body widens orbits as a = a_0 M_0 / M(t) (Jeans 1924).

    Energies and momenta of samples count the masses of t = 0. Forces other than ``gravity`` do not see the change.

    Attributes
    ----------
    rate : float, or one for each particle or species
        Relative change per unit of time: negative for loss, zero for none.
    form : "exponential" or "linear"
    G : float, optional
        Default the unit system's own.
    """

    rate: float
    form: str = "exponential"
    G: float | None = None

    name = "mass-change"  # type: ignore[misc]
    by_mass = time_dependent = works = external = True  # type: ignore[misc]
    varies = ("rate",)  # type: ignore[misc]
    odd_in_time = ("rate",)  # type: ignore[misc]
    dimensions = {"rate": "rate", "G": "gravitational constant"}  # type: ignore[misc]  # noqa: RUF012

    @staticmethod
    def law(p, x, v, m, t, a):
        n = x.shape[1]
        for j in range(n):
            if p.rate[j] == 0.0 or p.gm[j] == 0.0:
                continue
            grown = math.expm1(p.rate[j] * t) if p.exponential else max(p.rate[j] * t, -1.0)
            for i in range(n):
                if i == j:
                    continue
                d = column(x, j) - column(x, i)
                r2 = d @ d
                push = (p.gm[j] * grown / (r2 * math.sqrt(r2))) * d
                for k in range(3):
                    a[k, i] += push[k]

    def check(p):
        check_positive("mass-change", G=p.G)
        if p.form not in FORMS:
            raise InputError(f"form: expected one of {', '.join(FORMS)}, got {shown(p.form)}")

    def check_system(p, system):
        """Refuse a system that this force cannot run."""
        check_open("mass-change", system)
        gravitational_constant("mass-change", p.G, system)
        for force in system.forces:
            if force.name.startswith("gravity") and getattr(force, "softening", 0.0):
                raise InputError(f"needs gravity without softening, and {force.name!r} has softening")

    def bound(p: Any, system):
        """The changing masses of this System."""
        gm = gravitational_constant("mass-change", p.G, system) * system.state.masses
        return Changes(gm, p.rate, p.form == "exponential")
