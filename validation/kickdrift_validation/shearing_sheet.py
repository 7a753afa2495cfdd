"""Does sei solve Hill's motion exactly, and meet other forces with the order and the constants of the literature?

Rein & Tremaine 2011, doi:10.1111/j.1365-2966.2011.18939.x: epicycles to rounding, order 2 with other forces, and an
energy error that does not grow. Henon & Petit 1986, doi:10.1007/BF01234287: two satellites that pass at a distance of
many Hill radii, whose eccentricity after the encounter has a closed form. rebound's SEI runs the same patch. Particles
that bounce make a ring like those of Wisdom & Tremaine 1988, also beside rebound: see ring_patch.py. A dilute ring
heats up or cools down as kinetic theory says: see ring_thermal.py. ``--long`` takes ten times as many orbits, and
larger rings of two optical depths.
"""

import math
from fractions import Fraction
from typing import Any

import numpy as np

import kickdrift as kd
from kickdrift_validation.claim import INSTALL, Claim, claim, main, not_run
from kickdrift_validation.rebounds import simulation
from kickdrift_validation.ring_patch import beside_rebound as rings_beside_rebound
from kickdrift_validation.ring_patch import centre_of_mass, one_bounce
from kickdrift_validation.ring_thermal import thermal_balance

X = np.array([[1.0, 0.0, 0.3], [0.3, -2.0, 0.4], [-5.0, 1.0, 0.0]])
V = np.array([[0.1, -1.5, 0.2], [0.1, 0.4, -0.1], [0.0, 7.5, 0.3]])
TREMAINE = "Rein & Tremaine 2011"


def hills_motion(time: Any, omega: float, vertical: float) -> np.ndarray:
    """Positions of the bodies at X and V after a time, without other forces."""
    import mpmath

    with mpmath.workdps(40):
        w, t = mpmath.mpf(omega), mpmath.fraction(time.numerator, time.denominator)
        u, found = w * mpmath.mpf(vertical), np.zeros(X.shape)
        c, s = mpmath.cos(w * t), mpmath.sin(w * t)
        for i in range(len(X)):
            (x, y, z), (v_x, v_y, v_z) = map(mpmath.mpf, X[i]), map(mpmath.mpf, V[i])
            centre = 4 * x + 2 * v_y / w
            speed = v_x / w * c - (x - centre) * s
            found[i] = (
                centre + (x - centre) * c + v_x / w * s,
                y - 2 * v_x / w - mpmath.mpf(3) / 2 * w * centre * t + 2 * speed,
                z * mpmath.cos(u * t) + v_z / u * mpmath.sin(u * t),
            )
    return found


def epicycles(orbits: int) -> list[Claim]:
    """Errors after so many orbits, in steps of several lengths."""
    rows = []
    for omega, vertical, dt in ((1.0, 1.0, 0.3), (0.7, 3.6, 0.05), (1.0, 1.0, 2.0)):
        system = kd.System(X, V, masses=[1.0] * len(X), forces=[kd.Hill(omega, vertical)], units="nbody")
        sim, steps = kd.Simulation(system, "sei", dt=dt), round(2 * math.pi * orbits / dt / omega)
        sim.run(steps, every=steps)
        error = np.abs(sim.state.positions - (there := hills_motion(Fraction(dt) * steps, omega, vertical)))
        across, along = float(error[:, ::2].max()), float((error[:, 1] / np.abs(there[:, 1])).max())
        text = f"omega = {omega:g}, vertical = {vertical:g}, dt = {dt:g}, {orbits} orbits"
        rows += [
            claim(f"{text}: error of x and z", across, "at most 1e-13", across <= 1e-13, "closed form in mpmath"),
            claim(f"{text}: error of y, over y", along, "at most 1e-13", along <= 1e-13, "closed form in mpmath"),
        ]
    return rows


def moonlets(mass: float = 1e-3) -> kd.System:
    """Two bodies that pass each other, and massless ones."""
    x = [[0.3, 3.0, 0.02], [-0.2, -1.0, 0.0], [0.05, 1.5, 0.01], [0.1, 0.0, -0.01]]
    v = [[0.0, -0.45, 0.0], [0.01, 0.3, 0.01], [0.0, -0.07, 0.0], [0.01, -0.15, 0.0]]
    forces = [kd.Gravity(softening=0.05), kd.Hill(1.0)]
    return kd.System(x, v, masses=[mass, mass, 0.0, 0.0], forces=forces, units="nbody")


