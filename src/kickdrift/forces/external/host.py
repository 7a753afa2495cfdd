"""The Python side of forces that Python computes: it answers calls from compiled code, and keeps what went wrong.

A host belongs to one binding of a force. Its arrays lie in memory that keeps the host alive, so that the machine code
lives as long as the parts that name its address.
"""

from __future__ import annotations

import ctypes
import weakref
from typing import Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.external.kernel import (
    ANSWERS,
    BEGUN,
    CALLS,
    ENERGY,
    FAR,
    KNOWN,
    KNOWN_TO_SAMPLES,
    NOTES,
    PAIRS,
    UNKNOWN,
    VIRIAL,
    ExternalKernel,
)
from kickdrift.forces.seam.kernel import OK, RAISED
from kickdrift.model.memory import Memory
from kickdrift.model.state import Floats

_CALLBACK = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_double, ctypes.c_int64)
_HOSTS: weakref.WeakValueDictionary[int, Host] = weakref.WeakValueDictionary()  # by the address of the machine code


class Host:
    """Python's part of a bound force.

    Attributes
    ----------
    parts : ExternalKernel
    what : name of the function or calculator in messages
    error : first exception that a call raised since a method last began steps, if any
    positions, velocities : (n, 3), as the function sees them; read-only views
    """

    error: BaseException | None = None

    def __init__(
        self,
        what: str,
        factors: Floats,
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
        )
        self.parts.answer[PAIRS] = pairs
        self.positions, self.velocities = (array.view() for array in (self.parts.positions, self.parts.velocities))
        self.positions.flags.writeable = self.velocities.flags.writeable = False
        _HOSTS[address] = self

    def _kept(self, *shape: int) -> Floats:
        """Array of zeros whose memory keeps this host alive."""
        block: Any = (ctypes.c_double * int(np.prod(shape)))()
        block.host = self
        return np.frombuffer(block).reshape(shape)

    def _called(self, time: float, aside: int) -> int:
        self.parts.notes[CALLS] += 1
        try:
            self.answer(time, bool(aside))
        except BaseException as error:  # an exception must not pass through compiled code
            self.error = self.error or error
            return RAISED
        return OK

    def answer(self, time: float, aside: bool) -> None:
        """Fill forces and energy for the present positions and this time. ``aside`` says that a sample asks."""
        raise NotImplementedError

    # --- what calls find ---

    def put(self, forces: Any, energy: float, virial: float) -> None:
        """Store an answer. Raises InputError for forces of a wrong shape."""
        parts = self.parts
        if np.shape(forces) != parts.forces.shape:
            raise InputError(f"returned forces of shape {np.shape(forces)}, expected {parts.forces.shape}")
        parts.forces[...] = forces
        parts.answer[ENERGY], parts.answer[VIRIAL] = energy, virial

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
        self.parts.notes[BEGUN] = 1

    def memory(self) -> Memory | None:
        """State on which later answers depend: the reference; None for a function without one."""
        if not np.isfinite(self.parts.reach2):
            return None
        return {"reference": self.parts.reference.copy() if self.parts.notes[BEGUN] else None}

    def recall(self, memory: Memory) -> None:
        """Restore the reference. The memory may come from a file."""
        reference = memory["reference"]
        there = self.parts.reference
        if reference is not None and (np.shape(reference) != there.shape or not np.isfinite(reference).all()):
            raise InputError("checkpoint: its reference of a calculator belongs to other particles")
        self.begin_anew()
        if reference is not None:
            there[...] = reference
            self.parts.notes[BEGUN] = 1

    def begin_anew(self) -> None:
        """Forget the reference and the last answer."""
        self.parts.notes[BEGUN], self.parts.notes[KNOWN] = 0, UNKNOWN


def host_of(parts: Any) -> Host | None:
    """Host of a bound force's parts, also of a force inside another's parts; None for a compiled force."""
    inner = getattr(parts, "force", parts)
    return _HOSTS[inner.address] if isinstance(inner, ExternalKernel) else None
