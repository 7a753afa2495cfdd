"""Ewald's forces on some particles in plain NumPy, and the error of a choice of parameters, measured with them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.charges import slab
from kickdrift.forces.charges.accuracy import LEAST, Charged, Split, split_at
from kickdrift.forces.charges.mesh_choice import predicted
from kickdrift.forces.charges.radial import ALL_IMAGES, Radial, force_over_r
from kickdrift.forces.charges.waves import waves_of
from kickdrift.model.nearness import pairs_nearer
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.model.box.box import Box
    from kickdrift.model.subject import Subject

SAMPLE = 64  # particles whose forces are compared
LARGEST = 10_000  # particles in a System whose error is measured: beyond, the exact sum would take many seconds
FINER = 0.02  # error of the reference, in wanted errors
AT_ONCE = 2_000_000  # phases of waves in memory


class Summed(Protocol):
    """Coulomb's law by Ewald's sum; see ``Coulomb``."""

    def scaled_charges(self, system: Subject) -> Floats:
        """Return the charges (n,) times the root of Coulomb's constant."""

    @property
    def method(self) -> str: ...

    @property
    def accuracy(self) -> float: ...

    def charged(self, system: Subject) -> Charged:
        """Return the numbers on which the errors depend."""

    def split(self, system: Subject) -> Split:
        """Return the parameters of the sum."""

    def space(self, system: Subject) -> Box:
        """Return the box of the waves."""

    def radial(self, split: Split) -> Radial:
        """Return the near part."""

    def background(self, system: Subject) -> float:
        """Return the energy of the neutralising background, times the volume."""


class Errors(NamedTuple):
    """Root-mean-square errors of Ewald's forces, predicted and measured, and the size of the forces, all in typical
    forces (see `accuracy`). The forces on as many ``particles`` were measured."""

    predicted: float
    measured: float | None
    size: float | None
    particles: int


def errors_of(force: Summed, system: Subject) -> Errors:
    """Errors of the forces at the System's positions. Nothing is measured beyond ``LARGEST`` particles."""
    charges, split, n = force.scaled_charges(system), force.split(system), len(system)
    charged = force.charged(system)
    some = np.flatnonzero(charges)
    if not len(some):
        return Errors(0.0, None, None, 0)
    expected = predicted(charged, split, force.space(system).matrix)
    if n > LARGEST:
        return Errors(expected, None, None, 0)
    rows = some[np.linspace(0, len(some) - 1, min(SAMPLE, len(some))).astype(int)]
    wanted = max(FINER * min(expected, 1.0), LEAST)
    finer = split_at(charged, wanted, 0.5 * float(system.box.heights.min()), None, None)
    spaces = force.space(system), slab.space_of(system.box, wanted) if slab.is_slab(system.box) else None
    found, exact = (forces_on(rows, charges, system, *each) for each in zip((split, finer), spaces, strict=True))
    measured, size = (
        math.sqrt(float(np.einsum("ij,ij->i", each, each).mean())) / charged.unit for each in (found - exact, exact)
    )
    return Errors(expected, measured, size, len(rows))


def forces_on(
    rows: NDArray[np.int64], charges: Floats, system: Subject, split: Split, space: Box | None = None
) -> Floats:
    """Ewald's forces (m, 3) on the particles ``rows`` (m,), whose charges are scaled by the root of Coulomb's constant.
    ``space`` is the box of the waves, default the System's. A mesh is compiled code, everything else is plain NumPy."""
    from scipy.special import erf, erfc

    x, box = np.asarray(system.state.positions), system.box
    found = _far_forces(rows, charges, x, space or box, split)
    if space is not None and space != box:
        found[:, 2] -= 4.0 * math.pi / space.volume * float(charges @ x[:, 2]) * charges[rows]
    gaussian = 2.0 * split.alpha / math.sqrt(math.pi)
    every = np.arange(len(x))
    for k, i in enumerate(rows.tolist()):
        apart = box.minimum_image(x[i] - x)
        r2 = np.einsum("ij,ij->i", apart, apart)
        r2[i] = np.inf
        factor = np.ones(len(x)) if system.topology is None else system.topology.factor_of(np.full(len(x), i), every)
        near = np.flatnonzero((r2 < split.cutoff**2) | ((factor != 1.0) & (every != i)))
        r, factor = np.sqrt(r2[near]), factor[near]
        falling = gaussian * np.exp(-((split.alpha * r) ** 2))
        over = np.where(r < split.cutoff, factor * (erfc(split.alpha * r) / r + falling), 0.0)
        over += (factor - 1.0) * (erf(split.alpha * r) / r - falling)
        found[k] += charges[i] * ((charges[near] * over / r**2) @ apart[near])
    return found


