"""A System: what is simulated. A Simulation says how."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from kickdrift.display.showing import above
from kickdrift.errors import InputError
from kickdrift.model.bodies import Body, body_of
from kickdrift.model.body_checks import (
    begun,
    body_charges,
    body_names,
    body_radii,
    box_for,
    check_doubles,
    check_kinds,
    check_plane,
    forces_of,
    listed_species,
    names_of,
    vectors_of,
)
from kickdrift.model.box.box import Box
from kickdrift.model.bridged import Bridged
from kickdrift.model.checks.arguments import checked_arguments
from kickdrift.model.checks.values import no_overflow, per_particle, whole_number
from kickdrift.model.described import ShownSystem
from kickdrift.model.events.events import Event, checked_events
from kickdrift.model.fixed import NAME as FIXED
from kickdrift.model.fixed import Fixed, FixedParticles, fixed_of
from kickdrift.model.freedom import freedom_of
from kickdrift.model.measured import MeasuredSystem
from kickdrift.model.molecules.constraint import Constraint
from kickdrift.model.molecules.constraints import Constraints, Projected, constraints_of, on_manifold
from kickdrift.model.molecules.topology import Topology
from kickdrift.model.molecules.virtual_sites import VirtualSite, VirtualSites, virtual_sites_of
from kickdrift.model.run_defaults import Equilibration, RunDefaults
from kickdrift.model.stages import Stage, checked_stages
from kickdrift.model.starts.builders import drawn_velocities
from kickdrift.model.state import Floats, State
from kickdrift.model.turned import turned
from kickdrift.model.units.unit_systems import UnitSystem, unit_system
from kickdrift.text import shown

_KEPT = (
    "forces",
    "units",
    "name",
    "run",
    "seed",
    "names",
    "radii",
    "charges",
    "events",
    "dimensions",
    "topology",
    "constraints",
    "virtual_sites",
    "fixed",
)  # passed on by `remade`


def later_seed(seed: int | None, time: float) -> int | None:
    """Seed for a run that begins at this time: ``seed`` itself at time 0, and another one at every other time."""
    if time == 0:
        return seed
    bits = int(np.float64(time).view(np.uint64))
    return int(np.random.SeedSequence([seed or 0, bits]).generate_state(1)[0])


@checked_arguments
@dataclass(frozen=True, eq=False, repr=False)
class System(Bridged, MeasuredSystem, ShownSystem):
    """State, box, forces and units. A Simulation copies a System and never changes it.

    Parameters
    ----------
    positions, velocities : (n, 3)
        Velocities default to zero.
    masses : (n,) or one number, default 1
    box : None (open), three edge lengths (periodic, corner at the origin), or a Box
    forces : iterable of forces, e.g. ``[kd.LennardJones(cutoff=2.5)]``
    units : name of a unit system: lj, metal, real, gromacs, si, astro, stellar, galactic, nbody
    species : (n,) kinds, default all "A"
    names : (n,) names of the bodies, all different ("Jupiter"); default none
    radii : (n,) or one number; radii of the bodies for collisions; default none
    events : events that a run watches for, e.g. ``[kd.CloseApproach(0.1)]``
    dimensions : 3, or 2
        Two-dimensional particles lie and move in one plane, z the same for all. Positions and velocities may then be
        (n, 2), and the box is two edge lengths or a matrix (2, 2).
    topology : `Topology` with the bonds, angles and dihedrals of molecules; default none
    charges : (n,) or one number; charges of the particles, in the unit of ``units.charge``; default none
    constraints : list of `Constraint`, distances that a run keeps; default none. The start is projected on them
    virtual_sites : list of `VirtualSite`, sites without mass that follow other particles; default none
    stages : list of `Stage`, the runs of a protocol for `run_stages`; default none
    fixed : list of `Fixed`, particles that stay in place or move at a given velocity; default none
    """

    state: State
    forces: tuple[Any, ...]
    units: UnitSystem
    species: tuple[str, ...]  # names, in order of first appearance
    species_index: np.ndarray  # (n,) int32 into `species`
    names: tuple[str, ...] = ()  # names of the bodies, if any
    name: str = "system"
    run: RunDefaults = field(default_factory=RunDefaults)
    equilibration: Equilibration | None = None
    invariants: Mapping[str, Any] = field(default_factory=dict)
    source: str = ""  # text of the system file, if any
    seed: int | None = None  # seed of the drawn velocities, if any
    radii: Floats | None = None
    events: tuple[Event, ...] = ()
    dimensions: int = 3
    topology: Topology | None = None
    charges: Floats | None = None
    constraints: Constraints | None = None
    virtual_sites: VirtualSites | None = None
    stages: tuple[Stage, ...] = ()
    fixed: FixedParticles | None = None
    ephemerides: tuple[str, ...] = ()  # what JPL was asked for the start: body, date, plane and origin

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
        topology: Topology | None = None,
        charges: ArrayLike | None = None,
        constraints: Iterable[Constraint] | Constraints | None = None,
        virtual_sites: Iterable[VirtualSite] | VirtualSites | None = None,
        stages: Iterable[Stage] = (),
        fixed: Iterable[Fixed] | FixedParticles | None = None,
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
        put(self, "units", units if isinstance(units, UnitSystem) else unit_system(units))
        put(self, "forces", begun(forces_of(forces, self.units), self))
        put(self, "species", kinds)
        put(self, "species_index", np.fromiter(map(number.__getitem__, kind_of), np.int32, n))
        put(self, "names", body_names(names, n))
        check_kinds(name=(name, str), run=(run, RunDefaults), source=(source, str))
        check_kinds(equilibration=(equilibration, Equilibration), invariants=(invariants, Mapping))
        put(self, "name", name)
        put(self, "run", (run or RunDefaults()).in_units(self.units))
        put(self, "equilibration", equilibration)
        put(self, "stages", checked_stages(stages))
        put(self, "invariants", dict(invariants or {}))
        put(self, "source", source)
        put(self, "seed", None if seed is None else whole_number("seed", seed, 0))
        put(self, "radii", None if radii is None else body_radii(radii, n))
        put(self, "charges", None if charges is None else body_charges(charges, n))
        check_kinds(topology=(topology, Topology))
        put(self, "topology", topology)
        if topology is not None:
            topology.check(n)
        put(self, "constraints", self._held(constraints))
        put(self, "virtual_sites", virtual_sites_of(virtual_sites))
        if self.virtual_sites is not None:
            self._settle(self.virtual_sites)
        put(self, "fixed", fixed_of(self, fixed))
        if self.fixed is not None:
            self.fixed.check(self, self.constraints, self.virtual_sites)
            put(self, "state", replace(self.state, phase=self.fixed.settled(self.state.phase)))
        with no_overflow():
            for force in self.forces:
                force.check(self)
            check_doubles(self)
        put(self, "events", checked_events(self, events))

    def _held(self, given: Iterable[Constraint] | Constraints | None) -> Constraints | None:
        """The constraints, checked; the state is projected on them."""
        held = constraints_of(self, given)
        if held is None:
            return None
        held.check(self)
        state, masses = self.state, self.coherent_masses
        phase, moved = on_manifold(self, held, masses, state.phase)
        held.check_independent(masses, phase[0])
        held.start = Projected(max(moved.moved, held.start.moved), max(moved.lost, held.start.lost))
        object.__setattr__(self, "state", replace(state, phase=phase))
        return held

    def _settle(self, sites: VirtualSites) -> None:
        """Check the virtual sites, and put them at their places."""
        sites.check(self)
        for force in self.forces:
            if not getattr(force, "on_sites", False):
                raise InputError(
                    f"virtual_site: force {force.name!r} does not act through sites without mass; pair forces, charges "
                    "and forces along bonds do"
                )
        put = object.__setattr__
        put(self, "state", replace(self.state, phase=sites.settled(self.box, self.constraints, self.state.phase)))
        if self.topology is not None:
            put(self, "topology", sites.joined(self.topology))

    @property
    def tied_by(self) -> str:
        """What ties particles together besides forces: "constraints", "virtual sites", or "" for free particles."""
        if self.constraints is not None:
            return "constraints"
        return "virtual sites" if self.virtual_sites is not None else ""

    @property
    def held_by(self) -> str:
        """What keeps particles from moving freely: that which ties them, "fixed particles", or ""."""
        return self.tied_by or ("fixed particles" if self.fixed is not None else "")

    def __len__(self) -> int:
        return len(self.state)

    @property
    def box(self) -> Box:
        return self.state.box

    def __getitem__(self, body: str | int) -> Body:
        """The `Body` of that name or id. Raises an InputError that suggests the nearest name for an unknown one."""
        return body_of(self, body)

    def __iter__(self) -> Iterator[Body]:
        return (body_of(self, int(each)) for each in self.state.ids)

    def body(self, i: int) -> str:
        """Name of the particle in row i, or "particle 5" by its id; ``system["Jupiter"]`` is the body with that
        name."""
        if isinstance(i, str) or not -len(self) <= i < len(self):
            raise InputError(f"body: expected a row, 0 to {len(self) - 1}, got {shown(i)}; or system[{shown(i)}]")
        return self.names[i] if self.names else f"particle {self.state.ids[i]}"

    def at(self, phase: Floats, time: float, steps_done: int = 0, ids: Any = None, box: Box | None = None) -> System:
        """Return the system with its bodies at ``phase`` (2, 3, n) and ``time``, under other ids or in another box."""
        other, old = copy(self), self.state
        state = State(phase.copy(), old.masses, old.ids if ids is None else ids, box or old.box, time, steps_done)
        object.__setattr__(other, "state", state)
        return other

    def anew(self, state: State) -> System:
        """Return the system with its bodies in this state, for a new run that begins there: with no steps done, and
        without ``equilibration``, ``stages``, ``invariants`` and the text of a file, which are of the start. The seed
        depends on the time, so that runs in a chain have different noise."""
        made = self.at(state.phase, state.time, ids=state.ids, box=state.box)
        seed = later_seed(self.seed, state.time)
        gone: tuple[tuple[str, Any], ...] = (
            ("equilibration", None),
            ("stages", ()),
            ("invariants", {}),
            ("source", ""),
            ("seed", seed),
        )
        for key, value in gone:
            object.__setattr__(made, key, value)
        return made

    def under(self, forces: Iterable[Any]) -> System:
        """Return the system with other forces; its bodies keep their names and numbers."""
        other = copy(self)
        object.__setattr__(other, "forces", begun(forces_of(forces, self.units), self))
        return other

    def watched(self, events: Iterable[Event]) -> System:
        """Return the system with other events."""
        other = copy(self)
        object.__setattr__(other, "events", checked_events(self, events))
        return other

    def with_run(self, **defaults: Any) -> System:
        """Return the system with changed `RunDefaults`, such as ``dt`` and ``integrator``, which may be a value of
        ``kickdrift.integrator``. Steps replace a time, and a time replaces steps."""
        made = copy(self)
        object.__setattr__(made, "run", self.run.changed(**defaults).in_units(self.units))
        return made

    def with_equilibration(self, equilibration: Equilibration | None) -> System:
        """Return the system with another ``[equilibrate]``, or with none."""
        check_kinds(equilibration=(equilibration, Equilibration))
        made = copy(self)
        object.__setattr__(made, "equilibration", equilibration)
        return made

    def with_stages(self, *stages: Stage) -> System:
        """Return the system with these stages of a protocol, or with none."""
        made = copy(self)
        object.__setattr__(made, "stages", checked_stages(stages))
        return made

    def with_fixed(self, *groups: Fixed) -> System:
        """A new System in which these particles stay in place or move at a given velocity, beside those fixed before.
        Without a group, none are fixed. It has no ``invariants``."""
        before = [] if self.fixed is None or not groups else [Fixed(**table) for table in self.fixed.tables]
        return self.remade(fixed=[*before, *groups])

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
        """System of a central body and others on orbits, moved to its barycentre, exactly as from a system file.

        Parameters
        ----------
        bodies : tables with the keys of ``elements`` in a system file; the first is the central body
            ``name``, ``mass`` or ``GM``, ``radius``; an orbit by ``a``, ``q`` or ``P``, by ``e``, ``inc``, ``Omega``,
            ``omega``, and by one of ``f``, ``M``, ``E``, ``T``; ``primary``, an earlier body to orbit instead of the
            central one. Angles are in degrees. A text has its own unit, as in ``"4.2 yr"``.
        forces : iterable of forces; default ``[kd.Gravity()]``
        frame : origin of the orbits: "heliocentric", "jacobi" or "barycentric"
        seed : for bodies with a ``count`` and ranges, such as ``a=[2.1, 3.3]``

        Raises
        ------
        InputError
            For unknown keys and for values that are not an orbit; the message names the body and the key.
        """
        made: System = above("System from elements")(cls, bodies, forces, units, frame, seed, name)
        return made

    def with_body(self, name: str | None = None, *, barycentric: bool = False, **body: Any) -> System:
        """A new System with one more body, at the end. This System stays as it is.

        The other bodies stay where they are, unless ``barycentric`` moves all to the new barycentre. The new System
        has no ``invariants``.

        Parameters
        ----------
        name : name of the body
        body : orbit of the body, with the keys of `from_elements`, or its ``position`` and ``velocity`` (default 0);
            and ``mass`` or ``GM``, ``radius``, ``species``. ``primary`` is the name or id of the body to orbit, default
            the dominant body.

        Raises
        ------
        InputError
            For an unknown key, a name in use, and a body at another body's place.
        """
        made: System = above("System with a body")(self, name, barycentric, body)
        return made

    def add(self, name: str | None = None, *, barycentric: bool = False, **body: Any) -> System:
        """Another name of `with_body`, which returns a new System; rebound's ``add`` changes a Simulation in place."""
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
        """Return the same system, made and checked again with changed arguments of ``System``; without the invariants
        and the text of its file."""
        state = self.state
        own: dict[str, Any] = {
            "positions": state.positions, "velocities": state.velocities, "masses": state.masses, "box": state.box,
            "species": [self.species[k] for k in self.species_index], "equilibration": self.equilibration,
            "stages": self.stages,
        } | {key: getattr(self, key) for key in _KEPT}  # fmt: skip
        ids = changes.pop("ids", state.ids)
        made = System(**own | changes)
        return made.at(made.state.phase, state.time, state.steps_done, ids)

    def rotated(self, turn: Any) -> System:
        """Return the system in other axes: positions, velocities, and the poles and spins of its forces are turned.

        Parameters
        ----------
        turn : a rotation matrix (3, 3), whose rows are the new axes; a rotation of SciPy, such as
            ``Rotation.from_euler("z", 30, degrees=True)``; or "invariable": the plane perpendicular to the total
            angular momentum becomes the x-y plane, with the new x as near to the old as possible

        Raises
        ------
        InputError
            For a periodic box, for a force from outside (a field, a trap, a wall), and for what is no rotation.
        """
        made: System = turned(self, turn)
        return made

    def in_units(self, units: str) -> System:
        """Return the same system in other units: metal, real or gromacs, which convert into one another.

        Positions, velocities, masses, box, time, parameters of forces, constraints, fixed particles, stages and
        defaults of a run are converted. The known invariants stay behind.
        Coulomb's constant and Boltzmann's are those of the new units, which agree to rounding.

        Raises
        ------
        InputError
            For other units, events, and forces whose numbers are of one unit system, such as a many-body potential or
            a function of your own.
        """
        made: System = above("System in units")(self, units)
        return made

    def to_toml(self) -> str:
        """Text of a system file of this System: ``kd.load`` reads the same bits from the text.

        Positions and velocities are numbers. The text also holds the time, species, names, radii, charges, box, forces,
        events, ``[run]``, ``[equilibrate]`` and ``[invariants]``. Particles count from 0 in their present order.

        Raises
        ------
        InputError
            For content that a system file cannot hold; the message names it: forces that are not registered, events
            with the user's functions, the user's own units.
        """
        text: str = above("system file")(self)
        return text

    def acting(self, trait: str) -> list[str]:
        """Names of the forces that have a trait: "external" (does not conserve momentum), "works" (nor energy),
        "velocity_dependent", "joins" (bodies that it names belong together), "alike" (pulls all alike), "reflects"
        (mirrors bodies in place of a force). Fixed particles count as "external", and as "works" if they move."""
        found = [force.name for force in self.forces if getattr(force, trait, False)]
        if self.fixed is not None and (trait == "external" or (trait == "works" and self.fixed.move)):
            found.append(FIXED)
        return found

    @property
    def coherent_masses(self) -> Floats:
        """Masses (n,) in the unit in which force = mass x acceleration holds with this system's other units."""
        return self.state.masses * self.units.coherent_mass

    @property
    def degrees_of_freedom(self) -> int:
        """Degrees of freedom of the heat in a run that conserves the total momentum: 3 N less three, in open space less
        three more for rotation; all 3 N in a field. Two dimensions have 2 N less two and one. Each constraint takes one
        more. Beside fixed particles, each free one has three. See `model.freedom`."""
        return freedom_of(self)

    @property
    def volume(self) -> float:
        """Volume of the box, in two dimensions its area; infinite if the box is open along any of its axes."""
        return self.box.volume if self.dimensions == 3 else self.box.area
