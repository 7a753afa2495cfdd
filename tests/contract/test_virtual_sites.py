"""Virtual sites: places, forces, virial, files, and twenty steps of TIP4P/2005 beside OpenMM's Reference platform."""

from __future__ import annotations

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.analysis.certify import force_tests
from kickdrift.errors import InputError
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.model.starts.builders import check_overlaps

COUNT, EDGE, CUTOFF, DT = 27, 12.6, 6.0, 0.001
MASSES = (15.9994, 1.008, 1.008, 0.0)
CHARGES = (0.0, 0.5564, 0.5564, -1.1128)
SHARE = 0.131937768  # TIP4P/2005: 0.1546 angstrom of the 0.5860 from O to the middle of the hydrogens
BOND, ANGLE, EPSILON, SIGMA = 0.9572, 104.52, 0.008031, 3.1589


def table(rigid: bool = True, normal: float = 0.0, edge: float = EDGE, truncation: str = "cut") -> dict:
    found = {
        "units": "metal",
        "particles": {
            "lattice": "sc", "count": COUNT, "seed": 1, "species": ["O", "H", "H", "M"],
            "molecule": [[0.0, 0.0, 0.0], [BOND, 0.0, 0.0], [-0.2399, 0.9266, 0.0], [0.0, 0.0, 0.0]],
            "mass": {"O": MASSES[0], "H": MASSES[1], "M": 0.0},
            "charge": {"O": 0.0, "H": CHARGES[1], "M": CHARGES[3]},
        },
        "box": {"lengths": [edge] * 3},
        "topology": {"bonds": [[0, 1], [0, 2]], "angles": True, "factors": [0.0, 0.0, 1.0], "copies": COUNT},
        "virtual_site": [
            {"particles": 3, "of": [0, 1, 2], "weights": [1.0 - 2.0 * SHARE, SHARE, SHARE], "normal": normal}
        ],
        "velocities": {"temperature": 298.0, "seed": 1},
        "force": [
            {
                "type": "lennard-jones", "cutoff": CUTOFF, "truncation": truncation,
                "species": {
                    "O": {"epsilon": EPSILON, "sigma": SIGMA},
                    "H": {"epsilon": 0.0, "sigma": 1.0},
                    "M": {"epsilon": 0.0, "sigma": 1.0},
                },
            },
            {"type": "coulomb", "method": "ewald", "cutoff": CUTOFF, "accuracy": 1e-9},
        ],
    }  # fmt: skip
    if rigid:
        found["constraint"] = [{"bonds": True, "distance": BOND}, {"angles": True, "angle": ANGLE}]
    else:
        found["force"] += [
            {"type": "harmonic-bond", "stiffness": 40.0, "length": BOND},
            {"type": "harmonic-angle", "stiffness": 6.0, "rest": ANGLE},
        ]
    return found


def water(**given) -> kd.System:
    return kd.load(table(**given))


def energy_at(system: kd.System, x: np.ndarray, bound: BoundForces) -> float:
    return bound.measure(0.0, np.array([x, system.state.phase[1]])).potential


def test_a_site_may_be_near_and_a_particle_may_not():
    """TIP5P's lone pairs come near hydrogen of other molecules."""
    x = np.array([[1.0, 1.0, 1.0], [5.0, 1.0, 1.0], [1.0, 5.0, 1.0], [4.0, 1.0, 1.0], [4.0, 1.3, 1.0]])
    alone = [kd.LennardJones(EPSILON, SIGMA, cutoff=CUTOFF)]
    site = kd.VirtualSite(3, (0, 1), (0.25, 0.75))
    check_overlaps(
        kd.System(x, masses=[16.0, 16.0, 16.0, 0.0, 16.0], forces=alone, units="metal", virtual_sites=[site])
    )
    with pytest.raises(InputError, match=r"particles 3 and 4 overlap: distance 0\.3 angstrom"):
        check_overlaps(kd.System(x, masses=16.0, forces=alone, units="metal"))


