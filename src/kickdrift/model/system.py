"""A System: what is simulated. How it is simulated is a Simulation's business."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kickdrift.errors import InputError
from kickdrift.model.arguments import checked_arguments
from kickdrift.model.bodies import Body, body_of
from kickdrift.model.body_checks import body_names, body_radii, check_kinds, forces_of, listed_species, names_of
from kickdrift.model.box import Box
from kickdrift.model.bridging import SYSTEM_FILES, bridge
from kickdrift.model.checks import no_overflow, per_particle, whole_number
from kickdrift.model.event_checks import checked_events
from kickdrift.model.events import Event
from kickdrift.model.run_defaults import Equilibration, RunDefaults
from kickdrift.model.space import box_for, check_plane, vectors_of
from kickdrift.model.starts.builders import drawn_velocities
from kickdrift.model.state import Floats, State
from kickdrift.model.unit_systems import UnitSystem, unit_system
from kickdrift.text import shown

_KEPT = ("forces", "units", "name", "run", "seed", "names", "radii", "events", "dimensions")  # of a System made anew


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
        kind_of = ["A"] * n if species is None else names_of("species", listed_species(species))
        if len(kind_of) != n:
            raise InputError(f"species: expected {n} names, got {len(kind_of)}")
        kinds = tuple(dict.fromkeys(kind_of))
        number = {kind: k for k, kind in enumerate(kinds)}
        put = object.__setattr__
        put(self, "state", State(np.array([x.T, v.T]), m, np.arange(n, dtype=np.int64), box_for(box, dimensions)))
        put(self, "dimensions", dimensions)
        if dimensions == 2:
            check_plane(self.state.phase)
        put(self, "forces", forces_of(forces))
        put(self, "units", units if isinstance(units, UnitSystem) else unit_system(units))
        put(self, "species", kinds)
        put(self, "species_index", np.fromiter(map(number.__getitem__, kind_of), np.int32, n))
        put(self, "names", body_names(names, n))
        check_kinds(name=(name, str), run=(run, RunDefaults), source=(source, str))
        check_kinds(equilibration=(equilibration, Equilibration), invariants=(invariants, Mapping))
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

    def __getitem__(self, body: str | int) -> Body:
        """The `Body` of that name or id. An InputError for an unknown name has the nearest one."""
        return body_of(self, body)

    def __iter__(self) -> Iterator[Body]:
        return (body_of(self, int(each)) for each in self.state.ids)

    def body(self, i: int) -> str:
        """Name of the particle in row i, or "particle 5" by its id; ``system["Jupiter"]`` is the body of a name."""
        if isinstance(i, str):
            raise InputError(f"body: expected the number of a row, got {shown(i)}; system[{shown(i)}] is that body")
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
        object.__setattr__(other, "forces", forces_of(forces))
        return other

    def watched(self, events: Iterable[Event]) -> System:
        """The same system with these events to watch for in place of its own."""
        other = copy(self)
        object.__setattr__(other, "events", checked_events(self, events))
        return other

    def with_run(self, **defaults: Any) -> System:
        """The same system with these in its `RunDefaults`, as ``dt`` and ``integrator``; steps replace a time, and a
        time steps."""
        made = copy(self)
        object.__setattr__(made, "run", self.run.changed(**defaults))
        return made

    # --- new systems from old ones ---

    @classmethod
    def from_elements(
        cls,
        bodies: Sequence[Mapping[str, Any]],
        forces: Iterable[Any] | None = None,
        units: str | UnitSystem = "astro",
        frame: str = "heliocentric",
        seed: int | None = None,
        name: str = "system",
    ) -> System:
        """The System of a central body and others on orbits, moved to its barycentre: the same as a system file's.

        Parameters
        ----------
        bodies : tables with the keys of ``elements`` in a system file; the first is the central body
            ``name``, ``mass`` or ``GM``, ``radius``; an orbit by ``a``, ``q`` or ``P``, by ``e``, ``inc``, ``Omega``,
            ``omega``, and by one of ``f``, ``M``, ``E``, ``T``; ``primary``, an earlier body that it orbits instead
            of the central one. Angles are in degrees. A text has its own unit, as in ``"4.2 yr"``.
        forces : iterable of forces; default ``[kd.Gravity()]``
        frame : what the elements are relative to: "heliocentric", "jacobi" or "barycentric"
        seed : for bodies with a ``count`` and ranges, such as ``a=[2.1, 3.3]``

        Raises
        ------
        InputError
            With the body and the key, for unknown keys and for values that are no orbit.
        """
        made: System = SYSTEM_FILES["from_elements"](cls, bodies, forces, units, frame, seed, name)
        return made

    def with_body(self, name: str | None = None, *, barycentric: bool = False, **body: Any) -> System:
        """A new System with one more body, at the end. This System stays as it is.

        The other bodies stay where they are, unless ``barycentric`` moves all to the new barycentre. The new System
        has no ``invariants``.

        Parameters
        ----------
        name : of the body
        body : its orbit, with the keys of `from_elements`, or its ``position`` and ``velocity`` (default 0); and
            ``mass`` or ``GM``, ``radius``, ``species``. ``primary`` is the name or id of the body that it orbits,
            default the body that dominates.

        Raises
        ------
        InputError
            For an unknown key, a name that is taken, and a body at another's place.
        """
        made: System = SYSTEM_FILES["with_body"](self, name, barycentric, body)
        return made

    def add(self, name: str | None = None, *, barycentric: bool = False, **body: Any) -> System:
        """Another name of `with_body`: returns a new System, where rebound's ``add`` changes a Simulation in place."""
        return self.with_body(name, barycentric=barycentric, **body)

    def with_forces(self, *forces: Any) -> System:
        """A new System with these forces, or this list of forces, in place of its own. It has no ``invariants``."""
        one_list = len(forces) == 1 and isinstance(forces[0], Iterable) and not hasattr(forces[0], "check")
        return self.remade(forces=forces_of(forces[0] if one_list else forces))

    def with_velocities(
        self, values: ArrayLike | None = None, *, temperature: float | str | None = None, seed: int | None = None
    ) -> System:
        """A new System with other velocities, given or drawn. It has no ``invariants``.

        Parameters
        ----------
        values : (n, 3) velocities
        temperature, seed : draw them from the Maxwell-Boltzmann distribution with this seed. The total momentum is
            zero and the temperature exact: the bits are those of ``[velocities]`` in a system file. The temperature
            may be text with a unit, such as "94.4 K".
        """
        if values is None:
            values = drawn_velocities(self, temperature, seed)
        elif temperature is not None or seed is not None:
            raise InputError("with_velocities: expected values, or a temperature with a seed, got both")
        return self.remade(velocities=values, seed=seed)

    def remade(self, **changes: Any) -> System:
        """The same system, made and checked anew with these arguments of ``System`` in place of its own; without the
        invariants and the text of its file."""
        state = self.state
        own: dict[str, Any] = {
            "positions": state.positions, "velocities": state.velocities, "masses": state.masses, "box": state.box,
            "species": [self.species[k] for k in self.species_index], "equilibration": self.equilibration,
        } | {key: getattr(self, key) for key in _KEPT}  # fmt: skip
        ids = changes.pop("ids", state.ids)
        made = System(**own | changes)
        return made.at(made.state.phase, state.time, state.steps_done, ids)

    def to_toml(self) -> str:
        """The text of a system file of this System: ``kd.load`` reads the same bits from it.

        Positions and velocities stand as numbers. The text also holds species, names, radii, box, forces, events,
        ``[run]``, ``[equilibrate]`` and ``[invariants]``. Particles count from 0 in their present order.

        Raises
        ------
        InputError
            With the name of what a system file cannot say: forces that are not registered, events with a function of
            your own, units of your own, a time other than 0.
        """
        text: str = SYSTEM_FILES["to_toml"](self)
        return text

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
            for what `to_ase` and exported files say by them: species, and in the arrays "names" and "radii".
        forces : iterable of forces, in ``units``; default those of the calculator that the atoms carry, if it is ASE's
            LennardJones (shifted at its rc; not smooth) or kickdrift's
        units : the name of a unit system
        species : (n,) names, default the chemical symbols

        Raises
        ------
        InputError
            For a cell that leans, pbc along some axes only, constraints, another calculator, and numbers that are not
            finite.
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
