"""Spins that tides change: rates, the end state and precession beside closed forms, and conservation.

Two bodies feel the force tides-spin. Rates come from runs of whole orbits under weak tides, so that theories of first
order hold. The accelerations and torques stand in planetary_forces and reboundx_forces.
"""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

import kickdrift as kd
from kickdrift_validation.claim import Claim, at_most, main
from kickdrift_validation.planetary_forces import elements, rate, start

ORBITS, MASSES, RADIUS, K2 = 10, (0.9, 0.1), 0.05, 0.3
PLANET, SMALL = 1e-6, 0.005  # mass over the star's, and radius, of a planet whose spin has no weight beside the orbit
HUT = "Hut 1981, A&A 99, 126"


def hut(e: float) -> tuple[float, ...]:
    """The functions f1 to f5 of the eccentricity, Hut 1981."""
    e2 = e * e
    return (
        1 + 31 / 2 * e2 + 255 / 8 * e2**2 + 185 / 16 * e2**3 + 25 / 64 * e2**4,
        1 + 15 / 2 * e2 + 45 / 8 * e2**2 + 5 / 16 * e2**3,
        1 + 15 / 4 * e2 + 15 / 8 * e2**2 + 5 / 64 * e2**3,
        1 + 3 / 2 * e2 + 1 / 8 * e2**2,
        1 + 3 * e2 + 3 / 8 * e2**2,
    )


def one_body(body: int, radius: float = RADIUS, **values: Any) -> kd.TidesSpin:
    """Tides on one of two bodies."""
    both = {"k2": 0.0, "inertia": 0.0, "tau": 0.0, "spin": (0.0, 0.0, 0.0)}
    given = {key: [values.get(key, zero) if i == body else zero for i in range(2)] for key, zero in both.items()}
    return kd.TidesSpin(radius=radius, flattening=values.get("flattening", "none"), **given)


def rates() -> Iterator[Claim]:
    """Rates of a, e and the spin, for tides on one body whose spin moves."""
    e, lag, spin, inertia = 0.3, 0.2, 0.5, 0.25
    f1, f2, f3, f4, f5 = hut(e)
    rest = 1 - e * e
    for what, body in (("the central body", 0), ("the other body", 1)):
        own, other = MASSES[body], MASSES[1 - body]
        q, drag = other / own, K2 * own * lag / RADIUS**3  # k / T
        force = one_body(body, k2=K2, inertia=inertia, tau=lag, spin=(0.0, 0.0, spin))
        system = start([force], MASSES, e=e)
        sim = kd.Simulation(system, "gauss-radau15")
        length = ORBITS * 2.0 * math.pi
        sim.run(until=length)
        before, after, now = elements(system.state, 1.0), elements(sim.state, 1.0), sim.state.spins
        turning = 0.5 * (spin + float(now[2, body]))  # mean spin of the run
        common = drag * q * RADIUS**8
        wanted = -6 * common * (1 + q) * rest**-7.5 * (f1 - rest**1.5 * f2 * turning)
        yield rate(f"tides-spin on {what}: rate of a", (after.a - before.a) / length, wanted, f"{HUT}, eq. 9")
        wanted = -27 * common * (1 + q) * e * rest**-6.5 * (f3 - 11 / 18 * rest**1.5 * f4 * turning)
        yield rate(f"tides-spin on {what}: rate of e", (after.e - before.e) / length, wanted, f"{HUT}, eq. 10")
        wanted = 3 * drag * q * q / inertia * RADIUS**6 * rest**-6 * (f2 - rest**1.5 * f5 * turning)
        found = (float(now[2, body]) - spin) / length
        yield rate(f"tides-spin on {what}: rate of the spin", found, wanted, f"{HUT}, eq. 11")


def end_state() -> Iterator[Claim]:
    """A spin of twice the mean motion comes to the pseudo-synchronous spin, while the orbit hardly changes."""
    e, masses = 0.3, (1.0, PLANET)
    inertia, relaxation = 0.3, 40.0
    lag = PLANET * inertia / (3 * K2 * SMALL**3 * hut(e)[4] * (1 - e * e) ** -4.5) / relaxation
    force = one_body(1, SMALL, k2=K2, inertia=inertia, tau=lag, spin=(0.0, 0.0, 2.0))
    sim = kd.Simulation(start([force], masses, e=e), "gauss-radau15")
    sim.run(until=10 * relaxation)
    spins = []
    for _ in range(64):  # one orbit
        sim.run(until=sim.time + 2.0 * math.pi / 64)
        spins.append(float(sim.state.spins[2, 1]))
    now = elements(sim.state, sum(masses))
    _, f2, _, _, f5 = hut(now.e)
    wanted = f2 / (f5 * (1 - now.e**2) ** 1.5) * now.a**-1.5
    yield rate("tides-spin: pseudo-synchronous end state, spin over mean motion", float(np.mean(spins)), wanted,
               f"{HUT}, eq. 42")  # fmt: skip


def precession() -> Iterator[Claim]:
    """The spin of a flattened body precesses about the orbit's normal."""
    e, spin, tilt, inertia = 0.2, 5.0, 0.4, 0.3
    axis = (spin * math.sin(tilt), 0.0, spin * math.cos(tilt))
    masses = (1.0, PLANET)
    force = one_body(1, SMALL, k2=0.001, inertia=inertia, spin=axis, flattening="rotational")
    sim = kd.Simulation(start([force], masses, e=e), "gauss-radau15")
    length = ORBITS * 2.0 * math.pi
    sim.run(until=length)
    now = sim.state.spins[:, 1]
    found = math.atan2(now[1], now[0]) / length
    flat = 0.001 * spin**2 * SMALL**3 / (3.0 * masses[1])  # J2
    wanted = -1.5 * flat * masses[0] / (inertia * spin) * math.cos(tilt) * (1 - e * e) ** -1.5
    yield rate("tides-spin: rate of precession of the spin", found, wanted, "torque of the star on J2")


def conservation() -> Iterator[Claim]:
    """Orbit and spins of two tilted bodies under strong tides."""
    force = kd.TidesSpin((0.3, 0.4), (0.1, 0.08), (0.1, 0.3), ((0.5, 0.0, 2.0), (0.0, 1.0, 3.0)), (0.02, 0.03))
    report = kd.Simulation(start([force], MASSES, e=0.3), "gauss-radau15").run(until=60.0, interval=0.02)
    text = "tides-spin: angular momentum of orbits and spins, largest error of the sum of m |x × v|"
    yield at_most(text, report.angular_momentum_error, 1e-14, "conservation")
    assert report.energy is not None
    off = report.energy.max_relative_error
    yield at_most("tides-spin: energy less work, largest relative error", off, 1e-10, "conservation")


def claims(long: bool = False) -> Iterator[Claim]:
    for part in (rates, end_state, precession, conservation):
        yield from part()


if __name__ == "__main__":
    main(claims, __doc__)
