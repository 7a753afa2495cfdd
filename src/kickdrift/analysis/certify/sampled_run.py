"""Kinetic and potential energies of a run's samples, from files, Simulations and trajectories of other programs."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kickdrift.analysis.certify.canonical import Point
from kickdrift.analysis.observables.vectors import relative, vectors_of
from kickdrift.errors import InputError
from kickdrift.integrators import integrator
from kickdrift.integrators.options import RAMPED
from kickdrift.looks.molecules import KINDS, Molecules
from kickdrift.looks.observers import Sample
from kickdrift.looks.record import even_stretch
from kickdrift.model.freedom import DRIFT, NONE, TURN, apart_of, disturbing, free_masses, freedom_of, turning
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.model.units import constants
from kickdrift.run.simulation import Simulation
from kickdrift.trajectory.read import reader
from kickdrift.trajectory.read.frames import Frames
from kickdrift.trajectory.read.info import warnings_of
from kickdrift.trajectory.read.universe import mdanalysis

AXES = "xyz"
AT_REST = 0.1  # change of the total momentum over its thermal size, below which another program conserves it
BARELY = 1e-6  # degrees of freedom; fewer are rounding
ANGSTROM_PS = constants.ATOMIC_MASS * 1e4  # J in u angstrom^2 / ps^2
BAR = 1e5 * 1e-30 / ANGSTROM_PS  # bar in u / (angstrom ps^2)


@dataclass(frozen=True)
class Group:
    """A part of the degrees of freedom: an axis or a species.

    Attributes
    ----------
    name : what the page calls the part
    freedom : number of degrees of freedom
    kinetic : (k,) kinetic energy of the part in each sample
    """

    name: str
    freedom: float
    kinetic: Floats


@dataclass(frozen=True)
class SampledRun:
    """Energies of a run at equally spaced samples.

    Attributes
    ----------
    name : path of the file, or a word for another source
    boltzmann : in the run's units
    particles : number of particles with mass
    freedom : degrees of freedom of the kinetic energy
    kinetic : (k,) kinetic energies
    groups : axes, and species if there are two or more; empty if the source has no velocities
    potential : (k,) potential energies, or None
    volume : (k,) volumes; infinite for open boxes
    temperature, pressure : of the run's heat bath and barostat; None without
    bath : whether the run exchanges heat with a bath
    likeness : equal for runs of the same system
    notes : remarks for the user
    pressures : (k,) pressures of a run with a barostat; None without
    """

    name: str
    boltzmann: float
    particles: int
    freedom: float
    kinetic: Floats
    groups: tuple[Group, ...]
    potential: Floats | None
    volume: Floats
    temperature: float | None
    pressure: float | None
    bath: bool
    likeness: Any
    notes: tuple[str, ...] = ()
    pressures: Floats | None = None

    def from_sample(self, first: int) -> SampledRun:
        """The same run without the samples before ``first``."""
        groups = tuple(replace(each, kinetic=each.kinetic[first:]) for each in self.groups)
        potential, pressures = (each if each is None else each[first:] for each in (self.potential, self.pressures))
        return replace(
            self, kinetic=self.kinetic[first:], groups=groups, potential=potential, volume=self.volume[first:],
            pressures=pressures,
        )  # fmt: skip

    def constrained(self, count: int) -> SampledRun:
        """The same run with rigid bonds or angles. Each takes a degree of freedom, a third on average from each axis.
        Which species it takes from is unknown, so species are left out."""
        axes = [each for each in self.groups if each.name.startswith("axis")]
        groups = tuple(replace(each, freedom=each.freedom - count / len(axes)) for each in axes)
        if self.freedom <= count:
            raise InputError(f"constraints: {count} leave none of {self.freedom:g} degrees of freedom")
        note = f"{count} constraints: {self.freedom - count:g} degrees of freedom, and species are not tested"
        return replace(self, freedom=self.freedom - count, groups=groups, notes=(*self.notes, note))

    @property
    def point(self) -> Point:
        """The point of the run. The run must have a temperature."""
        assert self.temperature is not None
        return Point(self.temperature, self.pressure, self.boltzmann, self.particles, float(self.volume.mean()))


def sampled_run(source: Any) -> SampledRun:
    """Energies of a run: a path, an open Run or some of its frames, a Simulation, or an MDAnalysis Universe.

    Raises InputError for anything else, and for runs without velocities."""
    if isinstance(source, Simulation):
        return _of_simulation(source)
    if isinstance(source, str | os.PathLike):
        with reader.open(source) as run:
            return _of_frames(run)
    if isinstance(source, Frames):
        return _of_frames(source)
    if type(source).__module__.startswith("MDAnalysis"):
        return _of_universe(source)
    raise InputError(
        "runs: expected the path of a run's file, an open run, a Simulation or an MDAnalysis Universe, "
        f"got {type(source).__name__}"
    )


def kinetic_groups(
    velocities: Callable[[], Any],
    masses: Floats,
    species: NDArray[np.str_],
    dimensions: int,
    conserved: bool,
    turns: Floats | None = None,
) -> tuple[Group, ...]:
    """Kinetic energies by axis and by species, from pieces (k, n, 3) of velocities without the motion of the whole.

    A total momentum that is conserved takes one degree of freedom from each axis. It takes the share
    m_s / M of each axis from a species of mass m_s: <m_i v_i^2> = k_B T (1 - m_i / M). ``turns`` (n, 3) are the degrees
    of freedom that a conserved angular momentum takes from each component."""
    turns = np.zeros((len(masses), 3)) if turns is None else turns
    moving, names = masses > 0, list(dict.fromkeys(species[masses > 0].tolist()))
    axes, kinds = [], []
    weights = np.array([np.where(species == name, masses, 0.0) for name in names])
    for piece in velocities():
        squares = piece[:, :, :dimensions] ** 2
        axes.append(0.5 * np.einsum("n,fnk->fk", masses, squares))
        kinds.append(0.5 * np.einsum("sn,fnk->fs", weights, squares))
    by_axis, by_kind = np.concatenate(axes), np.concatenate(kinds)
    count, lost = int(moving.sum()), 1.0 if conserved else 0.0
    found = [Group(f"axis {AXES[k]}", count - lost - turns[:, k].sum(), by_axis[:, k]) for k in range(dimensions)]
    if len(names) > 1:
        for k, name in enumerate(names):
            share = weights[k].sum() / masses.sum()
            freedom = dimensions * (int((moving & (species == name)).sum()) - lost * share)
            freedom -= turns[species == name, :dimensions].sum()
            found.append(Group(f"species {name}", freedom, by_kind[:, k]))
    return tuple(each for each in found if each.freedom > BARELY)


def molecule_groups(molecules: Molecules, places: Iterable[Floats], velocities: Iterable[Floats]) -> tuple[Group, ...]:
    """Heat of each kind of motion of molecules with constraints, from frames (n, 3); none where all turn together."""
    if molecules.freedoms is None:
        return ()
    heats = np.array([molecules.heats(np.array([x.T, v.T])) for x, v in zip(places, velocities, strict=True)])
    kinds = zip(KINDS, molecules.freedoms, heats.T, strict=True)
    return tuple(Group(f"{kind} of molecules", float(freedom), heat) for kind, freedom, heat in kinds if freedom > 0)


def _of_frames(frames: Frames) -> SampledRun:
    run: Any = frames.run
    name = str(run.path)
    if not len(frames):
        raise InputError(f"{name}: holds no frames")
    system = run.system()
    vectors = vectors_of(frames, "velocities")
    apart, bath, note = _apart(run.method["integrator"], system)
    masses = vectors.masses * run.units.coherent_mass
    if system.fixed is not None:
        masses = system.fixed.free(masses)
    places, turns = vectors, None
    if apart == TURN or system.constraints is not None:
        places = vectors_of(frames, "positions")
    if apart == TURN:
        turns = np.mean([turning(masses, x.T).T for x in places.each()], axis=0)
    if system.constraints is not None:
        groups = molecule_groups(
            Molecules(system, integrator(run.method["integrator"]).drags), places.each(), vectors.each()
        )
    else:
        groups = kinetic_groups(
            lambda: relative(vectors.pieces(), places.pieces(), masses, apart),
            masses, vectors.species, vectors.dimensions, apart != NONE, turns,
        )  # fmt: skip
    if not groups:
        raise InputError(f"{name}: no degree of freedom is left to test")
    vectors.spacing()  # raises an error if samples are not equally spaced
    seen = run.framed(slice(None))
    potential, pressures = seen.get("potential_energy"), seen.get("pressure")
    pressure = _pressure(run.method, name)
    boxes = run.boxes_of(range(len(run)))
    axes = groups[: vectors.dimensions] if system.constraints is None else groups  # all kinds of motion
    return SampledRun(
        name=name,
        boltzmann=run.units.boltzmann,
        particles=int(np.count_nonzero(masses)),
        freedom=sum(each.freedom for each in axes),
        kinetic=np.sum([each.kinetic for each in axes], axis=0),
        groups=groups,
        potential=None if potential is None else potential[vectors.chosen],
        volume=np.array([boxes[row].volume for row in vectors.chosen]),
        temperature=_temperature(run.method, name),
        pressure=pressure,
        bath=bath,
        likeness=_likeness(system, pressure is None),
        notes=(note, *warnings_of(run)),
        pressures=None if pressure is None or pressures is None else pressures[vectors.chosen],
    )


def _of_simulation(sim: Simulation) -> SampledRun:
    system, name = sim.system, "the Simulation"
    if not isinstance(system, System):
        raise InputError(f"{name} runs a Problem, and an ensemble needs particles")
    samples = sim.record.samples
    samples = samples[even_stretch(np.array([each.step for each in samples]))]
    if len(samples) < 2:
        raise InputError(f"{name} holds {len(samples)} samples; call run() first")
    apart, bath, note = _apart(sim.integrator, system)
    freedom = freedom_of(system, integrator(sim.integrator).drags)
    count = int(np.count_nonzero(free_masses(system)))
    return SampledRun(
        name=name,
        boltzmann=system.units.boltzmann,
        particles=count,
        freedom=freedom,
        kinetic=np.array([_heat(each, 0.5 * freedom * system.units.boltzmann, apart) for each in samples]),
        groups=(),
        potential=np.array([each.energies.potential for each in samples]),
        volume=np.array([each.volume if sim.box_varies else system.volume for each in samples]),
        temperature=_temperature(sim.options, name),
        pressure=_pressure(sim.options, name),
        bath=bath,
        likeness=_likeness(system, not sim.box_varies),
        notes=(
            note,
            f"{name} keeps no velocities: axes and species are tested from a run's file",
            *sim.report().warnings,
        ),
    )


def _of_universe(given: Any) -> SampledRun:
    """Velocities of an MDAnalysis Universe or AtomGroup, in angstrom/ps; masses in u, temperatures in K."""
    MDAnalysis = mdanalysis("an MDAnalysis trajectory")
    atoms, trajectory, name = given.atoms, given.universe.trajectory, "the Universe"
    try:
        masses = np.asarray(atoms.masses, dtype=float)
    except MDAnalysis.NoDataError:
        raise InputError(f"{name} has no masses; add them with add_TopologyAttr") from None
    if not np.all(masses > 0):
        raise InputError(f"{name}: atom {int(np.argmin(masses))} has mass {masses.min():g}; set the atoms' masses")
    if not trajectory.ts.has_velocities:
        raise InputError(f"{name} has no velocities; write them to the trajectory (GROMACS .trr, AMBER .nc, H5MD)")
    velocities, volumes = np.empty((len(trajectory), len(atoms), 3)), np.empty(len(trajectory))
    for k, ts in enumerate(trajectory):
        velocities[k], volumes[k] = atoms.velocities, ts.volume or np.inf
    kinds: NDArray[np.str_] = np.asarray(atoms.types if hasattr(atoms, "types") else ["A"] * len(atoms), dtype=str)
    momentum = np.einsum("n,fnk->fk", masses, velocities)
    whole = (momentum.mean(axis=0) ** 2).sum() / masses.sum()
    thermal = (np.einsum("n,fnk->f", masses, velocities**2).mean() - whole) / (3 * len(atoms))
    conserved = bool(((momentum - momentum.mean(axis=0)) ** 2).mean() < AT_REST**2 * masses.sum() * thermal)
    apart = DRIFT if conserved else NONE
    groups = kinetic_groups(
        lambda: relative([velocities], [velocities], masses, apart), masses, kinds, 3, conserved
    )  # fmt: skip
    motion = "stays: 3 N - 3" if conserved else "changes: 3 N"
    return SampledRun(
        name=name,
        boltzmann=constants.BOLTZMANN / ANGSTROM_PS,
        particles=len(atoms),
        freedom=3.0 * (len(atoms) - conserved),
        kinetic=np.sum([each.kinetic for each in groups[:3]], axis=0),
        groups=groups,
        potential=None,
        volume=volumes,
        temperature=None,
        pressure=None,
        bath=True,
        likeness=(tuple(masses), tuple(kinds)),
        notes=(f"{name}'s total momentum {motion} degrees of freedom, less constraints",),
    )


def _heat(sample: Sample, per_temperature: float, apart: int) -> float:
    """Kinetic energy of a sample without the motion of the whole."""
    if np.isfinite(sample.temperature):
        return sample.temperature * per_temperature
    momentum, velocity = sample.momentum, sample.centre_of_mass_velocity
    if apart == NONE or momentum is None or velocity is None:
        return sample.energies.kinetic
    return sample.energies.kinetic - 0.5 * float(momentum @ velocity)


def _apart(name: str, system: System) -> tuple[int, bool, str]:
    """The motion that is no heat under a method, whether it has a heat bath, and a note on degrees of freedom."""
    method, outside = integrator(name), disturbing(system)
    apart, d = apart_of(system, method.drags), system.dimensions
    why = f"{name} conserves the total momentum{' and the angular momentum' if apart == TURN else ''}"
    if apart == NONE:
        why = f"{name if method.drags else outside[0]} changes the total momentum"
    lost = d * int(np.count_nonzero(system.state.masses)) - freedom_of(system, method.drags)
    return apart, method.bath, f"{d} N{f' - {lost}' if lost else ''} degrees of freedom: {why}"


def _likeness(system: System, of_box: bool) -> tuple[Any, ...]:
    """Facts in which two runs of the same system agree."""
    names = tuple(system.species[k] for k in system.species_index)
    box = system.box.described("") if of_box else ""
    return system.units.name, tuple(system.state.masses.tolist()), names, repr(system.forces), box


def _temperature(options: Mapping[str, Any], name: str) -> float | None:
    """A run's temperature; None if there is none. Raises InputError for a ramp, of temperature or pressure."""
    if any(options.get(end) is not None for end in RAMPED.values()):
        raise InputError(f"{name}: has a ramp; the tests need a constant temperature and pressure")
    return _number(options.get("temperature"), name)


def _pressure(options: Mapping[str, Any], name: str) -> float | None:
    """A run's pressure; None if there is none. Raises InputError for a stress beside it: the tests know the
    distribution of the volume under a pressure alone."""
    if options.get("stress") is not None:
        raise InputError(f"{name}: has a stress beside its pressure; the tests of volumes need a pressure alone")
    return _number(options.get("pressure"), name)


def _number(value: Any, name: str) -> float | None:
    """A run's temperature or pressure; None if there is none. Raises InputError for values that change in time."""
    if value is None or isinstance(value, int | float):
        return None if value is None else float(value)
    raise InputError(f"{name}: temperature or pressure changes during the run; the tests need constant ones")
