"""Both sides of forces that Python computes: compiled code passes positions and velocities, and adds what comes back.

The kernel asks Python only where positions changed since the last answer, so a sample costs no second calculation.

The `Host` is the Python side: it answers calls from compiled code, and keeps what went wrong. A host belongs to one
binding of a force. Its arrays lie in memory that keeps the host alive, so that the machine code lives as long as the
parts that name its address.
"""

from __future__ import annotations

import ctypes
import math
import weakref
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.forces.lists.along import ALL
from kickdrift.forces.seam.kernel import BLOWN_UP, OK, RAISED, kernel
from kickdrift.forces.seam.samples import SINCE, no_looks, note_look, sums_expected
from kickdrift.jit.compile import is_finite, never_inline
from kickdrift.jit.inner import by_type
from kickdrift.model.box.box import Box
from kickdrift.model.box.cell import Cell, cell_of, follow, lengths_and_tilts
from kickdrift.model.box.edges import lower
from kickdrift.model.memory import Memory
from kickdrift.model.state import Floats

# Slots of ``notes``: whether the answer is known (see below), whether there is a reference, whether the present
# positions are beyond its reach, the number of calls of Python, and whether the answer has no energy and virial.
KNOWN, BEGUN, FAR, CALLS, FORCES_ONLY, NOTES = range(6)
UNKNOWN, KNOWN_TO_ALL, KNOWN_TO_SAMPLES = range(3)  # the last: a sample has moved on, which the run must do itself
ASIDE, SUMS = 1, 2  # what a call tells Python: a sample asks; energy and virial are needed
TIME, ENERGY, VIRIAL, PAIRS, ALONG = range(5)  # slots of ``answer``; the last six hold the virial as `lists.along` does
ANSWERS = ALONG + 6


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
    cell: Cell  # in the system's lengths
    begun_in: NDArray[np.float64]  # (6,) edge lengths and tilts at which the function last began anew, as in `Cell`
    looks: NDArray[np.int64]  # see `seam.samples`
    along: Any = None  # virial of one chunk, for a barostat; see `lists.along`


@intrinsic
def call_python(typingctx, address, t, flags):
    """Call the machine code at an address with a time and ASIDE and SUMS; return its status."""

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
    same = not follow(force.cell) and notes[KNOWN] != UNKNOWN and not (force.clocked and answer[TIME] != t)
    farthest, bad = 0.0, 0.0
    for k in range(force.cell.live.size):
        if force.cell.live[k] != force.begun_in[k]:
            farthest = math.inf
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
    if same and sums is not None and force.looks[SINCE] > 0:
        note_look(force.looks)
    unsummed = sums is not None and notes[FORCES_ONLY] != 0
    if not same or unsummed or (notes[KNOWN] == KNOWN_TO_SAMPLES and not force.aside):
        summed = sums is not None if same or force.aside else sums_expected(force.looks, sums is not None)
        far = is_finite(force.reach2) and (notes[BEGUN] == 0 or farthest > force.reach2)
        notes[FAR] = far
        if not same:
            notes[KNOWN] = UNKNOWN
        status = call_python(force.address, t, ASIDE * force.aside + SUMS * summed)
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
        put_along(force.along, answer)
    return OK


@by_type
def put_along(along, answer):
    """Write the virial along each axis, if it is asked."""
    if isinstance(along, types.NoneType):
        return lambda along, answer: None

    if along.ndim == ALL:

        def put_all(along, answer):
            for k in range(6):
                along[0, k // 3, k % 3] = answer[ALONG + k]

        return put_all

    def put(along, answer):
        for k in range(3):
            along[0, k] = answer[ALONG + k]

    return put


_CALLBACK = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_double, ctypes.c_int64)
_HOSTS: weakref.WeakValueDictionary[int, Host] = weakref.WeakValueDictionary()  # by the address of the machine code


