"""Systems to and from ASE, and our forces as a calculator of ASE's, against ASE's own Lennard-Jones and dynamics."""

from __future__ import annotations

import itertools

import ase
import ase.io
import ase.units
import numpy as np
import pytest
from ase.build import bulk, fcc111
from ase.calculators.lj import LennardJones
from ase.constraints import FixAtoms, FixBondLength
from ase.filters import FrechetCellFilter
from ase.md.verlet import VelocityVerlet
from ase.optimize import BFGS, FIRE
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import kickdrift as kd
from kickdrift.bridges.ase import Calculator, Scale
from kickdrift.model.units.quantities import quantity
from kickdrift.model.units.unit_systems import UNIT_SYSTEMS
from kickdrift.trajectory.export.export import export
from kickdrift.trajectory.write.h5md import Writer

EPSILON, SIGMA, RC = 0.0103, 3.4, 8.0  # values for argon in eV and angstrom
ARGON = kd.LennardJones(epsilon=EPSILON, sigma=SIGMA, cutoff=RC)  # shifted, as in ASE


def argon(periodic: bool = True, seed: int = 1) -> ase.Atoms:
    """A warm crystal of 256 atoms."""
    atoms = bulk("Ar", "fcc", a=5.3, cubic=True).repeat(4)
    rng = np.random.default_rng(seed)
    atoms.positions += rng.normal(scale=0.1, size=(len(atoms), 3))
    atoms.set_momenta(rng.normal(scale=np.sqrt(40 * ase.units.kB * atoms.get_masses())[:, None], size=(len(atoms), 3)))
    atoms.pbc = periodic
    return atoms


def cluster(seed: int) -> ase.Atoms:
    """Thirteen atoms near the corners of a lattice, with no two too close."""
    rng = np.random.default_rng(seed)
    places = np.array([(i, j, k) for i in range(3) for j in range(3) for k in range(3)])[rng.permutation(27)[:13]]
    return ase.Atoms("Ar13", positions=4.0 * places + rng.uniform(-0.4, 0.4, (13, 3)))


# --- units ---


def test_metal_is_ases_units_but_for_the_time():
    """ASE's fs is CODATA 2014's, ours SciPy's; their u / eV differ by 9e-9."""
    scale = Scale.of(UNIT_SYSTEMS["metal"])
    assert (scale.length, scale.energy, scale.mass) == (1.0, 1.0, 1.0)
    assert scale.velocity == pytest.approx(1000 * ase.units.fs, rel=1e-8)  # angstrom/ps in ASE's units


@pytest.mark.parametrize("units", ["metal", "si"])
def test_real_units_are_converted(units):
    atoms, there = argon(), UNIT_SYSTEMS[units]
    system = kd.System.from_ase(atoms, [], units)
    energy = quantity("1 eV", "energy", there)
    x, v, m = system.state.positions, system.state.velocities, system.coherent_masses
    length = quantity("1 angstrom", "length", there)
    np.testing.assert_allclose(x, atoms.positions * length, rtol=1e-15)
    np.testing.assert_allclose(system.box.lengths, np.diagonal(atoms.cell) * length, rtol=1e-15)
    assert 0.5 * (m * (v**2).sum(axis=1)).sum() == pytest.approx(atoms.get_kinetic_energy() * energy, rel=1e-14)
    speed = quantity("1 m/s", "velocity", there)
    np.testing.assert_allclose(v / speed, atoms.get_velocities() * ase.units.second / ase.units.m, rtol=1e-8)


@pytest.mark.parametrize("units", ["lj", "nbody", "astro"])
def test_units_that_ase_does_not_know_take_the_numbers_as_they_are(units):
    atoms = argon()
    system = kd.System.from_ase(atoms, [], units)
    np.testing.assert_array_equal(system.state.positions, atoms.positions)
    np.testing.assert_array_equal(system.state.velocities, atoms.get_velocities())
    np.testing.assert_array_equal(system.state.masses, atoms.get_masses())
    assert system.units.coherent_mass == 1.0  # so energies keep their numbers too


# --- both directions ---


