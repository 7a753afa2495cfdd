"""Programs that move bodies under Newton's gravity, each from the same numbers.

The Sun and eight planets are from JPL's DE421 at J2000, the Earth with the Moon, in AU, years and solar masses. Stars
are a Plummer sphere in N-body units.
"""

from __future__ import annotations

import json
from functools import lru_cache
from importlib.metadata import version
from typing import Any, NamedTuple

import numba
import numpy as np

import kickdrift as kd
from kickdrift.engines import ENGINES
from kickdrift.model.starts.plummer import plummer
from kickdrift_validation.exact_reversal import solar_system
from kickdrift_validation.folders import DATA
from kickdrift_validation.gauss_radau import system_of
from kickdrift_validation.performance.turns import Missing, Native, Phase, Runner

FAR_AHEAD = DATA / "solar-system" / "sun-and-planets-100yr.json"
HEYOKA = "pip install 'kickdrift[heyoka]'"
NUDGE = 1e-15  # relative change of starts that differ by a rounding


class Bodies(NamedTuple):
    """Start of gravitating bodies, the same for all programs. ``dt`` is for methods with fixed steps. ``pilot`` is a
    time that suits a turn of other methods. ``reference`` is a later time with its positions (n, 3), known better than
    in float64."""

    system: kd.System
    G: float
    softening: float = 0.0
    dt: float | None = None
    reference: tuple[float, np.ndarray] | None = None
    pilot: float = 1.0

    @property
    def positions(self) -> np.ndarray:
        return self.system.state.positions

    @property
    def velocities(self) -> np.ndarray:
        return self.system.state.velocities

    @property
    def masses(self) -> np.ndarray:
        return self.system.state.masses

    def moved(self, seed: int) -> Bodies:
        """The same state, changed by a rounding. Seed 0 is the start itself."""
        if not seed:
            return self
        x = self.positions * (1 + NUDGE * np.random.default_rng(seed).standard_normal(self.positions.shape))
        arguments = {"forces": self.system.forces, "units": self.system.units}
        return self._replace(system=kd.System(x, self.velocities, self.masses, **arguments))

    def energy(self, x: np.ndarray, v: np.ndarray) -> Any:
        """Energy at any positions and velocities, in extended precision."""
        x, v, m = (np.asarray(part, dtype=np.longdouble) for part in (x, v, self.masses))
        i, j = np.triu_indices(len(m), 1)
        distances = np.sqrt(((x[i] - x[j]) ** 2).sum(axis=1) + self.softening**2)
        return 0.5 * (m * (v**2).sum(axis=1)).sum() - self.G * (m[i] * m[j] / distances).sum()

    def apart(self, x: np.ndarray, y: np.ndarray) -> float:
        """Largest difference of two programs' coordinates."""
        return float(np.abs(x - y).max())


def planets(dt: float | None = None) -> Bodies:
    system = solar_system()
    found = json.loads(FAR_AHEAD.read_text(encoding="utf-8"))
    reference = found["time"], np.array(found["positions"])
    return Bodies(system, float(system.units.gravity or 1.0), dt=dt, reference=reference)


def outer_planets() -> Bodies:
    """Hairer's outer solar system: AU and days."""
    system = system_of("hairer_outer_solar")
    return Bodies(system, float(system.forces[0].G), pilot=10_000.0)


@lru_cache(maxsize=2)
def stars(count: int, softening: float = 0.01, dt: float = 1e-3) -> Bodies:
    """A Plummer sphere of equal masses."""
    x, v, masses = plummer(count, seed=1)
    system = kd.System(x, v, masses, forces=[kd.Gravity(1.0, softening)], units="nbody")
    return Bodies(system, 1.0, softening, dt)


class TreeStars(Bodies):
    """Stars for trees. Their forces are approximate, and the direct sum of so many energies would take minutes."""

    def energy(self, x: np.ndarray, v: np.ndarray) -> float:
        """Energy at any positions and velocities, by kickdrift's tree, to a relative error of about 1e-7."""
        force = kd.GravityTree(1e-5, self.softening, self.G)
        system = kd.System(x, v, self.masses, forces=[force], units="nbody")
        return kd.Simulation(system, "leapfrog", dt=1.0).energy().total


