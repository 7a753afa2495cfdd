"""The Lennard-Jones force, written as any user would write a pair law."""

from __future__ import annotations

from typing import NamedTuple

from kickdrift.forces.pairs.law import pair_law


@pair_law
class LennardJones(NamedTuple):
    """U(r) = 4 epsilon ((sigma/r)^12 - (sigma/r)^6); Jones, Proc. R. Soc. Lond. A 106, 463 (1924),
    doi:10.1098/rspa.1924.0082."""

    epsilon: float = 1.0
    sigma: float = 1.0

    dimensions = {"epsilon": "energy", "sigma": "length"}  # type: ignore[misc]  # noqa: RUF012

    def law(p, r2):
        attraction = 4.0 * p.epsilon * p.sigma**6
        repulsion = attraction * p.sigma**6
        inverse = 1.0 / r2
        inverse6 = inverse**3
        energy = (repulsion * inverse6 - attraction) * inverse6
        return energy, (12.0 * repulsion * inverse6 - 6.0 * attraction) * inverse6 * inverse
