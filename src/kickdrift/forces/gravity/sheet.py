"""Gravity among particles of a shearing sheet and their images."""

from __future__ import annotations

import math
from typing import NamedTuple

from kickdrift.errors import InputError
from kickdrift.forces.fields.shipped import Hill
from kickdrift.forces.laws.body_law import body_law
from kickdrift.forces.laws.central import check_open, check_positive, gravitational_constant
from kickdrift.model.patch import Patch
from kickdrift.model.state import Floats
from kickdrift.text import shown

MOST_GHOSTS = 20


class Sheet(NamedTuple):
    """The sheet of a System."""

    omega: float
    width: float
    length: float
    ghosts: int
    softening2: float
    gm: Floats  # (n,) G m
    none: int  # 1 if no body attracts


@body_law
class GravitySheet(NamedTuple):
    """Direct sum of gravity in a patch with shear-periodic boundaries, in Hill's frame.

    The patch has a width along x and a length along y, and repeats along both. A particle at (x, y) has images at
    (x + k width, y - 3/2 omega k width t + l length) for all whole k and l, which move with the shear (Wisdom &
    Tremaine 1988, doi:10.1086/114690). A particle feels the images of another one in 2 ``ghosts`` + 1 columns around
    the nearest column, and in each column the nearest image and ``ghosts`` images on both sides.

    Positions are not wrapped: a particle that leaves the patch goes on, and its images fill the patch. Momentum is
    conserved. The images move with the shear and do work, so energy is not conserved. The potential energy leaves out
    the energy of a particle with its own images.

    Attributes
    ----------
    omega : float
        Angular frequency of the frame, as of the force ``hill``.
    width, length : float
        Of the patch along x and along y.
    ghosts : int
        Rings of images, 0 to 20; default 1, the 9 nearest images.
    softening : float
        Length; default 0.
    G : float, optional
        Default the unit system's own. 0 makes a patch without self-gravity, whose boundaries collisions see.
    """

    omega: float
    width: float
    length: float
    ghosts: int = 1
    softening: float = 0.0
    G: float | None = None

    by_mass = fastmath = time_dependent = works = True  # type: ignore[misc]
    odd_in_time = ("omega",)  # type: ignore[misc]

    @property
    def stands_for(p):
        """What the force is a model of; nothing for a patch without gravity."""
        return "" if p.G == 0 else "gravity of all pairs"

    dimensions = {  # type: ignore[misc]  # noqa: RUF012
        "omega": "rate", "width": "length", "length": "length", "softening": "length", "G": "gravitational constant",
    }  # fmt: skip

    @staticmethod
    def law(p, x, v, m, t, a):
        n, energy, width, length = x.shape[1], 0.0, p.width, p.length
        if p.none > 0:
            return energy
        lag = 1.5 * p.omega * width * t  # of an image a column further out
        lag -= length * math.floor(lag / length + 0.5)
        for i in range(n):
            for j in range(i):
                if p.gm[i] == 0.0 and p.gm[j] == 0.0:
                    continue
                column = math.floor((x[0, j] - x[0, i]) / width + 0.5)
                dx, dy, dz = x[0, j] - x[0, i] - column * width, x[1, j] - x[1, i], x[2, j] - x[2, i]
                pull_x = pull_y = pull_z = depth = 0.0
                for k in range(-p.ghosts, p.ghosts + 1):
                    d_x, d_y = dx + k * width, dy + (column - k) * lag
                    d_y -= length * math.floor(d_y / length + 0.5)
                    for row in range(-p.ghosts, p.ghosts + 1):
                        image = d_y + row * length
                        inverse = 1.0 / math.sqrt(d_x * d_x + image * image + dz * dz + p.softening2)
                        w = inverse * inverse * inverse
                        pull_x, pull_y, pull_z = pull_x + w * d_x, pull_y + w * image, pull_z + w * dz
                        depth += inverse
                a[0, i] += p.gm[j] * pull_x
                a[1, i] += p.gm[j] * pull_y
                a[2, i] += p.gm[j] * pull_z
                a[0, j] -= p.gm[i] * pull_x
                a[1, j] -= p.gm[i] * pull_y
                a[2, j] -= p.gm[i] * pull_z
                energy -= m[i] * p.gm[j] * depth
        return energy

    def check(p):
        check_positive("gravity-sheet", width=p.width, length=p.length)
        if p.G is not None and p.G < 0:
            raise InputError(f"G must be zero or more, got {shown(p.G)}")
        if not 0 <= p.ghosts <= MOST_GHOSTS:
            raise InputError(f"ghosts must be 0 to {MOST_GHOSTS}, got {shown(p.ghosts)}")
        if p.softening < 0:
            raise InputError(f"softening must be zero or more, got {shown(p.softening)}")

    def check_system(p, system):
        """Refuse a periodic box, and a frame that turns at another rate."""
        check_open("gravity-sheet", system)
        for force in system.forces:
            if isinstance(force, Hill) and force.omega != p.omega:
                raise InputError(f"omega is {p.omega:g}, and the omega of hill is {force.omega:g}")
        gravitational_constant("gravity-sheet", p.G, system)

    def bound(p, system):
        """The sheet with this System's masses."""
        gm = gravitational_constant("gravity-sheet", p.G, system) * system.state.masses
        return Sheet(p.omega, p.width, p.length, p.ghosts, p.softening**2, gm, int(not gm.any()))

    def patch(p):
        """The patch, which collisions see too."""
        return Patch(p.omega, p.width, p.length)