@pytest.mark.parametrize("periodic", [True, False])
@pytest.mark.parametrize("units", ["metal", "lj", "si"])
def test_atoms_come_back(units, periodic):
    atoms = argon(periodic)
    atoms.symbols[::3] = "Kr"
    atoms.set_masses(np.linspace(30, 90, len(atoms)))
    back = kd.System.from_ase(atoms, [], units).to_ase()
    exact = 0.0 if units != "si" else 1e-15
    np.testing.assert_allclose(back.positions, atoms.positions, rtol=exact)
    np.testing.assert_allclose(back.get_masses(), atoms.get_masses(), rtol=exact)
    np.testing.assert_allclose(back.get_momenta(), atoms.get_momenta(), rtol=1e-14)
    assert back.get_chemical_symbols() == atoms.get_chemical_symbols()
    assert (back.pbc == atoms.pbc).all()
    np.testing.assert_allclose(back.cell, atoms.cell if periodic else 0 * atoms.cell, rtol=exact)
    assert back.calc is None


def test_a_system_comes_back_with_its_forces():
    rng = np.random.default_rng(3)
    force = kd.LennardJones(cutoff=2.5, truncation="force-shift", species={"A": {}, "Ne": {"sigma": 1.1}})
    system = kd.System(
        rng.uniform(-30, 30, (6, 3)), rng.normal(size=(6, 3)), [1, 2, 4, 8, 16, 32], (6.0, 7.0, 8.0), [force],
        species=["A", "Ne", "A", "A", "Ne", "A"], names=list("abcdef"), radii=np.arange(6.0),
    )  # fmt: skip
    atoms = system.to_ase()
    assert atoms.get_chemical_symbols() == ["X"] * 6  # A is no element, so Ne may be none either
    back = kd.System.from_ase(atoms, units="lj")
    assert back.forces == system.forces
    assert (back.species, back.names, back.box) == (system.species, system.names, system.box)
    np.testing.assert_array_equal(back.species_index, system.species_index)
    np.testing.assert_array_equal(back.radii, system.radii)
    np.testing.assert_array_equal(back.state.phase, system.state.phase)  # masses are powers of two
    named = system.to_ase(symbols={"A": "Ar"}, calculator=False)
    assert named.get_chemical_symbols() == ["Ar", "Ne", "Ar", "Ar", "Ne", "Ar"]
    assert named.calc is None
    assert kd.System.from_ase(named, [], "lj", species=["B"] * 6).species == ("B",)


@pytest.mark.parametrize("suffix", ["traj", "extxyz"])
@pytest.mark.parametrize("units", ["lj", "metal"])
def test_exported_files_are_read_as_the_system_they_were(tmp_path, units, suffix):
    system = kd.System(
        np.arange(12.0).reshape(4, 3), np.eye(4, 3), [2, 1, 1, 4], units=units, species=["A", "Kr", "B", "A"],
        names=["a", "b", "c", "d"],
    )  # fmt: skip
    with Writer(tmp_path / "run.h5md", system, method={"dt": 1.0}, every=1) as writer:
        writer.append(system.state)
    export(tmp_path / "run.h5md", tmp_path / f"run.{suffix}")
    back = kd.System.from_ase(ase.io.read(tmp_path / f"run.{suffix}"), [], units)
    assert [back.species[k] for k in back.species_index] == ["A", "Kr", "B", "A"]
    assert back.names == system.names
    # The text file has eight decimals, and ASE's unit of velocity is about a hundred times 1 angstrom/ps.
    close = 1e-8 if suffix == "traj" else 1e-6
    np.testing.assert_allclose(back.state.phase, system.state.phase, rtol=close, atol=close)
    np.testing.assert_allclose(back.state.masses, system.state.masses, rtol=1e-8)


@pytest.mark.parametrize("units", ["metal", "lj", "si"])
def test_ases_lennard_jones_is_taken_with_the_atoms(units):
    atoms = argon()
    atoms.calc = LennardJones(epsilon=EPSILON, sigma=SIGMA)
    (force,) = kd.System.from_ase(atoms, units=units).forces
    scale = Scale.of(UNIT_SYSTEMS[units])
    assert force == kd.LennardJones(
        epsilon=EPSILON * scale.energy, sigma=SIGMA * scale.length, cutoff=3 * SIGMA * scale.length, truncation="shift"
    )


# --- the calculator ---


