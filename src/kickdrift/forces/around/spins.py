"""Systems whose bodies' spins are part of the state: tides that turn them, and the other forces beside these.

y of such a System has n columns more, which hold the spins as velocities, and the angles of rotation as positions:
see ``forces.beside.columns``.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.beside.columns import COLUMNS, Columns
from kickdrift.forces.laws.body_law import body_law
from kickdrift.forces.laws.central import check_open, check_positive, column, gravitational_constant
from kickdrift.forces.seam.arguments import Vector, check_not_negative, values_in
from kickdrift.model.state import Floats


class Spinning(NamedTuple):
    """The tides and spins of a System's bodies."""

    gm: Floats  # (n,) G m
    bulge: Floats  # (n,) k2 R^5; 0 for a body that keeps its shape
    tau: Floats  # (n,)
    inertia: Floats  # (n,) moments of inertia, coherent; 0 for a body without tides
    spin: Floats  # (3, n) at the start
    flattened: float  # 1 with the rotational bulge, else 0


@body_law
class TidesSpin(NamedTuple):
    """Tides with a constant time lag between all bodies, whose spins change by the torque.

    A body of radius R, Love number k2, time lag tau and spin S exerts on another body of mass m at r, v from it the
    force F = -3 G k2 m^2 R^5 / r^8 [r + tau (2 r (r . v) / r^2 + r × S + v)] (Hut 1981, A&A 99, 126), and by its
    rotational bulge F = k2 m R^5 / (2 r^7) [(5 (S . r)^2 - S^2 r^2) r - 2 (S . r) r^2 S] (Eggleton, Kiseleva & Hut
    1998, doi:10.1086/305670). The body takes the opposite force, and its spin changes as I dS/dt = -r × F. So momentum,
    and the angular momentum of orbits and spins together, are conserved.

    Each body's spin is part of the state: ``state.spins``, the column ``spins`` of a run's file, and checkpoints hold
    it. ``spin`` gives the start. Energies include the rotation, I S^2 / 2. The angular momentum of samples includes
    I S. The force needs a method for forces that depend on velocity: ``gauss-radau15`` or a Runge-Kutta method.

    Attributes
    ----------
    k2 : float, or one for each particle or species
        Potential Love number of degree 2; zero for a body that keeps its shape.
    radius : float, or one for each particle or species
        A length.
    inertia : float, or one for each particle or species
        Moment of inertia over m R^2: 0.4 for a homogeneous ball, 0.33 for the Earth, 0.07 for the Sun.
    spin : (x, y, z), or one for each particle or species
        Angular velocity at the start, in radians per unit of time; (0, 0, 0) for a body that does not rotate.
    tau : float, or one for each particle or species
        Time lag; default 0, the tides without dissipation.
    flattening : "rotational" or "none"
        Whether rotation flattens the bodies, so that their spins precess; default "rotational".
    G : float, optional
        Default the unit system's own.
    """

    k2: float
    radius: float
    inertia: float
    spin: Vector
    tau: float = 0.0
    flattening: str = "rotational"
    G: float | None = None

    name = "tides-spin"  # type: ignore[misc]
    stands_for, acts_by = "tides", "k2"  # type: ignore[misc]
    by_mass = velocity_dependent = joins = True  # type: ignore[misc]
    varies = ("k2", "radius", "inertia", "spin", "tau")  # type: ignore[misc]
    odd_in_time = ("tau", "spin")  # type: ignore[misc]
    dimensions = {  # type: ignore[misc]  # noqa: RUF012
        "radius": "length",
        "spin": "rate",
        "tau": "time",
        "G": "gravitational constant",
    }

    @property
    def works(p):
        """Whether there is a time lag, so that energy is not conserved."""
        return bool(values_in(p.tau).any())

    @staticmethod
    def law(p, x, v, m, t, a):
        """The first n columns are the bodies; n more, if there are any, hold the spins as velocities."""
        n, energy = m.size, 0.0
        moving = x.shape[1] > n
        for i in range(n):
            bulge, inertia = p.bulge[i], p.inertia[i]
            if bulge == 0.0:
                continue
            spin = column(v, n + i) if moving else column(p.spin, i)
            spin2 = spin @ spin
            energy += 0.5 * inertia * spin2
            torque = 0.0 * spin
            for j in range(n):
                if j == i:
                    continue
                d, u = column(x, j) - column(x, i), column(v, j) - column(v, i)
                r2, along = d @ d, spin @ d
                inverse2 = 1.0 / r2
                inverse5 = inverse2 * inverse2 * math.sqrt(inverse2)
                tide = bulge * p.gm[j] * inverse2 * inverse2 * inverse2
                late = d + p.tau[i] * ((2.0 * (d @ u) * inverse2) * d + np.cross(d, spin) + u)
                push = (-3.0 * tide * inverse2) * late
                turn = 0.5 * bulge * inverse5 * p.flattened
                push = push + (turn * (5.0 * along * along * inverse2 - spin2)) * d - (2.0 * turn * along) * spin
                energy += m[j] * (turn / 3.0 * (3.0 * along * along - spin2 * r2) - 0.5 * tide)
                torque = torque - m[j] * np.cross(d, push)
                for k in range(3):
                    a[k, j] += push[k]
                    a[k, i] -= m[j] / m[i] * push[k]
            if moving:
                for k in range(3):
                    a[k, n + i] += torque[k] / inertia
        return energy

    def check(p):
        check_positive("tides-spin", G=p.G)
        check_not_negative(k2=p.k2, radius=p.radius, inertia=p.inertia, tau=p.tau)
        if p.flattening not in ("rotational", "none"):
            raise InputError(f"flattening: expected rotational or none, got {p.flattening!r}")

    def check_system(p, system):
        """Refuse a system that this force cannot run."""
        check_open("tides-spin", system)
        gravitational_constant("tides-spin", p.G, system)

    def bound(p: Any, system):
        """The tides of this System's bodies; an InputError names a body without mass or moment of inertia."""
        masses, bulge = system.state.masses, p.k2 * p.radius**5
        for i in np.flatnonzero((bulge > 0) & ((masses == 0) | (p.inertia == 0))):
            body = system.body(int(i))
            if masses[i] == 0:
                raise InputError(f"tides-spin: k2: {body} has no mass, so its tide would move it without limit; give 0")
            raise InputError(f"tides-spin: inertia: {body} has tides and no moment of inertia; give inertia")
        if system.dimensions == 2 and p.spin[:2].any():
            raise InputError("tides-spin: spin: expected vectors along z in this two-dimensional system")
        gm = gravitational_constant("tides-spin", p.G, system) * masses
        inertia = np.where(bulge > 0, p.inertia * system.coherent_masses * p.radius**2, 0.0)
        return Spinning(gm, bulge, p.tau, inertia, p.spin, float(p.flattening == "rotational"))


SPINS = "spins"  # field of a State, and column of a run's file


def _with_spins(force: Any, spins: Floats) -> Any:
    """The force with these spins (3, n) at the start."""
    return replace(force, spin=tuple(map(tuple, spins.T.tolist())))


COLUMNS[TidesSpin.name] = Columns(
    SPINS,
    first=lambda force, system: np.array(force.bound_law(system).spin),
    begun=_with_spins,
    listed=lambda force, system: [(SPINS, "rate", (len(system), 3), np.transpose)],
    moments=lambda force, system: np.array(force.bound_law(system).inertia),
)
