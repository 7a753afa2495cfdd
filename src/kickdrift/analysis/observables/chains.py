"""Chains of a run: their size, stiffness and self-diffusion, as means over molecules with errors."""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from kickdrift.analysis.observables.motion import MeanSquaredDisplacement, mean_squared_displacement
from kickdrift.analysis.observables.vectors import Vectors, vectors_of
from kickdrift.errors import InputError
from kickdrift.model.molecules.relatives import Ids, molecules_of
from kickdrift.model.state import Floats
from kickdrift.statistics.blocks import Mean, block_average
from kickdrift.trajectory.read import reader
from kickdrift.trajectory.read.frames import Frames
from kickdrift.trajectory.read.universe import topology_of

CALLED = "chain_statistics"


class ChainStatistics(NamedTuple):
    """Sizes of equal chains of N bonds, each a Mean over chains and frames with its standard error (see
    `block_average`): infinite if the run is too short.

    Attributes
    ----------
    end_to_end : <R²>, length²
    gyration : <Rg²>, the squared radius of gyration with the particles' masses, length²
    contour : <L>, the summed lengths of a chain's bonds
    persistence : projection of R on a chain's first bond, <R · b> / <|b|>, a length; also on its last bond
    characteristic_ratio : <R²> / (N <b²>)
    chains, bonds : number of chains, and N of each
    """

    end_to_end: Mean
    gyration: Mean
    contour: Mean
    persistence: Mean
    characteristic_ratio: Mean
    chains: int
    bonds: int


def chain_statistics(run: Frames | str | os.PathLike[str]) -> ChainStatistics:
    """Mean sizes of linear chains of equal length: end to end, gyration, contour and persistence length.

    The errors are by block averages over frames, so frames closer than the relaxation time of a chain add little. The
    persistence length is the projection of the end-to-end vector on the first bond (Flory 1969, Statistical Mechanics
    of Chain Molecules, chapter 4). Bonds are nearest images in the box of their frame.

    Parameters
    ----------
    run : open or by its path, or some of its frames, ``run[100:]``

    Raises
    ------
    InputError
        Without bonds, for rings and branches, and for chains of unlike lengths.
    """
    found = _positions(run)
    order = _order(found)
    masses = found.masses[order]
    rows = np.array([_sizes(bonds, masses) for bonds in _bonds(found, order)])
    squared, gyration, contour, along, lengths, length = rows.T
    bonds = order.shape[1] - 1
    return ChainStatistics(
        block_average(squared),
        block_average(gyration),
        block_average(contour),
        block_average(along / length.mean()),
        block_average(squared / (bonds * lengths.mean())),
        len(order),
        bonds,
    )


def _positions(run: Any) -> Vectors:
    if not isinstance(run, Frames | str | os.PathLike):
        raise InputError(f"chains: expected a run, its path, or some of its frames, got {type(run).__name__}")
    return vectors_of(run, "positions")


def chain_diffusion(run: Frames | str | os.PathLike[str], lags: int | None = None) -> MeanSquaredDisplacement:
    """Mean squared displacement of the chains' centres of mass; its ``diffusion()`` is the chains' D.

    A motion of the centre of mass of all particles counts. Errors and ``lags`` are those of
    `mean_squared_displacement`. Raises InputError as `chain_statistics` does, and for a box that a barostat changes.
    """
    found = _positions(run)
    if found.box_varies:
        raise InputError("chain_diffusion: the box varies, and the centres would scale with it; run at constant volume")
    order = _order(found)
    weights = found.masses[order] / found.masses[order].sum(axis=1, keepdims=True)
    centres = np.array([np.einsum("cn,cnk->ck", weights, x[order]) for x in found.each()])
    found.spacing()  # or its error: uneven frames
    msd = mean_squared_displacement(centres, found.times, lags)
    return MeanSquaredDisplacement(**{**vars(msd), "units": found.units, "dimensions": found.dimensions})


def _order(found: Vectors) -> Ids:
    """Particles (chains, N + 1) of each chain from one end to the other."""
    topology = topology_of(found.source) if isinstance(found.source, reader.Run) else None
    bonds = np.zeros((0, 2), np.int64) if topology is None else np.asarray(topology.bonds)
    if not len(bonds):
        raise InputError(f"{CALLED}: expected a run with bonds; [topology] has none")
    count = np.bincount(bonds.ravel(), minlength=found.particles)
    if (branch := np.flatnonzero(count > 2)).size:
        raise InputError(f"{CALLED}: particle {branch[0]} has {count[branch[0]]} bonds; chains are linear")
    members = molecules_of(bonds, found.particles)
    size = np.bincount(members)
    ends = np.flatnonzero(count == 1)
    starts = ends[np.unique(members[ends], return_index=True)[1]]
    closed = np.setdiff1d(members[count > 0], members[ends])
    if closed.size:
        raise InputError(
            f"{CALLED}: particle {np.flatnonzero(members == closed[0])[0]} is in a ring; a ring has no ends"
        )
    lengths = size[members[starts]]
    if np.ptp(lengths):
        raise InputError(f"{CALLED}: chains have {lengths.min()} to {lengths.max()} particles; means need equal chains")
    neighbours: list[list[int]] = [[] for _ in range(found.particles)]
    for i, j in bonds.tolist():
        neighbours[i].append(j)
        neighbours[j].append(i)
    rows = []
    for start in starts.tolist():
        row = [start, neighbours[start][0]]
        while len(row) < lengths[0]:
            row.append(next(each for each in neighbours[row[-1]] if each != row[-2]))
        rows.append(row)
    return np.array(rows, np.int64)


def _bonds(found: Vectors, order: Ids) -> Iterator[Floats]:
    """Bond vectors (chains, N, 3) of each frame."""
    for x, box in zip(found.each(), found.boxes, strict=True):
        steps = x[order[:, 1:]] - x[order[:, :-1]]
        yield box.minimum_image(steps.reshape(-1, 3)).reshape(steps.shape)


def _sizes(bonds: Floats, masses: Floats) -> tuple[float, ...]:
    """Means over the chains of a frame: R², Rg², contour, R along the end bonds, b², and the length of end bonds."""
    across = bonds.sum(axis=1)
    lengths = np.linalg.norm(bonds, axis=2)
    along = 0.5 * np.einsum("ck,ck->c", across, bonds[:, 0] + bonds[:, -1])
    places = np.concatenate([np.zeros((len(bonds), 1, 3)), np.cumsum(bonds, axis=1)], axis=1)
    weights = masses / masses.sum(axis=1, keepdims=True)
    apart = places - np.einsum("cn,cnk->ck", weights, places)[:, None]
    gyration = np.einsum("cn,cnk,cnk->c", weights, apart, apart)
    ends = 0.5 * (lengths[:, 0] + lengths[:, -1])
    return tuple(
        float(np.mean(each))
        for each in ((across**2).sum(axis=1), gyration, lengths.sum(axis=1), along, lengths**2, ends)
    )