def virial_tensor(force: Summed, system: Subject, positions: Floats) -> Floats:
    """Sum (3, 3) of r F over pairs and images at these positions (n, 3), in a periodic box; for Ewald's sum see Heyes
    1994, doi:10.1103/PhysRevB.49.755."""
    from scipy.special import erf

    charges, split = force.scaled_charges(system), force.split(system)
    i, j = pairs_nearer(positions, system.box, split.cutoff).T
    apart = system.box.minimum_image(positions[i] - positions[j])
    r2 = np.einsum("ij,ij->i", apart, apart)
    factor = np.ones(len(i)) if system.topology is None else system.topology.factor_of(i, j)
    inside = r2 < split.cutoff**2
    over_r = np.zeros(len(i))
    over_r[inside] = (factor * charges[i] * charges[j])[inside] * force_over_r(force.radial(split), r2[inside])
    found = np.einsum("m,ma,mb->ab", over_r, apart, apart)
    if force.method not in ALL_IMAGES:
        return np.asarray(found)
    if split.mesh:  # by waves of the same error
        charged = force.charged(system)
        split = split_at(charged, force.accuracy, split.cutoff, split.alpha, None)
    k, k2, amplitude = _waves(system.box, split)
    density = np.concatenate([charges @ phase for _, phase in _phases(positions, k)])
    energies = 0.5 * amplitude * np.abs(density) ** 2
    found -= np.einsum("k,ka,kb->ab", energies * (2.0 / k2 + 0.5 / split.alpha**2), k, k)
    found += (energies.sum() + force.background(system) / system.volume) * np.eye(3)
    if system.topology is not None:
        pairs, factors = system.topology.scaled
        i, j = pairs.T
        apart = system.box.minimum_image(positions[i] - positions[j])
        r = np.linalg.norm(apart, axis=1)
        falling = 2.0 * split.alpha / math.sqrt(math.pi) * np.exp(-((split.alpha * r) ** 2))
        over_r = (factors - 1.0) * charges[i] * charges[j] * (erf(split.alpha * r) / r - falling) / r**2
        found += np.einsum("m,ma,mb->ab", over_r, apart, apart)
    return np.asarray(found)


def _waves(box: Box, split: Split) -> tuple[Floats, Floats, Floats]:
    """Wave vectors (waves, 3), their squares, and twice their amplitudes 4 pi exp(-k^2 / 4 alpha^2) / (k^2 V)."""
    waves = waves_of(box, split.waves)
    counts = np.diff(waves.first)
    columns = np.repeat(waves.columns, counts, axis=0)
    last = np.arange(len(columns)) - np.repeat(waves.first[:-1], counts)
    triples = np.concatenate([np.column_stack([columns, sign * last]) for sign in (1, -1)])
    k = 2.0 * math.pi * triples[waves.kept.T.ravel() > 0] @ np.linalg.inv(box.matrix).T
    k2 = np.einsum("ij,ij->i", k, k)
    return k, k2, 8.0 * math.pi / box.volume * np.exp(-0.25 * k2 / split.alpha**2) / k2


def _phases(x: Floats, k: Floats) -> Iterator[tuple[slice, NDArray[np.complex128]]]:
    """Yield slices of the waves with exp(i k x) (n, some waves)."""
    step = max(AT_ONCE // len(x), 1)
    for begin in range(0, len(k), step):
        some = slice(begin, begin + step)
        yield some, np.exp(1j * (x @ k[some].T))


def _far_forces(rows: NDArray[np.int64], charges: Floats, x: Floats, box: Box, split: Split) -> Floats:
    if split.mesh:
        from kickdrift.forces.charges.mesh_kernel import mesh_forces  # deferred: it loads the compiler

        return mesh_forces(charges, x, box, split)[rows]
    k, _, amplitude = _waves(box, split)
    found = np.zeros((len(rows), 3))
    for some, phase in _phases(x, k):
        density = charges @ phase
        pull = amplitude[some] * (phase[rows] * density.conj()).imag
        found += charges[rows, None] * (pull @ k[some])
    return found
