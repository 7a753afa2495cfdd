"""Virtual sites: places without mass that follow the particles of their molecule, and give them their force."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.box.box import Box
from kickdrift.model.checks.arguments import checked_arguments
from kickdrift.model.checks.values import listed, numbers
from kickdrift.model.molecules.constraint import Joined
from kickdrift.model.molecules.constraints import Constraints, in_one_image
from kickdrift.model.molecules.relatives import Ids
from kickdrift.model.molecules.topology import Topology, is_index
from kickdrift.model.state import Floats
from kickdrift.text import counted, shown

ONE = 1e-9  # error of the sum of weights
KEY = "virtual_site"


@checked_arguments
@dataclass(frozen=True, eq=False)
class VirtualSite:
    """Sites without mass whose places follow from two or three particles, as the M site of TIP4P does.

    A site is at ``w0 x0 + w1 x1 + w2 x2 + normal (x1 - x0) x (x2 - x0)``. Its force acts on these particles instead,
    by the derivatives of that place, so that energy and both momenta are conserved. Its particle has mass 0, and any
    charge and species. Pair forces leave it out where they leave out a particle that a bond joins to the first of
    ``of``: the factors of the topology hold for it.

    Parameters
    ----------
    particles : one site, or a list of sites (s,)
    of : two or three particles with mass; for a list of sites a list of such rows (s, 2 or 3)
    weights : a weight for each particle of a row, with the sum 1; or such a row for each site
    normal : factor of the cross product, an inverse length; one for all sites or one for each; needs three particles

    Raises
    ------
    InputError
        If these contradict each other. A System refuses further what its particles do not allow.
    """

    particles: Any
    of: Any
    weights: Any
    normal: Any = 0.0

    def __post_init__(self) -> None:
        put = object.__setattr__
        one = is_index(self.particles)
        sites = [self.particles] if one else listed(f"{KEY}: particles", self.particles, "the numbers of particles")
        if not sites or not all(map(is_index, sites)):
            raise InputError(f"{KEY}: particles: expected the numbers of particles, got {shown(self.particles)}")
        rows = [self.of] if one else listed(f"{KEY}: of", self.of, "two or three particles for each site")
        size = len(rows[0]) if rows and isinstance(rows[0], Sequence | np.ndarray) else 0
        if size not in (2, 3):
            raise InputError(f"{KEY}: of: expected two or three particles for each site, got {shown(self.of)}")
        of = _rows(rows, size)
        if len(of) != len(sites):
            raise InputError(f"{KEY}: of: expected {len(sites)} rows, one for each site, got {len(of)}")
        weights = numbers(f"{KEY}: weights", self.weights, f"{size} numbers")
        if weights.shape not in ((size,), (len(sites), size)):
            raise InputError(f"{KEY}: weights: expected {size} numbers, one for each particle of `of`")
        weights = np.broadcast_to(weights, (len(sites), size)).copy()
        if not (np.abs(weights.sum(axis=1) - 1.0) <= ONE).all():
            raise InputError(f"{KEY}: weights: expected the sum 1, got {weights.sum(axis=1).max():.12g}")
        normal = numbers(f"{KEY}: normal", self.normal, "a number")
        if normal.shape not in ((), (len(sites),)) or not np.isfinite(normal).all():
            raise InputError(f"{KEY}: normal: expected a finite number, or one for each site, got {shown(self.normal)}")
        if size == 2 and normal.any():
            raise InputError(f"{KEY}: normal: needs three particles in `of`, got two")
        put(self, "particles", np.array(sites, np.int64))
        put(self, "of", of)
        put(self, "weights", weights)
        put(self, "normal", np.broadcast_to(normal, (len(sites),)).copy())

    @property
    def last(self) -> int:
        """The highest number of a particle in this."""
        return int(max(self.particles.max(), self.of.max()))

    def repeated(self, copies: int, size: int) -> VirtualSite:
        """The sites of equal molecules of ``size`` particles in a row. The first molecule has the sites of this one."""
        far = size * np.arange(copies)
        return VirtualSite(
            (far[:, None] + self.particles).ravel(),
            (far[:, None, None] + self.of).reshape(-1, self.of.shape[1]),
            np.tile(self.weights, (copies, 1)),
            np.tile(self.normal, copies),
        )


def _rows(rows: list[Any], size: int) -> Ids:
    """Checked rows of different particles (s, size)."""
    for row in rows:
        good = isinstance(row, Sequence | np.ndarray) and len(row) == size and all(map(is_index, row))
        if not (good and len(set(row)) == size):
            raise InputError(f"{KEY}: of: expected {size} different particles in each row, got {shown(row)}")
    return np.array(rows, np.int64)


class VirtualSites:
    """All virtual sites of one System.

    Attributes
    ----------
    particles : (s,) the sites
    of : (s, 3) the particles that they follow; the last is there twice for a site of two
    shares : (s, 2) weights of the last two
    normal : (s,) factors of the cross product
    """

    def __init__(self, sites: Iterable[VirtualSite]) -> None:
        given = list(sites)
        self.tables = [_table(each) for each in given]
        self.particles = np.concatenate([each.particles for each in given])
        self.of: Ids = np.concatenate([each.of[:, [0, 1, -1]] for each in given])
        self.shares = np.concatenate([np.column_stack([each.weights, 0.0 * each.weights])[:, 1:3] for each in given])
        self.normal = np.concatenate([each.normal for each in given])

    def __len__(self) -> int:
        return len(self.particles)

    def __str__(self) -> str:
        return counted(len(self), "site", ",")

    @property
    def pairs(self) -> Ids:
        """Pairs (2 s, 2) of the particles that each site follows, which lie in one image of the box."""
        return np.concatenate([self.of[:, [0, 1]], self.of[:, [0, 2]]])

    def place(self, x: Floats) -> None:
        """Put the sites at their places at positions x (3, n), whose molecules lie in one image."""
        i, j, k = self.of.T
        first, second = x[:, j] - x[:, i], x[:, k] - x[:, i]
        found = (x[:, i] + self.shares[:, 0] * first) + self.shares[:, 1] * second
        for axis in range(3):
            a, b = (axis + 1) % 3, (axis + 2) % 3
            found[axis] += self.normal * (first[a] * second[b] - first[b] * second[a])
        x[:, self.particles] = found

    def settled(self, box: Box, held: Constraints | None, phase: Floats) -> Floats:
        """Phase (2, 3, n) with the molecules of sites and constraints in one image of the box, and the sites at rest at
        their places."""
        pairs = np.concatenate([self.pairs, *([] if held is None else [held.pairs])])
        found = np.array([in_one_image(box, pairs, phase[0]), phase[1]])
        self.place(found[0])
        found[1][:, self.particles] = 0.0
        return found

    def joined(self, topology: Topology) -> Topology:
        """The topology in which each site has the relatives of a particle that a bond joins to its first one."""
        return topology.with_sites(np.column_stack([self.particles, self.of[:, 0]]))

    def check(self, system: Joined) -> None:
        """Refuse sites that this System's particles do not allow."""
        n, masses = len(system.state), system.state.masses
        if (far := max(self.particles.max(), self.of.max())) >= n:
            raise InputError(f"{KEY}: there is no particle {far}; particles are 0 to {n - 1}")
        numbers, counts = np.unique(self.particles, return_counts=True)
        if (counts > 1).any():
            raise InputError(f"{KEY}: {system.body(int(numbers[counts > 1][0]))} is given twice")
        if (heavy := np.flatnonzero(masses[self.particles] > 0)).size:
            i = int(self.particles[heavy[0]])
            raise InputError(f"{KEY}: {system.body(i)} has a mass, and a site follows other particles; give it mass 0")
        if (light := np.flatnonzero(masses[self.of].min(axis=1) <= 0)).size:
            row = self.of[light[0]]
            i = int(row[np.argmin(masses[row])])
            raise InputError(f"{KEY}: follows {system.body(i)}, which has no mass and cannot take its force")
        if system.dimensions == 2 and self.normal.any():
            raise InputError(f"{KEY}: normal: leads out of the plane of a two-dimensional system")


def _table(site: VirtualSite) -> dict[str, Any]:
    """Table ``[[virtual_site]]`` of a system file, which makes the same sites."""
    same = (site.weights == site.weights[0]).all()
    found = {
        "particles": site.particles.tolist(),
        "of": site.of.tolist(),
        "weights": (site.weights[0] if same else site.weights).tolist(),
    }
    if site.normal.any():
        found["normal"] = float(site.normal[0]) if (site.normal == site.normal[0]).all() else site.normal.tolist()
    return found


def virtual_sites_of(given: Iterable[VirtualSite] | VirtualSites | None) -> VirtualSites | None:
    """The virtual sites of a System from a list of `VirtualSite`. `VirtualSites` and None stay as they are."""
    if given is None or isinstance(given, VirtualSites):
        return given
    stated = [given] if isinstance(given, VirtualSite) else listed("virtual_sites", given, "a list of VirtualSite")
    for each in stated:
        if not isinstance(each, VirtualSite):
            raise InputError(f"virtual_sites: expected kickdrift.VirtualSite, got {type(each).__name__}")
    return VirtualSites(stated) if stated else None
