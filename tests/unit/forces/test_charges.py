"""Charges: Madelung constants, NIST's water, slopes of the energy, errors against an exact sum, refusals."""

from __future__ import annotations

import json
import math
import re
from typing import Any

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.engines.lammps_world import lammps_class
from kickdrift.errors import InputError
from kickdrift.forces.bound.forces import BoundForces, Measured
from kickdrift.forces.charges import binding
from kickdrift.forces.charges.accuracy import share_of
from kickdrift.forces.charges.coulomb import SINGLE
from kickdrift.forces.charges.pair_terms import radial_terms
from kickdrift.forces.charges.radial import Radial, damped_shifted, ewald_near, reaction_field
from kickdrift.forces.charges.sampled import errors_of, forces_on
from kickdrift.forces.lists.row_lanes import NarrowSingle, Wide, WideSingle
from kickdrift.forces.pairs import binding as pair_binding
from kickdrift.jit.compile import driver
from kickdrift.jit.lanes.memory import load, store
from kickdrift.model.box.box import Box
from kickdrift.model.box.cell import lengths_and_tilts
from kickdrift.model.live_box import LiveBox
from kickdrift.model.units import constants
from kickdrift.model.units.unit_systems import UNIT_SYSTEMS
from kickdrift.run.report.charges import charge_warnings
from kickdrift.run.report.warnings import unused_warnings
from tests.folders import DATA
from tests.long import rest
from tests.oracle import slab
from tests.systems import assert_bits_last

UPRIGHT = [6.0, 7.0, 8.0]
LEANING = [[6.0, 0.0, 0.0], [1.5, 6.5, 0.0], [-1.0, 2.0, 6.8]]
SPECIAL = {"bonds": [(0, 1), (5, 6)], "factors": (0.5, 1.0, 1.0), "exclusions": [(8, 9)]}


BESIDE = kd.LennardJones(sigma=0.7, cutoff=2.0, truncation="shift")
FINE = kd.Coulomb(accuracy=1e-8)
MESH = kd.Coulomb("pme", accuracy=1e-6)
FIELD = kd.Coulomb("reaction-field", cutoff=2.7, surroundings=78.0)


def measured(system: kd.System, threads: int = 1) -> Measured:
    found = BoundForces(system, threads).measure(0.0, system.state.phase)
    assert found is not None
    return found


def ions(box: Any, net: float = 0.0, side: int = 4, special: bool = True, **given: Any) -> kd.System:
    """Disordered ions in a box; some pairs are left out or scaled."""
    box = Box.of(box)
    sites = np.indices((side,) * 3).reshape(3, -1).T
    x = (sites + 0.5 + np.random.default_rng(3).uniform(-0.25, 0.25, (side**3, 3))) / side @ box.matrix
    charges = np.where(sites.sum(axis=1) % 2, -1.0, 1.0)
    charges[0] += net
    topology = kd.Topology(**SPECIAL) if special else None
    return kd.System(x, box=box, charges=charges, forces=[kd.Coulomb(**given)], topology=topology)


# --- closed forms and published numbers ---

CUBE = np.indices((2, 2, 2)).reshape(3, -1).T.astype(float)
FCC = np.array([[0, 0, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0]])
CRYSTALS = {  # positions, charges, edge, nearest neighbours, Madelung constant
    "rock salt": (CUBE, (-1.0) ** CUBE.sum(axis=1), 2.0, 1.0, 1.74756459463),
    "caesium chloride": (np.array([[0.0] * 3, [0.5] * 3]), [1.0, -1.0], 1.0, math.sqrt(0.75), 1.76267477307),
    "zincblende": (np.vstack([FCC, FCC + 0.25]), [1.0] * 4 + [-1.0] * 4, 1.0, math.sqrt(3.0) / 4.0, 1.63805505339),
}


@pytest.mark.parametrize("name", CRYSTALS)
def test_madelung_constants(name):
    """Bailey, Borwein, Kapoor & Weisstein 2006, doi:10.1080/00029890.2006.11920328, and Sakamoto 1958."""
    x, charges, edge, nearest, constant = CRYSTALS[name]
    found = measured(kd.System(x, box=[edge] * 3, charges=charges, forces=[kd.Coulomb(accuracy=1e-12)]))
    assert found.potential == pytest.approx(-constant * len(x) / 2 / nearest, rel=1e-10)
    assert found.virial == pytest.approx(found.potential, rel=1e-9)  # the law is homogeneous of degree -1
    assert np.abs(found.accelerations).max() < 1e-12


