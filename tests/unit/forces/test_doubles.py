"""Forces that count something twice are refused where this is never meant, else told; so are constants that differ."""

import re

import pytest

import kickdrift as kd
from kickdrift.model.body_checks import doubtful_forces

TIDES = {"radius": 0.01, "tau": 0.0}
SPINS = TIDES | {"inertia": 1e-6, "spin": (0.0, 0.0, 0.0)}


def bodies(*forces, **more):
    x, v = [[0, 0, 0], [1, 0, 0], [3, 0, 0.1]], [[0, 0, 0], [0, 1, 0], [0, 0.2, 0]]
    return kd.System(x, v, [1.0, 0.1, 0.1], forces=forces, units="nbody", **more)


def first_order(**options):
    return kd.PostNewtonian(c=100.0, **options)


@pytest.mark.parametrize(
    ("forces", "message"),
    [
        ((kd.Gravity(), kd.GravityTree()), "gravity and gravity-tree are both gravity of all pairs"),
        ((kd.GravityTree(), kd.GravitySheet(1.0, 9.0, 9.0)), "gravity-tree and gravity-sheet are both gravity"),
        ((kd.Gravity(), kd.Gravity()), "gravity and gravity are twice the same, which would count twice"),
        ((kd.Gravity(), kd.Gravity(group=1)), "gravity and gravity are twice the same"),
        ((kd.Gravity(), first_order(), kd.EinsteinInfeldHoffmann(c=100.0)), "both relativity to first order"),
        ((kd.Tides(k2=0.1, **TIDES), kd.TidesSpin(k2=[0.0, 0.1, 0.0], **SPINS)), "tides on the bulge of particle 1"),
        ((kd.LennardJones(), kd.LennardJones()), "lennard-jones and lennard-jones are twice the same on pairs A-A"),
    ],
)
def test_what_is_never_meant_is_refused(forces, message):
    with pytest.raises(kd.InputError, match=message):
        bodies(*forces)


def test_a_system_file_with_forces_and_a_bridge_are_refused_too(tmp_path):
    path = tmp_path / "both.toml"
    path.write_text(bodies(kd.Gravity()).to_toml() + '\n[[force]]\ntype = "gravity-tree"\n')
    with pytest.raises(kd.InputError, match="both gravity of all pairs"):
        kd.load(path)
    with pytest.raises(kd.InputError, match="both gravity of all pairs"):
        bodies(kd.Gravity()).with_forces(kd.Gravity(), kd.GravityTree())
    atoms = pytest.importorskip("ase").Atoms("Ar2", [[0, 0, 0], [4, 0, 0]])
    with pytest.raises(kd.InputError, match="lennard-jones and lennard-jones are twice the same"):
        kd.System.from_ase(atoms, forces=[kd.LennardJones(0.01, 3.4)] * 2)


@pytest.mark.parametrize(
    ("forces", "message"),
    [
        ((kd.Gravity(), kd.Gravity(softening=0.5)), "gravity is given twice, and both forces count"),
        ((kd.LennardJones(), kd.LennardJones(sigma=0.5)), "lennard-jones is given twice on pairs A-A"),
        ((first_order(), first_order(form="potential")), "relativity-1pn is given twice on particle 0"),
        ((kd.Oblateness(1e-3, radius=0.01), kd.Oblateness(1e-4, radius=0.01)), "j2 is given twice on particle 0"),
        ((kd.Gravity(), first_order(G=2.0)), "forces differ in G: G = 1 in gravity and G = 2 in relativity-1pn"),
        ((first_order(), kd.LenseThirring((0, 0, 1.0), c=90.0)), "forces differ in c: c = 100 in .* c = 90 in lense"),
    ],
)
def test_what_may_be_meant_is_told(forces, message):
    system = bodies(*forces)
    (warning,) = doubtful_forces(system)
    assert re.match(message, warning)


@pytest.mark.parametrize(
    "forces",
    [
        (kd.Gravity(), first_order(), first_order(central=1)),
        (kd.Gravity(), first_order(G=1.0 + 1e-9)),
        (kd.Tides(k2=[0.1, 0.0, 0.0], **TIDES), kd.TidesSpin(k2=[0.0, 0.1, 0.0], **SPINS)),
        (kd.Gravity(), kd.GravitySheet(1.0, 9.0, 9.0, G=0.0), kd.Hill(1.0)),
        (kd.UniformField((0, 0, -1.0)), kd.UniformField((0, 0, -1.0))),
    ],
)
def test_other_places_and_other_things_stand_beside_each_other(forces):
    assert not doubtful_forces(bodies(*forces))


def test_pairs_and_types_of_their_own_stand_beside_each_other():
    alone = [{"A": {}, "B": {"epsilon": 0.0}}, {"A": {"epsilon": 0.0}, "B": {"sigma": 0.8}}]
    apart = bodies(*(kd.LennardJones(cutoff=2.5, species=each) for each in alone), species=["A", "B", "A"])
    assert not doubtful_forces(apart)
    topology = kd.Topology([(0, 1), (1, 2)], bond_types=["a", "b"])
    first, second = kd.HarmonicBond(1.0, 1.0, types={"a": {}}), kd.HarmonicBond(1.0, 2.0, types={"b": {}})
    assert not doubtful_forces(bodies(first, second, topology=topology))
    both = bodies(first, kd.HarmonicBond(1.0, 2.0), topology=topology)
    assert doubtful_forces(both) == [
        "harmonic-bond is given twice on bond 0-1, and both forces count; give one force, unless a sum is meant"
    ]


def test_terms_of_a_dihedral_series_stand_beside_each_other():
    line = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [2, 1, 0.5]]
    terms = [kd.PeriodicDihedral(1.0, n) for n in (1, 2, 3)]
    system = kd.System(line, forces=terms, topology=kd.Topology([(0, 1), (1, 2), (2, 3)], dihedrals=True))
    assert not doubtful_forces(system)


def test_the_report_tells_it():
    report = kd.Simulation(bodies(kd.Gravity(), kd.Gravity(softening=0.5)), "rk4", dt=1e-3).run(2)
    assert report.warnings == ["gravity is given twice, and both forces count; give one force, unless a sum is meant"]
