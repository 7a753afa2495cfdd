"""Constraints as stated by users: what they mean, and what a System refuses in one line."""

from __future__ import annotations

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.batch import Batch
from kickdrift.errors import InputError
from kickdrift.run.minimization import minimum

BENT = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [-0.3, 0.9, 0.0]])
WATER = kd.Topology([(0, 1), (0, 2)], angles=True, bond_types="OH")
MASSES = [15.9994, 1.008, 1.008]


def water(*constraints: kd.Constraint, **more: object) -> kd.System:
    given = {"masses": MASSES, "species": ["O", "H", "H"], "topology": WATER, "units": "metal"} | more
    return kd.System(BENT, constraints=constraints, **given)


@pytest.mark.parametrize(
    "constraint",
    [
        kd.Constraint(bonds=True, distance=1.0),
        kd.Constraint(bonds="OH", distance=1.0),
        kd.Constraint(hydrogen=True, distance=1.0),
        kd.Constraint(pairs=[(0, 1), (2, 0)], distance=[1.0, 1.0]),
    ],
)
def test_bonds_are_named_in_several_ways(constraint):
    held = water(constraint).constraints
    np.testing.assert_array_equal(held.pairs, [[0, 1], [0, 2]])
    np.testing.assert_array_equal(held.lengths, [1.0, 1.0])


def test_hydrogen_is_known_by_its_mass_and_by_its_name():
    by_mass = water(kd.Constraint(hydrogen=True), species=["X", "Y", "Y"])
    by_name = water(kd.Constraint(hydrogen=True), units="lj", species=["O", "HW1", "HW2"])
    assert len(by_mass.constraints) == len(by_name.constraints) == 2
    heavy = water(kd.Constraint(hydrogen=True), masses=20.0, species=["O", "D", "D1"])
    assert len(heavy.constraints) == 2
    for other in ("He", "D", "Dy"):  # a species D of lj is no deuterium
        with pytest.raises(InputError, match="hydrogen: no bond has an end with the mass of hydrogen"):
            water(kd.Constraint(hydrogen=True), units="lj", species=["O", other, other])


def test_an_angle_is_a_distance_across_two_rigid_bonds():
    both = kd.Constraint(angles=True, angle=109.47), kd.Constraint(bonds=True, distance=1.0)
    system = water(*both)
    assert system.constraints.lengths[2] == pytest.approx(2.0 * np.sin(np.radians(109.47 / 2.0)), rel=1e-14)
    assert np.abs(system.constraints.errors(system.state.phase[0])).max() < 1e-15
    with pytest.raises(InputError, match="angle 1-0-2: its bond 1-0 has no constraint"):
        water(both[0])


def test_rigid_molecules_keep_their_shape():
    rng = np.random.default_rng(1)
    bonds = [(0, 1), (1, 2), (2, 3), (3, 4), (5, 6)]
    system = kd.System(rng.normal(size=(8, 3)), topology=kd.Topology(bonds), constraints=[kd.Constraint(rigid=True)])
    assert len(system.constraints) == 9 + 1
    assert system.degrees_of_freedom == 3 * 8 - 10 - 6
    assert system.constraints.start.moved == 0.0


@pytest.mark.parametrize("order", [(0, 1, 2, 3, 4, 5), (0, 1, 3, 2, 5, 4), (5, 4, 3, 2, 1, 0)])
def test_a_rigid_body_may_begin_with_particles_on_a_line_or_in_a_plane(order):
    x = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [0.5, 1, 0], [0.3, 0.4, 1], [0.9, 0.2, 2]])[list(order)]
    system = kd.System(x, constraints=[kd.Constraint(rigid=[range(6)])])
    assert len(system.constraints) == 12
    flat = kd.System(x[:, [0, 2, 1]][:, :2], dimensions=2, constraints=[kd.Constraint(rigid=[range(6)])])
    assert len(flat.constraints) == 9


