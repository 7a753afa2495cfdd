"""A System to and from other programs."""

from collections.abc import Iterable, Mapping
from importlib import import_module
from typing import Any

from kickdrift.display.showing import above
from kickdrift.errors import InputError
from kickdrift.model.units.unit_systems import UnitSystem


def bridge(package: str, asked: str) -> Any:
    """Return the bridge module for a package. If the package is missing, raises an InputError that says how to install
    it."""
    try:
        import_module(package)
    except ImportError:
        raise InputError(f"{asked} needs {package}: pip install 'kickdrift[{package}]'") from None
    return above(f"bridge to {package}")


class Bridged:
    """Conversions of a System; each bridge is a module of a later layer."""

    @classmethod
    def from_ase(
        cls,
        atoms: Any,
        forces: Iterable[Any] | None = None,
        units: str | UnitSystem = "metal",
        species: Iterable[str] | None = None,
    ) -> Any:
        """System of an ``ase.Atoms``: positions, velocities, masses, box, species.

        ASE's units are angstrom, eV, u, and angstrom sqrt(u / eV) for time; values are converted to ``units``. Unit
        systems that ASE does not know (lj, nbody, astro) keep ASE's numbers: an angstrom is one sigma, an eV one
        epsilon.

        Parameters
        ----------
        atoms : ase.Atoms
            Open, or periodic along any of the cell's vectors. If the vectors do not have the form of a `Box`, atoms and
            velocities are rotated with them (`Box.from_vectors`). FixAtoms becomes `Fixed`. Tags and magnetic moments
            are ignored, except for species, names, radii and two dimensions that `to_ase` and exported files store in
            the atoms. The topology is that of the atoms' calculator, or the lists that ASE reads from LAMMPS data
            files.
        forces : iterable of forces, in ``units``; default those of the atoms' calculator: `LennardJones` (shifted at
            its rc) for ASE's LennardJones that is not smooth, kickdrift's own, and `CalculatorForce` for any other
        units : name of a unit system
        species : (n,) names, default the chemical symbols

        Raises
        ------
        InputError
            For a cell that no `Box` can have, constraints other than FixAtoms, a calculator that cannot follow motion,
            atoms with a momentum but no mass, and numbers that are not finite.
        """
        return bridge("ase", "System.from_ase").system_of(atoms, forces, units, species)

    def to_ase(self, symbols: Mapping[str, str] | None = None, calculator: bool = True) -> Any:
        """An ``ase.Atoms`` in ASE's units, with unwrapped positions; the inverse of `from_ase`.

        Parameters
        ----------
        symbols : {species: chemical symbol}; default the species itself if it is an element, else ASE's "X" with tags
            that number the species in ``info["species"]``
        calculator : whether the atoms have a calculator with this system's forces

        Raises
        ------
        InputError
            For an unknown symbol, a body without mass, and forces that a calculator does not support.
        """
        return bridge("ase", "System.to_ase").atoms_of(self, symbols, calculator)

    @classmethod
    def from_lammps(
        cls, path: Any, units: str | None = None, commands: Iterable[str] = (), trusted: bool = False
    ) -> Any:
        """System of an input of LAMMPS, or of a data file with its coefficients, in the input's units.

        LAMMPS reads the input up to its first run, in a process of its own. Its box, particles, lists, styles and
        coefficients become the System, and the fixes nve, nvt, langevin, temp/csvr and shake the run's defaults and
        constraints. A species is a type's element or label, else its number. Pair styles: lj/cut, buck and born, also
        with coul/long, lj/charmm/coul/long, lj/gromacs, lj/smooth/linear, mie/cut, morse, yukawa, gauss, soft, eam, sw
        and tersoff, with cutoffs of pairs; any other becomes a `LammpsForce`. Bonds: harmonic, fene, morse. Angles:
        harmonic, cosine, charmm. Dihedrals: harmonic, charmm, fourier, opls, multi/harmonic. Impropers: harmonic, cvff.
        A UserWarning names what was left out.

        Parameters
        ----------
        path : file of the input or of the data
        units : lj, metal or real, of a data file whose first line does not state them
        commands : styles and coefficients that a data file lacks, such as ``["pair_style lj/cut 2.5"]``
        trusted : whether the input may run commands of the shell, Python and loops

        Raises
        ------
        InputError
            For such commands in an input that is not trusted, for what kickdrift lacks, and whatever LAMMPS says.
        """
        return bridge("lammps", "System.from_lammps").system_of(path, units, tuple(commands), trusted)

    def to_lammps(self, path: Any, overwrite: bool = False) -> Any:
        """Write an input of LAMMPS and a data file beside it, and return their paths; the inverse of `from_lammps`.

        The input is in the units of the system, from gromacs in real. It ends with the run of the system's defaults, if
        they have steps. A potential of many bodies, and the tables of a switched law, are files beside it.
        ``kd.System.from_lammps(path)`` has the same energies to rounding, beside tables, which stay LAMMPS' own. A
        UserWarning names what was left out: stages, equilibration, barostats, events, and integrators that LAMMPS
        lacks.

        Parameters
        ----------
        path : file of the input, or a folder for it (``in.NAME`` by the system's name)
        overwrite : whether to replace files of these names that kickdrift wrote

        Raises
        ------
        InputError
            For forces, virtual sites and fixed particles without a counterpart in LAMMPS, and for other units.
        """
        return above("input of LAMMPS")(self, path, overwrite)

    def to_gromacs(self, path: Any, overwrite: bool = False) -> Any:
        """Write a topology and coordinates of GROMACS, NAME.top and NAME.gro, and return their paths.

        ``kd.load("NAME.top", coordinates="NAME.gro", rigid="none")`` reads both back, with the same energies to
        rounding. A topology holds no cutoffs and no methods; a comment at its top says them in the words of an .mdp
        file. Bonded terms are harmonic-bond, harmonic-angle, periodic-dihedral, periodic-improper, harmonic-improper
        and ryckaert-bellemans, beside lennard-jones, coulomb, listed-pairs, constraints and virtual sites.

        Parameters
        ----------
        path : file that ends in .top or .gro
        overwrite : whether to replace files of these names that kickdrift wrote

        Raises
        ------
        InputError
            For units other than gromacs, metal and real, other forces, fixed particles, and charges of pairs three
            bonds apart that are not scaled alike.
        """
        return above("files of GROMACS")(self, path, overwrite)

    @classmethod
    def from_mdanalysis(
        cls,
        universe: Any,
        forces: Iterable[Any] = (),
        units: str | UnitSystem = "real",
        factors: Iterable[float] | None = None,
    ) -> Any:
        """System of an ``MDAnalysis.Universe`` at its present frame: particles, masses, charges, box, lists.

        MDAnalysis' units are angstrom, ps, u and elementary charges; values are converted to ``units``, and stay plain
        numbers in lj, nbody and astro. MDAnalysis has positions in float32. ``universe.trajectory[k]`` goes to frame k.
        Species are the elements, else the types. The topology has MDAnalysis' lists with their types.

        Parameters
        ----------
        universe : MDAnalysis.Universe
        forces : iterable of forces, in ``units``; MDAnalysis has none
        units : name of a unit system
        factors : (bonded, two bonds apart, three bonds apart) of pair forces, see `Topology`

        Raises
        ------
        InputError
            For a Universe without masses, a box that no `Box` can have, and numbers that are not finite.
        """
        bridged = bridge("MDAnalysis", "System.from_mdanalysis")
        return bridged.system_of(universe, forces, units, None if factors is None else tuple(factors))

    @classmethod
    def from_openmm(
        cls, system: Any, topology: Any, positions: Any, velocities: Any = None, integrator: Any = None
    ) -> Any:
        """System of an ``openmm.System``, in units ``gromacs`` (nm, ps, u, kJ/mol), where OpenMM's numbers stand.

        Particles with one element, sigma and epsilon are one species: "O" if all oxygen is alike, else "O1", "O2".
        OpenMM's exceptions are exclusions of the topology, and those with a charge or a well of their own become
        `ListedPairs`. Bonded terms get types, named by the species of their first particles. Torsions that do not
        follow a chain of bonds are impropers. The tolerance of OpenMM's Ewald sum or PME becomes the ``accuracy`` of
        `Coulomb`. The start is projected on the constraints.

        Parameters
        ----------
        system : openmm.System
            With NonbondedForce, HarmonicBondForce, HarmonicAngleForce, PeriodicTorsionForce, RBTorsionForce,
            CMAPTorsionForce, CustomBondForce, CustomAngleForce, CustomTorsionForce and CustomNonbondedForce, which
            become kickdrift's laws of the same energies or `FormulaBond`, `FormulaPair` and so on, constraints,
            CMMotionRemover (which needs no counterpart), and
            MonteCarloBarostat, which becomes the run's default beside ``integrator``, or beside "baoa" with a friction
            of 1/ps. Its moves follow from the compressibility of water, 4.5e-5 per bar.
        topology : openmm.app.Topology, for elements and bonds; None if there is none
        positions : (n, 3) in any unit of OpenMM, or as numbers in nm
        velocities : (n, 3) likewise, or as numbers in nm/ps; default zero
        integrator : an integrator of OpenMM whose step, temperature and friction become the run's defaults, optional

        Raises
        ------
        InputError
            For forces, virtual sites and particles without a counterpart, which it names, and for sizes that differ.
        """
        bridged = bridge("openmm", "System.from_openmm")
        return bridged.system_of(system, topology, positions, velocities, integrator)

    def to_openmm(self) -> Any:
        """OpenMM's objects: a tuple of ``system``, ``topology``, ``positions`` and ``velocities``.

        The inverse of `from_openmm`: ``kd.System.from_openmm(*system.to_openmm())`` has the same energies, in units
        gromacs. The system has OpenMM's standard forces, constraints and virtual sites. Defaults of a run stay behind.

        Raises
        ------
        InputError
            For units other than gromacs, metal and real, forces without a counterpart, truncations other than "cut" and
            "potential-switch", cutoffs that differ, several Lennard-Jones forces, scaled pairs in a reaction field, and
            scaled pairs beyond the cutoff, which OpenMM does not cut off.
        """
        return bridge("openmm", "System.to_openmm").parts_of(self)

    @classmethod
    def from_snapshot(
        cls,
        path: Any,
        units: str | UnitSystem | None = None,
        scale: Mapping[str, str] | None = None,
        forces: Iterable[Any] | None = None,
        snapshot: int | None = None,
    ) -> Any:
        """System of a snapshot of AMUSE (HDF5), NEMO, or GADGET and its family (HDF5: Arepo, SWIFT), at its time.

        Files with units become ``astro``; NEMO's, and AMUSE's in N-body units, are plain numbers with G = 1, ``nbody``.
        GADGET's PartType1 to PartType5 become the species halo, disk, bulge, stars and boundary. A UserWarning tells
        of gas that was left out.

        Parameters
        ----------
        path : file of the snapshot
        units : of the System: astro, si, or nbody for plain numbers
        scale : units of a file that does not say them, such as
            ``{"length": "1 kpc", "mass": "1e10 Msun", "velocity": "1 km/s"}``; time in place of velocity may do
        forces : iterable of forces; default `Gravity`, above 20,000 stars `GravityTree`
        snapshot : number of one in a file of AMUSE or NEMO, from 0 or negative from the end; default the last

        Raises
        ------
        InputError
            For a snapshot without masses, or without units that are not given; for comoving coordinates, one of several
            files, and other or damaged files.
        """
        return bridge("h5py", "System.from_snapshot").system_of(path, units, scale, forces, snapshot)

    @classmethod
    def from_rebound(cls, sim: Any, forces: Iterable[Any] | None = None) -> Any:
        """System of a ``rebound.Simulation`` at its time: bodies, masses, radii, names, G, softening, to the bit.

        The unit system is ``astro`` for AU, yr, Msun, ``si`` for m, s, kg, and else ``nbody`` (plain numbers), with the
        names of rebound's units if there are any. G is the Simulation's own. The integrators leapfrog (order 2 and 4),
        whfast, saba and ias15 become the run's defaults, with the options that both programs have. A UserWarning names
        what was left out.

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
        """A ``rebound.Simulation`` of this system; the inverse of `from_rebound`.

        Massless bodies at the end of the list are test particles in rebound (``N_active``). A UserWarning names what
        was left out: events, and an integrator that rebound does not have.

        Raises
        ------
        InputError
            For a periodic box, forces other than `Gravity`, and units in which force is not m a (metal).
        """
        return bridge("rebound", "System.to_rebound").simulation_of(self)

    @classmethod
    def from_galpy(
        cls,
        orbit: Any,
        potential: Any = None,
        units: str | UnitSystem = "galactic",
        masses: Any = 0.0,
        ro: float | None = None,
        vo: float | None = None,
    ) -> Any:
        """System of the bodies of a ``galpy.orbit.Orbit`` at its start, such as samples of a distribution function.

        Parameters
        ----------
        orbit : galpy.orbit.Orbit of one body or many, in three dimensions
        potential : of galpy, which becomes the force ``galaxy``; see ``Galaxy.from_galpy``
        units : unit system
        masses : one number or one for each body, in ``units``; default 0, test particles
        ro, vo : kpc and km/s of galpy's natural units; default the orbit's own
        """
        return bridge("galpy", "System.from_galpy").system_of(orbit, potential, units, masses, ro, vo)

    def to_galpy(self, ro: float = 8.0, vo: float = 220.0) -> Any:
        """The bodies as one ``galpy.orbit.Orbit``, and a list of galpy's potentials for the force ``galaxy``.

        Their actions are ``orbit.jr(pot=potentials)``, and so on. The bodies' own gravity is left out.

        Raises
        ------
        InputError
            For a galaxy with a strength that changes, or with a halo that turns.
        """
        return bridge("galpy", "System.to_galpy").orbit_of(self, ro, vo)

    def to_gala(self) -> Any:
        """The bodies as one ``gala.dynamics.PhaseSpacePosition``, and gala's potential for the force ``galaxy``, or
        None. The bodies' own gravity is left out.

        Raises
        ------
        InputError
            For a galaxy with a part that changes or turns.
        """
        return bridge("gala", "System.to_gala").positions_of(self)