@pytest.mark.parametrize("normal", [0.0, 0.4])
def test_forces_are_the_slopes_of_the_energy(normal):
    """Forces on the particles that sites follow, by differences; sites feel none, and the sum is zero."""
    system = water(normal=normal, truncation="force-shift")
    bound, h = BoundForces(system), 1e-4
    forces = bound.measure(0.0, system.state.phase.copy()).accelerations * system.coherent_masses
    assert np.abs(forces.sum(axis=1)).max() < 1e-12
    assert not forces[:, 3::4].any()
    for i in (0, 1, 2, 3, 41, 42):
        for axis in range(3):
            sides = []
            for side in (-h, h):
                x = system.state.phase[0].copy()
                x[axis, i] += side
                sides.append(energy_at(system, x, bound))
            assert (sides[0] - sides[1]) / (2 * h) == pytest.approx(forces[axis, i], abs=1e-7)


@pytest.mark.parametrize("normal", [0.0, 0.4])
def test_the_virial_is_the_slope_of_the_energy(normal):
    """Box and particles scaled together; the sites follow the particles, so that a cross product scales twice."""
    system, h = water(normal=normal, rigid=False, truncation="force-shift"), 1e-5
    virial = BoundForces(system).measure(0.0, system.state.phase.copy()).virial
    sides = []
    for side in (1.0 - h, 1.0 + h):
        scaled = system.remade(box=[EDGE * side] * 3, positions=system.state.positions * side)
        sides.append(energy_at(scaled, scaled.state.phase[0].copy(), BoundForces(scaled)))
    assert virial == pytest.approx((sides[0] - sides[1]) / (2 * h), abs=2e-5)  # the error of Ewald's sum over h


def test_certify_tests_the_forces_of_sites():
    """Moves by whole edges and scaled boxes place the sites anew, and a site is no neighbour of its molecule."""
    system = water(rigid=False, truncation="force-shift")
    evaluate, rng = force_tests.Evaluator(system), np.random.default_rng(0)
    states = force_tests.tested_states(evaluate, 1, 0.05, rng)
    near = force_tests.nearest_distances(system)
    assert near.min() > 0.9  # the bond; the site of oxygen is at 0.15
    given = force_tests.Subject(evaluate, states, evaluate(states[0]), near, rng, (), ("virtual_site",), 1e-9)
    rows = [*force_tests.symmetry_tests(given), force_tests.virial_test(given)]
    assert [row.test for row in rows if row.verdict == "pass"] == [
        "translation", "periodic images", "rotation", "virial = -dE/dV"
    ]  # fmt: skip


@pytest.mark.parametrize("wrong", [{"of": [0, 1, 9]}, {"particles": 9}])
def test_a_site_beside_its_molecule_is_named(wrong):
    given = table()
    given["virtual_site"][0].update(wrong)
    with pytest.raises(InputError, match=r"virtual_site.*no particle 9 in a molecule of 4 particles"):
        kd.load(given)


def test_the_pressure_of_rigid_molecules_with_sites_is_that_of_the_centres():
    """Centres and box scaled, molecules with their sites as they are."""
    system, h = water(truncation="force-shift"), 1e-5
    sample = kd.Simulation(system, dt=DT).run(0)
    x, masses = system.state.positions.reshape(COUNT, 4, 3), np.array(MASSES)
    centres = np.einsum("i,nix->nx", masses, x)[:, None, :] / masses.sum()
    sides = []
    for side in (1.0 - h, 1.0 + h):
        scaled = system.remade(box=[EDGE * side] * 3, positions=(x + (side - 1.0) * centres).reshape(-1, 3))
        sides.append(kd.Simulation(scaled, dt=DT).energy().potential)
    moving = np.einsum("i,nix->nx", masses, system.state.velocities.reshape(COUNT, 4, 3)) / masses.sum()
    twice = masses.sum() * system.units.coherent_mass * float((moving**2).sum())
    expected = (twice + (sides[0] - sides[1]) / (2 * h)) / (3 * system.volume)
    assert sample.pressure == pytest.approx(expected, abs=1e-5 * twice / (3 * system.volume))


