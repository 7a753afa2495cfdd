"""Minimization: the positions of least potential energy near those of a System, from any start.

A capped descent from overlaps, FIRE and L-BFGS move the particles by their forces alone, as if each had mass 1. No
particle moves further than a cap in one step.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, fields
from typing import Any, NamedTuple

import numpy as np

from kickdrift.display.showing import Lines, Shown
from kickdrift.errors import InputError, RunError
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.forces.pairs.law import PairForce
from kickdrift.jit.cache.notices import compiling_for
from kickdrift.model.checks.values import positive, unwarned, whole_number
from kickdrift.model.nearness import nearest_pair
from kickdrift.model.state import Floats, State
from kickdrift.model.system import System
from kickdrift.model.units.quantities import quantity
from kickdrift.run.push_off import SOFT_STEPS, soft_systems
from kickdrift.run.stepping import purpose_of
from kickdrift.text import counted, measured, shown, suggestion

# FIRE's parameters, names and values of Guenole et al. 2020, table 1. Times are in units of the longest step.
GROWTH, CUT, ALPHA, ALPHA_CUT = 1.1, 0.5, 0.25, 0.99
DELAY, MOST_UPHILL = 20, 2000  # steps downhill before the time step grows; steps uphill in a row before FIRE ends
FIRST, SHORTEST = 0.1, 0.002

CAP = 0.1  # default cap, as part of the shortest sigma
UNEVEN = 10.0  # ratio of the largest to the median force, above which the capped descent comes first
DESCENT_STEPS = 200  # most steps of this descent
PROBE = 1e-4  # displacement, as part of the cap, for the slopes of the forces
CHECKS = 100  # steps of FIRE between two measurements of the stiffness
HALVINGS = 60  # most returns in a row from places where the forces are not finite
ROUNDS = 2  # most rounds of L-BFGS in a row that end without a step


class Point(NamedTuple):
    """Positions (3, n), their potential energy, and the forces (3, n) there."""

    x: Floats
    energy: float
    forces: Floats

    @property
    def largest(self) -> float:
        """The largest force on a particle."""
        return float(lengths(self.forces).max())


class EnergySurface:
    """The potential energy and the forces of a System over the positions of its particles, at rest and at its time.

    ``evaluations`` counts the evaluations of the forces. ``cap`` is the largest displacement in one step."""

    def __init__(self, system: System, threads: int, cap: float | None) -> None:
        if walls := system.acting("reflects"):
            raise InputError(f"minimize: force {walls[0]!r} has no energy; a harmonic-wall has one")
        self.system, self.evaluations = system, 0
        self.cap = default_cap(system) if cap is None else cap
        self._forces = BoundForces(system, threads, hold=True)
        self._fixed: Any = [] if system.fixed is None else system.fixed.particles
        self._phase = np.zeros((2, 3, len(system)))
        self._masses = system.coherent_masses

    def at(self, x: Floats) -> Point | None:
        """The surface at positions x; None if the forces are not finite there."""
        self.evaluations += 1
        self._phase[0] = x
        found = self._forces.measure(self.system.state.time, self._phase)
        return None if found is None else Point(x.copy(), found.potential, found.accelerations * self._masses)

    def near(self, x: Floats) -> Point:
        """The surface at x. If the forces are not finite there, the nearest particles first step apart.

        Raises RunError if that does not help."""
        for _ in range(len(self.system)):
            if found := self.at(x):
                return found
            if (apart := self._parted(x)) is None:
                break
            x = apart
        raise RunError("minimize: the forces at these positions are not finite")

    def _parted(self, x: Floats) -> Floats | None:
        """Positions with the nearest two particles moved apart to the cap; None without such a pair."""
        box = self.system.box
        if not np.isfinite(self.cap) or (pair := nearest_pair(x.T, box, self.cap)) is None:
            return None
        first, second, _ = pair
        between = box.minimum_image((x[:, first] - x[:, second])[None])[0]
        size = np.abs(between).max()
        direction = between / size if size > 0 else np.array([1.0, 0.0, 0.0])
        moved = x.copy()
        step = 0.5 * self.cap * direction / np.linalg.norm(direction)
        moved[:, first] += step
        moved[:, second] -= step
        moved[:, self._fixed] = x[:, self._fixed]
        return moved

    def stiffness(self, x: Floats, along: Floats, times: int) -> tuple[float, Floats]:
        """Largest slope of the forces (power iteration), and its direction, from which the next search may begin."""
        along[:, self._fixed] = 0.0
        probe = PROBE * self.cap if np.isfinite(self.cap) else 1e-6 * (float(np.abs(x).max()) or 1.0)
        slope = 0.0
        for _ in range(times):
            ahead, behind = self.at(x + probe * along), self.at(x - probe * along)
            if ahead is None or behind is None:
                return 0.0, along
            change = (behind.forces - ahead.forces) / (2 * probe)
            size = np.abs(change).max()
            if not size > 0:
                break
            slope, along = float(size), change / size
        return slope, along


def default_cap(system: System) -> float:
    """A tenth of the shortest sigma. Without a sigma, a tenth of the mean spacing of the particles. If all forces allow
    particles at one place, as springs and traps do, there is no cap (infinity)."""
    forces = system.forces
    if sigmas := [length for force in forces if isinstance(force, PairForce) and (length := force.shortest()) > 0]:
        return CAP * min(sigmas)
    spans = np.ptp(system.state.phase[0], axis=1)
    spans = spans[spans > 0]
    if len(spans) == 0 or all(getattr(force, "may_overlap", False) for force in forces):
        return np.inf
    return CAP * float(np.exp(np.log(spans).mean())) / float(len(system)) ** (1 / len(spans))


def lengths(vectors: Floats) -> Floats:
    """Lengths (n,) of vectors (3, n), also where their squares would overflow."""
    scale = float(np.abs(vectors).max())
    return scale * np.sqrt(((vectors / scale) ** 2).sum(axis=0)) if scale > 0 else np.zeros(vectors.shape[1])


def limited(vectors: Floats, most: float) -> Floats:
    """The vectors (3, n), each shortened to at most ``most``."""
    sizes = lengths(vectors)
    return vectors * (most / np.maximum(sizes, most)) if sizes.max() > most else vectors


def untangled(surface: EnergySurface, here: Point, steps: int, force: float) -> Iterator[Point]:
    """Points of a descent from overlapping particles, none higher than the last, until the forces are even.

    Each particle moves along its force. The step of a particle is proportional to its force up to the median force and
    constant above. So one overlap does not hold up the others. A step that raises the energy is halved (the rule of
    GROMACS' steepest descent)."""
    step = surface.cap
    if not np.isfinite(step):
        return
    for _ in range(min(steps, DESCENT_STEPS)):
        sizes = lengths(here.forces)
        if sizes.max() <= force or step < 1e-6 * surface.cap:
            return
        median = float(np.median(sizes[sizes > 0]))
        if sizes.max() <= UNEVEN * median:
            return
        there = surface.at(here.x + here.forces * (step / np.maximum(sizes, median)))
        if there and there.energy < here.energy:
            here, step = there, min(1.2 * step, surface.cap)
        else:
            step *= 0.5
        yield here


def fire(surface: EnergySurface, here: Point, steps: int, force: float) -> Iterator[Point]:
    """Points of the Fast Inertial Relaxation Engine, version 2.0, until the largest force is at most ``force``.

    Bitzek et al. 2006, doi:10.1103/PhysRevLett.97.170201; Guenole et al. 2020, doi:10.1016/j.commatsci.2020.109584,
    algorithm 2 with semi-implicit Euler steps. The longest time step is the reciprocal of the highest frequency, which
    a power iteration measures now and then."""
    rng = np.random.Generator(np.random.PCG64(0))
    along = rng.uniform(-1.0, 1.0, here.x.shape)
    along[2] *= surface.system.dimensions == 3
    v, scale, alpha = np.zeros_like(here.x), FIRST, ALPHA
    downhill = uphill = lost = 0
    stiff, longest, most = 0.0, 0.0, np.inf
    for step in range(steps):
        if step % CHECKS == 0:
            slope, along = surface.stiffness(here.x, along, 3 if stiff else 10)
            stiff = slope or stiff or here.largest / (surface.cap if np.isfinite(surface.cap) else 1.0)
            longest, most = 1.0 / np.sqrt(stiff), stiff * surface.cap
        pull = limited(here.forces, most)
        if (v * pull).sum() > 0:
            downhill, uphill = downhill + 1, 0
            if downhill > DELAY:
                scale, alpha = min(GROWTH * scale, 1.0), ALPHA_CUT * alpha
            x = here.x
        else:
            downhill, uphill = 0, uphill + 1
            if uphill > MOST_UPHILL:
                return
            if step >= DELAY:
                scale = max(CUT * scale, SHORTEST)
                alpha = ALPHA
            x = here.x - 0.5 * scale * longest * v
            v = np.zeros_like(v)
        dt = scale * longest
        v = v + dt * pull
        v = limited((1.0 - alpha) * v + (alpha * np.linalg.norm(v) / np.linalg.norm(pull)) * pull, surface.cap / dt)
        there = surface.at(x + dt * v)
        if there is None:
            lost += 1
            if lost > HALVINGS:
                return
            v, scale = np.zeros_like(v), CUT * scale
            continue
        here, lost = there, 0
        yield here
        if here.largest <= force:
            return


def l_bfgs(surface: EnergySurface, here: Point, steps: int, force: float) -> Iterator[Point]:
    """Points of SciPy's L-BFGS-B, until the largest force is at most ``force``.

    Liu & Nocedal 1989, doi:10.1007/BF01589116; Byrd et al. 1995, doi:10.1137/0916069. Each round of the method stays
    within the cap of the place where the round began. The next round begins where a particle reaches the cap. Energies
    of many particles are rounded too coarsely for the last steps, so FIRE takes these: FIRE compares no energies."""
    done = idle = 0
    while done < steps and idle < ROUNDS:
        there, taken = _round(surface, here, steps - done, force)
        idle = 0 if taken and there.energy < here.energy else idle + 1
        here, done = there, done + max(taken, 1)
        for _ in range(max(taken, 1)):
            yield here
        if here.largest <= force:
            return
    yield from fire(surface, here, steps - done, force)


def _round(surface: EnergySurface, here: Point, steps: int, force: float) -> tuple[Point, int]:
    """The point where one round of L-BFGS-B ends, and the number of its steps."""
    from scipy.optimize import minimize

    begin, capped, points = here.x.ravel(), np.isfinite(surface.cap), [here]

    def value(x: Floats) -> tuple[float, Floats]:
        found = surface.at(x.reshape(here.x.shape))
        if found is None:
            return 1e300, np.zeros(x.size)
        points.append(found)
        return found.energy, -found.forces.ravel()

    def stop(x: Floats) -> None:
        if np.abs(x - begin).max() >= 0.999 * surface.cap:
            raise StopIteration

    bounds = np.stack([begin - surface.cap, begin + surface.cap], axis=1) if capped else None
    options = {"maxiter": steps, "maxfun": 10**9, "ftol": 0.0, "gtol": force / np.sqrt(3.0), "maxcor": 20}
    found = minimize(value, begin, jac=True, method="L-BFGS-B", bounds=bounds, callback=stop, options=options)
    at = [point for point in points if np.array_equal(point.x.ravel(), found.x)]
    return (at[-1] if at else here), int(found.nit)


METHODS: dict[str, Callable[[EnergySurface, Point, int, float], Iterator[Point]]] = {"fire": fire, "l-bfgs": l_bfgs}


Progress = Callable[[int, int], Any]

FORCE, STEPS, METHOD = 1e-6, 10_000, "fire"  # defaults
RISE = 1e-9  # relative rise of the energy that may be rounding


@dataclass(frozen=True, repr=False)
class Minimum(Shown):
    """Result of a minimization, in the system's units.

    Attributes
    ----------
    method : "fire" or "l-bfgs"
    converged : whether the largest force is at most the tolerance, and the energy no higher than at the start
    energy, energy_at_start : potential energy now and before
    largest_force, force : largest force on a particle, and its tolerance
    max_displacement : longest step of a particle; infinite without a cap
    steps, evaluations : number of steps, and of evaluations of the forces
    energy_unit, force_unit : symbols of the units, "" for plain numbers
    system : the System at the minimum, at time 0. Its velocities are those from before the minimization, so that
        ``kd.Simulation(found.system)`` can equilibrate and run.
    """

    method: str
    converged: bool
    energy: float
    energy_at_start: float
    largest_force: float
    force: float
    max_displacement: float
    steps: int
    evaluations: int
    energy_unit: str
    force_unit: str
    system: System = field(repr=False)

    def _lines(self) -> Lines:
        sign = "at most" if self.largest_force <= self.force else "more than"
        largest = measured(f"{self.largest_force:.2g}", self.force_unit)
        steps = f"{counted(self.steps, 'step')}, {counted(self.evaluations, 'force evaluation')}"
        found = f"yes, in {steps}" if self.converged else f"no, {self.trouble}, after {steps}"
        return [
            ("system", self.system.name),
            ("energy", f"{measured(f'{self.energy:.10g}', self.energy_unit)} (start: {self.energy_at_start:.10g})"),
            ("largest force", f"{largest}, {sign} {self.force:g}"),
            ("method", self.method),
            ("converged", found),
        ]

    @property
    def trouble(self) -> str:
        """Reason why the minimization did not converge, as text; "" if it did."""
        if self.converged:
            return ""
        if self.largest_force > self.force:
            return f"the largest force is more than {self.force:g}"
        return "the energy rose, so the particles flew apart"

    def as_json(self) -> dict[str, Any]:
        """The result as one JSON object, without the System."""
        return {each.name: getattr(self, each.name) for each in fields(self) if each.name != "system"}


def minimize(sim: Any, *given: Any) -> Minimum:
    """See ``Simulation.minimize``. ``given`` are the arguments of ``minimum`` from ``force`` on."""
    if sim.running:
        raise InputError("minimize: the Simulation is already running")
    if not isinstance(sim.system, System):
        raise InputError("minimize: a Problem has no forces")
    now = sim.state
    found = minimum(sim.system.at(now.phase, now.time, now.steps_done, now.ids, now.box), sim.threads, *given)
    phase = found.system.state.phase.copy()
    phase[1] = 0.0
    sim.state = State(phase, now.masses, now.ids, now.box, now.time, now.steps_done)
    return found


@unwarned
def minimum(
    system: System,
    threads: int = 1,
    force: float | str = FORCE,
    steps: int = STEPS,
    method: str = METHOD,
    max_displacement: float | str | None = None,
    soft: bool = False,
    progress: Progress | None = None,
) -> Minimum:
    """Minimum of the potential energy near the positions of a System; see ``Simulation.minimize``."""
    if system.tied_by:
        raise InputError(f"minimize moves particles freely, so it breaks {system.tied_by}; take sim.equilibrate")
    if not system.forces:
        raise InputError(f"minimize: {system.name!r} has no forces")
    least = _amount("force", force, system)
    steps = whole_number("minimize: steps", steps, 0)
    if not isinstance(method, str) or method not in METHODS:
        known = ", ".join(METHODS)
        raise InputError(f"minimize: method: expected one of {known}, got {shown(method)}{suggestion(method, METHODS)}")
    if not isinstance(soft, bool):
        raise InputError(f"minimize: soft must be True or False, got {shown(soft)}")
    gentle = list(soft_systems(system)) if soft else []
    cap = None if max_displacement is None else _amount("length", max_displacement, system, "max_displacement")
    with compiling_for(purpose_of(method, system)):
        surface = EnergySurface(system, threads, cap)
        here = surface.near(system.state.phase[0].copy())
    first, done = here, 0
    for softened, most in gentle:
        with compiling_for(purpose_of(method, softened)):
            around = EnergySurface(softened, threads, surface.cap)
            there = around.near(here.x)
        for point in METHODS[method](around, there, min(SOFT_STEPS, steps - done), most):
            there, done = point, done + 1
            if progress:
                progress(done, steps)
        here, surface.evaluations = surface.near(there.x), surface.evaluations + around.evaluations
    for walk in (untangled, METHODS[method]):
        if here.largest <= least:
            break
        for point in walk(surface, here, steps - done, least):
            here, done = point, done + 1
            if progress:
                progress(done, steps)
    if progress:
        progress(steps, steps)
    phase = system.state.phase.copy()
    phase[0] = here.x
    units = system.units
    return Minimum(
        method=method,
        converged=here.largest <= least and not here.energy > first.energy + RISE * abs(first.energy),
        energy=here.energy,
        energy_at_start=first.energy,
        largest_force=here.largest,
        force=least,
        max_displacement=surface.cap,
        steps=done,
        evaluations=surface.evaluations,
        energy_unit=units.symbol("energy"),
        force_unit=units.symbol("force"),
        system=system.remade(positions=here.x.T).at(phase, 0.0),
    )


def _amount(dimension: str, value: float | str, system: System, key: str = "") -> float:
    """A positive number in the system's units, from a number or a text with a unit."""
    key = f"minimize: {key or dimension}"
    found = quantity(value, dimension, system.units, key) if isinstance(value, str) else value
    return positive(key, found, "positive")