def check_same(atoms: ase.Atoms, calculator: Calculator) -> None:
    """Check that energy and forces equal ASE's own, to round-off."""
    other = atoms.copy()
    other.calc, atoms.calc = LennardJones(epsilon=EPSILON, sigma=SIGMA, rc=RC), calculator
    scale = np.abs(other.get_forces()).max()
    np.testing.assert_allclose(atoms.get_forces(), other.get_forces(), rtol=0, atol=1e-12 * scale)
    size = np.abs(other.get_potential_energies()).sum()
    assert atoms.get_potential_energy() == pytest.approx(other.get_potential_energy(), rel=0, abs=1e-12 * size)
    if atoms.pbc.all():
        stress = other.get_stress()
        np.testing.assert_allclose(atoms.get_stress(), stress, rtol=0, atol=1e-12 * np.abs(stress).max())


@pytest.mark.parametrize("units", ["metal", "si"])
@pytest.mark.parametrize("periodic", [True, False])
def test_the_calculator_agrees_with_ases(units, periodic):
    scale = Scale.of(UNIT_SYSTEMS[units])
    force = kd.LennardJones(epsilon=EPSILON * scale.energy, sigma=SIGMA * scale.length, cutoff=RC * scale.length)
    check_same(argon(periodic), Calculator([force], units))


CLUSTERS = Calculator([ARGON])


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32))
def test_the_calculator_agrees_with_ases_in_clusters(seed):
    """One calculator serves all clusters, and its pair list must follow."""
    check_same(cluster(seed), CLUSTERS)


def test_what_is_compiled_and_bound_is_kept_until_the_atoms_are_others(monkeypatch):
    from kickdrift.forces.bound import forces as bound

    made = []
    plain = bound.BoundForces.__init__
    monkeypatch.setattr(bound.BoundForces, "__init__", lambda self, *args: (made.append(1), plain(self, *args))[1])
    calculator, atoms = Calculator([ARGON]), argon()
    for step in range(4):
        atoms.rattle(0.05, seed=step)
        check_same(atoms, calculator)
    assert len(made) == 1
    atoms.set_cell(1.02 * np.asarray(atoms.cell), scale_atoms=True)
    check_same(atoms, calculator)
    assert len(made) == 2
    del atoms[10:13]
    check_same(atoms, calculator)
    atoms.pbc = False
    check_same(atoms, calculator)
    assert len(made) == 4


def test_masses_count_where_forces_go_by_them():
    atoms = ase.Atoms("H2", positions=[[0, 0, 0], [2, 0, 0]], masses=[3, 4])
    atoms.calc = Calculator([kd.Gravity()], "nbody")
    np.testing.assert_allclose(atoms.get_forces(), [[3.0, 0, 0], [-3.0, 0, 0]], rtol=1e-14)
    assert atoms.get_potential_energy() == pytest.approx(-6.0, rel=1e-14)
    atoms.set_masses([3, 8])
    np.testing.assert_allclose(atoms.get_forces(), [[6.0, 0, 0], [-6.0, 0, 0]], rtol=1e-14)


def test_ases_dynamics_run_our_forces():
    """Velocity Verlet by ASE with ASE's forces, by ASE with ours, and by kickdrift: one path, in three systems of
    units."""
    steps, dt = 20, 5 * ase.units.fs
    paths = []
    for calculator in (LennardJones(epsilon=EPSILON, sigma=SIGMA, rc=RC), Calculator([ARGON])):
        atoms = argon()
        atoms.calc = calculator
        VelocityVerlet(atoms, dt).run(steps)
        paths.append(atoms)
    theirs, mixed = paths
    start = argon()
    start.calc = theirs.calc
    sim = kd.Simulation(kd.System.from_ase(start), "velocity-verlet", dt=dt / Scale.of(UNIT_SYSTEMS["metal"]).velocity)
    sim.run(steps)
    ours = kd.System.from_ase(start).at(sim.state.phase, sim.time).to_ase()
    moved = np.abs(theirs.positions - start.positions).max()
    assert moved > 0.1
    for atoms in (mixed, ours):
        np.testing.assert_allclose(
            atoms.positions, theirs.positions, rtol=0, atol=1e-12 * np.abs(theirs.positions).max()
        )
        np.testing.assert_allclose(atoms.get_momenta(), theirs.get_momenta(), rtol=0, atol=1e-11)
        assert atoms.get_potential_energy() == pytest.approx(theirs.get_potential_energy(), rel=1e-12)