def test_sites_stand_at_their_places_without_freedom():
    system = water()
    assert system.degrees_of_freedom == 6 * COUNT - 3
    sim = kd.Simulation(system, "baoab", dt=0.002, temperature=298.0, friction=5.0)
    report = sim.run(40, every=10)
    x, v = sim.state.positions.reshape(COUNT, 4, 3), sim.state.velocities
    np.testing.assert_allclose(x[:, 3], (1 - 2 * SHARE) * x[:, 0] + SHARE * (x[:, 1] + x[:, 2]), atol=1e-13)
    assert not v[3::4].any()
    assert report.molecules.error < 1e-13


def test_twenty_steps_are_those_of_openmm():
    mm = pytest.importorskip("openmm")
    start = water()
    sim = kd.Simulation(start, "velocity-verlet", dt=DT)
    sim.run(20, every=20)
    ours = sim.state.positions
    assert np.abs(ours - start.state.positions).max() > 0.2
    system, nb, nm = mm.System(), mm.NonbondedForce(), 0.1
    system.setDefaultPeriodicBoxVectors(*(mm.Vec3(*row) for row in np.eye(3) * EDGE * nm))
    nb.setNonbondedMethod(mm.NonbondedForce.Ewald)
    nb.setCutoffDistance(CUTOFF * nm)
    nb.setEwaldErrorTolerance(1e-10)
    nb.setUseDispersionCorrection(False)
    across = 2.0 * BOND * np.sin(np.radians(ANGLE / 2.0)) * nm
    for k in range(COUNT):
        for mass, charge in zip(MASSES, CHARGES, strict=True):
            system.addParticle(mass)
            nb.addParticle(charge, SIGMA * nm, 0.0 if charge else EPSILON * 96.48533212331)
        for a in range(4):
            for b in range(a):
                nb.addException(4 * k + a, 4 * k + b, 0.0, 1.0, 0.0)
        for a, b, length in ((0, 1, BOND * nm), (0, 2, BOND * nm), (1, 2, across)):
            system.addConstraint(4 * k + a, 4 * k + b, length)
        system.setVirtualSite(
            4 * k + 3, mm.ThreeParticleAverageSite(4 * k, 4 * k + 1, 4 * k + 2, 1.0 - 2.0 * SHARE, SHARE, SHARE)
        )
    system.addForce(nb)
    drift, kick, both = mm.CustomIntegrator(DT), mm.CustomIntegrator(DT), mm.CompoundIntegrator()
    drift.addPerDofVariable("before", 0.0)
    for variable, formula in (("v", "v+0.5*dt*f/m"), ("x", "x+dt*v"), ("before", "x")):
        drift.addComputePerDof(variable, formula)
    drift.addConstrainPositions()
    drift.addComputePerDof("v", "v+(x-before)/dt")
    kick.addComputePerDof("v", "v+0.5*dt*f/m")  # apart, because OpenMM places its sites at the end of a step
    kick.addConstrainVelocities()
    for part in (drift, kick):
        part.setConstraintTolerance(1e-12)
        both.addIntegrator(part)
    context = mm.Context(system, both, mm.Platform.getPlatformByName("Reference"))
    context.setPositions(start.state.positions * nm)
    context.setVelocities(start.state.velocities * nm)
    for _ in range(20):
        for part in range(2):
            both.setCurrentIntegrator(part)
            both.step(1)
            context.setPositions(context.getState(getPositions=True).getPositions())  # the other's forces are old
    state = context.getState(getPositions=True, getVelocities=True)
    apart = state.getPositions(asNumpy=True)._value / nm - ours
    assert np.abs(apart - EDGE * np.round(apart / EDGE)).max() < 1e-6
    speeds = state.getVelocities(asNumpy=True)._value.reshape(COUNT, 4, 3)[:, :3] / nm
    assert np.abs(speeds - sim.state.velocities.reshape(COUNT, 4, 3)[:, :3]).max() < 1e-4