def morton_order(x: np.ndarray) -> np.ndarray:
    """Indices (n,) that sort positions (n, 3) along a space-filling curve (Morton 1966)."""
    places = np.zeros(len(x), dtype=np.int64)
    whole = ((x - x.min(axis=0)) / np.ptp(x, axis=0).max() * (2**20 - 1)).astype(np.int64)
    for bit in range(20):
        for axis in range(3):
            places |= ((whole[:, axis] >> bit) & 1) << (3 * bit + axis)
    return np.argsort(places, kind="stable")


@lru_cache(maxsize=1)
def tree_stars(count: int, softening: float = 0.01, dt: float = 1e-3) -> TreeStars:
    """Stars of a Plummer sphere in Morton's order, which more than doubles the speed of rebound's tree."""
    x, v, masses = plummer(count, seed=1, scaled=False)
    order = morton_order(x)
    system = kd.System(x[order], v[order], masses[order], units="nbody")
    return TreeStars(system, 1.0, softening, dt)


TREE_STEPS = 8.0  # least in a turn, since sampling the energy at both ends costs as much as a step


def by_tree(start: TreeStars, accuracy: float, threads: int = 1) -> Native:
    force = kd.GravityTree(accuracy, start.softening, start.G)
    system = kd.System(start.positions, start.velocities, start.masses, forces=[force], units="nbody")
    return Native(kd.Simulation(system, "leapfrog-dkd", start.dt, threads), least=TREE_STEPS)


def kickdrift(start: Bodies, integrator: str, threads: int = 1, **options: Any) -> Native:
    sim = kd.Simulation(start.system, integrator, start.dt, threads, **options)
    return Native(sim, least=start.pilot if start.dt is None else None)


class Rebound(Runner):
    """rebound, synchronised at the end of each turn. ``values`` are attributes of its integrator."""

    def __init__(self, start: Bodies, integrator: str, **values: Any) -> None:
        try:
            import rebound
        except ImportError:
            raise Missing(ENGINES["rebound"].install) from None
        self.version, self.chooses = rebound.__version__, start.dt is None
        self.least = start.pilot if self.chooses else self.least
        self.sim = sim = rebound.Simulation()
        sim.G, sim.softening, sim.integrator = start.G, start.softening, integrator
        if start.dt is not None:
            sim.dt = start.dt
        for name, value in values.items():
            setattr(sim.integrator, name, value)
        for m, x, v in zip(start.masses, start.positions, start.velocities, strict=True):
            sim.add(m=float(m), x=x[0], y=x[1], z=x[2], vx=v[0], vy=v[1], vz=v[2])

    def run(self, amount: float) -> float:
        if self.chooses:
            begin = self.sim.t
            self.sim.integrate(begin + amount, exact_finish_time=0)
            return self.sim.t - begin
        self.sim.steps(round(amount))
        self.sim.synchronize()
        return round(amount)

    def phase(self) -> Phase:
        x, v = np.zeros((2, self.sim.N, 3))
        self.sim.serialize_particle_data(xyz=x, vxvyvz=v)
        return x, v

    def at(self, time: float) -> Phase:
        self.sim.integrate(time, exact_finish_time=1)
        return self.phase()


class ReboundTree(Rebound):
    """rebound's tree, with monopoles. The box holds all stars for as long as they are timed."""

    least = 1.0

    def __init__(self, start: TreeStars, opening_angle: float) -> None:
        try:
            import rebound
        except ImportError:
            raise Missing(ENGINES["rebound"].install) from None
        self.version, self.chooses = rebound.__version__, False
        self.sim = sim = rebound.Simulation()
        sim.G, sim.softening, sim.integrator, sim.dt = start.G, start.softening, "leapfrog", start.dt
        sim.root_size = 3.0 * float(np.abs(start.positions).max())
        sim.gravity, sim.opening_angle2 = "tree", opening_angle**2
        body = rebound.Particle()
        for m, x, v in zip(start.masses, start.positions, start.velocities, strict=True):
            body.m, (body.x, body.y, body.z), (body.vx, body.vy, body.vz) = m, x, v
            sim.add(body)


