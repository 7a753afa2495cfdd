"""Forces of planetary science beside REBOUNDx, body by body.

Both programs give the accelerations of four bodies by one force alone. REBOUNDx has no wheels: `pip install reboundx`
compiles its source. Where the two programs differ on purpose, the bodies are chosen so that this does not show:
REBOUNDx leaves massless bodies out of tides_spin, scales Lense-Thirring's force by M / (M + m) and uses gamma =
1.000021, and lets migration push the star.

Spins are compared after a time too. REBOUNDx integrates spins after each step of the bodies, with the bodies fixed at
the end of the step, and the bodies feel the spins of the step's start. So its error is of first order in the step, and
its angular momentum is conserved to this order. Spins of four steps, extrapolated to the step 0, are compared.
"""

import ctypes
import warnings
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

import kickdrift as kd
from kickdrift.forces.bound.forces import BoundForces
from kickdrift_validation.claim import Claim, at_most, claim, main, not_run
from kickdrift_validation.rebounds import simulation

BOUND, NEEDS = 1e-13, "pip install reboundx"
MASSES = [1.0, 1e-2, 3e-3, 0.0]
LIGHT = 50.0
LOVE, RADII, LAGS, SPINS = (0.03, 0.3, 0.2), (0.3, 0.2, 0.1), (0.01, 0.02, 0.05), (0.7, 1.1, -0.3)


def start() -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities (4, 3), about the centre of mass at rest."""
    x, v = np.random.default_rng(3).normal(size=(2, 4, 3))
    m = np.array(MASSES)[:, None]
    return x, 0.3 * (v - (m * v).sum(axis=0) / m.sum())


def ours(force: Any) -> np.ndarray:
    """Accelerations (4, 3) by kickdrift."""
    x, v = start()
    system = kd.System(x, v, MASSES, forces=[force], units="nbody")
    found: np.ndarray = BoundForces(system).measure(0.0, system.state.phase).accelerations.T
    return found


def theirs(name: str, prepare: Callable[[Any, Any], None]) -> np.ndarray:
    """Accelerations (4, 3) by REBOUNDx."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import rebound
        import reboundx

        sim = rebound.Simulation()
        sim.gravity = "none"
        for m, r, u in zip(MASSES, *start(), strict=True):
            sim.add(m=m, x=r[0], y=r[1], z=r[2], vx=u[0], vy=u[1], vz=u[2])
        extras = reboundx.Extras(sim)
        force = extras.load_force(name)
        extras.add_force(force)
        prepare(sim, force)
        rebound.clibrebound.reb_simulation_update_acceleration(ctypes.byref(sim))
        return np.array([[p.ax, p.ay, p.az] for p in sim.particles])


class Case(NamedTuple):
    """A force of kickdrift's, REBOUNDx's of the same meaning, and the bodies that are compared."""

    force: Any
    name: str
    prepare: Callable[[Any, Any], None]
    bodies: tuple[int, ...] = (0, 1, 2, 3)
    factor: float = 1.0  # of REBOUNDx's accelerations


def harmonics(sim: Any, force: Any) -> None:
    sim.particles[0].params["J2"], sim.particles[0].params["J4"], sim.particles[0].params["R_eq"] = 0.1, -0.05, 0.4


def shine(sim: Any, force: Any) -> None:
    force.params["c"] = LIGHT
    sim.particles[0].params["radiation_source"] = 1
    sim.particles[2].params["beta"], sim.particles[3].params["beta"] = 0.1, 0.3


def deform(sim: Any, force: Any) -> None:
    for particle, k2, radius, lag, spin in zip(sim.particles, LOVE, RADII, LAGS, SPINS, strict=False):
        particle.r = radius
        particle.params["tctl_k2"], particle.params["tctl_tau"], particle.params["OmegaMag"] = k2, lag, spin


INERTIAS, AXES = (0.07, 0.3, 0.4), [(0.1, 0.2, 0.7), (0.3, 0.0, 1.1), (0.0, -0.4, -0.3), (0.0, 0.0, 0.0)]


def spin(sim: Any, force: Any) -> None:
    """REBOUNDx's tau is half the lag of Hut 1981: its force has twice the part with the lag."""
    values = zip(sim.particles, LOVE, RADII, LAGS, AXES, INERTIAS, strict=False)
    for particle, k2, radius, lag, axis, inertia in values:
        particle.r = radius
        particle.params["k2"], particle.params["tau"], particle.params["Omega"] = k2, 0.5 * lag, list(axis)
        particle.params["I"] = inertia * particle.m * radius**2


def rotate(sim: Any, force: Any) -> None:
    force.params["lt_c"] = LIGHT
    sim.particles[0].params["I"], sim.particles[0].params["Omega"] = 0.5, [0.1, 0.2, 0.5]


def attract(sim: Any, force: Any) -> None:
    sim.particles[0].params["Acentral"], sim.particles[0].params["gammacentral"] = -0.3, -1.7