@pytest.mark.parametrize("optimiser", [BFGS, FIRE])
def test_ases_optimisers_find_the_minimum(optimiser):
    """Three atoms end at the triangle with sides 2^(1/6) sigma and energy -3 epsilon, up to the shift."""
    atoms = ase.Atoms("Ar3", positions=[[0, 0, 0], [4.1, 0, 0], [1.7, 3.3, 0.2]])
    atoms.calc = Calculator([ARGON])
    assert optimiser(atoms, logfile=None).run(fmax=1e-7, steps=500)
    sides = atoms.get_all_distances()[np.triu_indices(3, 1)]
    np.testing.assert_allclose(sides, 2 ** (1 / 6) * SIGMA, rtol=1e-5)
    shift = 4 * EPSILON * ((SIGMA / RC) ** 12 - (SIGMA / RC) ** 6)
    assert atoms.get_potential_energy() == pytest.approx(3 * (-EPSILON - shift), rel=1e-9)


@pytest.mark.long
def test_ases_cell_optimisers_use_our_stress():
    """The crystal reaches the same lattice constant as with ASE's own forces."""
    edges = []
    for calculator in (LennardJones(epsilon=EPSILON, sigma=SIGMA, rc=RC), Calculator([ARGON])):
        atoms = bulk("Ar", "fcc", a=5.2, cubic=True).repeat(4)
        atoms.calc = calculator
        assert BFGS(FrechetCellFilter(atoms, hydrostatic_strain=True), logfile=None).run(fmax=1e-4, steps=50)
        edges.append(np.diagonal(atoms.cell))
    np.testing.assert_allclose(*edges, rtol=1e-10)
    assert edges[0] == pytest.approx(4 * 5.26, rel=0.01)  # argon near absolute zero


# --- bad input ---


def changed(change) -> ase.Atoms:
    atoms = argon()
    change(atoms)
    return atoms


def spoil(atoms):
    atoms.positions[7, 2] = np.nan


def strike(atoms):
    atoms.set_momenta([[0, 0, np.inf]] + [[0, 0, 0]] * 255)


@pytest.mark.parametrize(
    ("atoms", "message"),
    [
        (changed(lambda atoms: atoms.set_cell([20, 20, 0])), "box: the edge vectors are singular"),
        (
            changed(lambda atoms: atoms.set_cell([[9, 0, 0], [0, 9, 0], [9, 9, 0]])),
            "box: the edge vectors are singular",
        ),
        (changed(lambda atoms: atoms.set_cell([np.inf, 9, 9])), "atoms: cell: expected finite numbers, got "),
        (changed(spoil), "positions: particle 7 has nan in z; expected finite numbers"),
        (changed(strike), "velocities: particle 0 has inf in z"),
        (
            changed(lambda atoms: atoms.set_constraint(FixBondLength(0, 1))),
            "constraint FixBondLengths has no equiv",
        ),
        (changed(lambda atoms: atoms.set_masses(np.zeros(256))), "atom 0 has a momentum but no mass"),
        (ase.Atoms(), "positions: expected shape"),
        ("Ar2", "atoms: expected ase.Atoms, got str"),
    ],
)
def test_atoms_that_do_not_fit_are_refused(atoms, message):
    with pytest.raises(kd.InputError, match=message) as raised:
        kd.System.from_ase(atoms, [])
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("calculator", "units", "message"),
    [
        (None, "metal", r"forces: needed \(forces=\[\] means no forces\)"),
        (Calculator([ARGON]), "lj", "forces: the calculator's forces are in units 'metal', not 'lj'"),
        (Calculator([ARGON]), "imperial", "units: expected one of lj, metal"),
    ],
)
def test_calculators_that_are_no_force_here_are_refused(calculator, units, message):
    atoms = argon()
    atoms.calc = calculator
    with pytest.raises(kd.InputError, match=message):
        kd.System.from_ase(atoms, units=units)


