"""What every force keeps at constant pressure: it follows the box, gives its virial along each axis, and keeps bits.

A force that no barostat takes says why.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.forces import FORCES
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.forces.many_body.base import ManyBodyForce
from kickdrift.integrators.options import Options
from kickdrift.integrators.splitting.barostats.barostat import check_pressed
from kickdrift.model.box.cell import lengths_and_tilts
from kickdrift.model.box.edges import lower
from kickdrift.model.live_box import LiveBox, in_box
from kickdrift_validation.example_forces import charges, crystal, example, topology
from tests.long import shortened
from tests.systems import liquid

RANGE = 1.6
LEANS = np.array([[1.0, 0.0, 0.0], [0.3, 1.0, 0.0], [0.1, -0.2, 1.0]])


def soft(positions: np.ndarray, velocities: np.ndarray, time: float, box: kd.Box) -> tuple[Any, float, Any]:
    """A soft repulsion (1 - r^2 / RANGE^2)^3 of all pairs in Python, with the virial as a matrix."""
    apart = box.minimum_image(positions[:, None] - positions[None])
    reach = np.maximum(1.0 - np.einsum("ijk,ijk->ij", apart, apart) / RANGE**2, 0.0)
    np.fill_diagonal(reach, 0.0)
    forces = 6.0 / RANGE**2 * (reach**2)[:, :, None] * apart
    return forces.sum(axis=1), 0.5 * float((reach**3).sum()), 0.5 * np.einsum("ija,ijb->ab", forces, apart)


def system_of(name: str) -> kd.System:
    """Particles in a periodic box under one force of this name."""
    if name == "python":
        force = kd.PythonForce(soft, external=False)
    else:
        force = example(FORCES[name], cutoff=1.5)
    if isinstance(force, ManyBodyForce):
        return crystal(force)
    start = liquid(64)
    given = {"topology": topology(force), "charges": charges(force, len(start))}
    return kd.System(start.state.positions, start.state.velocities, box=start.box, forces=[force], **given)


def leaning(system: kd.System) -> kd.System:
    """The same particles in a box that leans."""
    box = kd.Box(matrix=LEANS * np.diag(system.box.matrix))
    x = system.state.positions @ (np.linalg.inv(system.box.matrix) @ box.matrix)
    return in_box(system.at(np.array([x.T, system.state.phase[1]]), 0.0), box)


def found(name: str) -> tuple[bool, str]:
    """Whether a periodic box takes this force, and why no barostat does; "" if one does."""
    try:
        system = system_of(name)
    except InputError:
        return False, "a force of open space"
    return True, system.forces[0].fixes_box(system)


OURS = [name for name, cls in FORCES.items() if cls.__module__.startswith("kickdrift.")]
FOUND = {name: found(name) for name in OURS}
PRESSED = [name for name, (_, reason) in FOUND.items() if not reason]
FIXED = [name for name, (periodic, reason) in FOUND.items() if periodic and reason]


def changes_shape(name: str) -> bool:
    """Whether a barostat can change all of the box under this force."""
    system = system_of(name)
    return not (system.forces[0].fixes_shape(system) or system.forces[0].fixes_edges(system))


SHAPED = [name for name in PRESSED if changes_shape(name)]
EACH_KIND = [
    "lennard-jones",
    "eam",
    "stillinger-weber",
    "tersoff",
    "harmonic-bond",
    "harmonic-angle",
    "opls-dihedral",
    "springs",
]
EACH_KIND += ["mie", "coulomb", "restraint", "python", "ase", "lammps", "listed-pairs", "cmap", "tabulated"]
EACH_KIND += ["tabulated-bond", "formula-pair", "formula-bond"]
# The short set has each kind of loop in one of the tests below; the laws are compared in tests of their own.
EDGES = ["lennard-jones", "eam", "harmonic-bond", "springs", "restraint", "python"]
SHAPES = ["lennard-jones", "coulomb", "stillinger-weber", "harmonic-angle", "ase"]
RUNS = ["lennard-jones", "harmonic-bond", "python"]


def options_of(system: kd.System, coupling: str, barostat: str) -> dict[str, Any]:
    metal = system.units.name == "metal"
    tau = 0.2 if metal else 0.5
    given = {"temperature": 600.0 if metal else 1.0, "tau": tau, "pressure": "-1 GPa" if metal else 0.0}
    given |= {"coupling": coupling, "barostat": barostat}
    soft = {"compressibility": "0.02 GPa^-1" if metal else 0.2, "pressure_every": 3}
    return given | {"mtk": {"pressure_tau": tau}, "monte-carlo": soft}.get(barostat, soft | {"pressure_tau": tau})


def test_all_kinds_of_forces_are_pressed():
    assert set(EACH_KIND) <= set(PRESSED)
    assert {FORCES[name].__module__ for name in PRESSED} == {FORCES[name].__module__ for name in EACH_KIND}


@pytest.mark.parametrize("name", FIXED)
def test_a_force_without_a_virial_is_refused_by_name(name):
    system = system_of(name)
    options = Options(dt=0.002, **options_of(system, "isotropic", "c-rescale"))
    with pytest.raises(InputError, match=f"^pressure: force '{name}' does not scale with the box: {FOUND[name][1]}"):
        check_pressed(system, options)


def agree(got: Any, wanted: Any) -> None:
    scale = np.abs(wanted.accelerations).max()
    assert got.potential == pytest.approx(wanted.potential, rel=1e-10)
    assert got.virial == pytest.approx(wanted.virial, rel=1e-8, abs=1e-10 * abs(wanted.potential))
    np.testing.assert_allclose(got.accelerations, wanted.accelerations, rtol=0, atol=1e-9 * scale)
    assert got.pairs == wanted.pairs


@pytest.mark.parametrize("shape", ["rectangular", "leaning"])
@pytest.mark.parametrize("name", shortened(PRESSED, EDGES))
def test_a_force_follows_its_box(name, shape):
    """Sums and accelerations are those of the force bound anew; the virial is the slope of the energy in the edges."""
    system, rng = system_of(name), np.random.default_rng(4)
    if shape == "leaning":
        system = leaning(system)
    together = shape == "leaning" or bool(system.forces[0].fixes_shape(system))
    live, size = LiveBox(system.box), 0.002 * np.diag(system.box.matrix).min()
    start, bound = live.lengths.copy(), BoundForces(system, live=live, apart=not together)
    for _ in range(5):
        live.lengths *= np.exp(rng.normal(-0.005, 0.01, 1 if together else 3))
        phase = system.state.phase.copy()
        phase[0] = phase[0] * (live.lengths / start)[:, None] + rng.normal(0.0, size, phase[0].shape)
        fresh = in_box(system.at(phase, 0.0), live.box)
        got = bound.measure(0.0, phase)
        agree(got, BoundForces(fresh).measure(0.0, phase))

    def energy(factors: np.ndarray) -> float:
        there = np.array([phase[0] * factors[:, None], phase[1]])
        box = fresh.box.with_edges(fresh.box.matrix * factors)
        return BoundForces(in_box(system.at(there, 0.0), box)).measure(0.0, there).potential

    h, steps = 2e-6, [np.ones(3)] if together else list(np.eye(3))
    slopes = [(energy(1.0 - h * step) - energy(1.0 + h * step)) / (2 * h) for step in steps]
    virials = [got.virial] if together else bound.along.sum(axis=0)
    assert virials == pytest.approx(slopes, rel=1e-5, abs=1e-6 * abs(got.potential))
    assert np.sum(virials) == pytest.approx(got.virial, rel=1e-10, abs=1e-12 * abs(got.potential))


@pytest.mark.parametrize("shape", ["rectangular", "leaning"])
@pytest.mark.parametrize("name", shortened([name for name in EACH_KIND if name in SHAPED], SHAPES))
def test_a_force_follows_a_box_that_changes_its_shape(name, shape):
    """As above, also when the box takes other edges of its lattice; each part of the virial is the slope of the energy
    in a strain."""
    system, rng = system_of(name), np.random.default_rng(6)
    if shape == "leaning":
        system = leaning(system)
    live, size = LiveBox(system.box, free=True), 0.002 * np.diag(system.box.matrix).min()
    rows, x, bound = system.box.matrix, system.state.positions, BoundForces(system, live=live, apart=True)
    for k in range(8):
        change = np.tril(np.eye(3) + rng.normal(0.0, 0.02, (3, 3)))
        rows, x = rows @ change, x @ change + rng.normal(0.0, size, x.shape)
        if k == 4:
            rows[2] += rows[0] - rows[1]
        rows = lower(rows)
        live.lengths[:] = lengths_and_tilts(rows)
        phase = np.array([x.T, system.state.phase[1]])
        got = bound.measure(0.0, phase)
        agree(got, BoundForces(in_box(system.at(phase, 0.0), live.box)).measure(0.0, phase))

    def energy(strain: np.ndarray) -> float:
        box, turn = kd.Box.from_vectors(live.box.matrix @ (np.eye(3) + strain))
        there = np.array([turn @ (np.eye(3) + strain) @ phase[0], phase[1]])
        return BoundForces(in_box(system.at(there, 0.0), box)).measure(0.0, there).potential

    h, slopes = 2e-6, []
    for i, j in ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)):
        strain = np.zeros((3, 3))
        strain[i, j] = strain[j, i] = h if i == j else 0.5 * h
        slopes.append((energy(-strain) - energy(strain)) / (2 * h))
    virials = bound.along.sum(axis=0).ravel()
    assert virials == pytest.approx(slopes, rel=1e-5, abs=1e-6 * abs(got.potential))
    assert virials[:3].sum() == pytest.approx(got.virial, rel=1e-10, abs=1e-12 * abs(got.potential))


@pytest.mark.parametrize(
    ("barostat", "coupling"),
    [("c-rescale", "per-axis"), ("mtk", "isotropic"), ("monte-carlo", "semi-isotropic"), ("mtk", "full")],
)
@pytest.mark.parametrize("name", shortened(EACH_KIND, RUNS))
def test_a_run_at_constant_pressure_has_the_same_bits(name, barostat, coupling):
    """However it is cut, looked at or shared among threads, at a pressure of zero or below."""
    system = system_of(name)
    if system.forces[0].fixes_shape(system) or (coupling == "full" and system.forces[0].fixes_edges(system)):
        coupling = "isotropic"
    elif coupling in ("isotropic", "full"):
        system = leaning(system)

    def made(threads: int = 1) -> kd.Simulation:
        return kd.Simulation(system, "nose-hoover", 0.002, threads, **options_of(system, coupling, barostat))

    def end(sim: kd.Simulation) -> bytes:
        return sim.state.phase.tobytes() + repr(sim.state.box).encode()

    whole, looked, cut, again = made(), made(2), made(), made(2)
    whole.advance(40)
    looked.run(40, every=3)
    assert end(looked) == end(whole)
    cut.advance(13)
    kept = cut.checkpoint()
    cut.advance(27)
    again.restore(kept)
    again.run(27, every=5)
    assert end(cut) == end(again) == end(whole)
    assert whole.state.box != system.box or barostat == "monte-carlo"
