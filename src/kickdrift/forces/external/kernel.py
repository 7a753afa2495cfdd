"""The compiled side of forces that Python computes: it passes positions and velocities, and adds what comes back.

The kernel asks Python only where positions changed since the last answer, so a sample costs no second calculation.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from kickdrift.forces.seam.kernel import BLOWN_UP, OK, kernel
from kickdrift.jit.compile import is_finite, never_inline

# Slots of ``notes``: whether the answer is known (see below), whether there is a reference, whether the present
# positions are beyond its reach, and the number of calls of Python.
KNOWN, BEGUN, FAR, CALLS, NOTES = range(5)
UNKNOWN, KNOWN_TO_ALL, KNOWN_TO_SAMPLES = range(3)  # the last: a sample has moved on, which the run must do itself
TIME, ENERGY, VIRIAL, PAIRS, ANSWERS = range(5)  # slots of ``answer``


class ExternalKernel(NamedTuple):
    """A force computed in Python, bound to a System."""

    address: int  # of the machine code that calls Python
    aside: bool  # whether this serves samples, which change no reference
    moving: bool  # whether the force depends on velocities
    clocked: bool  # whether the force depends on time
    scale: float  # factor from the system's lengths to the function's
    reach2: float  # squared distance from the reference, in the function's lengths; infinite for no reference
    notes: NDArray[np.int64]  # (NOTES,)
    answer: NDArray[np.float64]  # (ANSWERS,)
    positions: NDArray[np.float64]  # (n, 3) in the function's lengths
    velocities: NDArray[np.float64]  # (n, 3); (0, 3) for a force that sees none
    forces: NDArray[np.float64]  # (n, 3) in the function's units
    reference: NDArray[np.float64]  # (n, 3) positions at which the function last began anew
    factors: NDArray[np.float64]  # (n,) accelerations from forces: the unit of force over the mass


@intrinsic
def call_python(typingctx, address, t, aside):
    """Call the machine code at an address with a time and a number; return its status."""

    def codegen(context, builder, sig, args):
        whole, double = ir.IntType(64), ir.DoubleType()
        kind = ir.FunctionType(whole, [double, whole])
        return builder.call(builder.inttoptr(args[0], kind.as_pointer()), [args[1], args[2]])

    return types.int64(types.int64, types.float64, types.int64), codegen


@kernel(ExternalKernel)
def external_forces(force, t, x, v, a, sums):
    never_inline()
    n, notes, answer, scale = x.shape[1], force.notes, force.answer, force.scale
    places, speeds, reference = force.positions, force.velocities, force.reference
    same = notes[KNOWN] != UNKNOWN and not (force.clocked and answer[TIME] != t)
    farthest, bad = 0.0, 0.0
    for i in range(n):
        apart2 = 0.0
        for k in range(3):
            here = x[k, i] * scale
            if here != places[i, k]:
                same = False
                places[i, k] = here
            d = here - reference[i, k]
            apart2 += d * d
            bad += 0.0 * here
        farthest = max(farthest, apart2)
    for i in range(speeds.shape[0]):
        for k in range(3):
            if force.moving and speeds[i, k] != v[k, i]:
                same = False
            speeds[i, k] = v[k, i]
            bad += 0.0 * v[k, i]
    if bad != 0.0:
        notes[KNOWN] = UNKNOWN
        return BLOWN_UP
    if not same or (notes[KNOWN] == KNOWN_TO_SAMPLES and not force.aside):
        far = is_finite(force.reach2) and (notes[BEGUN] == 0 or farthest > force.reach2)
        notes[FAR] = far
        if not same:
            notes[KNOWN] = UNKNOWN
        status = call_python(force.address, t, force.aside)
        if status != OK:
            notes[KNOWN] = UNKNOWN
            return status
        answer[TIME] = t
        notes[KNOWN] = KNOWN_TO_SAMPLES if far and force.aside else KNOWN_TO_ALL
    total = answer[ENERGY]
    for i in range(n):
        for k in range(3):
            total += force.forces[i, k]
            a[k, i] += force.forces[i, k] * force.factors[i]
    if not is_finite(total):
        notes[KNOWN] = UNKNOWN
        return BLOWN_UP
    if sums is not None:
        sums[0] += answer[ENERGY]
        sums[1] += answer[VIRIAL]
        sums[2] += answer[PAIRS]
    return OK
