"""The dielectric constant of a liquid of neutral molecules, from the fluctuations of its dipole."""

from __future__ import annotations

import math
import os
from typing import NamedTuple

import numpy as np

from kickdrift.analysis.observables.vectors import vectors_of
from kickdrift.errors import InputError
from kickdrift.model.box.box import Box
from kickdrift.model.molecules.relatives import Ids, molecules_of, whole
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.statistics.blocks import block_average
from kickdrift.trajectory.layout.record import system_of
from kickdrift.trajectory.read import reader
from kickdrift.trajectory.read.frames import Frames

NEUTRAL = 1e-6  # of the largest charge


class Dielectric(NamedTuple):
    """A static dielectric constant, its standard error, and the dipole of the box (frames, 3) in charge times length.

    The error is by block averages, infinite if the run is too short. A dipole of water keeps its direction for about
    10 ps."""

    value: float
    error: float
    dipoles: Floats


def dielectric_constant(run: Frames | str | os.PathLike[str], temperature: float | None = None) -> Dielectric:
    """Dielectric constant 1 + 4π C <M²> / (3 V k_B T) of a liquid under Ewald's sum, for the dipole M of the box.

    Neumann 1983, Mol. Phys. 50, 841, doi:10.1080/00268978300102721, for a sum with conducting surroundings (tin foil).
    C is Coulomb's constant. The mean dipole of a liquid is zero by symmetry, so it is not estimated. Molecules are
    particles that bonds, constraints or virtual sites join; each must be neutral. Each frame counts in its own box.

    Parameters
    ----------
    run : open or by its path, or some of its frames, ``run[100:]``
    temperature : of the liquid; default the mean of the run's samples

    Raises
    ------
    InputError
        For particles without charges or with a charged molecule, an open box, and a temperature that is not positive.
    """
    found = vectors_of(run, "positions")
    if not isinstance(found.source, reader.Run):
        raise InputError("dielectric_constant: expected a run, because it needs the molecules; got an array")
    if not all(found.box.periodic_axes):
        raise InputError("dielectric_constant: needs a periodic box; open space has no volume")
    system = system_of(found.source)
    charges, coulomb = system.charges, system.units.coulomb
    if charges is None or coulomb is None or not charges.any():
        raise InputError("dielectric_constant: the run's particles have no charges")
    joined = _joined(system)
    own = np.bincount(molecules_of(joined, len(system)), charges)
    if (charged := np.flatnonzero(np.abs(own) > NEUTRAL * np.abs(charges).max())).size:
        raise InputError(
            f"dielectric_constant: molecule {charged[0]} has the charge {own[charged[0]]:.6g}, and the dipole of a "
            "box with ions depends on their images"
        )
    if temperature is None:
        temperature = float(np.mean(found.source.observables["temperature"]))
    if not (math.isfinite(temperature) and temperature > 0):
        raise InputError(f"dielectric_constant: temperature must be positive, got {temperature}")
    boxes = found.boxes
    dipoles = np.array([_dipole(charges, joined, x, box) for x, box in zip(found.each(), boxes, strict=True)])
    scale = 4.0 * math.pi * coulomb / (3.0 * system.units.boltzmann * temperature)
    mean = block_average(scale * (dipoles**2).sum(axis=1) / [box.volume for box in boxes])
    return Dielectric(1.0 + float(mean.value), float(mean.error), dipoles)


def _joined(system: System) -> Ids:
    """Pairs (m, 2) of particles that belong to one molecule."""
    pairs = [np.zeros((0, 2), np.int64)]
    if system.topology is not None:
        pairs.append(system.topology.bonds)
    if system.constraints is not None:
        pairs.append(system.constraints.pairs)
    if system.virtual_sites is not None:
        pairs.append(np.column_stack([system.virtual_sites.particles, system.virtual_sites.of[:, 0]]))
    return np.concatenate(pairs)


def _dipole(charges: Floats, joined: Ids, x: Floats, box: Box) -> Floats:
    """Sum (3,) of charges times places in whole molecules, at positions x (n, 3)."""
    places = whole(joined, len(x), lambda i, j: box.minimum_image(x[j] - x[i]))
    return np.asarray(charges @ places)
