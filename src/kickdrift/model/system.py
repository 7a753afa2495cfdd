"""A System: what is simulated. How it is simulated is a Simulation's business."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field
from types import FunctionType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kickdrift.errors import InputError
from kickdrift.model.arguments import checked_arguments
from kickdrift.model.body_checks import body_names, body_radii, names_of
from kickdrift.model.box import Box
from kickdrift.model.bridging import bridge
from kickdrift.model.checks import listed, no_overflow, per_particle, whole_number
from kickdrift.model.event_checks import checked_events
from kickdrift.model.events import Event
from kickdrift.model.run_defaults import Equilibration, RunDefaults
from kickdrift.model.space import box_for, check_plane, vectors_of
from kickdrift.model.state import Floats, State
from kickdrift.model.unit_systems import UnitSystem, unit_system
from kickdrift.text import shown


@checked_arguments
@dataclass(frozen=True, eq=False)
class System:
    """State + box + forces + units; never changed by a Simulation, which copies it.

    Parameters
    ----------
    positions, velocities : (n, 3)
        Velocities default to zero.
    masses : (n,) or one number, default 1
    box : None (open), three edge lengths (periodic, corner at the origin), or a Box
    forces : iterable of forces, e.g. ``[kd.LennardJones(cutoff=2.5)]``
    units : name of a unit system: lj, metal, si, astro, nbody
    species : (n,) kinds, default all "A"
    names : (n,) names of the bodies, each its own ("Jupiter"); default none
    radii : (n,) or one number; of the bodies, where they have any, for collisions
    events : what a run watches for, e.g. ``[kd.CloseApproach(0.1)]``
    dimensions : 3, or 2
        Two-dimensional particles lie and move in one plane, z the same for all. Positions and velocities may then be
        (n, 2), and the box is two edge lengths or a matrix (2, 2).
    """

    state: State
    forces: tuple[Any, ...]
    units: UnitSystem
    species: tuple[str, ...]  # the names, in order of first appearance
    species_index: np.ndarray  # (n,) int32 into `species`
    names: tuple[str, ...] = ()  # of the bodies, where they have any
    name: str = "system"
    run: RunDefaults = field(default_factory=RunDefaults)
    equilibration: Equilibration | None = None
    invariants: Mapping[str, Any] = field(default_factory=dict)
    source: str = ""  # the text of the system file, where there was one
    seed: int | None = None  # of the drawn velocities, where they were drawn
    radii: Floats | None = None
    events: tuple[Event, ...] = ()
    dimensions: int = 3

    def __init__(
        self,
        positions: ArrayLike,
        velocities: ArrayLike | None = None,
        masses: ArrayLike = 1.0,
        box: Box | Sequence[float] | None = None,
        forces: Iterable[Any] = (),
        units: str | UnitSystem = "lj",
        species: Sequence[str] | None = None,
        name: str = "system",
        run: RunDefaults | None = None,
        equilibration: Equilibration | None = None,
        invariants: Mapping[str, Any] | None = None,
        source: str = "",
        seed: int | None = None,
        names: Sequence[str] = (),
        radii: ArrayLike | None = None,
        events: Iterable[Event] = (),
        dimensions: int = 3,
    ) -> None:
        dimensions = whole_number("dimensions", dimensions, 2, 3)
        x = vectors_of("positions", positions, dimensions)
        n = len(x)
        v = np.zeros((n, 3)) if velocities is None else vectors_of("velocities", velocities, dimensions)
        if v.shape != x.shape:
            raise InputError(f"velocities: expected shape {x.shape} like the positions, got {v.shape}")
        m = per_particle("masses", masses, n, "mass", "a finite number")
        kind_of = ["A"] * n if species is None else names_of("species", _names(species))
        if len(kind_of) != n:
            raise InputError(f"species: expected {n} names, got {len(kind_of)}")
        kinds = tuple(dict.fromkeys(kind_of))
        number = {kind: k for k, kind in enumerate(kinds)}
        put = object.__setattr__
        put(self, "state", State(np.array([x.T, v.T]), m, np.arange(n, dtype=np.int64), box_for(box, dimensions)))
        put(self, "dimensions", dimensions)
        if dimensions == 2:
            check_plane(self.state.phase)
        put(self, "forces", _forces(forces))
        put(self, "units", units if isinstance(units, UnitSystem) else unit_system(units))
        put(self, "species", kinds)
        put(self, "species_index", np.fromiter(map(number.__getitem__, kind_of), np.int32, n))
        put(self, "names", body_names(names, n))
        for key, value, kind in (
            ("name", name, str),
            ("run", run, RunDefaults),
            ("source", source, str),
            ("equilibration", equilibration, Equilibration),
            ("invariants", invariants, Mapping),
        ):
            if not (isinstance(value, kind) or (value is None and kind is not str)):
                expected = "text" if kind is str else f"a {kind.__name__}"
                raise InputError(f"{key}: expected {expected}, got {shown(value)}")
        put(self, "name", name)
        put(self, "run", run or RunDefaults())
        put(self, "equilibration", equilibration)
        put(self, "invariants", dict(invariants or {}))
        put(self, "source", source)
        put(self, "seed", None if seed is None else whole_number("seed", seed, 0))
        put(self, "radii", None if radii is None else body_radii(radii, n))
        with no_overflow():
            for force in self.forces:
                force.check(self)
        put(self, "events", checked_events(self, events))

    def __len__(self) -> int:
        return len(self.state)

    @property
    def box(self) -> Box:
        return self.state.box

    def body(self, i: int) -> str:
        """Name of a particle, or "particle 5" by its id."""
        return self.names[i] if self.names else f"particle {self.state.ids[i]}"

    def remaining(self, keep: NDArray[np.bool_], phase: Floats, masses: Floats, radii: Floats | None) -> System:
        """The same system with the bodies that ``keep`` (n,) marks, under their ids, at ``phase`` (2, 3, n) with these
        masses and radii."""
        left, put = copy(self), object.__setattr__
        phase = np.ascontiguousarray(phase[:, :, keep])
        put(left, "state", State(phase, masses[keep], self.state.ids[keep], self.box))
        put(left, "species_index", self.species_index[keep])
        put(left, "names", tuple(name for name, kept in zip(self.names, keep, strict=False) if kept))
        put(left, "radii", None if radii is None else radii[keep])
        for force in left.forces:
            force.check(left)
        return left

    def at(self, phase: Floats, time: float, steps_done: int = 0, ids: NDArray[np.int64] | None = None) -> System:
        """The same system with its bodies at ``phase`` (2, 3, n) and ``time``, under other ids if these are given."""
        other, old = copy(self), self.state
        state = State(phase.copy(), old.masses, old.ids if ids is None else ids, old.box, time, steps_done)
        object.__setattr__(other, "state", state)
        return other

    def under(self, forces: Iterable[Any]) -> System:
        """The same system, its bodies under their names and numbers, with these forces in place of its own."""
        other = copy(self)
        object.__setattr__(other, "forces", _forces(forces))
        return other

    def watched(self, events: Iterable[Event]) -> System:
        """The same system with these events to watch for in place of its own."""
        other = copy(self)
        object.__setattr__(other, "events", checked_events(self, events))
        return other

    def with_run(self, **defaults: Any) -> System:
        """The same system with these in its `RunDefaults`, as ``dt`` and ``integrator``, which may be a value of
        ``kickdrift.integrator``; steps replace a time, and a time steps."""
        made = copy(self)
        object.__setattr__(made, "run", self.run.changed(**defaults))
        return made

    # --- to and from other programs ---

    @classmethod
    def from_ase(
        cls,
        atoms: Any,
        forces: Iterable[Any] | None = None,
        units: str | UnitSystem = "metal",
        species: Iterable[str] | None = None,
    ) -> System:
        """The System of an ``ase.Atoms``: positions, velocities, masses, box, species.

        Units are ASE's angstrom, eV, u, and its time angstrom sqrt(u / eV), converted to ``units``; in those that ASE
        does not know (lj, nbody, astro) its numbers stand as they are: an angstrom is one sigma, an eV one epsilon.

        Parameters
        ----------
        atoms : ase.Atoms
            Open, or periodic along any of the cell's vectors. Where these do not have the form of a `Box`, atoms and
            velocities are turned with them (`Box.from_vectors`). Tags, charges and magnetic moments are not taken, but
            for what `to_ase` and exported files say by them: species, in the arrays "names" and "radii", and in
            ``info`` 2 "dimensions".
        forces : iterable of forces, in ``units``; default those of the calculator that the atoms carry, if it is ASE's
            LennardJones (shifted at its rc; not smooth) or kickdrift's
        units : the name of a unit system
        species : (n,) names, default the chemical symbols

        Raises
        ------
        InputError
            For periodic vectors of the cell that span no volume, constraints, another calculator, atoms with a momentum
            but no mass, and numbers that are not finite.
        """
        return bridge("ase", "System.from_ase").system_of(atoms, forces, units, species)

    def to_ase(self, symbols: Mapping[str, str] | None = None, calculator: bool = True) -> Any:
        """An ``ase.Atoms`` in ASE's units, positions unwrapped; the other way round from `from_ase`.

        Parameters
        ----------
        symbols : {species: chemical symbol}; default the species itself where it is an element's, else ASE's "X", and
            then the tags number those in ``info["species"]``
        calculator : whether the atoms are to carry a calculator that runs this system's forces

        Raises
        ------
        InputError
            For an unknown symbol, a body without mass, and forces that a calculator cannot have.
        """
        return bridge("ase", "System.to_ase").atoms_of(self, symbols, calculator)

    @classmethod
    def from_rebound(cls, sim: Any, forces: Iterable[Any] | None = None) -> System:
        """The System of a ``rebound.Simulation``, at its time: bodies, masses, radii, names, G, softening, to the bit.

        Without units it is in ``nbody`` (plain numbers), with AU, yr, Msun in ``astro``, with m, s, kg in ``si``, with
        others of rebound's in ``nbody`` with these units' names; G is the Simulation's own. leapfrog (order 2 and
        4), whfast, saba and ias15 become the run's defaults, as far as both have their options; a UserWarning says what
        was not taken.

        Parameters
        ----------
        sim : rebound.Simulation
        forces : iterable of forces; default its gravity

        Raises
        ------
        InputError
            For variational particles, boundaries, collisions, additional forces and other functions, test particles
            with a mass, gravity by a tree, and numbers that are not finite.
        """
        return bridge("rebound", "System.from_rebound").system_of(sim, forces)

    def to_rebound(self) -> Any:
        """A ``rebound.Simulation`` of this system; the other way round from `from_rebound`.

        Massless bodies at the end of the list are test particles there (``N_active``). A UserWarning says what was not
        taken: events, and an integrator that rebound does not have.

        Raises
        ------
        InputError
            For a periodic box, forces other than `Gravity`, and units in which force is not m a (metal).
        """
        return bridge("rebound", "System.to_rebound").simulation_of(self)

    def acting(self, trait: str) -> list[str]:
        """The names of the forces that have a trait: "external" (it does not conserve momentum), "works" (nor energy),
        "velocity_dependent", "joins" (bodies that it names belong together)."""
        return [force.name for force in self.forces if getattr(force, trait, False)]

    @property
    def coherent_masses(self) -> Floats:
        """(n,) masses in the unit that makes force = mass x acceleration hold in this system's other units."""
        return self.state.masses * self.units.coherent_mass

    @property
    def degrees_of_freedom(self) -> int:
        """3 N, less the three of the conserved total momentum, and 2 N - 2 in two dimensions; massless particles do not
        count."""
        moving = int(np.count_nonzero(self.state.masses))
        return max(self.dimensions * (moving - 1), 0)

    @property
    def volume(self) -> float:
        """The volume of the box, in two dimensions its area; infinite where the box is open along any of its axes."""
        return self.box.volume if self.dimensions == 3 else self.box.area


def _forces(forces: Iterable[Any]) -> tuple[Any, ...]:
    """The forces as a tuple, checked: each an object with ``check``, such as ``kd.Gravity()``."""
    found = listed("forces", forces, "a list of forces, such as [kd.LennardJones(cutoff=2.5)]")
    for k, force in enumerate(found):
        if isinstance(force, type) or not callable(getattr(force, "check", None)):
            raise InputError(f"forces[{k}]: expected a force, such as kd.LennardJones(cutoff=2.5), {_instead(force)}")
    return tuple(found)


def _instead(force: Any) -> str:
    """What was given in place of a force, and what to write."""
    if isinstance(force, str):
        return f"got the name {shown(force)}"
    if isinstance(force, type):
        return f"got the class {force.__name__}; write {force.__name__}(…)"
    if isinstance(force, FunctionType):
        return "got a function; a formula U(r) becomes a force by @kd.pair_law, see docs/your-own-force.md"
    return f"got {shown(force)}"


def _names(species: Any) -> list[Any]:
    return list(species) if isinstance(species, str) else listed("species", species, "a list of names")