class Host:
    """Python's part of a bound force.

    Attributes
    ----------
    parts : ExternalKernel
    what : name of the function or calculator in messages
    error : first exception that a call raised since a method last began steps, if any
    summing : whether this call needs the energy and the virial
    positions, velocities : (n, 3), as the function sees them; read-only views
    """

    error: BaseException | None = None
    summing = True
    _seen = b""  # the matrix of ``box``

    def __init__(
        self,
        what: str,
        factors: Floats,
        box: Box,
        *,
        scale: float = 1.0,
        reach: float = np.inf,
        moving: bool = False,
        clocked: bool = False,
        sees_velocities: bool = True,
        pairs: float = 0.0,
    ) -> None:
        n = len(factors)
        self.what = what
        self._callback = _CALLBACK(self._called)
        address = ctypes.cast(self._callback, ctypes.c_void_p).value
        assert address is not None
        self.parts = ExternalKernel(
            address=address,
            aside=False,
            moving=moving,
            clocked=clocked,
            scale=scale,
            reach2=reach * reach,
            notes=np.zeros(NOTES, np.int64),
            answer=np.zeros(ANSWERS),
            positions=self._kept(n, 3),
            velocities=np.zeros((n if sees_velocities else 0, 3)),
            forces=np.zeros((n, 3)),
            reference=np.zeros((n, 3)),
            factors=factors,
            cell=cell_of(box),
            begun_in=np.zeros(6),
            looks=no_looks(),
        )
        self.box = box
        self.parts.answer[PAIRS] = pairs
        self.positions, self.velocities = (array.view() for array in (self.parts.positions, self.parts.velocities))
        self.positions.flags.writeable = self.velocities.flags.writeable = False
        _HOSTS[address] = self

    def _kept(self, *shape: int) -> Floats:
        """Array of zeros whose memory keeps this host alive."""
        block: Any = (ctypes.c_double * int(np.prod(shape)))()
        block.host = self
        return np.frombuffer(block).reshape(shape)

    def _called(self, time: float, flags: int) -> int:
        self.parts.notes[CALLS] += 1
        self.summing = bool(flags & SUMS)
        try:
            self.answer(time, bool(flags & ASIDE))
        except BaseException as error:  # an exception must not pass through compiled code
            self.error = self.error or error
            return RAISED
        return OK

    def answer(self, time: float, aside: bool) -> None:
        """Fill forces and energy for the present positions and this time. ``aside`` says that a sample asks."""
        raise NotImplementedError

    # --- what calls find ---

    def put(self, forces: Any, energy: float, virial: float, along: Any = np.nan) -> None:
        """Store an answer, whose virial (6,) may be known ``along`` and across the axes: xx, yy, zz, yz, xz, xy. Raises
        InputError for forces of a wrong shape. A host that leaves out energy and virial sets FORCES_ONLY then."""
        parts = self.parts
        if np.shape(forces) != parts.forces.shape:
            raise InputError(f"returned forces of shape {np.shape(forces)}, expected {parts.forces.shape}")
        parts.forces[...] = forces
        parts.answer[ENERGY], parts.answer[VIRIAL] = energy, virial
        parts.answer[ALONG:] = along
        parts.notes[FORCES_ONLY] = 0

    @property
    def calls(self) -> int:
        """Number of times that compiled code has called Python."""
        return int(self.parts.notes[CALLS])

    @property
    def failure(self) -> str:
        """One line about the call that raised, or about a last answer without a finite energy or finite forces; else
        ""."""
        if (error := self.error) is not None:
            what = str(error) if isinstance(error, InputError) else f"raised {type(error).__name__}: {error}"
            return " ".join(f"{self.what} {what}".split())
        return f"{self.what} {trouble}" if (trouble := self._trouble()) else ""

    def _trouble(self) -> str:
        parts = self.parts
        bad = np.flatnonzero(~np.isfinite(parts.forces).all(axis=1))
        if bad.size:
            return f"returned a force on particle {bad[0]} that is not finite"
        energy = float(parts.answer[ENERGY])
        return "" if np.isfinite(energy) else f"returned the energy {energy}"

    # --- the reference, from which the function's own memory begins ---

    @property
    def far(self) -> bool:
        """Whether the present positions are beyond the reach of the reference."""
        return bool(self.parts.notes[FAR])

    @property
    def follows_sample(self) -> bool:
        """Whether a sample has answered already, so that the run moves the reference alone."""
        return bool(self.parts.notes[KNOWN] == KNOWN_TO_SAMPLES)

    def begin_here(self) -> None:
        """Make the present positions the reference."""
        self.parts.reference[...] = self.parts.positions
        self.parts.begun_in[...] = lengths_and_tilts(self.parts.cell.matrix)
        self.parts.notes[BEGUN] = 1

    @property
    def box_now(self) -> Box:
        """The box at this call, which a barostat may have changed."""
        matrix = self.parts.cell.matrix
        if matrix.tobytes() == self._seen:
            return self.box
        self._seen = matrix.tobytes()
        if not np.array_equal(matrix, np.where(np.array(self.box.periodic_axes)[:, None], self.box.matrix, 0.0)):
            self.box = self.box.with_edges(lower(matrix))
        return self.box

    def memory(self, varies: bool = False) -> Memory | None:
        """State on which later answers depend: the reference, and in a box that ``varies`` its edge lengths; None for a
        function without a reference."""
        if not np.isfinite(self.parts.reach2):
            return None
        begun = bool(self.parts.notes[BEGUN])
        found = {"reference": self.parts.reference.copy() if begun else None}
        return found | ({"begun_in": self.parts.begun_in.copy()} if varies and begun else {})

    def recall(self, memory: Memory) -> None:
        """Restore the reference. The memory may come from a file."""
        reference = memory["reference"]
        there = self.parts.reference
        begun_in = memory.get("begun_in", lengths_and_tilts(self.parts.cell.matrix))
        if np.shape(begun_in) not in ((3,), (6,)) or not np.isfinite(begun_in).all():
            raise InputError("checkpoint: its reference of a calculator belongs to another box")
        if reference is not None and (np.shape(reference) != there.shape or not np.isfinite(reference).all()):
            raise InputError("checkpoint: its reference of a calculator belongs to other particles")
        self.begin_anew()
        if reference is not None:
            there[...], self.parts.begun_in[: len(begun_in)] = reference, begun_in
            self.parts.notes[BEGUN] = 1

    def begin_anew(self) -> None:
        """Forget the reference and the last answer."""
        self.parts.notes[BEGUN], self.parts.notes[KNOWN] = 0, UNKNOWN


def host_of(parts: Any) -> Host | None:
    """Host of a bound force's parts, also of a force inside another's parts; None for a compiled force."""
    inner = getattr(parts, "force", parts)
    return _HOSTS[inner.address] if isinstance(inner, ExternalKernel) else None