def water() -> tuple[kd.System, dict[str, float]]:
    """The first SPC/E configuration of NIST's Standard Reference Simulation Website in kelvin and angstrom, and the
    parts of its energy. See tests/data/nist-spce/reference.json for the source."""
    reference = json.loads((DATA / "nist-spce" / "reference.json").read_text(encoding="utf-8"))
    rows = [line.split() for line in (DATA / "nist-spce" / "config1.xyz").read_text(encoding="utf-8").splitlines()]
    edges, model = [float(each) for each in rows[1][1:]], reference["model"]
    x = np.array([[float(each) for each in row[1:4]] for row in rows[2:]])
    species = [row[4] for row in rows[2:]]
    in_kelvin = UNIT_SYSTEMS["metal"].coulomb / UNIT_SYSTEMS["metal"].boltzmann
    charges = [math.sqrt(in_kelvin) * model[f"charge_{name}"] for name in species]
    sigma = 10.0 * model["sigma_nm"]
    lennard_jones = kd.LennardJones(
        species={"O": {"epsilon": model["epsilon_over_kB_K"], "sigma": sigma}, "H": {"epsilon": 0.0, "sigma": sigma}},
        cutoff=10.0, truncation="cut", tail=True,
    )  # fmt: skip
    limit = math.sqrt(26.5) * 2.0 * math.pi / edges[0]  # between the squares 26 and 27
    coulomb = kd.Coulomb(alpha=5.6 / edges[0], cutoff=10.0, waves=limit)
    bonds = [(m, m + k) for m in range(0, len(x), 3) for k in (1, 2)]
    topology = kd.Topology(bonds, factors=(0.0, 0.0, 1.0))
    system = kd.System(
        x, box=edges, forces=[lennard_jones, coulomb], species=species, charges=charges, topology=topology
    )
    return system, {key: each[0] for key, each in reference.items() if key not in ("source", "unit", "model", "ewald")}


@pytest.mark.long
def test_each_part_of_the_energy_of_nists_water():
    """To half a unit of the printed digits, six; the near part of NIST uses an erfc with errors of 1.2e-7."""
    system, parts = water()
    dispersion, charges = system.forces
    with_dispersion = measured(system).potential
    alone = measured(system.with_forces(dispersion)).potential
    far = BoundForces(system).forces[1].parts
    intra = (
        measured(system.with_forces(charges)).potential
        - measured(system.remade(topology=None, forces=[charges])).potential
    )
    near_of_left_out = sum(
        far.charges[i] * far.charges[j] * math.erfc(far.alpha * r) / r
        for (i, j) in far.pairs.tolist()
        if (r := float(np.linalg.norm(system.box.minimum_image(system.state.positions[i] - system.state.positions[j]))))
    )
    found = {
        "dispersion": alone - dispersion.tail_corrections(system)[0],
        "dispersion_tail": dispersion.tail_corrections(system)[0],
        "self": far.alone,
        "intra": intra + near_of_left_out,
    }
    for key, value in found.items():
        assert value == pytest.approx(parts[key], rel=6e-6), key
    near_and_far = with_dispersion - alone - found["self"] - found["intra"]
    assert near_and_far == pytest.approx(parts["real"] + parts["fourier"], rel=2e-6)
    assert with_dispersion == pytest.approx(parts["total"], rel=3e-6)


# --- the sum itself ---


@pytest.mark.parametrize("net", [0.0, 2.5])
@pytest.mark.parametrize("box", [UPRIGHT, LEANING], ids=["upright", "leaning"])
def test_ewald_is_the_slope_of_its_energy_and_does_not_depend_on_the_splitting(box, net):
    system = ions(box, net, accuracy=1e-11)
    split, found = system.forces[0].split(system), measured(system)
    bound, way = BoundForces(system), np.random.default_rng(7).normal(size=(3, len(system)))

    def energy(h: float) -> float:
        return bound.measure(0.0, system.state.phase + h * np.array([way, 0 * way])).potential

    h = 1e-3
    slope = (8 * (energy(h) - energy(-h)) - (energy(2 * h) - energy(-2 * h))) / (12 * h)
    assert slope == pytest.approx(-float((found.accelerations * way).sum()), rel=1e-8)

    def stretched(s: float) -> float:
        given = {
            "alpha": split.alpha / (1 + s),
            "cutoff": 0.99 * split.cutoff * (1 + s),
            "waves": split.waves / (1 + s),
        }
        return measured(ions((1 + s) * np.array(box), net, **given)).potential

    virial = -(8 * (stretched(h) - stretched(-h)) - (stretched(2 * h) - stretched(-2 * h))) / (12 * h)
    assert found.virial == pytest.approx(virial, rel=1e-7)
    for factor in (0.9, 1.1):
        cutoff = split.cutoff * min(1.0, 1.0 / factor)
        other = measured(ions(box, net, alpha=factor * split.alpha, cutoff=cutoff, waves=1.2 * split.waves))
        assert other.potential == pytest.approx(found.potential, rel=1e-8)
        np.testing.assert_allclose(other.accelerations, found.accelerations, rtol=0, atol=1e-7)


@pytest.mark.parametrize("box", [UPRIGHT, LEANING], ids=["upright", "leaning"])
def test_compiled_forces_are_those_of_plain_numpy(box):
    system = ions(box, accuracy=1e-5)
    force = system.forces[0]
    plain = forces_on(np.arange(len(system)), force.scaled_charges(system), system, force.split(system))
    np.testing.assert_allclose(measured(system).accelerations.T, plain, rtol=0, atol=1e-8)


