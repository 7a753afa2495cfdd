"""Systems whose bodies have changed: some left, some are new."""

from collections.abc import Sequence
from copy import copy

import numpy as np
from numpy.typing import NDArray

from kickdrift.model.state import Floats, State
from kickdrift.model.system import System


def holding(
    system: System,
    ids: NDArray[np.int64],
    phase: Floats,
    masses: Floats,
    radii: Floats | None,
    species_index: NDArray[np.int32],
    names: Sequence[str],
) -> System:
    """The system with these n bodies instead of its own, at ``phase`` (2, 3, n), checked by its forces."""
    other, put = copy(system), object.__setattr__
    put(other, "state", State(np.ascontiguousarray(phase), masses, ids, system.box))
    put(other, "species_index", species_index)
    put(other, "names", tuple(names))
    put(other, "radii", radii)
    for force in other.forces:
        force.check(other)
    return other


def remaining(system: System, keep: NDArray[np.bool_], phase: Floats, masses: Floats, radii: Floats | None) -> System:
    """The system with only the bodies that ``keep`` (n,) marks, under their ids, at ``phase`` (2, 3, n) with these
    masses and radii."""
    return holding(
        system,
        system.state.ids[keep],
        phase[:, :, keep],
        masses[keep],
        None if radii is None else radii[keep],
        system.species_index[keep],
        [name for name, kept in zip(system.names, keep, strict=False) if kept],
    )


def next_id(system: System) -> int:
    """The smallest id above all ids."""
    return int(system.state.ids.max()) + 1


def empty_rows(system: System) -> int:
    """Number of rows for bodies that do not exist yet, which are the last rows."""
    return int(np.isnan(system.state.phase[0, 0]).sum())


def with_empty_rows(system: System, count: int) -> System:
    """The system with ``count`` rows for bodies that do not exist yet: without mass, at nan, under the next ids.

    No force has checked these, so the result serves to describe a file, not to run."""
    if not count:
        return system
    other, old, put = copy(system), system.state, object.__setattr__
    nothing = np.full((2, 3, count), np.nan)
    ids = np.arange(next_id(system), next_id(system) + count, dtype=np.int64)
    phase = np.concatenate([old.phase, nothing], axis=2)
    masses = np.concatenate([old.masses, np.zeros(count)])
    state = State(phase, masses, np.concatenate([old.ids, ids]), old.box, old.time, old.steps_done)
    put(other, "state", state)
    put(other, "species_index", np.concatenate([system.species_index, np.zeros(count, np.int32)]))
    put(other, "names", (*system.names, *(f"new-{k + 1}" for k in range(count) if system.names)))
    for key in ("radii", "charges"):
        own = getattr(system, key)
        put(other, key, None if own is None else np.concatenate([own, np.zeros(count)]))
    return other