def test_what_ase_cannot_hold_is_refused():
    system = kd.System(np.eye(3), masses=[1, 0, 1], units="nbody", forces=[kd.Gravity()], names=["a", "dust", "c"])
    with pytest.raises(kd.InputError, match="masses: dust has no mass, and ASE stores momenta"):
        system.to_ase()
    plain = kd.System(np.eye(3))
    with pytest.raises(kd.InputError, match="symbols: 'Qq' for species 'A' is not a chemical element"):
        plain.to_ase({"A": "Qq"})
    with pytest.raises(kd.InputError, match="symbols: no species 'B'; known are A"):
        plain.to_ase({"B": "Ar"})
    dragged = kd.System(np.eye(3), forces=[kd.LinearDrag(0.1)])
    with pytest.raises(kd.InputError, match="linear-drag depends on more than positions"):
        dragged.to_ase()
    assert dragged.to_ase(calculator=False).calc is None


def test_a_calculation_that_fails_says_why():
    atoms = argon()
    atoms.calc = Calculator([ARGON])
    atoms.positions[3] = atoms.positions[200]
    with pytest.raises(kd.RunError, match="not finite; particle 3 and particle 200 are nearest, 0 angstrom apart"):
        atoms.get_potential_energy()
    atoms.positions[3] += 2.0
    assert np.isfinite(atoms.get_potential_energy())
    open_atoms = argon(periodic=False)
    open_atoms.calc = atoms.calc
    with pytest.raises(kd.InputError, match="pressure: needs a periodic box; open space has no volume"):
        open_atoms.get_stress()
    atoms.set_cell([12, 12, 12])
    with pytest.raises(kd.InputError, match="lennard-jones: box edge x is 12 angstrom, shorter than twice the cutoff"):
        atoms.get_forces()


MATRIX = np.array([[15.0, 0.0, 0.0], [-4.0, 16.0, 0.0], [5.0, 7.5, 17.5]])
AXES = [axes for axes in itertools.product((True, False), repeat=3) if any(axes)]


def shaken(atoms, seed=2) -> ase.Atoms:
    rng = np.random.default_rng(seed)
    atoms.positions += rng.normal(scale=0.1, size=(len(atoms), 3))
    atoms.set_momenta(rng.normal(size=(len(atoms), 3)))
    return atoms


def distances(atoms) -> np.ndarray:
    return atoms.get_all_distances(mic=bool(atoms.pbc.any()))[np.triu_indices(len(atoms), 1)]


@pytest.mark.parametrize("units", ["metal", "lj", "si"])
@pytest.mark.parametrize("axes", AXES)
def test_a_box_goes_to_ase_and_back(axes, units):
    both = np.array(axes)
    length = 1e-10 if units == "si" else 1.0
    matrix = np.where(np.outer(both, both), MATRIX, np.diag(np.diag(MATRIX) * [1.0, 0.0, 1.0])) * length
    box = kd.Box(matrix=matrix, periodic=axes)
    rng = np.random.default_rng(1)
    system = kd.System(rng.uniform(-30, 30, (9, 3)) * length, np.eye(9, 3), box=box, units=units)
    atoms = system.to_ase()
    np.testing.assert_allclose(atoms.cell[:], matrix / length, rtol=1e-15)
    assert tuple(atoms.pbc) == axes
    back = kd.System.from_ase(atoms, [], units)
    assert back.box.periodic_axes == axes
    np.testing.assert_allclose(back.box.matrix, box.matrix, rtol=1e-15)
    np.testing.assert_allclose(back.state.phase, system.state.phase, rtol=1e-14)


def scattered(cell, pbc=True) -> ase.Atoms:
    return ase.Atoms("Ar9", positions=np.random.default_rng(4).uniform(0, 20, (9, 3)), cell=cell, pbc=pbc)


CELLS = {
    "primitive": bulk("Ar", "fcc", a=5.26) * (3, 3, 3),
    "left-handed": scattered(MATRIX[::-1]),
    "leaning far": scattered([[9, 0, 0], [8, 9, 0], [20, -7, 9]]),
    "upside down": scattered([20, 20, -20]),
    "rolled": scattered(np.roll(np.diag([9.0, 10.0, 11.0]), 1, axis=0)),
    "surface": fcc111("Ar", (4, 4, 2), a=5.26, vacuum=10.0),
    "wire": scattered([[0, 0, 0], [3, 3, 9], [0, 0, 0]], [False, True, False]),
    "open vector that leans": scattered([[9, 3, 0], [0, 9, 0], [4, 1, 8]], [True, True, False]),
}


