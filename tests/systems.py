"""Systems for several test modules."""

from __future__ import annotations

import math

import numpy as np

import kickdrift as kd
from kickdrift.forces import LennardJones
from kickdrift.integrators import integrator
from kickdrift.model.system import System
from kickdrift_validation.problems import kepler

CUTOFF = 2.5
GRID = 2.0**-24  # grid for positions and edges: differences and subtracted edges are then exact in both implementations
SPECIES = {"A": {}, "B": {"epsilon": 0.5, "sigma": 0.8}, "C": {"epsilon": 1.5, "sigma": 1.1}}
PAIRS = {("C", "A"): {"epsilon": 0.25, "sigma": 0.9}, ("B", "B"): {"sigma": 0.7}}


BATH = {"temperature": 1.0, "friction": 1.0, "tau": 0.5, "collision_rate": 1.0}


def needed(name):
    """Values of the options that a method cannot do without, beside dt: those of its heat bath."""
    values = BATH | ({"friction": 100.0} if integrator(name).overdamped else {})
    return {each.name: values[each.name] for each in integrator(name).declared if each.name in values}


def in_frame(name, system):
    """The system in the frame that a method needs: Hill's for sei, which hardly turns; spheres for event-driven; a tree
    for leapfrog-block; else unchanged."""
    if name == "leapfrog-block" and isinstance(system, System):
        return system.with_forces(kd.GravityTree(softening=0.1))
    if name == "event-driven" and isinstance(system, System):
        return system.with_forces().watched([kd.Collision(radii=0.01, action="bounce")])
    return system.with_forces(*system.forces, kd.Hill(0.02)) if name == "sei" and isinstance(system, System) else system


PRESSED = {"pressure": 0.5, "pressure_tau": 1.0, "compressibility": 0.1}
NOT_TAKEN = {"mtk": "compressibility", "monte-carlo": "pressure_tau"}  # by barostats


def pressed(given):
    """What options of a barostat or a ramp need beside them; nothing for other options."""
    if given.get("ramp_steps") is not None:
        return {"temperature_to": 2.0}
    own = {*PRESSED, "pressure_to", "barostat", "coupling", "pressure_every", "stress"}
    if not any(value is not None for key, value in given.items() if key in own):
        return {}
    left_out = {*given, NOT_TAKEN.get(given.get("barostat"))}
    full = {} if given.get("stress") is None else {"coupling": "full"}
    return full | {key: value for key, value in PRESSED.items() if key not in left_out}


def tried_with(name, key):
    """Whether tests of every choice try an option with a method: barostats with nose-hoover, which takes them all."""
    return key not in ("barostat", "coupling") or name == "nose-hoover"


def liquid(count=64, cutoff=2.0, seed=3) -> kd.System:
    """A disordered Lennard-Jones liquid in a small periodic box."""
    rng = np.random.default_rng(seed)
    edge = round(count ** (1 / 3))
    length = (count / 0.8442) ** (1 / 3)
    grid = np.indices((edge, edge, edge)).reshape(3, -1).T * length / edge
    x = grid + rng.uniform(-0.08, 0.08, (count, 3))
    v = rng.normal(size=(count, 3))
    v -= v.mean(axis=0)
    return kd.System(x, v, box=(length,) * 3, forces=[kd.LennardJones(cutoff=cutoff, truncation="shift")])


def wells(n: int, seed=4) -> kd.System:
    """Particles in a harmonic well, from the distribution at the temperature 1."""
    rng = np.random.default_rng(seed)
    return kd.System(rng.normal(size=(n, 3)), rng.normal(size=(n, 3)), forces=[kd.HarmonicTrap(1.0)], units="lj")


def assert_mean_squares(sim, exact):
    """Check the means of x^2 and v^2 of a run with a heat bath, which moves on, within four standard errors."""
    sim.advance(50)
    found = []
    for _ in range(60):
        sim.advance(8)
        found.append([(sim.state.positions**2).mean(), (sim.state.velocities**2).mean()])
    means = np.mean(np.array(found).reshape(12, 5, 2), axis=1)
    error = means.std(axis=0, ddof=1) / math.sqrt(12)
    assert np.all(np.abs(means.mean(axis=0) - exact) < 4 * error)
    assert np.all(error < 0.01)