def moved(system: kd.System, dt: float, time: float) -> kd.State:
    sim = kd.Simulation(system, "sei", dt=dt)
    sim.run(round(time / dt), every=round(time / dt))
    return sim.state


def order() -> list[Claim]:
    """Power of dt in the error of positions, and energy over many orbits."""
    truth = kd.Simulation(moonlets(), "dop853", rtol=1e-13, atol=1e-13)
    truth.run(until=6.0)
    coarse, fine = (
        float(np.abs(moved(moonlets(), dt, 6.0).positions - truth.state.positions).max()) for dt in (0.04, 0.02)
    )
    power = float(np.log2(coarse / fine))
    system = kd.System(  # bound to each other, at a quarter of the Hill radius
        [[0.025, 0.0, 0.005], [-0.025, 0.0, -0.005]], [[0.0, 0.3, 0.0], [0.0, -0.3, 0.0]], masses=[0.01, 0.01],
        forces=[kd.Gravity(), kd.Hill(1.0)], units="nbody",
    )  # fmt: skip
    sim, found = kd.Simulation(system, "sei", dt=0.004), []
    start = sim.energy().total
    sim.run(100_000, every=100, observe=lambda sim: found.append(sim.energy().total - start))
    errors = np.abs(found)
    growth = float(errors[-200:].max() / errors[:200].max())
    return [
        claim("power of dt in the error of positions", power, "2 within 0.1", abs(power - 2) < 0.1, TREMAINE),
        claim("largest energy error in the last fifth of 10^5 steps of a pair, over that in the first fifth", growth,
              "at most 1.5", growth <= 1.5, TREMAINE),
    ]  # fmt: skip


def distant_encounter() -> Claim:
    """A body on a circular orbit passes a satellite at the distance b in x.

    In units with omega = 1 and G m = 1 for the satellite, the amplitude of the epicycle afterwards is
    8/9 (2 K0(2/3) + K1(2/3)) / b^2, to first order in the mass.
    """
    from scipy.special import k0, k1

    b, mass, far = 20.0, 1.0, 200.0
    x = [[0.0, 0.0, 0.0], [b, far * b / 1.5, 0.0]]
    v = [[0.0, 0.0, 0.0], [0.0, -1.5 * b, 0.0]]
    system = kd.System(x, v, masses=[mass, 0.0], forces=[kd.Gravity(), kd.Hill(1.0)], units="nbody")
    dt = 0.005
    state = moved(system, dt, 2 * far / 1.5 / 1.5)
    (vx, vy), px = state.velocities[1, :2], state.positions[1, 0]
    found = math.hypot(vx, 4 * px + 2 * vy - px)
    expected = 8.0 / 9.0 * (2.0 * k0(2.0 / 3.0) + k1(2.0 / 3.0)) * mass / b**2
    off = abs(found / expected - 1)
    return claim(f"epicycle after a passage at b = {b:g}, over the closed form, less 1", off, "at most 0.01",
                 off <= 0.01, "Goldreich & Tremaine 1982; Henon & Petit 1986")  # fmt: skip


def beside_rebound() -> list[Claim]:
    """The same patch under rebound's SEI, which takes the same kicks at the same times."""
    system = moonlets()
    sim = simulation(system, "sei", 0.02)
    sim.softening, sim.OMEGA = 0.05, 1.0
    sim.steps(300)
    there = np.array([p.xyz for p in sim.particles])
    off = float(np.abs(moved(system, 0.02, 6.0).positions - there).max())
    return [claim("positions after 300 steps beside rebound's SEI", off, "at most 1e-11", off <= 1e-11, "rebound")]


def claims(long: bool = False) -> list[Claim]:
    """All of it; what needs rebound is not run where it is not installed."""
    rows = [*epicycles(100_000 if long else 10_000), *order(), distant_encounter(), *one_bounce(), centre_of_mass()]
    rows += thermal_balance(100, 12 if long else 5, 40 if long else 16)
    try:
        import rebound  # noqa: F401
    except ImportError:
        return [*rows, not_run("the same positions and rings as rebound's", "at most 1e-11", "rebound", INSTALL)]
    rows += beside_rebound()
    if not long:
        return [*rows, *rings_beside_rebound(40, 0.5, 5, 3, 6)]
    return [*rows, *(row for depth in (0.2, 0.5) for row in rings_beside_rebound(80, depth, 6, 5, 15))]


if __name__ == "__main__":
    main(claims, __doc__)
