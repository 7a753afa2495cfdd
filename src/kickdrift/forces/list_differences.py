"""The variations of a many-body force on its list of neighbours, by central differences along each deviation."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.beside_pairs import BesidePairs, add_by_masses, add_own
from kickdrift.forces.kernel import FORCES, OK, call_force
from kickdrift.forces.pair_kernel import PairKernel
from kickdrift.forces.variations_kernel import STEP
from kickdrift.jit.compile import jit, never_inline
from kickdrift.model.state import Floats

REACH = 0.1 * STEP  # largest displacement, in cutoffs: a force changes over a tenth of its cutoff


class ListDifferences(NamedTuple):
    """A force on a list, and its variations by differences."""

    force: Any  # parts of the particles' force
    address: int  # of the machine code of this force
    work: int
    phase: NDArray[np.float64]  # (2, 3, n) positions and velocities of the particles
    a: NDArray[np.float64]  # (3, n) accelerations of the particles
    by_masses: NDArray[np.float64]  # (n, k) -dm / m along the deviations; (n, 0) if no mass varies
    reach: float  # largest displacement
    ahead: NDArray[np.float64]  # (3, n) accelerations of displaced particles
    behind: NDArray[np.float64]


class ListDifferencesKernel(BesidePairs):
    """A bound many-body force with its variations: ``parts`` is a ListDifferences."""


def bind(own: PairKernel, by_masses: Floats) -> ListDifferencesKernel:
    """Bind a many-body force of n particles; ``by_masses`` is as in `ListDifferences`."""
    a = np.zeros((3, len(by_masses)))
    room = np.zeros((2, *a.shape)), a, by_masses, REACH * own.parts.cutoff, a.copy(), a.copy()
    return ListDifferencesKernel(ListDifferences(own.parts, 0, 0, *room), own)


@jit
def add_differences(force, wanted, t, x, v, a, sums):
    """Add the accelerations of the particles and their deviations. Return a status."""
    status = add_own(force, wanted, t, x, v, a, sums)
    if status != OK:
        return status
    own, n = force.a, force.a.shape[1]
    directions = x.shape[1] // n - 1
    for q in range(directions):
        largest = 0.0
        for k in range(3):
            for i in range(n):
                largest = max(largest, abs(x[k, n + i * directions + q]))
        if largest == 0.0:
            continue
        h = force.reach / largest
        status = displaced(force, t, x, q, h, force.ahead)
        if status == OK:
            status = displaced(force, t, x, q, -h, force.behind)
        if status != OK:
            return status
        for k in range(3):
            for i in range(n):
                a[k, n + i * directions + q] += (force.ahead[k, i] - force.behind[k, i]) / (2.0 * h)
    add_by_masses(force.by_masses, own, a)
    return OK


ListDifferencesKernel.add = add_differences


@jit
def displaced(force, t, x, q, h, there):
    """there <- accelerations of particles moved by h times deviation q. Return a status."""
    never_inline()
    phase, n = force.phase, force.a.shape[1]
    directions = x.shape[1] // n - 1
    for k in range(3):
        for i in range(n):
            phase[0, k, i], there[k, i] = x[k, i] + h * x[k, n + i * directions + q], 0.0
    return call_force(force.address, force.work, FORCES, t, phase[0], phase[1], there, None)