def two_bodies(e: float, t: float = 0.0) -> kd.System:
    """Two unequal masses on a Kepler ellipse, at a time after pericentre; G = 1, semi-major axis 1."""
    (r, v), masses = kepler(t, e), np.array([0.6, 0.4])
    shares = np.array([-masses[1], masses[0]])[:, None]
    return kd.System(shares * r, shares * v, masses=masses, forces=[kd.Gravity()], units="nbody")


def circling(*names: str) -> kd.System:
    """Two bodies on circles about each other, period 2 pi, so that the angle is the time."""
    x, v = [[0.5, 0.0, 0.0], [-0.5, 0.0, 0.0]], [[0.0, 0.5, 0.0], [0.0, -0.5, 0.0]]
    return kd.System(x, v, [0.5, 0.5], forces=[kd.Gravity()], units="nbody", names=names)


def three_bodies() -> kd.System:
    """Three bodies of similar masses whose encounters need short steps."""
    x, v = [[0, 0, 0], [1, 0, 0], [0, 1.3, 0.2]], [[0, 0, 0], [0, 0.9, 0], [-0.7, 0, 0.1]]
    return kd.System(x, v, [1.0, 0.5, 0.3], forces=[kd.Gravity()], units="nbody")


def planets_that_meet(moved=(0, 0, 0, 0.0), masses=(1.0, 1e-3, 3e-4)) -> kd.System:
    """A star and two planets that meet; ``moved`` changes half, body and axis of the start by an amount."""
    x = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.02], [-1.4, 0.1, 0.0]])
    v = np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -0.86, 0.05]])
    half, body, axis, by = moved
    (x, v)[half][body, axis] += by
    return kd.System(x, v, masses, forces=[kd.Gravity(G=1.0)], units="nbody", names=["star", "b", "c"])


def slope(end, h=1e-4):
    """Derivative of a function of a displacement, by differences of order 4."""
    one, two = ((end(k * h) - end(-k * h)) / (2 * h * k) for k in (1, 2))
    return (4 * one - two) / 3


def on_grid(x):
    """Positions rounded to the grid."""
    return np.round(np.asarray(x) / GRID) * GRID


def fluid(rng, n):
    """Positions and box of a shaken simple cubic lattice at the density of a liquid."""
    cells = max(math.ceil(n ** (1 / 3)), 5)
    sites = rng.permutation(np.indices((cells,) * 3).reshape(3, -1).T)[:n]
    return on_grid((sites + rng.uniform(-0.2, 0.2, (n, 3))) * 1.0625), (1.0625 * cells,) * 3


def make_system(x, box=None, truncation="shift", mixed=False, seed=0, **options):
    """Lennard-Jones particles with random masses at x, of one species or of three."""
    rng = np.random.default_rng(seed)
    n = len(x)
    species = None
    if mixed:  # always two species or three, so that the compiled code is one of two
        options = {"species": SPECIES, "pairs": PAIRS, **options}
        species = [*"AB", *rng.choice(list("ABC"), max(n - 2, 0))][:n]
    force = LennardJones(**{"cutoff": CUTOFF, "truncation": truncation, **options})
    if species is not None:
        force = force.among(species)  # few particles may lack one of them
    return System(x, masses=rng.uniform(0.5, 20.0, n), box=box, forces=[force], species=species)


def moved(system, x):
    """The same system with its particles moved to x (n, 3)."""
    names = [system.species[k] for k in system.species_index]
    return System(x, masses=system.state.masses, box=system.box, forces=system.forces, species=names)


def assert_bits_last(made, steps, cut):
    """Check that two threads, and a restart after ``cut`` steps, keep the bits of a run; ``made`` takes the threads."""
    whole, first, threaded, other = (made(threads) for threads in (1, 1, 2, 1))
    whole.run(steps)
    first.run(cut)
    other.restore(first.checkpoint())
    other.run(steps - cut)
    threaded.run(steps)
    assert whole.state.phase.tobytes() == other.state.phase.tobytes() == threaded.state.phase.tobytes()