@pytest.mark.parametrize(("method", "options"), [("leapfrog-dkd", {}), ("respa", {"substeps": 1})])
def test_other_words_place_their_sites(method, options):
    """A word that ends with a drift shows sites at their places; kicks by groups spread the forces of each group."""
    system = water(rigid=False, normal=0.4, truncation="force-shift")
    grouped = kd.Coulomb(method="ewald", cutoff=CUTOFF, accuracy=1e-9, group=len(options))
    system = system.with_forces(*(grouped if force.name == "coulomb" else force for force in system.forces))
    dt, steps = 2e-5, 50
    sim, verlet = (kd.Simulation(system, name, dt=dt, **more) for name, more in ((method, options), ("leapfrog", {})))
    sim.run(steps, every=7)
    verlet.run(steps)
    np.testing.assert_allclose(sim.state.positions, verlet.state.positions, rtol=0.0, atol=1e-12 if options else 3e-6)
    x = sim.state.phase[0].copy()
    system.virtual_sites.place(x)
    np.testing.assert_array_equal(sim.state.phase[0], x)


def test_files_and_text_keep_sites(tmp_path):
    system = water(normal=0.4)
    (tmp_path / "water.toml").write_text(system.to_toml(), encoding="utf-8")
    sim = kd.Simulation(system, "velocity-verlet", dt=DT)
    sim.run(10, every=5, output=tmp_path / "water.h5md")
    whole = kd.Simulation(system, "velocity-verlet", dt=DT)
    whole.run(20, every=5)
    resumed = kd.resume(tmp_path / "water.h5md")
    resumed.run(10)
    np.testing.assert_array_equal(resumed.state.phase, whole.state.phase)
    with kd.open(tmp_path / "water.h5md") as run:
        there = run.system()
    for other in (there, kd.load(tmp_path / "water.toml")):
        np.testing.assert_array_equal(other.state.phase, system.state.phase)
        np.testing.assert_array_equal(other.virtual_sites.of, system.virtual_sites.of)


REFUSED = [
    ({"of": [0]}, "of: expected two or three particles for each site"),
    ({"of": [0, 1, 1]}, "of: expected 3 different particles in each row, got [0, 1, 1]"),
    ({"weights": [0.5, 0.3, 0.3]}, "weights: expected the sum 1, got 1.1"),
    ({"weights": [0.5, 0.5]}, "weights: expected 3 numbers"),
    ({"of": [0, 1], "weights": [0.5, 0.5], "normal": 1.0}, "normal: needs three particles in `of`, got two"),
    ({"particles": 1, "of": [0, 2, 3]}, "particle 1 has a mass, and a site follows other particles; give it mass 0"),
    ({"particles": 3, "of": [0, 1, 7]}, "follows particle 7, which has no mass and cannot take its force"),
    ({"particles": 900}, "there is no particle 900"),
    ({"particles": 10**30}, "particles: expected the numbers of particles, got 1000"),
    ({"of": [0, 1, 10**30]}, "of: expected 3 different particles in each row, got [0, 1, 1000"),
]


@pytest.mark.parametrize(("change", "message"), REFUSED)
def test_bad_sites_are_refused_in_one_line(change, message):
    given = table()
    given["virtual_site"][0] |= change
    if change.get("particles") == 900 or change.get("of", [0])[-1] == 7:
        del given["topology"]["copies"], given["constraint"]
    with pytest.raises(InputError) as caught:
        kd.load(given)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def pressed(system: kd.System) -> kd.Simulation:
    options = {"temperature": 298.0, "friction": 5.0, "pressure": 0.0, "pressure_tau": 1.0, "compressibility": 70.0}
    return kd.Simulation(system, "baoab", dt=DT, coupling="per-axis", **options)


def test_what_has_no_sites_refuses_them():
    system = water()
    for call, words in (
        (lambda: kd.Simulation(system, "rk4", dt=DT), "keeps no constraints"),
        (lambda: kd.Simulation(water(rigid=False), "rk4", dt=DT), "keeps no virtual sites"),
        (lambda: kd.Simulation(water(rigid=False), dt=DT).minimize(), "it breaks virtual sites"),
        (lambda: kd.Simulation(water(rigid=False), dt=DT, engine="openmm"), "virtual sites: only a native run"),
        (lambda: pressed(water(normal=0.4, truncation="force-shift")), "virtual sites beside the plane"),
        (lambda: system.with_forces(kd.Gravity(G=1.0)), "force 'gravity' does not act through sites without mass"),
    ):
        with pytest.raises(InputError, match=words):
            call()