@pytest.mark.parametrize("accuracy", [1e-2, 1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize("box", [12.0, LEANING], ids=["upright", "leaning"])
def test_the_error_of_the_forces_is_the_one_asked(box, accuracy):
    """Measured errors are at most the accuracy and at least a fifth of it."""
    box = [box] * 3 if isinstance(box, float) else 2.0 * np.array(box)
    system = ions(box, side=8, special=False, accuracy=accuracy)
    errors = errors_of(system.forces[0], system)
    assert 1.3 * share_of(accuracy) * accuracy < errors.predicted < accuracy  # two parts with this share each
    assert 0.2 * accuracy < errors.measured < accuracy


def test_an_uneven_density_counts_in_the_error(monkeypatch):
    """Ions in two fifths of a box have 2.5 times the density that its volume tells, and their cutoff neglects more."""
    even = ions(2.0 * np.array(LEANING), side=8, special=False)
    matrix = even.box.matrix
    matrix[2, 2] *= 2.5
    slab = even.remade(box=Box.of(matrix))
    force = slab.forces[0]
    assert even.forces[0].charged(even).crowding == 1.0
    assert force.charged(slab).crowding == pytest.approx(2.3, abs=0.1)
    with monkeypatch.context() as patched:  # a System's is computed once
        patched.delattr("kickdrift.forces.charges.accuracy._crowding")
        assert force.charged(slab) == force.charged(slab)
        with pytest.raises(NameError):
            force.charged(slab.remade(box=Box.of(0.999 * matrix)))
    errors = errors_of(force, slab)
    assert 0.2 * force.accuracy < errors.measured < force.accuracy
    held = force.held(slab)
    assert held.split(even) == force.split(slab)


PRESSED = {"temperature": 1.0, "tau": 1.0, "pressure": 1.0, "pressure_tau": 1.0, "compressibility": 0.1}


def layered(accuracy: float, box: Any = (6.0, 7.0, 5.0), method: str = "ewald") -> kd.System:
    """A slab whose lower layers have larger charges, so that it has a dipole."""
    edges = np.asarray(box, float)
    slab = Box(matrix=edges if edges.ndim == 2 else np.diag(edges), periodic=[True, True, False])
    crowd = ions(slab.matrix, special=False)
    layers = np.indices((4,) * 3).reshape(3, -1)[2]
    charges = crowd.charges * np.array([2.0, 1.0, 1.0, 0.5])[layers] + np.array([0.3, 0.0, 0.0, -0.3])[layers]
    return crowd.remade(box=slab, charges=charges, forces=[kd.Coulomb(method, accuracy=accuracy)])


@pytest.mark.parametrize(
    ("method", "accuracy"), [rest("ewald", 1e-2), ("ewald", 1e-4), rest("ewald", 1e-8), rest("pme", 1e-4)]
)
def test_a_slab_is_that_of_the_exact_sum(method, accuracy):
    """Ewald's sum in two dimensions, at two splitting parameters, is exact; the slab's error is the accuracy."""
    system = layered(accuracy, method=method)
    x, edges, force = system.state.positions, np.diag(system.box.matrix)[:2], system.forces[0]
    (energy, forces), (again, _) = (slab.energy_and_forces(x, system.charges, edges, each) for each in (1.2, 0.9))
    assert again == pytest.approx(energy, rel=1e-13)
    found, unit = measured(system), force.charged(system).unit
    error = float(np.sqrt(np.square(found.accelerations.T - forces).sum(axis=1).mean())) / unit
    assert 0.2 * accuracy < error < accuracy
    assert found.potential == pytest.approx(energy, rel=2.0 * accuracy)
    assert 0.1 * error < errors_of(force, system).measured < 2.0 * error
    if accuracy < 1e-6:
        assert found.virial == pytest.approx(energy, rel=1e-5)


def test_slabs_lean_and_say_their_vacuum():
    leaning = [[6.0, 0.0, 0.0], [1.5, 6.5, 0.0], [0.0, 0.0, 5.0]]
    system = layered(1e-4, leaning)
    assert 0.2e-4 < errors_of(system.forces[0], system).measured < 1e-4
    report = kd.Simulation(system, dt=1e-3).run(2)
    vacuum = report.charges.vacuum
    assert vacuum > 6.5
    assert f"slab with a vacuum of {vacuum:.5g} σ" in str(report)
    far = system.at(np.array([system.state.phase[0] * [[1], [1], [2]], system.state.phase[1]]), 0.0)
    assert any(
        "the edge z of the box, which is the thickness of a slab, is 5 σ" in told for told in charge_warnings(far)
    )


@pytest.mark.long
@pytest.mark.parametrize("beside", [False, True], ids=["alone", "beside a pair force"])
@pytest.mark.parametrize("box", [UPRIGHT, LEANING], ids=["upright", "leaning"])
def test_ewalds_sum_follows_a_box_that_changes(box, beside):
    """Sums and accelerations are those of the force bound anew to the same waves."""
    start = ions(box, net=0.5)
    others = [kd.LennardJones(sigma=0.7, cutoff=2.0, truncation="cut", tail=True)] if beside else []

    def system_at(scale: float) -> kd.System:
        coulomb = kd.Coulomb(alpha=1.3, cutoff=2.2, waves=8.0 / scale)
        there = start.remade(box=Box.of(scale * start.box.matrix), forces=[*others, coulomb])
        return there.at(start.state.phase * scale, 0.0)

    system = system_at(1.0)
    live = LiveBox(system.box)
    bound, lengths = BoundForces(system, live=live), live.lengths.copy()
    for scale in (1.0, 0.97, 1.06, 1.0):
        live.lengths[:] = scale * lengths
        fresh = system_at(scale)
        found, wanted = bound.measure(0.0, fresh.state.phase), measured(fresh)
        assert (found.potential, found.virial) == pytest.approx((wanted.potential, wanted.virial), rel=1e-12)
        np.testing.assert_allclose(found.accelerations, wanted.accelerations, rtol=0, atol=1e-12)


def test_a_pair_force_takes_the_near_part_into_its_sum():
    given = {"alpha": 1.2, "cutoff": 2.5, "waves": 6.0}
    lennard_jones = kd.LennardJones(sigma=0.8, cutoff=2.0)
    alone, plain = ions(UPRIGHT, **given), ions(UPRIGHT, **given).with_forces(lennard_jones)
    both = alone.with_forces(lennard_jones, kd.Coulomb(**given))
    assert len(BoundForces(both).list_builds) == 2
    found, parts = measured(both), [measured(plain), measured(alone)]
    for key in ("accelerations", "potential", "virial"):
        wanted = sum(getattr(part, key) for part in parts)
        np.testing.assert_allclose(getattr(found, key), wanted, rtol=0, atol=1e-10 * np.abs(wanted).max())


def test_a_mixture_takes_the_near_part_too():
    given, kinds = (
        {"alpha": 1.2, "cutoff": 2.2, "waves": 6.0},
        {"A": {"sigma": 0.8}, "B": {"sigma": 0.6, "epsilon": 0.5}},
    )
    mixture = kd.LennardJones(species=kinds, cutoff=2.5, truncation="cut")  # a loop that NIST's water compiles
    alone = ions(UPRIGHT, **given).remade(species=["AB"[k % 2] for k in range(64)])
    found = measured(alone.with_forces(mixture, kd.Coulomb(**given)))
    parts = [measured(alone.with_forces(mixture)), measured(alone)]
    wanted = sum(part.accelerations for part in parts)
    np.testing.assert_allclose(found.accelerations, wanted, rtol=0, atol=1e-10 * np.abs(wanted).max())


# --- open space and cutoffs ---


def pairs_of(system: kd.System) -> tuple[np.ndarray, ...]:
    i, j = np.triu_indices(len(system), 1)
    apart = system.box.minimum_image(system.state.positions[i] - system.state.positions[j])
    factor = 1.0 if system.topology is None else system.topology.factor_of(i, j)
    return i, j, apart, np.linalg.norm(apart, axis=1), factor * system.charges[i] * system.charges[j]


def assert_sum(system: kd.System, energy: np.ndarray, over_r: np.ndarray, beside: float = 0.0) -> None:
    i, j, apart, r, product = pairs_of(system)
    forces = np.zeros((len(system), 3))
    np.add.at(forces, i, (product * over_r)[:, None] * apart)
    np.add.at(forces, j, -(product * over_r)[:, None] * apart)
    found = measured(system)
    np.testing.assert_allclose(found.accelerations.T, forces, rtol=0, atol=1e-11 * np.abs(forces).max())
    assert found.potential == pytest.approx(float((product * energy).sum()) + beside, rel=1e-11)
    assert found.virial == pytest.approx(float((product * over_r * r**2).sum()), rel=1e-11)


def test_all_pairs_in_open_space():
    system = ions(UPRIGHT).remade(box=None, forces=[kd.Coulomb("direct", dielectric=2.0)])
    _, _, _, r, _ = pairs_of(system)
    assert_sum(system, 0.5 / r, 0.5 / r**3)
    assert kd.Simulation(system, dt=1e-3).run(1).charges.method == "direct"


@pytest.mark.parametrize("surroundings", [rest(None), 78.0])
def test_a_reaction_field(surroundings):
    """Tironi et al. 1995, eqs. 4 and 5."""
    system, cutoff = ions(UPRIGHT, method="reaction-field", cutoff=2.9, surroundings=surroundings), 2.9
    _, _, _, r, _ = pairs_of(system)
    k = (0.5 if surroundings is None else 77.0 / 157.0) / cutoff**3
    inside = r < cutoff
    assert_sum(system, inside * (1 / r + k * r**2 - 1 / cutoff - k * cutoff**2), inside * (1 / r**3 - 2 * k))


def test_the_damped_shifted_force():
    """Fennell & Gezelter 2006, eqs. 18 and 19; energies of single charges as LAMMPS' coul/dsf has them."""
    from scipy.special import erfc

    cutoff, alpha = 2.9, 0.6
    system = ions(UPRIGHT, method="damped-shifted", cutoff=cutoff, alpha=alpha)
    _, _, _, r, _ = pairs_of(system)

    def field(r: Any) -> Any:
        return erfc(alpha * r) / r**2 + 2 * alpha / math.sqrt(math.pi) * np.exp(-((alpha * r) ** 2)) / r

    inside = r < cutoff
    energy = erfc(alpha * r) / r - erfc(alpha * cutoff) / cutoff + field(cutoff) * (r - cutoff)
    squares = float(system.charges @ system.charges)
    single = -(0.5 * math.erfc(alpha * cutoff) / cutoff + alpha / math.sqrt(math.pi)) * squares
    assert_sum(system, inside * energy, inside * (field(r) - field(cutoff)) / r, single)


@driver
def evaluate(radial: Any, r2: Any, energy: Any, force: Any) -> None:
    for k in range(0, r2.size, 8):
        u, g = radial_terms(radial, load(r2, k))
        store(energy, k, u)
        store(force, k, g)


LAWS = {
    "ewald 1e-4": (ewald_near(0.9, 3.3, 1e-4), 0.9, 1e-9),
    "ewald 1e-8": (ewald_near(0.9, 4.9, 1e-8), 0.9, 1e-12),
    "ewald 1e-12": (ewald_near(0.9, 5.8, 1e-12), 0.9, 1e-12),
}


@pytest.mark.parametrize("name", LAWS)
def test_the_polynomial_of_the_near_part(name):
    """Against mpmath, relative to the values at r = 1."""
    mpmath = pytest.importorskip("mpmath")
    radial, alpha, bound = LAWS[name]
    r = np.linspace(0.3, math.sqrt(radial.cutoff2), 160)
    energy, force = np.empty(160), np.empty(160)
    evaluate(radial, r * r, energy, force)
    for k, each in enumerate(r):
        z = mpmath.mpf(float(each)) * alpha
        exact = mpmath.erfc(z) / each
        slope = (exact + 2 * alpha / mpmath.sqrt(mpmath.pi) * mpmath.exp(-z * z)) / each**2
        assert abs(energy[k] - float(exact)) < bound * max(1.0, 1 / each)
        assert abs(force[k] - float(slope)) < 10 * bound * max(1.0, 1 / each**3)


@pytest.mark.parametrize("radial", [reaction_field(3.0, None), damped_shifted(0.5, 3.0), damped_shifted(0.0, 3.0)])
def test_shifted_laws_vanish_at_the_cutoff(radial: Radial):
    energy, force = np.empty(8), np.empty(8)
    evaluate(radial, np.full(8, 9.0), energy, force)
    assert abs(energy[0]) < 1e-13
    assert abs(force[0]) < 1e-12


# --- runs ---


def salt(**given: Any) -> kd.System:
    """A small molten salt in reduced units, of two species as the shipped one."""
    sites = np.indices((6, 6, 6)).reshape(3, -1).T
    charges, x = np.where(sites.sum(axis=1) % 2, -1.0, 1.0), 1.1 * (sites + 0.5)
    lennard_jones = kd.LennardJones(cutoff=2 ** (1 / 6), species={"A": {}, "B": {}})
    species = ["B" if charge < 0.0 else "A" for charge in charges]
    start = kd.System(x, box=[6.6] * 3, charges=charges, species=species, forces=[lennard_jones, kd.Coulomb(**given)])
    return start.with_velocities(temperature=0.5, seed=2)


@pytest.mark.long
def test_energy_is_conserved_and_the_report_says_what_was_chosen():
    sim = kd.Simulation(salt(accuracy=1e-5), dt=0.002)
    report = sim.run(400)
    assert report.energy.rms_relative_error < 1e-4
    assert report.energy.verdict != "secular drift"
    assert report.charges.method == "ewald"
    assert report.charges.measured_error < 1e-4
    errors = errors_of(sim.system.forces[1], sim.system.at(sim.state.phase, sim.time))  # of the end, not of the lattice
    assert report.charges.measured_error == errors.measured / errors.size
    text = str(report)
    assert "ewald, cutoff = " in text
    assert "measured for" in text
    assert json.dumps(report.as_json()["charges"])


def test_charges_that_are_all_zero_have_no_forces_and_no_error():
    system = ions(UPRIGHT, special=False).remade(charges=0.0)
    sim = kd.Simulation(system, dt=1e-3)
    report = sim.run(2)
    assert report.charges.predicted_error == 0.0
    assert not sim.forces().any()


def test_threads_cuts_and_restarts_keep_the_bits():
    assert_bits_last(lambda threads: kd.Simulation(salt(), dt=0.002, threads=threads), 60, 25)


def test_a_far_part_in_a_slower_group():
    system = salt()
    lennard_jones = system.forces[0]
    slow = system.with_forces(lennard_jones, kd.Coulomb(group=1))
    report = kd.Simulation(slow, "respa", dt=0.004).run(100)
    assert report.energy.rms_relative_error < 1e-3


def test_warnings_of_a_net_charge_and_of_charges_without_a_force():
    system = ions(UPRIGHT, net=0.5)
    assert any("the net charge is 0.5" in line for line in kd.Simulation(system, dt=1e-4).run(1).warnings)
    alone = ions(UPRIGHT, special=False).with_forces(kd.LennardJones(sigma=0.5, cutoff=2.0))
    assert any("charges have no effect" in line for line in kd.Simulation(alone, dt=1e-4).run(1).warnings)


# --- refusals ---


def drop() -> kd.System:
    return ions(UPRIGHT, special=False).remade(box=None, forces=[kd.Coulomb("direct")])


REFUSED = [
    (lambda: kd.Coulomb("pppm"), "coulomb: method 'pppm' is not one of ewald, pme, auto, direct, reaction-field, "),
    (lambda: kd.Coulomb(accuracy=0.0), "coulomb: accuracy must be from 1e-13 to 0.5, got 0.0"),
    (lambda: kd.Coulomb("direct", cutoff=2.0), 'coulomb: cutoff goes with method "ewald" and'),
    (lambda: kd.Coulomb(surroundings=3.0), 'coulomb: surroundings goes with method "reaction-field", not "ewald"'),
    (
        lambda: kd.Coulomb("direct", accuracy=1e-6),
        'coulomb: accuracy goes with method "ewald" and "pme" and "auto", not',
    ),
    (lambda: kd.Coulomb(cutoff=-1.0), "coulomb: cutoff must be positive, got -1.0"),
    (lambda: ions(UPRIGHT).remade(charges=None), "coulomb: the particles have no charges; give charge in"),
    (lambda: ions(UPRIGHT).remade(charges=[1.0, math.nan] * 32), "charges: particle 1 has charge nan"),
    (lambda: ions(UPRIGHT).remade(box=None), 'coulomb: method "ewald" needs a box that is periodic along three axes'),
    (
        lambda: ions(Box(UPRIGHT, periodic=[False, False, True])),
        "needs a box that is periodic along three axes, or along x and y, and this box is along z",
    ),
    (
        lambda: ions(Box(UPRIGHT, periodic=[True, True, False]), net=0.5),
        "coulomb: the charges of a slab must sum to zero, and their sum is 0.5",
    ),
    (
        lambda: kd.Simulation(layered(1e-4), "csvr", dt=0.1, **PRESSED),
        "is a system whose box is open along an axis, which has no volume",
    ),
    (lambda: ions(UPRIGHT).with_forces(kd.Coulomb("direct")), 'coulomb: method "direct" needs open space'),
    (lambda: ions(UPRIGHT, cutoff=3.1), "coulomb: box edge x is 6, shorter than twice the cutoff"),
    (
        lambda: ions(UPRIGHT, cutoff=2.9, alpha=3.0),
        "coulomb: alpha times cutoff is 8.7; a shorter cutoff than 2 serves",
    ),
    (lambda: ions(UPRIGHT, method="reaction-field"), 'coulomb: cutoff is needed by method "reaction-field"'),
    (lambda: ions(UPRIGHT).remade(masses=0.0), "coulomb: particle 0 has no mass"),
    (lambda: ions(UPRIGHT).remade(units="astro"), "coulomb: units 'astro' have no Coulomb constant"),
    (
        lambda: ions(UPRIGHT).with_forces(kd.Coulomb(), kd.Coulomb(accuracy=1e-3)),
        "forces: coulomb is given twice, and would count the same charges twice",
    ),
    (
        lambda: kd.Simulation(ions(UPRIGHT, accuracy=1e-6), dt=0.1, precision="mixed"),
        'coulomb: accuracy 1e-06 is more than pairs in float32 give to 64 particles, 2.0e-06; take precision "double"',
    ),
    (
        lambda: drop().watched([kd.Collision(0.1, action="merge")]),
        "collision: action 'merge' cannot act on charged particles",
    ),
]


@pytest.mark.parametrize(("make", "line"), REFUSED, ids=[line[:50] for _, line in REFUSED])
def test_bad_input_is_one_line(make, line):
    with pytest.raises(InputError) as error:
        make()
    assert "\n" not in str(error.value)
    assert line in str(error.value)


# --- mixed precision ---


def assert_single(system: kd.System) -> None:
    """Pairs in float32 differ from float64 by no more than the error that the accuracy allows, and by rounding."""
    double, mixed = (BoundForces(system, mixed=mixed).measure(0.0, system.state.phase) for mixed in (False, True))
    size = np.sqrt((double.accelerations**2).mean())
    apart = np.sqrt(((double.accelerations - mixed.accelerations) ** 2).mean())
    assert 1e-9 * size < apart < SINGLE * len(system) ** (1.0 / 3.0) * size
    assert mixed.pairs == double.pairs
    assert mixed.potential == pytest.approx(double.potential, rel=1e-6)
    assert mixed.virial == pytest.approx(double.virial, rel=1e-5, abs=1e-5 * abs(double.potential))
    if system.forces[-1].method == "reaction-field":  # all its forces are between pairs
        assert np.abs(mixed.accelerations.sum(axis=1)).max() < 1e-12 * size * len(system)


@pytest.mark.long
@pytest.mark.parametrize("beside", [(), (BESIDE,)], ids=["alone", "beside a pair force"])
def test_mixed_precision_differs_by_the_rounding_of_float32(beside):
    for force in (kd.Coulomb(), FIELD):
        assert_single(ions(LEANING).with_forces(*beside, force))


@pytest.mark.long
@pytest.mark.parametrize("lanes", [WideSingle(), NarrowSingle()], ids=lambda lanes: type(lanes).__name__)
def test_mixed_precision_with_other_widths_of_lanes(monkeypatch, lanes):
    for module in (binding, pair_binding):
        monkeypatch.setattr(module, "row_lanes", lambda mixed: lanes if mixed else Wide())
    assert_single(ions(UPRIGHT).with_forces(BESIDE, kd.Coulomb()))


@pytest.mark.long
def test_mixed_precision_gives_the_same_bits_on_threads_and_in_pieces():
    one, other = (kd.Simulation(kd.load("molten-salt"), dt=0.001, threads=k, precision="mixed") for k in (1, 2))
    one.run(20, every=20)
    for _ in range(2):
        other.run(10, every=5)
    np.testing.assert_array_equal(one.state.positions, other.state.positions)


def test_opposite_charges_without_a_core_are_named():
    system = ions(UPRIGHT)  # some particles are in bonds or exclusions
    x, charges = system.state.positions, system.charges
    apart = system.box.minimum_image(x[:, None] - x[None])
    r2 = np.where(charges[:, None] * charges[None] < 0, (apart**2).sum(axis=2), np.inf)
    held = [0, 1, 5, 6, 8, 9]
    r2[held], r2[:, held] = np.inf, np.inf
    i, j = (int(each) for each in np.unravel_index(r2.argmin(), r2.shape))
    (told,) = charge_warnings(system)
    assert told.startswith(tuple(f"particle {a} and particle {b} have opposite" for a, b in ((i, j), (j, i))))
    assert "lennard-jones" in told
    assert not charge_warnings(system.with_forces(BESIDE, FINE))
    assert charge_warnings(system.with_forces(kd.LennardJones(epsilon=0.0, cutoff=2.0), FINE)) == [told]


def test_info_tells_of_charges(kickdrift, tmp_path):
    _, told, _ = kickdrift("info", "molten-salt")
    assert re.search(r"net charge +0 e: 256 of -1 e, 256 of \+1 e\n", told)
    assert re.search(
        r"charges +ewald, cutoff = 11\.03 angstrom, alpha = .* 1,054 waves\nforce error +7\.1e-05 pred", told
    )
    (tmp_path / "bare.toml").write_text(salt().with_forces(BESIDE).to_toml())
    assert "warning           charges have no effect" in kickdrift("info", tmp_path / "bare.toml")[1]


def test_pairs_of_species_that_nobody_named_are_told():
    named = kd.LennardJones(cutoff=2.0, pairs={("A", "B"): {"sigma": 0.7}})
    system = kd.System([[0, 0, 0], [0, 0, 1]], species=["A", "B"], forces=[named])
    (told,) = unused_warnings(system)
    assert told.startswith("lennard-jones: pairs A-A, B-B have epsilon = 1 and sigma = 1, the default")
    assert not unused_warnings(system.with_forces(kd.LennardJones(0.5, cutoff=2.0, pairs=named.pairs)))


def test_coulombs_constant_of_each_unit_system():
    """Energy of two elementary charges an angstrom apart: 14.3996454784 eV by CODATA 2018, to its change since."""
    assert UNIT_SYSTEMS["lj"].coulomb == 1.0
    assert UNIT_SYSTEMS["metal"].coulomb == pytest.approx(14.3996454784, rel=2e-9)
    joules = UNIT_SYSTEMS["si"].coulomb * constants.ELEMENTARY_CHARGE**2 / 1e-10
    assert joules / constants.ELEMENTARY_CHARGE == pytest.approx(UNIT_SYSTEMS["metal"].coulomb, rel=1e-14)


@pytest.mark.parametrize(
    ("engine", "box", "forces", "more"),
    [
        rest("lammps", UPRIGHT, [BESIDE, FINE], {"special": False}),
        ("lammps", LEANING, [BESIDE, FINE], {"special": False}),
        ("lammps", UPRIGHT, [FINE], {"special": False, "net": 0.5}),
        ("lammps", UPRIGHT, [BESIDE, MESH], {"special": False}),
        rest("openmm", UPRIGHT, [BESIDE, MESH], {}),
        rest("openmm", UPRIGHT, [BESIDE, FINE], {}),
        ("openmm", UPRIGHT, [FINE], {"net": 0.5}),
        rest("openmm", UPRIGHT, [BESIDE, FIELD], {}),
        ("openmm", kd.Box(), [kd.Coulomb("direct")], {}),
    ],
    ids=str,
)
def test_other_programs_agree(engine, box, forces, more):
    """LAMMPS' erfc has relative errors of some 1e-7. A topology of `more` leaves pairs out, and scales others."""
    pytest.importorskip(engine)
    system = ions(UPRIGHT if box == kd.Box() else box, **more)
    if box == kd.Box():
        system = kd.System(system.state.positions, charges=system.charges, topology=system.topology)
    system = system.with_forces(*forces)
    own, other = (kd.Simulation(system, dt=1e-3, engine=each) for each in ("native", engine))
    assert other.energy().potential == pytest.approx(own.energy().potential, rel=1e-6)
    if system.box.periodic:
        assert other.sample().pressure == pytest.approx(own.sample().pressure, rel=1e-6)
    np.testing.assert_allclose(other.forces(), own.forces(), rtol=0, atol=1e-6 * np.abs(own.forces()).max())


def test_engines_name_the_methods_that_they_have():
    system = ions(UPRIGHT).with_forces(BESIDE, kd.Coulomb("damped-shifted", cutoff=2.7, alpha=0.5))
    possible = "'ewald' and 'pme' and 'auto' and 'direct' and 'reaction-field'"
    with pytest.raises(InputError, match=f"'damped-shifted': possible are {possible}"):
        kd.Simulation(system, dt=1e-3, engine="openmm")


STRAINS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
SPLITS = {
    "ewald": {"alpha": 1.0, "cutoff": 2.2, "waves": 8.0},
    "pme": {"method": "pme", "alpha": 1.0, "cutoff": 2.2, "mesh": (12, 15, 16), "order": 6},
}


HALF = [[6.0, 0.0, 0.0], [3.0, 7.0, 0.0], [3.0, 3.5, 8.0]]  # leans by half an edge, where barostats take other edges


@pytest.mark.long
@pytest.mark.parametrize("method", SPLITS)
def test_the_virial_across_the_axes_is_the_slope_of_the_energy_in_a_strain(method):
    """Also after a barostat has taken other edges of the same lattice; the energy then stays."""
    system = ions(HALF, net=0.5, **SPLITS[method])
    live = LiveBox(system.box, free=True)
    bound, phase, rows = BoundForces(system, live=live, apart=True), system.state.phase, system.box.matrix

    def energy(strain: np.ndarray) -> float:
        turned, turn = kd.Box.from_vectors(rows @ (np.eye(3) + strain))
        live.lengths[:] = lengths_and_tilts(turned.matrix)
        return bound.measure(0.0, np.array([turn @ (np.eye(3) + strain) @ phase[0], 0 * phase[0]])).potential

    h, slopes, start = 1e-6, [], energy(np.zeros((3, 3)))
    for i, j in STRAINS:
        strain = np.zeros((3, 3))
        strain[i, j] = strain[j, i] = h if i == j else 0.5 * h
        slopes.append((energy(-strain) - energy(strain)) / (2.0 * h))
    for other in (rows, np.array([[1, 0, 0], [-1, 1, 0], [0, -1, 1]]) @ rows):
        live.lengths[:] = lengths_and_tilts(other)
        found = bound.measure(0.0, phase)
        virials = bound.along.sum(axis=0).ravel()
        assert found.potential == pytest.approx(start, rel=1e-12)
        np.testing.assert_allclose(virials, slopes, rtol=0, atol=1e-8 * abs(start))
        assert virials[:3].sum() == pytest.approx(found.virial, rel=1e-12)


@pytest.mark.long
@pytest.mark.parametrize("method", ["ewald", "pme"])
def test_the_virial_across_the_axes_is_that_of_lammps(method):
    """Of LAMMPS' coul/long with ewald, whose erfc has errors of 1e-7."""
    pytest.importorskip("lammps")
    system = ions(LEANING, special=False, method=method, accuracy=1e-6)
    split, live = system.forces[0].split(system), LiveBox(system.box, free=True)
    bound = BoundForces(system, live=live, apart=True)
    bound.measure(0.0, system.state.phase)
    (ax, by, cz, cy, cx, bx), n = lengths_and_tilts(system.box.matrix).tolist(), len(system)
    lmp = lammps_class()(cmdargs=["-log", "none", "-screen", "none", "-nocite"])
    for line in (
        "units lj", "atom_style charge", "atom_modify map array",
        f"region whole prism 0 {ax} 0 {by} 0 {cz} {bx} {cx} {cy}", "create_box 1 whole", "mass 1 1.0",
        f"pair_style coul/long {split.cutoff}", "kspace_style ewald 1e-9",
        f"kspace_modify gewald {split.alpha}", "compute pull all pressure NULL virial",
    ):  # fmt: skip
        lmp.command(line)
    lmp.create_atoms(n, None, [1] * n, system.box.wrap(system.state.positions).ravel().tolist())
    lmp.scatter_atoms("q", 1, 1, np.ctypeslib.as_ctypes(np.array(system.charges)))
    for line in ("pair_coeff * *", "run 0 post no"):
        lmp.command(line)
    found = np.array(lmp.extract_compute("pull", 0, 1)[:6])[[0, 1, 2, 5, 4, 3]] * system.volume
    lmp.close()
    np.testing.assert_allclose(bound.along.sum(axis=0).ravel(), found, rtol=0, atol=2e-5 * np.abs(found).max())


@pytest.mark.parametrize(
    ("given", "error"),
    [
        ({"accuracy": 1e-6}, 1e-9),
        ({"method": "reaction-field", "cutoff": 2.7}, 1e-9),
        ({"method": "pme", "accuracy": 1e-6}, 1e-5),
    ],
    ids=str,
)
def test_the_pressure_tensor_has_the_virial(given, error):
    from kickdrift.looks.pressure import instantaneous_pressure

    system = ions(LEANING, net=0.5, **given)
    x = system.state.positions
    found = instantaneous_pressure(system, x, np.zeros_like(x)) * system.volume
    assert float(np.trace(found)) == pytest.approx(measured(system).virial, rel=error)


def test_charges_in_a_group_before_that_of_their_near_part_are_refused():
    with pytest.raises(InputError, match="coulomb: group 0 is below group 1 of 'lennard-jones'"):
        ions(UPRIGHT).with_forces(kd.LennardJones(cutoff=2.7, group=1), kd.Coulomb("ewald", group=0))