def migrate(sim: Any, force: Any) -> None:
    import reboundx

    force.params["coordinates"] = reboundx.coordinates["PARTICLE"]
    force.params["ide_position"], force.params["ide_width"] = 5.5, 0.2
    sim.particles[0].params["primary"] = 1
    sim.particles[3].params["tau_a"], sim.particles[3].params["tau_e"], sim.particles[3].params["tau_inc"] = (
        -300.0,
        -90.0,
        -120.0,
    )


def correct(sim: Any, force: Any) -> None:
    force.params["c"] = LIGHT


def cases() -> list[Case]:
    spins = [(0.0, 0.0, spin) for spin in (*SPINS, 0.0)]
    return [
        Case(kd.Oblateness(0.1, 0.4, j4=-0.05), "gravitational_harmonics", harmonics),
        Case(kd.PostNewtonian(c=LIGHT, form="potential"), "gr_potential", correct),
        Case(kd.LenseThirring((0.05, 0.1, 0.25), c=LIGHT), "lense_thirring", rotate, (3,), 2.0 / 2.000021),
        Case(kd.RadiationPressure([0.0, 0.0, 0.1, 0.3], c=LIGHT), "radiation_forces", shine),
        Case(kd.Tides((*LOVE, 0.0), (*RADII, 0.0), (*LAGS, 0.0), spins), "tides_constant_time_lag", deform),
        Case(
            kd.TidesSpin((*LOVE, 0.0), (*RADII, 0.0), (*INERTIAS, 0.0), AXES, (*LAGS, 0.0)),
            "tides_spin",
            spin,
            (0, 1, 2),
        ),
        Case(kd.CentralPotential(-0.3, -1.7), "central_force", attract),
        Case(
            kd.Migration([0, 0, 0, 300.0], [0, 0, 0, 90.0], [0, 0, 0, 120.0], edge=5.5, width=0.2),
            "modify_orbits_forces",
            migrate,
            (3,),
        ),
    ]


TURNING: dict[str, Any] = {
    "k2": (0.1, 0.08),
    "radius": (0.3, 0.4),
    "inertia": (0.1, 0.3),
    "spin": ((0.5, 0.0, 2.0), (0.0, 1.0, 3.0)),
    "tau": (0.02, 0.03),
}
LENGTH, STEPS = 6.0, (0.02, 0.01, 0.005, 0.0025)


def turned(system: Any, dt: float) -> np.ndarray:
    """Spins (2, 3) after a time by REBOUNDx, with steps of one length by IAS15."""
    import reboundx

    sim = simulation(system, "ias15", dt, 1.0)
    sim.integrator.epsilon = 0.0
    extras = reboundx.Extras(sim)
    force = extras.load_force("tides_spin")
    extras.add_force(force)
    for particle, k2, radius, inertia, axis, lag in zip(sim.particles, *TURNING.values(), strict=True):
        particle.r = radius
        particle.params["k2"], particle.params["tau"], particle.params["Omega"] = k2, 0.5 * lag, list(axis)
        particle.params["I"] = inertia * particle.m * radius**2
    extras.initialize_spin_ode(force)
    sim.integrate(LENGTH)
    return np.array([list(particle.params["Omega"]) for particle in sim.particles])


def evolution() -> Iterator[Claim]:
    """Spins of two tilted bodies under strong tides, after a time."""
    bodies = [{"mass": 0.9}, {"mass": 0.1, "a": 1.0, "e": 0.3}]
    system = kd.System.from_elements(bodies, units="nbody").with_forces(kd.Gravity(), kd.TidesSpin(**TURNING))
    sim = kd.Simulation(system, "gauss-radau15")
    sim.run(until=LENGTH)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = [turned(system, dt) for dt in STEPS]
    off = [float(np.abs(each - sim.state.spins.T).max()) for each in found]
    ratio = off[-2] / off[-1]
    reference = "REBOUNDx, tides_spin"
    text = "tides-spin: difference of spins from REBOUNDx's, over that at half the step"
    yield claim(text, ratio, "1.99 to 2.01", 1.99 <= ratio <= 2.01, reference)
    for order in range(1, len(STEPS)):
        found = [(2**order * fine - coarse) / (2**order - 1) for coarse, fine in pairwise(found)]
    off[0] = float(np.abs(found[0] - sim.state.spins.T).max())
    text = "tides-spin: difference of spins from REBOUNDx's, extrapolated to the step 0"
    yield claim(text, off[0], "at most 1e-8", off[0] <= 1e-8, reference)


def claims(long: bool = False) -> Iterator[Claim]:
    text = "accelerations beside REBOUNDx, relative difference"
    if find_spec("reboundx") is None:
        yield not_run(text, f"at most {BOUND:g}", "REBOUNDx", NEEDS)
        return
    for case in cases():
        chosen = list(case.bodies)
        found, wanted = ours(case.force)[chosen], case.factor * theirs(case.name, case.prepare)[chosen]
        off = float(np.abs(found - wanted).max() / np.abs(wanted).max())
        yield at_most(f"{case.force.name}: {text}", off, BOUND, f"REBOUNDx, {case.name}")
    yield from evolution()


if __name__ == "__main__":
    main(claims, __doc__)