@pytest.mark.parametrize("name", CELLS)
def test_distances_and_motion_are_those_of_the_atoms(name):
    """The Box may have other axes; quantities that do not depend on axes are the same."""
    atoms = shaken(CELLS[name].copy())
    system = kd.System.from_ase(atoms, [])
    x, v = system.state.positions, system.state.velocities
    i, j = np.triu_indices(len(atoms), 1)
    ours = np.linalg.norm(system.box.minimum_image(x[i] - x[j]), axis=1)
    np.testing.assert_allclose(ours, distances(atoms), rtol=1e-12)
    if atoms.pbc.all():
        assert system.box.volume == pytest.approx(atoms.get_volume(), rel=1e-13)
    plain = kd.System.from_ase(ase.Atoms(atoms.symbols, atoms.positions, momenta=atoms.get_momenta()), [])
    np.testing.assert_allclose(v @ v.T, plain.state.velocities @ plain.state.velocities.T, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(v @ x.T, plain.state.velocities @ plain.state.positions.T, rtol=1e-11, atol=1e-10)
    assert tuple(system.to_ase().pbc) == tuple(atoms.pbc)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.floats(-20.0, 20.0), min_size=9, max_size=9).map(lambda rows: np.reshape(rows, (3, 3))),
    st.sampled_from(AXES),
)
def test_any_cell_is_taken(cell, axes):
    atoms = ase.Atoms("Ar6", positions=np.random.default_rng(4).uniform(0, 20, (6, 3)), cell=cell, pbc=axes)
    sound = cell[np.array(axes)]
    assume(np.linalg.svd(sound)[1].min() > 1e-3)
    system = kd.System.from_ase(atoms, [])
    x = system.state.positions
    i, j = np.triu_indices(6, 1)
    np.testing.assert_allclose(
        np.linalg.norm(x[i] - x[j], axis=1), np.linalg.norm(atoms.positions[i] - atoms.positions[j], axis=1), rtol=1e-12
    )
    there = np.array(axes)
    # Whole multiples of our edges make the cell's periodic vectors, rotated with the atoms.
    turned = np.linalg.lstsq(atoms.positions - atoms.positions[0], x - x[0], rcond=None)[0]
    whole = np.linalg.lstsq(system.box.matrix[there].T, (cell @ turned)[there].T, rcond=None)[0]
    np.testing.assert_allclose(whole, np.rint(whole), atol=1e-6 * (1 + np.abs(whole).max()))


def test_an_open_vector_in_the_plane_of_others_has_no_height():
    system = kd.System.from_ase(scattered([[9, 3, 0], [0, 9, 0], [1, 1, 0]], [True, True, False]), [])
    assert system.box.matrix[2].tolist() == [0, 0, 0]
    assert system.box.area == pytest.approx(81)


SOLID = bulk("Ar", "fcc", a=5.26)


@pytest.mark.parametrize(
    "atoms",
    [
        SOLID * (6, 6, 6),  # a primitive cell: no vector lies along an axis
        bulk("Ar", "hcp", a=3.7, c=6.0) * (6, 6, 4),
        fcc111("Ar", (6, 6, 3), a=5.26, vacuum=10.0),
        ase.Atoms(SOLID * (6, 6, 6), pbc=[False, True, True]),
    ],
    ids=["primitive", "hexagonal", "surface", "open along a"],
)
def test_the_calculator_agrees_with_ases_in_any_cell(atoms):
    check_same(shaken(atoms.copy()), Calculator([ARGON]))


PLANES = {
    "upright": kd.Box((18.0, 20.0)),
    "leaning": kd.Box([[18.0, 0.0], [-9.0, 20.0]]),
    "open": None,
    "open along y": kd.Box((18.0, 20.0), periodic=(True, False, False)),
}


def plane(box, units="metal") -> kd.System:
    """16 atoms that move in the plane z = 0.5."""
    rng = np.random.default_rng(7)
    x = np.column_stack([4.0 * np.indices((4, 4)).reshape(2, -1).T + rng.uniform(-0.2, 0.2, (16, 2)), np.full(16, 0.5)])
    v = rng.normal(size=(16, 2))
    return kd.System(x, v, 39.948, box, [ARGON], units, dimensions=2, species=["Ar"] * 16)


