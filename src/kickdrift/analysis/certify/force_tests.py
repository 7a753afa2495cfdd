"""Tests of forces at given positions: slopes of the energy, sums, symmetries, the virial, and jumps along a line."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.analysis.certify.certificate import ForceCheck, judged, skipped
from kickdrift.errors import InputError, RunError
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.model.box.box import Box
from kickdrift.model.checks.values import no_overflow
from kickdrift.model.molecules.relatives import molecules_of
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.run.simulation import Simulation

SLOPE = "force = -dE/dx"
NOISE = "digits of the energy"
MOMENTUM, TORQUE = "sum of forces", "sum of torques"
SHIFT, IMAGE, TURN, SWAP = "translation", "periodic images", "rotation", "exchange of like particles"
VIRIAL, BITS = "virial = -dE/dV", "same bits again"
STEPS = (3e-3, 1e-3, 3e-4, 1e-4)  # of central differences, in nearest distances
SHORTER = (3e-5, 1e-5)  # for forces that state an error, as charges do: a pair may cross their cutoff in all of STEPS
SCALINGS, SMALLER = (1e-4, 3e-5, 1e-5, 3e-6), (1e-6, 3e-7, 1e-7)  # the same for changes of the box
SAME, EXACT = 1e-9, 1e-11  # relative: of energies of equal configurations, and of sums that vanish
SLOPE_BOUND = 1e-6  # relative to the force on the particle
LEAST = 1e-3  # smallest force that counts by itself, relative to the typical force
NOISE_BOUND = 1e-10  # of the energy; float32 has 1e-7
SAMPLED = 24  # particles and directions whose force is tested
WHERE = ("energy", "force", "slope of the force", "curvature of the force")
POINTS = 400  # of a line
FINER = 4  # factor between two lattices of points
LEVELS = 5  # of ever finer lattices around the place
STENCIL = 12  # points on each side that are looked at again
CLEAR = 30.0  # times the typical difference of the line
ROUNDING = 1e3  # times the spacing of floats near the values


class Values(NamedTuple):
    """Forces and energies at one set of positions, in the units that make force = mass x acceleration."""

    forces: Floats  # (n, 3)
    energy: float
    virial: float  # nan if unknown


class Evaluator:
    """Forces of a System at any positions (n, 3).

    The evaluator keeps its pair lists between calls, as a run does. Another evaluator has lists of its own.
    """

    def __init__(self, system: System, engine: str | None = None, threads: int = 1) -> None:
        self.system, self.engine, self.threads = system, engine, threads
        self._masses = system.coherent_masses
        self._velocities = system.state.phase[1]
        self._measure = self._own() if engine is None else self._of_engine(engine)
        self.calls = 0

    def another(self, system: System | None = None) -> Evaluator:
        """An evaluator with lists of its own, of another System if given."""
        return Evaluator(self.system if system is None else system, self.engine, self.threads)

    def __call__(self, positions: Floats) -> Values:
        """Forces at ``positions`` (n, 3). Raises RunError if forces or energy are not finite."""
        self.calls += 1
        phase = np.ascontiguousarray([positions.T, self._velocities])
        with no_overflow():
            found = self._measure(phase)
        if found is None or not np.isfinite(found.potential):
            raise RunError(f"{self.system.name}: the forces are not finite at positions that a test tried")
        return Values((found.accelerations * self._masses).T.copy(), float(found.potential), float(found.virial))

    def _own(self) -> Any:
        bound, time = BoundForces(self.system, self.threads), self.system.state.time
        return lambda phase: bound.measure(time, phase)

    def _of_engine(self, engine: str) -> Any:
        sim, time = Simulation(self.system, engine=engine, dt=self.system.run.dt or 1e-3), self.system.state.time
        stepper: Any = sim.integration.stepper

        def measure(phase: Floats) -> Any:
            stepper.reset(phase, time, 0)
            return stepper.measure(time, phase)

        return measure


def tested_states(evaluate: Evaluator, count: int, part: float, rng: np.random.Generator) -> list[Floats]:
    """Positions (n, 3) near the System's own, each moved by some ``part`` of its distance to the nearest neighbour.

    Positions where the forces are not finite are tried again with half the displacement."""
    x = evaluate.system.state.positions
    near = nearest_distances(evaluate.system)[:, None]
    flat = np.array([1.0, 1.0, 1.0 if evaluate.system.dimensions == 3 else 0.0])
    found: list[Floats] = []
    for _ in range(count):
        direction, size = rng.standard_normal(x.shape) * flat, part
        while True:
            moved = x + size * near * direction
            try:
                evaluate(moved)
            except RunError:
                if size < 1e-6 * part:
                    raise InputError(
                        f"{evaluate.system.name}: no positions near the start have finite forces"
                    ) from None
                size /= 2
                continue
            found.append(moved)
            break
    return found


def nearest_distances(system: System) -> Floats:
    """Distance from each particle to its nearest neighbour, (n,); 1 for a single particle. A virtual site is no
    neighbour, and has the distance of the first particle that it follows."""
    x, least, sites = system.state.positions, np.ones(len(system)), system.virtual_sites
    bodies = np.arange(len(x)) if sites is None else np.setdiff1d(np.arange(len(x)), sites.particles)
    for i in bodies if len(bodies) > 1 else ():
        d = system.box.minimum_image(x[bodies[bodies != i]] - x[i])
        nearest = float(np.sqrt((d**2).sum(axis=1).min()))
        least[i] = nearest or 1.0
    if sites is not None:
        least[sites.particles] = least[sites.of[:, 0]]
    return least


class Subject(NamedTuple):
    """A system as the tests see it: evaluation, positions near its own, lengths, and a random generator."""

    evaluate: Evaluator
    states: list[Floats]
    first: Values  # at the first of these positions, before all tests
    near: Floats  # (n,) distance to the nearest neighbour
    rng: np.random.Generator
    external: tuple[str, ...]  # names of forces that change the total momentum
    listed: tuple[str, ...]  # names of forces on listed particles
    stated: float = 0.0  # relative error of the forces that one of them states
    stating: tuple[str, ...] = ()  # names of the forces that state one
    exact: Subject | None = None  # the other forces alone, if both kinds act

    def bound(self, exact: float) -> float:
        """The bound of a test: that of ``exact`` forces, or the error that the forces state."""
        return max(exact, self.stated)


def slope_tests(given: Subject) -> tuple[list[ForceCheck], Floats]:
    """Force against the slope of the energy, and the digits of the energy. Also the errors of the force over the step,
    (2, steps)."""
    system = given.evaluate.system
    free = np.flatnonzero(system.state.masses > 0)
    if not free.size:
        return [skipped(SLOPE, "no particle has a mass"), skipped(NOISE, "no particle has a mass")], np.empty((2, 0))
    worst, culprit, errors, noise = 0.0, "", np.zeros(len(STEPS)), 0.0
    axes = system.dimensions
    for x in given.states:
        at = given.evaluate(x)
        typical = rms(at.forces[free]) or 1.0
        for _ in range(SAMPLED // len(given.states)):
            i, axis = int(given.rng.choice(free)), int(given.rng.integers(axes))
            force, size = at.forces[i, axis], max(LEAST * typical, float(np.abs(at.forces[i]).max()))
            off = _slope_errors(given, x, i, axis, force, size, STEPS)
            errors = np.maximum(errors, off)
            if given.stated and min(off) > SLOPE_BOUND:
                off += _slope_errors(given, x, i, axis, force, size, SHORTER)
            if min(off) > worst:
                worst, culprit = min(off), f"{system.body(i)}, {'xyz'[axis]}"
        noise = max(noise, _noise(given, x, int(given.rng.choice(free))))
    rows = [
        judged(SLOPE, worst, SLOPE_BOUND, f"worst at {culprit}" if worst > SLOPE_BOUND else "central differences"),
        judged(NOISE, noise, NOISE_BOUND, "scatter of the energy along a short line, relative to its size"),
    ]
    return rows, np.array([STEPS, errors])


def _moved(x: Floats, i: int, axis: int, by: float) -> Floats:
    y = x.copy()
    y[i, axis] += by
    return y


def _slope(given: Subject, x: Floats, i: int, axis: int, h: float) -> float:
    """dE/dx by central differences of order 4."""
    e = [given.evaluate(_moved(x, i, axis, k * h)).energy for k in (-2, -1, 1, 2)]
    return (e[0] - 8 * e[1] + 8 * e[2] - e[3]) / (12 * h)


def _slope_errors(
    given: Subject, x: Floats, i: int, axis: int, force: float, size: float, steps: tuple[float, ...]
) -> list[float]:
    """Differences between a force and the slope of the energy for each step, relative to ``size``."""
    return [abs(_slope(given, x, i, axis, h * given.near[i]) + force) / size for h in steps]


def _noise(given: Subject, x: Floats, i: int) -> float:
    """Scatter of the energy around a parabola over nine points of a very short line, relative to its size."""
    s = np.arange(-4, 5)
    e = np.array([given.evaluate(_moved(x, i, 0, k * 1e-6 * given.near[i])).energy for k in s])
    size = max(float(np.abs(e).max()), float((np.abs(given.evaluate(x).forces).sum(axis=1) * given.near).sum())) or 1.0
    residue = (e - e[4]) - np.polyval(np.polyfit(s, e - e[4], 2), s)
    return rms(residue) / size


def sum_tests(given: Subject) -> Iterator[ForceCheck]:
    """Sum of all forces, and of all torques in open space."""
    system = given.evaluate.system
    why = f"{', '.join(given.external)} changes the total momentum"
    periodic = system.box.periodic
    if given.external:
        yield skipped(MOMENTUM, why)
        yield skipped(TORQUE, why)
        return
    forces = [given.evaluate(x).forces for x in given.states]
    off = max(float(np.abs(f.sum(axis=0)).max()) / (np.abs(f).sum() or 1.0) for f in forces)
    yield judged(MOMENTUM, off, given.bound(EXACT), "relative to the sum of sizes: every action has its reaction")
    if periodic:
        yield skipped(TORQUE, "a periodic box has no conserved angular momentum")
        return
    torques = [
        (np.cross(x, f), np.abs(x).max() * np.abs(f).sum() or 1.0) for x, f in zip(given.states, forces, strict=True)
    ]
    yield judged(TORQUE, max(float(np.abs(t.sum(axis=0)).max() / size) for t, size in torques), EXACT, "as above")


def symmetry_tests(given: Subject) -> Iterator[ForceCheck]:
    """Translation, periodic images, rotation, and the exchange of like particles."""
    evaluate, x = given.evaluate, given.states[0]
    system, at = evaluate.system, evaluate(given.states[0])
    why = f"{', '.join(given.external)} depends on the place"
    flat = np.array([1.0, 1.0, float(system.dimensions == 3)])
    if given.external:
        yield skipped(SHIFT, why)
    else:
        shift = (
            given.rng.uniform(-1, 1, 3) * flat * (system.box.heights.min() if system.box.periodic else np.ptp(x) or 1.0)
        )
        yield judged(SHIFT, _difference(evaluate(x + shift), at, np.eye(3)), given.bound(SAME))
    if system.box.periodic:
        whole = given.rng.integers(-2, 3, x.shape) * np.array(system.box.periodic_axes)
        if system.virtual_sites is not None:  # the particles that a site follows lie in one image
            whole = whole[molecules_of(system.virtual_sites.pairs, len(system))]
        yield judged(
            IMAGE,
            _difference(evaluate(x + whole @ system.box.matrix), at, np.eye(3)),
            SAME,
            "particles moved by whole edges",
        )
    else:
        yield skipped(IMAGE, "open space")
    yield _turned(given, x, at, why)
    if given.listed:
        yield skipped(SWAP, f"{', '.join(given.listed)} acts on listed particles")
    else:
        order = _like_for_like(given)
        found, back = evaluate.another()(x), evaluate(x[order])
        same = _relative(back.forces - at.forces[order], at.forces)
        same = max(same, abs(back.energy - at.energy) / _energy_scale(at), _difference(found, at, np.eye(3)))
        yield judged(SWAP, same, SAME, "also finds lists that are out of date")


def _turned(given: Subject, x: Floats, at: Values, why: str) -> ForceCheck:
    """Invariance under a rotation: any in open space, a quarter turn in a cubic box."""
    system = given.evaluate.system
    if given.external:
        return skipped(TURN, why)
    if system.dimensions == 2:
        c, s = np.cos(1.0), np.sin(1.0)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    else:
        turn = np.linalg.qr(given.rng.standard_normal((3, 3)))[0]
        turn *= np.sign(np.linalg.det(turn))
        quarter = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    if system.box.periodic:
        edges = np.diag(system.box.matrix)[: system.dimensions]
        if system.box.tilts or np.ptp(edges) > 0 or not all(system.box.periodic_axes[: system.dimensions]):
            return skipped(TURN, "the box is not a cube")
        turn = quarter
    found = given.evaluate(x @ turn.T)
    same = given.bound(SAME)
    return judged(TURN, _difference(found, at, turn), same, "the box turned onto itself" if system.box.periodic else "")


def virial_test(given: Subject) -> ForceCheck:
    """Virial against the slope of the energy over the volume: box and positions are scaled."""
    evaluate, x = given.evaluate, given.states[0]
    system, at = evaluate.system, evaluate(given.states[0])
    if not system.box.periodic:
        return skipped(VIRIAL, "open space has no volume")
    if np.isnan(at.virial):
        return skipped(VIRIAL, "the force gives no virial, so a run has no pressure")
    matrix, axes = system.box.matrix, system.box.periodic_axes

    def energy(e: float) -> float:
        box = Box(matrix=matrix * (1 + e), periodic=axes)
        return evaluate.another(system.remade(positions=x * (1 + e), box=box))(x * (1 + e)).energy

    scale, bound = float(np.abs(at.forces).sum() * given.near.mean()) or 1.0, given.bound(SLOPE_BOUND)

    def difference(h: float) -> float:
        slope = (energy(-2 * h) - 8 * energy(-h) + 8 * energy(h) - energy(2 * h)) / (12 * h)
        return abs(slope + at.virial) / scale

    try:
        off = min(map(difference, SCALINGS))
        if given.stated and off > bound:
            off = min(off, *map(difference, SMALLER))
    except RunError as error:
        return skipped(VIRIAL, str(error))
    remark = "from a scaled box; relative to all |F| times the nearest distance"
    return judged(VIRIAL, off, bound, remark)


def bits_test(given: Subject) -> ForceCheck:
    """The same bits from two evaluators, and values that do not depend on what was evaluated before."""
    x = given.states[-1]
    first, second = given.evaluate.another()(x), given.evaluate.another()(x)
    same = np.array_equal(first.forces, second.forces) and first.energy == second.energy
    if not same:
        return judged(BITS, _difference(first, second, np.eye(3)), 0.0, "two evaluations of the same positions differ")
    off = _difference(given.evaluate(x), first, np.eye(3))  # after many others, with lists of its own
    off = max(off, _difference(given.evaluate(given.states[0]), given.first, np.eye(3)))
    return judged(BITS, off, SAME, "also after other positions, to rounding")


def _like_for_like(given: Subject) -> NDArray[np.int64]:
    """A random order that exchanges particles of the same species, mass and charge."""
    system = given.evaluate.system
    order = np.arange(len(system))
    charges = np.zeros(len(system)) if system.charges is None else system.charges
    kinds = np.column_stack([system.species_index, system.state.masses, charges])
    for kind in np.unique(kinds, axis=0):
        rows = np.flatnonzero((kinds == kind).all(axis=1))
        order[rows] = given.rng.permutation(rows)
    return order


def _difference(one: Values, two: Values, turn: Floats) -> float:
    """Largest relative difference of two evaluations; the forces of the second are turned first."""
    return max(
        _relative(one.forces - two.forces @ turn.T, two.forces), abs(one.energy - two.energy) / _energy_scale(two)
    )


def _relative(difference: Floats, forces: Floats) -> float:
    return float(np.abs(difference).max() / (np.abs(forces).max() or 1.0))


def rms(values: Floats) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def _energy_scale(at: Values) -> float:
    return abs(at.energy) or 1.0


class Jump(NamedTuple):
    """A jump along a line: its quantity and its place.

    derivative : 0 for the energy, 1 for the force, 2 for its slope, 3 for its curvature
    size : of the jump, in units of energy over length to the power ``derivative``
    place : distance along the line
    """

    derivative: int
    size: float
    place: float


def jump_along(values: Callable[[float], tuple[float, float]], length: float) -> Jump | None:
    """The strongest jump along a line; None if none is resolved.

    ``values(s)`` returns the energy at the distance s, and the force along the line. Fourth differences of smooth
    values fall as the fourth power of the spacing. Near a jump of the k-th derivative they fall as its k-th power.
    """
    s = np.linspace(0.0, length, POINTS)
    line = np.array([values(each) for each in s])
    energy = _jump_of(lambda at: values(at)[0], s, line[:, 0])
    if energy is not None and energy.derivative == 0:
        return energy
    force = _jump_of(lambda at: values(at)[1], s, line[:, 1])
    return None if force is None else Jump(force.derivative + 1, force.size, force.place)


def _jump_of(value: Callable[[float], float], s: Floats, values: Floats) -> Jump | None:
    """The strongest jump of one quantity and of its first two derivatives."""
    size = np.abs(_fourth(values))
    place = int(np.argmax(size))
    noise = ROUNDING * np.spacing(np.abs(values).max())
    if not size[place] > max(CLEAR * np.median(size), noise):
        return None
    exponents: list[float] = []
    levels: list[tuple[Floats, float]] = []  # values near the place, and their spacing
    spacing, centre, largest = float(s[1] - s[0]), float(s[place + 2]), float(size[place])
    for _ in range(LEVELS):
        finer = spacing / FINER
        near = centre + finer * np.arange(-STENCIL, STENCIL + 1)
        near = near - min(0.0, float(near[0]))
        found = np.array([value(float(each)) for each in near])
        size = np.abs(_fourth(found))
        place = int(np.argmax(size))
        if not size[place] > noise:
            break
        exponents.append(float(np.log(largest / size[place]) / np.log(FINER)))
        levels.append((found, finer))
        spacing, centre, largest = finer, float(near[place + 2]), float(size[place])
    if not exponents:
        return None
    exponent = float(np.median(exponents))
    derivative = round(exponent)
    if derivative > 2 or abs(exponent - derivative) > 0.3:
        return None
    if derivative == 0:  # fourth differences around a jump of one are 1, -3, 3, -1
        return Jump(0, largest / 3, centre)
    level = min(1, len(levels) - 1) if derivative == 2 else -1  # rounding limits the spacing for a curvature
    found, spacing = levels[level]
    place = int(np.argmax(np.abs(_fourth(found))))
    near = np.diff(found[max(place - 2, 0) : place + 7], derivative) / spacing**derivative
    return Jump(derivative, abs(float(near[-1] - near[0])), centre)


def _fourth(values: Floats) -> Floats:
    return np.diff(values, 4)