def test_quantities_with_units_are_what_a_file_takes():
    system = water(kd.Constraint(bonds=True, distance="0.1 nm"), kd.Constraint(angles=True, angle="109.47 deg"))
    numbers = water(kd.Constraint(bonds=True, distance=1.0), kd.Constraint(angles=True, angle=109.47))
    np.testing.assert_allclose(system.constraints.lengths, numbers.constraints.lengths, rtol=1e-14)
    each = water(kd.Constraint(pairs=[(0, 1), (0, 2)], distance=["1.1 angstrom", 1.0]))
    np.testing.assert_allclose(each.constraints.lengths, [1.1, 1.0], rtol=1e-14)


def test_a_start_is_projected_and_the_system_says_how_far():
    system = water(kd.Constraint(bonds=True, distance=1.1), velocities=np.random.default_rng(2).normal(size=(3, 3)))
    centre = np.array(MASSES) @ BENT
    assert 0.1 < system.constraints.start.moved < 0.2
    assert 0.0 < system.constraints.start.lost < 1.0
    np.testing.assert_allclose(np.array(MASSES) @ system.state.positions, centre, atol=1e-12)
    again = system.remade()
    np.testing.assert_array_equal(again.state.phase, system.state.phase)


def test_a_loose_tolerance_is_that_of_runs_alone():
    """Each start is projected to rounding."""
    system = water(kd.Constraint(bonds=True, distance=1.1, tolerance=1e-3))
    assert system.constraints.start.moved > 0.1
    assert np.abs(system.constraints.errors(system.state.phase[0])).max() < 1e-15


def test_constraints_may_come_from_a_generator():
    held = kd.System(BENT, topology=WATER, constraints=(kd.Constraint(bonds=True) for _ in range(1))).constraints
    np.testing.assert_array_equal(held.pairs, [[0, 1], [0, 2]])
    assert kd.System(BENT, constraints=iter([])).constraints is None


def test_a_molecule_across_a_face_of_the_box_becomes_whole():
    x = np.array([[0.1, 5.0, 5.0], [9.4, 5.0, 5.0]])
    system = kd.System(x, box=[10.0] * 3, constraints=[kd.Constraint(pairs=[(0, 1)], distance=0.7)])
    np.testing.assert_allclose(system.state.positions[1], [-0.6, 5.0, 5.0], atol=1e-12)


FAR = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
TRIANGLE = [(0, 1), (1, 2), (0, 2)]


@pytest.mark.parametrize(
    ("given", "more", "words"),
    [
        ({}, {}, "expected exactly one of pairs, bonds, hydrogen, angles, rigid, got none"),
        ({"pairs": [(0, 1)], "rigid": True}, {}, "got pairs and rigid"),
        ({"pairs": [(0, 0)]}, {}, "joins a particle to itself"),
        ({"pairs": [(0, 7)]}, {}, "there is no particle 7; particles are 0 to 2"),
        ({"pairs": [(0, 1)], "distance": 0.0}, {}, "expected a length above zero"),
        ({"pairs": [(0, 1)], "distance": [1.0, 2.0]}, {}, "got 2"),
        ({"pairs": [(0, 1)], "tolerance": 1e-30}, {}, "below which all is rounding"),
        ({"pairs": [(0, 1)]}, {"masses": [1.0, 0.0, 1.0]}, "particle 1 has no mass"),
        ({"pairs": [(0, 1)]}, {"box": [2.0, 9.0, 9.0]}, "so that the nearest image is certain"),
        ({"pairs": TRIANGLE, "distance": [1.0, 1.0, 3.0]}, {}, "contradict each other"),
        ({"pairs": TRIANGLE}, {}, "follows from the others"),
        ({"rigid": True}, {}, "lists no bonds"),
        ({"rigid": [["a", "b"]]}, {}, "two or more of the particles 0 to 2, got ['a', 'b']"),
        ({"rigid": [[0, 1.7]]}, {}, "two or more of the particles 0 to 2, got [0, 1.7]"),
        ({"rigid": [[True, False]]}, {}, "two or more of the particles 0 to 2, got [True, False]"),
        ({"pairs": []}, {}, "pairs: the list is empty"),
        ({"rigid": []}, {}, "rigid: the list is empty"),
        ({"pairs": [(0, 1)], "distance": "1 fs"}, {"units": "metal"}, "distance: expected a length"),
        ({"pairs": [(0, 1)], "distance": "-1 nm"}, {"units": "metal"}, "expected a length above zero"),
        ({"bonds": "CH"}, {"topology": WATER}, "no bonds of type 'CH'"),
        ({"angles": True, "angle": 200.0}, {}, "expected degrees between 0 and 180"),
    ],
)
def test_bad_input_is_one_line_that_names_the_key(given, more, words):
    with pytest.raises(InputError, match=r"^constraint(\[0\])?: ") as found:
        kd.System(FAR, constraints=[kd.Constraint(**given)], **more)
    assert words in str(found.value)
    assert "\n" not in str(found.value)


