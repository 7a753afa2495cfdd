"""Is a body without mass on a Kepler orbit exact in one step of wisdom-holman, however long, on every conic?

A star and eight bodies without mass have no interaction, so the map is Kepler's motion alone, and any step must end
where the closed form does: steps from a thousandth of a turn to ten turns, eccentricities from 0 to 0.99, hyperbolas to
3. Errors are in units of what one rounding of the start does by then: eps (|x| + |v| (1 + 3 t / r0)), since a rounding
of 2 / r0 in 1 / a = 2 / r0 - v^2 turns the phase by 3/2 t 2 / r0 of it.
"""

import math
from collections.abc import Iterator

import numpy as np

import kickdrift as kd
from kickdrift_validation.claim import Claim, at_most, main

ELLIPSES = (0.0, 0.05, 0.2, 0.4, 0.6, 0.8, 0.95, 0.99)
HYPERBOLAS = (1.001, 1.01, 1.1, 1.3, 1.6, 2.0, 2.5, 3.0)
TURNS = (0.001, 0.01, 0.03, 0.1, 0.2, 0.35, 0.5, 0.75, 1.3, 10.3)
ROUNDINGS = 10.0
EPSILON = float(np.finfo(float).eps)
L = np.longdouble


def exact(e: float, t: float) -> tuple[np.ndarray, np.ndarray]:
    """Position and velocity (2,) a time t after pericentre, G M = 1, |a| = 1, in extended precision; from Kepler's
    equation (Danby 1988, ch. 6), solved by Newton's method from a start beyond the root, where it falls to it."""
    ecc, mean = L(e), L(t)
    turn = 2 * L(np.pi) + L(1.2246467991473532e-16) * 2  # pi to 33 digits
    if e < 1.0:
        mean = np.remainder(mean + turn / 2, turn) - turn / 2
        anomaly = mean + np.sign(mean) * ecc
    else:
        anomaly = np.arcsinh((mean + ecc) / (ecc - 1)) if mean else L(0)
    sine, cosine = (np.sin, np.cos) if e < 1.0 else (np.sinh, np.cosh)
    sign = 1 if e < 1.0 else -1
    for _ in range(200):
        change = sign * (anomaly - ecc * sine(anomaly) - sign * mean) / (sign * (1 - ecc * cosine(anomaly)))
        anomaly -= change
        if abs(change) <= 1e-19 * max(L(1), abs(anomaly)):
            break
    s, c = sine(anomaly), cosine(anomaly)
    b, r = np.sqrt(abs(1 - ecc * ecc)), abs(1 - ecc * c)
    return np.array([sign * (c - ecc), b * s]), np.array([-s, b * c]) / r


def start(eccentricities: tuple[float, ...]) -> kd.System:
    """A star, and a body on each conic at its pericentre, each in a plane of its own."""
    x, v = np.zeros((2, 9, 3))
    for k, e in enumerate(eccentricities, start=1):
        x[k, :2], v[k, :2] = (part.astype(float) for part in exact(e, 0.0))
    masses = np.array([1.0] + [0.0] * 8)
    return kd.System(x, v, masses=masses, forces=[kd.Gravity(G=1.0)], units="nbody")


def worst(system: kd.System, eccentricities: tuple[float, ...], dt: float) -> tuple[float, float]:
    """The largest error of a position after one step in roundings, and the eccentricity that has it."""
    sim = kd.Simulation(system, "wisdom-holman", dt=dt)
    sim.run(1)
    off = []
    for k, e in enumerate(eccentricities, start=1):
        x, v = exact(e, dt)
        error = float(np.linalg.norm((sim.state.positions[k, :2] - sim.state.positions[0, :2]).astype(L) - x))
        size = math.hypot(*x) + math.hypot(*v) * (1.0 + 3.0 * dt / abs(1.0 - e))
        off.append(error / (EPSILON * size))
    place = int(np.argmax(off))
    return off[place], eccentricities[place]


def claims(long: bool = False) -> Iterator[Claim]:
    """One for each step and kind of conic."""
    for kind, eccentricities in (("ellipses", ELLIPSES), ("hyperbolas", HYPERBOLAS)):
        system = start(eccentricities)
        for turns in TURNS:
            value, e = worst(system, eccentricities, turns * 2 * math.pi)
            text = f"{kind}, a step of {turns:g} turns: farthest position, at e = {e:g}, in roundings"
            yield at_most(text, value, ROUNDINGS, "closed form, extended precision")


if __name__ == "__main__":
    main(claims, __doc__)