class Whfast512(Rebound):
    """rebound's WHFast with eight planets in AVX-512's lanes. It needs G = 1, so its time is in other units
    inside."""

    def __init__(self, start: Bodies) -> None:
        self.scale = float(np.sqrt(start.G))
        x, v, m = start.positions, start.velocities / self.scale, start.masses
        inside = start._replace(system=kd.System(x, v, m, units="nbody"), G=1.0, dt=start.dt * self.scale)
        super().__init__(inside, "whfast512")
        import rebound

        if not rebound.avx512_available:
            raise Missing("needs a processor with AVX-512")

    def run(self, amount: float) -> float:
        steps = round(amount)
        self.sim.integrator.concatenate_steps = steps  # in one call, else each costs a conversion
        self.sim.integrate(self.sim.t + 0.5 * steps * self.sim.dt, exact_finish_time=0)
        self.sim.synchronize()
        return steps

    def phase(self) -> Phase:
        x, v = super().phase()
        return x, v * self.scale


class Heyoka(Runner):
    """heyoka's adaptive Taylor method at its default tolerance, for its own N-body system, compiled beforehand."""

    def __init__(self, start: Bodies) -> None:
        try:
            import heyoka
        except ImportError:
            raise Missing(HEYOKA) from None
        self.version, self.least = heyoka.__version__, start.pilot
        bodies = heyoka.model.nbody(len(start.masses), masses=start.masses.tolist(), Gconst=start.G)
        self.integrator = heyoka.taylor_adaptive(bodies, np.hstack([start.positions, start.velocities]).ravel())

    def run(self, amount: float) -> float:
        self.at(self.integrator.time + amount)
        return amount

    def phase(self) -> Phase:
        state = self.integrator.state.reshape(-1, 6)
        return state[:, :3].copy(), state[:, 3:].copy()

    def at(self, time: float) -> Phase:
        self.integrator.propagate_until(time)
        if self.integrator.time != time:
            raise RuntimeError(f"heyoka stopped at t = {self.integrator.time:g}")
        return self.phase()


@numba.njit
def newton(t, y, gm, n):
    """f(t, y) for positions and velocities in one array, as SciPy needs it. It is compiled, so that the turn times
    SciPy alone."""
    dy = np.empty_like(y)
    dy[: 3 * n] = y[3 * n :]
    dy[3 * n :] = 0.0
    for i in range(n):
        for j in range(i):
            dx, dy_, dz = y[3 * i] - y[3 * j], y[3 * i + 1] - y[3 * j + 1], y[3 * i + 2] - y[3 * j + 2]
            r2 = dx * dx + dy_ * dy_ + dz * dz
            inverse = 1.0 / (r2 * np.sqrt(r2))
            for k, d in enumerate((dx, dy_, dz)):
                dy[3 * n + 3 * i + k] -= gm[j] * d * inverse
                dy[3 * n + 3 * j + k] += gm[i] * d * inverse
    return dy


class Scipy(Runner):
    """A solver of scipy.integrate, step by step, without the overhead of solve_ivp. Its f is compiled."""

    def __init__(self, start: Bodies, solver: str, rtol: float, atol: float) -> None:
        from scipy import integrate

        self.version, self.least, self.solver = version("scipy"), 0.1 * start.pilot, getattr(integrate, solver)
        self.tolerances, n = {"rtol": rtol, "atol": atol}, len(start.masses)
        gm = start.G * start.masses
        self.f = lambda t, y: newton(t, y, gm, n)
        self.time, self.y = 0.0, np.concatenate([start.positions.ravel(), start.velocities.ravel()])
        self.f(0.0, self.y)

    def run(self, amount: float) -> float:
        self.at(self.time + amount)
        return amount

    def phase(self) -> Phase:
        x, v = self.y.reshape(2, -1, 3)
        return x.copy(), v.copy()

    def at(self, time: float) -> Phase:
        solver = self.solver(self.f, self.time, self.y, time, **self.tolerances)
        while solver.status == "running":
            solver.step()
        if solver.status == "failed":
            raise RuntimeError(f"SciPy's {self.solver.__name__} failed at t = {solver.t:g}")
        self.time, self.y = time, solver.y
        return self.phase()