def test_two_lengths_of_one_pair_and_too_many_conditions_are_refused():
    twice = [kd.Constraint(pairs=[(0, 1)], distance=length) for length in (1.0, 2.0)]
    with pytest.raises(InputError, match="particles 0 and 1 cannot be both 1 and 2 apart"):
        kd.System(FAR, constraints=twice)
    x = np.random.default_rng(1).normal(size=(5, 3))
    with pytest.raises(InputError, match="has 10 constraints, 1 more than its 5 particles have internal motions"):
        kd.System(x, constraints=[kd.Constraint(pairs=[(a, b) for b in range(5) for a in range(b)])])
    chain = np.arange(10_003.0)[:, None] * np.eye(3)[0]
    with pytest.raises(InputError, match="has 10,002 constraints; the limit is 10,000"):
        kd.System(chain, constraints=[kd.Constraint(pairs=[(k, k + 1) for k in range(10_002)])])


def test_what_moves_particles_freely_refuses_constraints(tmp_path):
    held = kd.Constraint(pairs=[(0, 1)])
    bodies = kd.System(BENT, masses=MASSES, forces=[kd.Gravity()], units="nbody", constraints=[held])
    with pytest.raises(InputError, match="a batch moves each particle freely, and 'system' has constraints"):
        Batch([bodies, bodies], "leapfrog", 0.01)
    with pytest.raises(InputError, match="minimize moves particles freely, so it breaks constraints"):
        minimum(bodies)
    crystal = kd.System(BENT, box=(9.0, 9.0, 9.0), forces=[kd.LennardJones(cutoff=2.5)], constraints=[held])
    with pytest.raises(InputError, match=r"elastic_constants: .* would break the constraints"):
        kd.analysis.elastic_constants(crystal)
    kd.Simulation(bodies, dt=0.01).run(2, output=tmp_path / "run.h5md")
    with pytest.raises(InputError, match="constraints"):
        kd.resume(tmp_path / "run.h5md", system=bodies.remade(constraints=None))


def test_a_message_names_the_constraint_and_the_particles():
    near = kd.Constraint(pairs=[(0, 1)])
    with pytest.raises(InputError, match=r"^constraint\[1\]: pair \[0, 7\]: there is no particle 7"):
        kd.System(FAR, constraints=[near, kd.Constraint(pairs=[(0, 7)])])
    with pytest.raises(InputError, match=r"^constraint\[0\]: particle 0 and particle 1 are at one place"):
        kd.System(np.zeros((2, 3)), constraints=[near])
    larger = kd.System(FAR, constraints=[kd.Constraint(pairs=[(1, 2)])])
    with pytest.raises(InputError, match=r"^constraint: pair \[1, 2\]: there is no particle 2"):
        kd.System(FAR[:2], constraints=larger.constraints)


def test_constraints_are_any_iterable():
    assert len(kd.System(FAR, constraints=(kd.Constraint(pairs=[(0, 1)]) for _ in range(1))).constraints) == 1
    assert kd.System(FAR, constraints=[]).constraints is None
    with pytest.raises(InputError, match="constraints: expected a list of"):
        kd.System(FAR, constraints=5)


def test_a_start_far_from_its_constraints_and_angles_without_rigid_bonds_are_refused():
    with pytest.raises(InputError, match=r"particles 0 and 1 are 1 apart, and their constraint is 0.1; start nearer"):
        kd.System(BENT, constraints=[kd.Constraint(pairs=[(0, 1)], distance=0.1)])
    with pytest.raises(InputError, match=r"angle 1-0-2: its bond .* a rigid angle needs both bonds rigid"):
        water(kd.Constraint(angles=True))
