"""Topologies: their lists, the pairs without pair forces, and the lists that are refused."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.systemfile.reading import loads

RING = [(0, 1), (1, 2), (2, 3), (3, 0), (3, 4)]  # four in a ring, and a tail


def distances(bonds: list[tuple[int, int]], n: int) -> np.ndarray:
    """Number of bonds on the shortest path between particles, by Floyd and Warshall."""
    found = np.where(np.eye(n, dtype=bool), 0.0, np.inf)
    for i, j in bonds:
        found[i, j] = found[j, i] = 1.0
    for k in range(n):
        found = np.minimum(found, found[:, [k]] + found[[k]])
    return found


def test_angles_and_dihedrals_are_all_paths_along_bonds():
    topology = kd.Topology(RING, angles=True, dihedrals=True)
    joined = {frozenset(bond) for bond in RING}
    for items in (topology.angles, topology.dihedrals):
        size = items.shape[1]
        paths = {
            min(path, path[::-1])
            for path in itertools.permutations(range(5), size)
            if all(frozenset(step) in joined for step in itertools.pairwise(path))
        }
        assert {min(tuple(item), tuple(item[::-1])) for item in items.tolist()} == paths
        assert len(items) == len(paths)


@pytest.mark.parametrize("bonds", [RING, [(0, 1), (1, 2), (2, 3), (3, 4), (4, 5)], [(0, 3), (1, 3), (2, 3)]])
def test_factors_go_by_the_shortest_path(bonds):
    factors, n = (0.0, 0.3, 0.7), 6
    topology = kd.Topology(bonds, factors=factors)
    apart = distances(bonds, n)
    i, j = np.triu_indices(n, 1)
    wanted = [factors[int(apart[pair]) - 1] if apart[pair] <= 3 else 1.0 for pair in zip(i, j, strict=True)]
    np.testing.assert_array_equal(topology.factor_of(i, j), wanted)
    np.testing.assert_array_equal(topology.factor_of(j, i), wanted)
    assert len(topology.scaled.pairs) == sum(each != 1.0 for each in wanted)


def test_exclusions_come_beside_factors():
    topology = kd.Topology([(0, 1)], exclusions=[(5, 2)])
    np.testing.assert_array_equal(topology.factor_of(np.array([0, 2, 2]), np.array([1, 5, 4])), [1.0, 0.0, 1.0])
    assert str(topology) == "1 bond, 1 exclusion"
    assert topology == kd.Topology(**topology.tables())
    assert topology != kd.Topology([(0, 1)])


def test_chains():
    topology = kd.Topology.chains(3, 4, angles=True, dihedrals=True, bond_types="backbone")
    assert topology.bonds.tolist() == [[0, 1], [1, 2], [2, 3], [4, 5], [5, 6], [6, 7], [8, 9], [9, 10], [10, 11]]
    assert topology.angles.tolist()[:2] == [[0, 1, 2], [1, 2, 3]]
    assert topology.dihedrals.tolist() == [[0, 1, 2, 3], [4, 5, 6, 7], [8, 9, 10, 11]]
    assert set(topology.types("bonds")) == {"backbone"}


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"bonds": [(0, 0)]}, r"topology: bonds\[0\] = \[0, 0\] joins a particle to itself"),
        ({"bonds": [(0, 1), (1, 0)]}, r"topology: bonds\[1\] = \[1, 0\] is given twice, first as bonds\[0\]"),
        ({"bonds": [(0, 1, 2)]}, r"bonds\[0\]: expected the numbers of 2 particles, got \(0, 1, 2\)"),
        ({"bonds": [(0, -1)]}, r"bonds\[0\]: expected the numbers of 2 particles"),
        ({"bonds": [(0, 1.5)]}, r"bonds\[0\]: expected the numbers of 2 particles"),
        ({"bonds": "ab"}, "bonds: expected a list, got 'ab'"),
        ({"bonds": [(0, 1)], "angles": 3}, "angles: expected a list, got 3"),
        ({"bonds": [], "angles": [(0, 1, 0)]}, r"angles\[0\] = \[0, 1, 0\] names a particle twice"),
        ({"impropers": True}, "impropers: expected a list, got True"),
        ({"impropers": [(0, 1, 2, 3), (3, 2, 1, 0)]}, r"impropers\[1\] = \[3, 2, 1, 0\] is given twice"),
        ({"impropers": [(0, 1, 2)]}, r"impropers\[0\]: expected the numbers of 4 particles"),
        ({"bonds": [(0, 1)], "bond_types": ["a", "b"]}, "bond_types: expected one name or 1, got 2"),
        ({"bonds": [(0, 1)], "factors": (0, 0)}, "factors: expected three numbers from 0 to 1"),
        ({"bonds": [(0, 1)], "factors": (0, 2, 1)}, "factors: expected three numbers from 0 to 1"),
        (
            {"bonds": [(0, 1), (1, 2)], "factors": (0, 0.5, 1), "exclusions": [(2, 0)]},
            r"exclusions\[0\] = \[0, 2\] .* its particles are two bonds apart and factors\[1\] = 0.5",
        ),
    ],
)
def test_a_wrong_list_is_refused(given, message):
    with pytest.raises(kd.InputError, match=message):
        kd.Topology(**given)


def test_a_particle_that_does_not_exist():
    with pytest.raises(kd.InputError, match=r"bonds\[1\] = \[1, 7\]: there is no particle 7; particles are 0 to 2"):
        kd.System(np.eye(3), topology=kd.Topology([(0, 1), (1, 7)]))
    with pytest.raises(kd.InputError, match=r"exclusions\[0\] = \[1, 3\]: there is no particle 3"):
        kd.System(np.eye(3), topology=kd.Topology(exclusions=[(1, 3)]))
    with pytest.raises(kd.InputError, match="topology: expected a Topology"):
        kd.System(np.eye(3), topology=[(0, 1)])


TEXT = """
units = "lj"
[particles]
positions = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [2, 1, 0.5]]
[box]
lengths = [10, 10, 10]
[topology]
{}
[[force]]
type = "harmonic-bond"
stiffness = 100
length = 1
[run]
dt = 0.001
"""


@pytest.mark.parametrize(
    ("table", "expected"),
    [
        ("bonds = [[0, 1], [1, 2]]\nangles = true", kd.Topology([(0, 1), (1, 2)], True)),
        ("chains = {count = 2, length = 2}\nfactors = [0, 1, 1]", kd.Topology.chains(2, 2, factors=(0, 1, 1))),
        (
            'bonds = [[0, 1]]\nimpropers = [[1, 0, 2, 3]]\nimproper_types = "flat"',
            kd.Topology([(0, 1)], impropers=[(1, 0, 2, 3)], improper_types="flat"),
        ),
        ('bonds = [[0, 3]]\nbond_types = "long"', kd.Topology([(0, 3)], bond_types="long")),
    ],
)
def test_a_topology_in_a_system_file(table, expected):
    system = loads(TEXT.format(table))
    assert system.topology == expected
    assert loads(system.to_toml()).topology == expected
    assert str(expected) in str(system)


def test_a_topology_without_bonds_comes_back():
    topology = kd.Topology(impropers=[(1, 0, 2, 3)], exclusions=[(0, 3)])
    system = kd.System([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], topology=topology)
    assert loads(system.to_toml()).topology == topology


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("angles = true", "topology: expected exactly one of chains, file and bonds, got none"),
        ("", "topology: expected exactly one of chains, file and bonds, got none"),
        ("bonds = []\nchains = {count = 1, length = 2}", "expected exactly one of chains, file and bonds"),
        ("chains = {count = 2, length = 3}", r"there is no particle 4; particles are 0 to 3"),
        ("chains = {count = 2, length = 1}", "topology.chains.length: expected a number greater than or equal to 2"),
        ("bond = [[0, 1]]", "topology.bond: unknown key; did you mean 'bonds'"),
        ('file = "nowhere.data"', "topology.file: no such file: nowhere.data"),
    ],
)
def test_a_wrong_table_is_refused(table, message):
    with pytest.raises(kd.InputError, match=message):
        loads(TEXT.format(table))


DATA = """LAMMPS data file

