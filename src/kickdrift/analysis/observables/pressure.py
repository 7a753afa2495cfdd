"""Pressure tensor at a run's frames, from the forces between pairs of particles."""

import os
from typing import NamedTuple

import numpy as np

from kickdrift.analysis.observables.vectors import relative, vectors_of
from kickdrift.errors import InputError
from kickdrift.integrators import integrator
from kickdrift.looks.pressure import instantaneous_pressure
from kickdrift.model.box.box import Box
from kickdrift.model.freedom import DRIFT, apart_of
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.statistics.blocks import block_average
from kickdrift.trajectory.layout.record import system_of
from kickdrift.trajectory.read import reader
from kickdrift.trajectory.read.frames import Frames


class PressureTensor(NamedTuple):
    """Pressure tensor over time, in energy per volume.

    ``tensors`` (f, 3, 3) are at ``times`` (f,). ``tensor`` is their mean and ``error`` its standard error, both (3, 3).
    ``pressure`` is a third of the mean's trace, with its error ``pressure_error``. Errors are by block averages over
    frames, infinite if there are too few frames.
    """

    times: Floats
    tensors: Floats
    tensor: Floats
    error: Floats
    pressure: float
    pressure_error: float


def pressure_tensor(run: Frames | str | os.PathLike[str], system: System | None = None) -> PressureTensor:
    """P = (sum of m v v + sum over pairs of r F) / V at the frames of a run in a periodic box.

    Allen & Tildesley 2017, eqs. 2.60 and 2.67, doi:10.1093/oso/9780198803195.001.0001. Velocities are relative to the
    centre of mass, unless the run's method or a field changes the total momentum. The stress tensor is the negative.
    The trace over the number of dimensions is the pressure that the run itself reports. Pair forces act as in the run,
    with the same compiled law, truncation and tail. Springs act too. Fields act on single particles and do not
    contribute. Each frame counts in its own box.

    Parameters
    ----------
    run : open or by its path, or some of its frames, ``run[::10]``
    system : System with the forces; default the run's own, from the file

    Raises
    ------
    InputError
        For an open box, or if a force is neither a pair force nor a field.
    """
    positions = vectors_of(run, "positions")
    velocities = vectors_of(run, "velocities")
    if not isinstance(positions.source, reader.Run):
        raise InputError("pressure_tensor: expected a run, because it needs the forces; got an array")
    assert positions.times is not None
    system, run_box = system_of(positions.source) if system is None else system, positions.source.box
    if len(system) != positions.particles:
        raise InputError(f"pressure_tensor: the system has {len(system)} particles, the run {positions.particles}")
    apart = min(DRIFT, apart_of(system, _drags(positions.source)))
    pieces = relative(velocities.pieces(), velocities.pieces(), system.coherent_masses, apart)
    heat = np.ones((len(system), 1)) if system.fixed is None else system.fixed.free(np.ones(len(system)))[:, None]
    moving = (v * heat for piece in pieces for v in piece)
    tensors = np.array(
        [
            instantaneous_pressure(system if box is run_box else _in_box(system, box), x, v)
            for x, v, box in zip(positions.each(), moving, positions.boxes, strict=True)
        ]
    )
    mean = block_average(tensors)
    trace = block_average(np.trace(tensors, axis1=1, axis2=2) / system.dimensions)
    return PressureTensor(positions.times, tensors, mean.value, mean.error, float(trace.value), float(trace.error))


def _drags(run: reader.Run) -> bool:
    """Whether the run's method changes the total momentum; a method that is not known here does not."""
    try:
        return integrator(str(run.method.get("integrator"))).drags
    except InputError:
        return False


def _in_box(system: System, box: Box) -> System:
    """The system in the box of a frame, which must fit its cutoffs."""
    found = system.at(system.state.phase, system.state.time, box=box)
    for force in found.forces:
        force.check(found)
    return found
