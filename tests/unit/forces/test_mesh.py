"""Particle-mesh Ewald against Ewald's sum: forces, energies, virials, errors, boxes that change, bits, refusals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.forces.bound.forces import BoundForces, Measured
from kickdrift.forces.charges.fourier import POINT, plan_of, transform
from kickdrift.forces.charges.sampled import errors_of
from kickdrift.jit.compile import driver
from kickdrift.model.box.box import Box
from kickdrift.model.live_box import LiveBox
from tests.long import rest
from tests.systems import assert_bits_last

UPRIGHT = [6.0, 7.0, 8.0]
LEANING = [[6.0, 0.0, 0.0], [1.5, 6.5, 0.0], [-1.0, 2.0, 6.8]]
BOXES = pytest.mark.parametrize("box", [UPRIGHT, LEANING], ids=["upright", "leaning"])
SPECIAL = {"bonds": [(0, 1), (5, 6)], "factors": (0.5, 1.0, 1.0), "exclusions": [(8, 9)]}


def measured(system: kd.System, threads: int = 1) -> Measured:
    found = BoundForces(system, threads).measure(0.0, system.state.phase)
    assert found is not None
    return found


def ions(box: Any, net: float = 0.0, side: int = 4, special: bool = True, **given: Any) -> kd.System:
    """Disordered ions in a box, whose charges are not all of one size; some pairs are left out or scaled."""
    box = Box.of(box)
    sites, random = np.indices((side,) * 3).reshape(3, -1).T, np.random.default_rng(5)
    x = (sites + 0.5 + random.uniform(-0.3, 0.3, (side**3, 3))) / side @ box.matrix
    charges = np.where(sites.sum(axis=1) % 2, -1.0, 1.0) * random.uniform(0.5, 1.5, side**3)
    charges += (net - charges.sum()) / side**3
    topology = kd.Topology(**SPECIAL) if special else None
    return kd.System(x, box=box, charges=charges, forces=[kd.Coulomb(**given)], topology=topology)


@driver
def transform_lines(plan: Any, x: Any, y: Any, own: Any, sign: int) -> None:
    if sign > 0:
        transform(plan, x, 0, POINT, 8, y, 0, POINT, 8, own)
    else:
        transform(plan, x, 8, POINT, -8, y, 8, POINT, -8, own)


@pytest.mark.parametrize("n", [8, 9, 10, 15, 16, 24, 25, 27, 50, 60, 64, 90])
def test_transforms_are_those_of_numpy(n):
    x = np.random.default_rng(n).normal(size=(n, 2, 8))
    for sign, wanted in ((1, np.fft.fft), (-1, lambda z, axis: n * np.fft.ifft(z, axis=axis))):
        y = np.zeros_like(x)
        transform_lines(plan_of(n), x.ravel(), y.ravel(), np.zeros(2 * POINT * n), sign)
        exact = wanted(x[:, 0] + 1j * x[:, 1], axis=0)
        np.testing.assert_allclose(y[:, 0] + 1j * y[:, 1], exact, rtol=0, atol=2e-14 * n)


@pytest.mark.parametrize("net", [rest(0.0), 2.5])
@BOXES
def test_a_fine_mesh_gives_ewalds_sum(box, net):
    exact = measured(ions(box, net, accuracy=1e-12))
    found = measured(ions(box, net, method="pme", accuracy=1e-6))
    assert (found.potential, found.virial) == pytest.approx((exact.potential, exact.virial), rel=3e-7)
    np.testing.assert_allclose(found.accelerations, exact.accelerations, rtol=0, atol=2e-6)


@pytest.mark.parametrize("order", [4, 5, rest(6), rest(7), 8])
@BOXES
def test_forces_are_the_slope_of_the_energy_whatever_the_mesh(box, order):
    """The splines have order - 2 continuous slopes, so the quotient of differences is as good as the order allows."""
    split = {"alpha": 1.0, "cutoff": 2.7}  # the near part is taken off, since pairs enter and leave the cutoff
    systems = (
        ions(box, net=0.5, method="pme", mesh=(12, 15, 16), order=order, **split),
        ions(box, net=0.5, waves=1e-3, **split),
    )
    whole, near = (BoundForces(system) for system in systems)
    phase, way = systems[0].state.phase, np.random.default_rng(7).normal(size=(3, len(systems[0])))

    def far(h: float) -> tuple[float, np.ndarray]:
        there = phase + h * np.array([way, 0 * way])
        both = [bound.measure(0.0, there) for bound in (whole, near)]
        return both[0].potential - both[1].potential, both[0].accelerations - both[1].accelerations

    h = 2e-4
    slope = (8 * (far(h)[0] - far(-h)[0]) - (far(2 * h)[0] - far(-2 * h)[0])) / (12 * h)
    found = far(0.0)[1] * way
    assert slope == pytest.approx(-float(found.sum()), abs=1e-7 * float(np.abs(found).sum()))


@BOXES
def test_the_virial_is_the_slope_along_the_volume(box):
    """Of the far part alone, since pairs enter and leave the cutoff."""
    split = {"alpha": 1.0, "cutoff": 2.5}

    def far(s: float) -> tuple[float, float]:
        systems = (
            ions((1 + s) * np.array(box), 0.5, method="pme", mesh=(12, 15, 16), order=6, **split),
            ions((1 + s) * np.array(box), 0.5, waves=1e-3, **split),
        )
        mesh, near = (measured(system) for system in systems)
        background = systems[1].forces[0].background(systems[1]) / systems[1].volume
        return mesh.potential - near.potential + background, mesh.virial - near.virial + 3.0 * background

    h = 1e-3
    virial = -(8 * (far(h)[0] - far(-h)[0]) - (far(2 * h)[0] - far(-2 * h)[0])) / (12 * h)
    assert far(0.0)[1] == pytest.approx(virial, rel=1e-7)


@pytest.mark.parametrize("accuracy", [1e-2, 1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize("box", [12.0, LEANING], ids=["upright", "leaning"])
def test_the_error_of_the_forces_is_the_one_asked(box, accuracy):
    """Measured errors are at most the accuracy and at least a fifth of it."""
    box = [box] * 3 if isinstance(box, float) else 2.0 * np.array(box)
    system = ions(box, side=8, special=False, method="pme", accuracy=accuracy)
    errors = errors_of(system.forces[0], system)
    assert 0.4 * accuracy < errors.predicted < accuracy
    assert 0.2 * accuracy < errors.measured < accuracy


@pytest.mark.parametrize("beside", [False, True], ids=["alone", "beside a pair force"])
@BOXES
def test_the_mesh_follows_a_box_that_changes(box, beside):
    start = ions(box, net=0.5)
    others = [kd.LennardJones(sigma=0.7, cutoff=2.0, truncation="cut", tail=True)] if beside else []

    def system_at(scale: float) -> kd.System:
        coulomb = kd.Coulomb("pme", alpha=1.3, cutoff=2.2, mesh=(12, 15, 16), order=5)
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


def salt(**given: Any) -> kd.System:
    """Ions that a repulsion keeps apart, with velocities."""
    lennard_jones = kd.LennardJones(sigma=0.8, cutoff=1.6)
    system = ions([12.0] * 3, side=8, special=False).with_forces(lennard_jones, kd.Coulomb("pme", **given))
    velocities = np.random.default_rng(2).normal(scale=0.5, size=(len(system), 3))
    return system.at(np.array([system.state.positions.T, velocities.T]), 0.0)


def test_threads_cuts_and_restarts_keep_the_bits():
    assert_bits_last(lambda threads: kd.Simulation(salt(), dt=0.002, threads=threads), 40, 15)


def test_the_report_names_the_mesh_and_its_error():
    system = salt(accuracy=1e-3)
    report = kd.Simulation(system, dt=0.002).run(5)
    found, split = report.charges, system.forces[1].split(system)
    assert (found.method, found.mesh, found.order, found.waves) == ("pme", split.mesh, split.order, None)
    assert f"mesh {split.mesh[0]} x {split.mesh[1]} x {split.mesh[2]}, order {split.order}" in str(report)
    assert 0.0 < found.measured_error < 1e-3


def test_values_that_are_given_stay():
    system = ions([12.0] * 3, side=8, special=False, method="pme", accuracy=1e-3, cutoff=2.5, order=6)
    split = system.forces[0].split(system)
    assert (split.cutoff, split.order) == (2.5, 6)
    given = system.with_forces(kd.Coulomb("pme", mesh=(20, 18, 16), alpha=1.1))
    split = given.forces[0].split(given)
    assert (split.mesh, split.alpha) == ((20, 18, 16), 1.1)


def test_auto_takes_waves_for_few_ions_and_a_mesh_for_many():
    few, many = ions([6.0] * 3, method="auto"), ions([24.0] * 3, side=16, special=False, method="auto")
    assert few.forces[0].split(few) == kd.Coulomb().split(few)
    assert many.forces[0].split(many) == kd.Coulomb("pme").split(many)
    assert many.forces[0].split(many).mesh
    assert kd.Simulation(few, dt=1e-4).run(1).charges.method == "ewald"


REFUSED = [
    (lambda: kd.Coulomb(mesh=(16, 16, 16)), 'coulomb: mesh goes with method "pme", not "ewald"'),
    (lambda: kd.Coulomb("pme", waves=3.0), 'coulomb: waves goes with method "ewald", not "pme"'),
    (lambda: kd.Coulomb("pme", order=3), "coulomb: order must be from 4 to 8, got 3"),
    (lambda: kd.Coulomb("pme", mesh=(16, 14, 16)), "coulomb: mesh along y must be a number of points, 8 or more"),
    (lambda: kd.Coulomb("pme", mesh=(16, 16, 15)), "coulomb: mesh along z must be an even number of points, 8 or more"),
    (lambda: kd.Coulomb("pme", mesh=(16, 16)), "coulomb: mesh: expected three numbers"),
    (lambda: ions(UPRIGHT, method="pme").remade(box=None), 'coulomb: method "pme" needs a box that is periodic along'),
    (
        lambda: ions(UPRIGHT, method="pme", accuracy=1e-8, order=4, cutoff=1.0),
        "coulomb: no mesh gives accuracy 1e-08 here with the values that are given",
    ),
]  # fmt: skip


@pytest.mark.parametrize(("make", "line"), REFUSED, ids=[line[:50] for _, line in REFUSED])
def test_bad_input_is_one_line(make, line):
    with pytest.raises(InputError) as error:
        make()
    assert "\n" not in str(error.value)
    assert line in str(error.value)