4 atoms
2 atom types
3 bonds
2 bond types
1 angles
1 angle types
1 impropers
3 improper types

0 10 xlo xhi
0 10 ylo yhi
0 10 zlo zhi

Masses

1 1.5
2 2.5

Atoms # molecular

2 1 2 2.25 1.0 1.0 0 0 0
1 1 1 1.25 1.0 1.0 0 0 0
3 1 1 9.5 1.0 1.0 -1 0 0
4 1 1 1.25 2.0 1.0 0 0 0

Velocities

1 0.5 0.0 0.0
2 -0.25 0.125 0.0
3 0.0 0.0 1.0
4 0.0 0.0 -1.0

Bonds

1 1 1 2
2 2 1 4
3 1 3 1

Angles

1 1 2 1 3

Impropers

1 3 1 2 3 4
"""


def test_a_universe_of_mdanalysis():
    import MDAnalysis

    universe = MDAnalysis.Universe.empty(5)
    universe.add_TopologyAttr("bonds", [(0, 1), (1, 2), (2, 3), (3, 4)])
    assert kd.Topology.from_mdanalysis(universe) == kd.Topology.chains(1, 5)
    universe.add_TopologyAttr("types", ["C", "C", "H", "C", "C"])
    universe.add_TopologyAttr("angles", [(0, 1, 2)])
    found = kd.Topology.from_mdanalysis(universe, angles=True, factors=(0, 0, 1))
    assert found.types("bonds") == ("C-C", "C-H", "C-H", "C-C")
    assert found.angles.tolist() == [[0, 1, 2], [1, 2, 3], [2, 3, 4]]
    universe.add_TopologyAttr("impropers", [(0, 1, 2, 3)])
    assert kd.Topology.from_mdanalysis(universe).impropers.tolist() == [[0, 1, 2, 3]]


def test_a_data_file_of_lammps(tmp_path):
    path = tmp_path / "start.data"
    path.write_text(DATA)
    force = '[[force]]\ntype = "harmonic-bond"\nstiffness = 1\nlength = 1\n'
    text = 'units = "lj"\n[particles]\nfile = "start.data"\n[topology]\nfile = "start.data"\nfactors = [0, 0, 1]\n'
    system = loads(text + force, folder=tmp_path)
    assert {tuple(sorted(bond)) for bond in system.topology.bonds.tolist()} == {(0, 1), (0, 3), (0, 2)}
    types = dict(zip(map(frozenset, system.topology.bonds.tolist()), system.topology.bond_types, strict=True))
    assert types == {frozenset((0, 1)): "1", frozenset((0, 3)): "2", frozenset((0, 2)): "1"}
    assert system.topology.angles.tolist() in ([[1, 0, 2]], [[2, 0, 1]])
    assert system.topology.impropers.tolist() in ([[0, 1, 2, 3]], [[3, 2, 1, 0]])
    assert system.topology.improper_types == ("3",)
    assert system.topology.factors == (0.0, 0.0, 1.0)
    np.testing.assert_allclose(system.state.masses, [1.5, 2.5, 1.5, 1.5], rtol=1e-15)
    np.testing.assert_allclose(system.state.positions[2], [-0.5, 1.0, 1.0], rtol=1e-14)  # the image is in the file
    np.testing.assert_allclose(system.state.velocities[1], [-0.25, 0.125, 0.0], rtol=1e-14)
    assert system.species == ("1", "2")

    from ase.io.lammpsdata import read_lammps_data

    found = kd.Topology.from_ase(read_lammps_data(path, atom_style="molecular"), factors=(0, 0, 1))
    assert {frozenset(bond) for bond in found.bonds.tolist()} == set(types)
    assert dict(zip(map(frozenset, found.bonds.tolist()), found.bond_types, strict=True)) == types
    assert found.angles.tolist() in ([[1, 0, 2]], [[2, 0, 1]])


def test_a_data_file_without_a_style_beside_its_atoms(tmp_path):
    """As LAMMPS' own file of chains: neither the name nor the heading of the atoms says anything."""
    plain = DATA.replace("Atoms # molecular", "Atoms")
    (tmp_path / "start.data").write_text(DATA)
    (tmp_path / "data.chain").write_text(plain)
    text = 'units = "lj"\nforce = []\n[particles]\nfile = "%s"\n'
    expected = loads(text % "start.data", folder=tmp_path)
    for style in ("", 'atom_style = "bond"\n'):
        found = loads(text % "data.chain" + style, folder=tmp_path)
        np.testing.assert_array_equal(found.state.positions, expected.state.positions)
        assert found.species == expected.species
    (tmp_path / "data.chain").write_text(plain.replace("3 bonds", "0 bonds"))
    with pytest.raises(kd.InputError, match="does not say its atom_style, such as charge"):
        loads(text % "data.chain", folder=tmp_path)
    with pytest.raises(kd.InputError, match="atom_style: expected 'atomic', 'charge'"):
        loads(text % "data.chain" + 'atom_style = "bonds"\n', folder=tmp_path)
    (tmp_path / "one.xyz").write_text("1\n\nAr 0 0 0\n")
    with pytest.raises(kd.InputError, match="atom_style is for data files of LAMMPS"):
        loads('units = "metal"\nforce = []\n[particles]\nfile = "one.xyz"\natom_style = "full"\n', folder=tmp_path)