@pytest.mark.parametrize("units", ["metal", "lj"])
@pytest.mark.parametrize("name", PLANES)
def test_a_plane_goes_to_ase_and_back(name, units, tmp_path):
    system = plane(PLANES[name], units)
    atoms = system.to_ase()
    assert atoms.info["dimensions"] == 2
    ase.io.write(tmp_path / "plane.extxyz", atoms)
    for found in (atoms, ase.io.read(tmp_path / "plane.extxyz")):
        back = kd.System.from_ase(found, [ARGON], units)
        assert (back.dimensions, back.degrees_of_freedom) == (2, 29 if name == "open" else 30)
        assert back.volume == pytest.approx(system.volume)
        np.testing.assert_allclose(back.state.phase, system.state.phase, rtol=0, atol=2e-7)
    energy = kd.Simulation(system, "velocity-verlet", 0.001).energy().potential
    assert atoms.get_potential_energy() == pytest.approx(energy, rel=1e-12)
    with pytest.raises(kd.InputError, match=r"^(stress: .* in two dimensions it is a force over a length|pressure: )"):
        atoms.get_stress()


def test_a_turned_plane_is_still_one():
    system = plane(PLANES["leaning"])
    atoms = system.to_ase()
    atoms.rotate(33.0, "z", rotate_cell=True)
    back = kd.System.from_ase(atoms, [])
    assert back.dimensions == 2
    np.testing.assert_allclose(back.box.matrix, system.box.matrix, rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(back.state.positions, system.state.positions, rtol=0, atol=1e-12)


def test_other_dimensions_of_atoms_say_nothing():
    assert "dimensions" not in kd.System(np.eye(3)).to_ase().info
    for given_there in ("2", [2, 2], 3, 2.5, np.array([2.0, 2.0])):
        atoms = ase.Atoms("Ar", info={"dimensions": given_there})
        assert kd.System.from_ase(atoms, []).dimensions == 3


def test_atoms_that_left_their_plane_are_refused():
    atoms = plane(None).to_ase()
    atoms.positions[3, 2] += 1.0
    with pytest.raises(kd.InputError, match=r"^positions: particle 3 has z = 1\.5; expected z = 0\.5"):
        kd.System.from_ase(atoms)


def slab() -> ase.Atoms:
    """A slab of argon with a frozen lowest layer, at 20 K."""
    atoms = fcc111("Ar", (4, 4, 4), a=5.3, vacuum=8.0, orthogonal=True, periodic=True)
    atoms.info.clear()
    atoms.set_constraint(FixAtoms(np.flatnonzero(atoms.positions[:, 2] < 8.1)))
    atoms.set_velocities(0.003 * np.random.default_rng(1).standard_normal((64, 3)))
    return atoms


def test_a_frozen_layer_comes_from_ase_moves_as_there_and_goes_back(tmp_path):
    atoms, forces = slab(), [kd.LennardJones(EPSILON, SIGMA, cutoff=5.1, truncation="shift")]
    system = kd.System.from_ase(atoms, forces)
    assert len(system.fixed) == 16
    assert system.degrees_of_freedom == 3 * 48
    atoms.calc = Calculator(forces)
    VelocityVerlet(atoms, 0.5).run(20)
    sim = kd.Simulation(system, dt=0.5 / Scale.of(system.units).velocity)
    sim.run(20, output=tmp_path / "slab.h5md")
    for name in ("slab.extxyz", "slab.traj"):
        kd.export(tmp_path / "slab.h5md", tmp_path / name)
        (held,) = ase.io.read(tmp_path / name).constraints
        assert held.get_indices().tolist() == system.fixed.particles.tolist()
    np.testing.assert_allclose(sim.state.positions, atoms.positions, rtol=0, atol=1e-12)
    back = sim.now().to_ase()
    assert back.constraints[0].get_indices().tolist() == system.fixed.particles.tolist()
    with pytest.warns(UserWarning, match="those at a given velocity are free"):
        moved = system.with_fixed().with_fixed(kd.Fixed(0, velocity=(1, 0, 0))).to_ase()
    assert not moved.constraints


def test_a_structure_file_keeps_its_frozen_layer(tmp_path):
    ase.io.write(tmp_path / "slab.extxyz", slab())
    system = kd.load({"units": "metal", "particles": {"file": str(tmp_path / "slab.extxyz")}, "force": []})
    assert len(system.fixed) == 16
    assert not system.state.velocities[system.fixed.particles].any()
