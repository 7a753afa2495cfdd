"""Accelerations by the forces of planetary science, from textbook formulas in 50 digits (mpmath).

Each entry has a force and a function of positions, velocities and masses, as matrices and lists of mpmath, and of the
time; it returns the accelerations. Where a formula is a potential, its slope is taken by mpmath. Nothing here is
kickdrift's: the formulas are those of the sources, in the sources' form, for body 0 as the central body and G = 1.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import mpmath
import numpy as np
from mpmath import mp, mpf

import kickdrift as kd
from kickdrift.forces.beside.columns import further
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.integrators.flows.flow import flow_of

DIGITS = 50
Bodies = list[Any]  # of vectors (3, 1)
LIGHT = 20.0
MASSES = [1.0, 2e-2, 7e-3, 0.0, 3e-3]
TIME = 0.7


def start() -> tuple[np.ndarray, np.ndarray]:
    """Five bodies at any places, on bound orbits, about their centre of mass at rest."""
    rng = np.random.default_rng(23)
    x, v = rng.normal(size=(2, 5, 3))
    x[0], v = 0.01 * x[0], 0.3 * v
    m = np.array(MASSES)[:, None]
    return x, v - (m * v).sum(axis=0) / m.sum()


def dot(a: Any, b: Any) -> Any:
    return sum(p * q for p, q in zip(a, b, strict=True))


def cross(a: Any, b: Any) -> Any:
    return mp.matrix([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def norm(a: Any) -> Any:
    return mp.sqrt(dot(a, a))


def exact(values: Any) -> Any:
    """A vector of the same binary numbers."""
    return mp.matrix([mpf(float(value)) for value in values])


def around(formula: Callable[..., Any], reaction: bool) -> Callable[..., Bodies]:
    """Accelerations of all bodies by the formula of one at r, v from body 0."""

    def of_all(x: Bodies, v: Bodies, m: list[Any], t: Any) -> Bodies:
        found = [mp.matrix([0, 0, 0])] + [formula(i, x[i] - x[0], v[i] - v[0], m) for i in range(1, len(x))]
        if reaction:
            found[0] = sum((-m[i] / m[0] * found[i] for i in range(1, len(x))), mp.matrix([0, 0, 0]))
        return found

    return of_all


def slope(potential: Callable[[Any], Any], r: Any) -> Any:
    """Minus the slope of a potential, by mpmath."""
    parts = []
    for k in range(3):
        along = mp.matrix([1 if k == axis else 0 for axis in range(3)])
        parts.append(-mp.diff(lambda s, along=along: potential(r + s * along), 0))
    return mp.matrix(parts)


# --- gravity ---

ZONALS = {"j2": 0.02, "j3": -0.013, "j4": -0.017, "j5": 0.011, "j6": 0.019}
EQUATOR, POLE = 0.3, (0.3, -0.4, 0.8)


def zonal(i: int, r: Any, v: Any, m: list[Any]) -> Any:
    """Murray & Dermott 1999, section 6.11; mpmath's Legendre polynomials."""
    pole = exact(POLE) / norm(exact(POLE))

    def potential(at: Any) -> Any:
        far = norm(at)
        terms = [mpf(j) * (mpf(EQUATOR) / far) ** int(key[1]) * mp.legendre(int(key[1]), dot(at, pole) / far)
                 for key, j in ZONALS.items()]  # fmt: skip
        return m[0] / far * sum(terms)

    return slope(potential, r)


def power_law(i: int, r: Any, v: Any, m: list[Any]) -> Any:
    return slope(lambda at: mpf(0.3) * mpf(0.8) / mpf(0.75) * (norm(at) / mpf(0.8)) ** mpf(-0.75), r)


def changed(x: Bodies, v: Bodies, m: list[Any], t: Any) -> Bodies:
    """Newton's law for masses m exp(rate t), less that for m."""
    rates = [mpf(rate) for rate in RATES]
    return [
        sum(
            (m[j] * (mp.exp(rates[j] * t) - 1) * (x[j] - x[i]) / norm(x[j] - x[i]) ** 3
             for j in range(len(x)) if j != i),
            mp.matrix([0, 0, 0]),
        )
        for i in range(len(x))
    ]  # fmt: skip


RATES = (-0.2, 0.1, 0.0, 0.3, -0.05)

# --- relativity ---


def eih(x: Bodies, v: Bodies, m: list[Any], t: Any) -> Bodies:
    """Newhall, Standish & Williams 1983, eq. 1 with beta = gamma = 1, less Newton's term."""
    n, c2, beta, gamma = len(x), mpf(LIGHT) ** 2, 1, 1
    r = [[norm(x[i] - x[j]) for j in range(n)] for i in range(n)]
    others = [[j for j in range(n) if j != i] for i in range(n)]
    zero = mp.matrix([0, 0, 0])
    newton = [sum((m[j] * (x[j] - x[i]) / r[i][j] ** 3 for j in others[i]), zero) for i in range(n)]
    found = []
    for i in range(n):
        total = zero
        for j in others[i]:
            bracket = -mpf(2 * (beta + gamma)) / c2 * sum(m[k] / r[i][k] for k in others[i])
            bracket -= mpf(2 * beta - 1) / c2 * sum(m[k] / r[j][k] for k in others[j])
            bracket += gamma * dot(v[i], v[i]) / c2 + (1 + gamma) * dot(v[j], v[j]) / c2
            bracket -= 2 * (1 + gamma) / c2 * dot(v[i], v[j])
            bracket -= 3 / (2 * c2) * (dot(x[i] - x[j], v[j]) / r[i][j]) ** 2
            bracket += 1 / (2 * c2) * dot(x[j] - x[i], newton[j])
            total += m[j] * (x[j] - x[i]) / r[i][j] ** 3 * bracket
            along = dot(x[i] - x[j], (2 + 2 * gamma) * v[i] - (1 + 2 * gamma) * v[j])
            total += m[j] / r[i][j] ** 3 / c2 * along * (v[i] - v[j])
            total += mpf(3 + 4 * gamma) / (2 * c2) * m[j] * newton[j] / r[i][j]
        found.append(total)
    return found


def schwarzschild(i: int, r: Any, v: Any, m: list[Any]) -> Any:
    """Anderson et al. 1975: beta = gamma = 1."""
    far = norm(r)
    return m[0] / (mpf(LIGHT) ** 2 * far**3) * ((4 * m[0] / far - dot(v, v)) * r + 4 * dot(r, v) * v)


def radiated(x: Bodies, v: Bodies, m: list[Any], t: Any) -> Bodies:
    """Blanchet 2014, section 7, the 2.5PN terms A and B: a = -(G M / r^2) [A n + B v] of each pair's separation."""
    found = [mp.matrix([0, 0, 0]) for _ in x]
    for i in range(len(x)):
        for j in range(i):
            d, u, total = x[i] - x[j], v[i] - v[j], m[i] + m[j]
            r, nu = norm(d), m[i] * m[j] / (m[i] + m[j]) ** 2
            n, outward, v2 = d / r, dot(d, u) / r, dot(u, u)
            scale = 8 * total * nu / (5 * mpf(LIGHT) ** 5 * r)
            along = -scale * outward * (mpf(17) / 3 * total / r + 3 * v2)
            across = scale * (3 * total / r + v2)
            a = -total / r**2 * (along * n + across * u)
            found[i] += m[j] / total * a
            found[j] -= m[i] / total * a
    return found


SPIN = (0.03, -0.06, 0.15)


def dragged(i: int, r: Any, v: Any, m: list[Any]) -> Any:
    """IERS Conventions 2010, eq. 10.12, with gamma = 1."""
    far, spin = norm(r), exact(SPIN)
    return 2 / (mpf(LIGHT) ** 2 * far**3) * (3 / far**2 * dot(r, spin) * cross(r, v) + cross(v, spin))


# --- radiation ---

BETAS = (0.0, 0.1, 0.0, 0.3, 0.2)
RECOIL = {"a1": (0.0, 0.2, 0.1, -0.3, 0.1), "a2": (0.0, 0.1, -0.3, 0.2, 0.05), "a3": (0.0, 0.05, 0.1, 0.2, -0.1)}


def lit(i: int, r: Any, v: Any, m: list[Any]) -> Any:
    """Burns, Lamy & Soter 1979, eq. 5."""
    far, c = norm(r), mpf(LIGHT)
    n = r / far
    return mpf(BETAS[i]) * m[0] / far**2 * ((1 - dot(v, n) / c) * n - v / c)


def recoiled(i: int, r: Any, v: Any, m: list[Any]) -> Any:
    """Marsden, Sekanina & Yeomans 1973."""
    radial, normal = r / norm(r), cross(r, v) / norm(cross(r, v))
    axes = (radial, cross(normal, radial), normal)
    parts = (mpf(RECOIL[key][i]) * axis for key, axis in zip(RECOIL, axes, strict=True))
    return (mpf(1.5) / norm(r)) ** mpf(2.25) * sum(parts, mp.matrix([0, 0, 0]))


# --- tides ---

LOVE, RADII, LAGS = (0.03, 0.3, 0.2, 0.0, 0.4), (0.3, 0.2, 0.1, 0.1, 0.15), (0.01, 0.02, 0.05, 0.03, 0.04)
SPINS = ((0.1, 0.2, 0.7), (0.3, 0.0, 1.1), (0.0, -0.4, -0.3), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0))


def hut(love: Any, radius: Any, lag: Any, spin: Any, mass: Any, r: Any, v: Any) -> Any:
    """Force on the body of this mass at r from the deformed body (Hut 1981, the spin along any axis): radial 1 +
    3 tau r' / r, and across along the spin less the angular velocity of the orbit."""
    far = norm(r)
    n = r / far
    turning = cross(r, v) / far**2
    bracket = (1 + 3 * lag * dot(r, v) / far**2) * n - lag * cross(spin - turning, n)
    return -3 * love * mass**2 * radius**5 / far**7 * bracket


def slaved(i: int, r: Any, v: Any, m: list[Any]) -> Any:
    """Spin of the pseudo-synchronous rotation, Hut 1981, eq. 42, from the orbit's elements."""
    gm = m[0] + m[i]
    a = 1 / (2 / norm(r) - dot(v, v) / gm)
    h = cross(r, v)
    e2 = 1 - dot(h, h) / (gm * a)
    f2 = 1 + mpf(15) / 2 * e2 + mpf(45) / 8 * e2**2 + mpf(5) / 16 * e2**3
    f5 = 1 + 3 * e2 + mpf(3) / 8 * e2**2
    return mp.sqrt(gm / a**3) * f2 / ((1 - e2) ** mpf(1.5) * f5) * h / norm(h)


def tidal(i: int, r: Any, v: Any, m: list[Any]) -> Any:
    values = [[mpf(value) for value in each] for each in (LOVE, RADII, LAGS)]
    k, radius, lag = values
    on_central = hut(k[0], radius[0], lag[0], exact(SPINS[0]), 1, r, v) * m[i]
    if k[i] == 0:
        return on_central
    spin = exact(SPINS[i]) if any(SPINS[i]) else slaved(i, r, v, m)
    return on_central - hut(k[i], radius[i], lag[i], spin, m[0], -r, -v) / m[i]


INERTIAS = (0.07, 0.3, 0.4, 0.1, 0.2)


def flattened(love: Any, radius: Any, spin: Any, r: Any) -> Any:
    """Potential energy of a unit mass at r from a body that its rotation flattens: J2 = k2 S^2 R^3 / (3 G m)."""
    return love * radius**5 * (3 * dot(spin, r) ** 2 / norm(r) ** 5 - dot(spin, spin) / norm(r) ** 3) / 6


def spinning(x: Bodies, v: Bodies, m: list[Any], t: Any) -> Bodies:
    """Accelerations of all bodies, and then of all spins, by the tide and the flattening of each body."""
    n, zero = len(x), mp.matrix([0, 0, 0])
    found = [zero] * (2 * n)
    for i, (love, radius, lag) in enumerate(zip(LOVE, RADII, LAGS, strict=True)):
        k, size, spin = mpf(love), mpf(radius), exact(SPINS[i])
        for j in (other for other in range(n) if other != i and k):
            r = x[j] - x[i]
            push = hut(k, size, mpf(lag), spin, 1, r, v[j] - v[i]) * m[j]
            push += slope(lambda at, k=k, size=size, spin=spin: flattened(k, size, spin, at), r)
            found[j] += push
            found[i] -= m[j] / m[i] * push
            found[n + i] -= m[j] * cross(r, push) / (mpf(INERTIAS[i]) * m[i] * size**2)
    return found


# --- gas ---

TIMES = {
    "tau_a": (0.0, 10.0, 20.0, -30.0, 5.0),
    "tau_e": (0.0, 3.0, 4.0, 5.0, 0.0),
    "tau_i": (0.0, 7.0, 0.0, 4.0, 6.0),
}
GAS = (0.0, 0.1, 0.2, 0.3, 0.4)
EDGE, WIDTH = 0.9, 0.23  # one body inside, one on the edge


def migrating(i: int, r: Any, v: Any, m: list[Any]) -> Any:
    """Papaloizou & Larwood 2000, section 2; the trap of Pichierri, Morbidelli & Crida 2018."""
    tau_a, tau_e, tau_i = (mpf(TIMES[key][i]) for key in TIMES)
    pole = exact(POLE) / norm(exact(POLE))
    a = 1 / (2 / norm(r) - dot(v, v) / (m[0] + m[i]))
    inner, outer = mpf(EDGE) * (1 - mpf(WIDTH)), mpf(EDGE) * (1 + mpf(WIDTH))
    trap = mpf(1)
    if 0 < a < inner:
        trap = mpf(-10)
    elif 0 < a < outer:
        trap = mpf(5.5) * mp.cos((outer - a) * 2 * mp.pi / (4 * mpf(WIDTH) * mpf(EDGE))) - mpf(4.5)
    total = -v / (2 * tau_a) * trap
    if tau_e:
        total -= 2 * dot(v, r) * r / (norm(r) ** 2 * tau_e)
    if tau_i:
        total -= 2 * dot(v, pole) * pole / tau_i
    return total


def dragged_by_gas(i: int, r: Any, v: Any, m: list[Any]) -> Any:
    """Adachi, Hayashi & Nakazawa 1976."""
    pole = exact(POLE) / norm(exact(POLE))
    z = dot(r, pole)
    flat = r - z * pole
    far = norm(flat)
    gas = (1 - mpf(0.05)) * mp.sqrt(m[0] / far) * cross(pole, flat) / far
    density = mpf(GAS[i]) * (far / mpf(1.5)) ** mpf(-2.75) * mp.exp(-(z**2) / (2 * (mpf(0.5) * far) ** 2))
    return -density * norm(v - gas) * (v - gas)


def slowed(i: int, r: Any, v: Any, m: list[Any]) -> Any:
    """Binney & Tremaine 2008, eq. 8.7."""
    speed = norm(v)
    ratio = speed / (mp.sqrt(2) * mpf(0.9))
    shape = mp.erf(ratio) - 2 * ratio / mp.sqrt(mp.pi) * mp.exp(-(ratio**2))
    density = mpf(0.3) * (norm(r) / mpf(1.5)) ** mpf(-1.75)
    return -4 * mp.pi * m[i] * density * mpf(5) * shape / speed**3 * v


class Formula(NamedTuple):
    """A force, and its accelerations in 50 digits."""

    force: Any
    accelerations: Callable[..., Bodies]
    source: str


FORMULAS: dict[str, Formula] = {
    "j2": Formula(
        kd.Oblateness(radius=EQUATOR, pole=POLE, G=1.0, **ZONALS), around(zonal, True), "slope of the potential"
    ),
    "relativity-1pn": Formula(kd.PostNewtonian(c=LIGHT, G=1.0), around(schwarzschild, True), "Anderson et al. 1975"),
    "relativity-eih": Formula(kd.EinsteinInfeldHoffmann(c=LIGHT, G=1.0), eih, "Newhall et al. 1983, eq. 1"),
    "relativity-2.5pn": Formula(kd.RadiationReaction(c=LIGHT, G=1.0), radiated, "Blanchet 2014, section 7"),
    "lense-thirring": Formula(
        kd.LenseThirring(SPIN, c=LIGHT, G=1.0), around(dragged, True), "IERS Conventions 2010, eq. 10.12"
    ),
    "radiation-pressure": Formula(
        kd.RadiationPressure(BETAS, c=LIGHT, G=1.0), around(lit, False), "Burns et al. 1979, eq. 5"
    ),
    "non-gravitational": Formula(
        kd.NonGravitational(scale=1.5, power=2.25, **RECOIL), around(recoiled, False), "Marsden et al. 1973"
    ),
    "tides": Formula(
        kd.Tides(LOVE, RADII, LAGS, SPINS, rotation="pseudo-synchronous", G=1.0), around(tidal, True), "Hut 1981"
    ),
    "tides-spin": Formula(
        kd.TidesSpin(LOVE, RADII, INERTIAS, SPINS, LAGS, G=1.0), spinning, "Hut 1981; J2 = k2 S^2 R^3 / (3 G m)"
    ),
    "migration": Formula(
        kd.Migration(**TIMES, edge=EDGE, width=WIDTH, pole=POLE, G=1.0),
        around(migrating, False),
        "Papaloizou & Larwood 2000; Pichierri et al. 2018",
    ),
    "gas-drag": Formula(
        kd.GasDrag(GAS, 1.5, slope=2.75, headwind=0.05, aspect=0.5, pole=POLE, G=1.0),
        around(dragged_by_gas, False),
        "Adachi et al. 1976",
    ),
    "dynamical-friction": Formula(
        kd.DynamicalFriction(0.3, 0.9, 5.0, scale=1.5, slope=1.75, G=1.0),
        around(slowed, False),
        "Binney & Tremaine 2008, eq. 8.7",
    ),
    "central-potential": Formula(
        kd.CentralPotential(0.3, -1.75, 0.8), around(power_law, True), "slope of the potential"
    ),
    "mass-change": Formula(kd.MassChange(RATES, G=1.0), changed, "Newton's law for m exp(rate t)"),
}


def off(name: str) -> float:
    """Largest difference of a force's accelerations from the formula's, over the formula's largest acceleration of the
    same body."""
    formula, (x, v) = FORMULAS[name], start()
    system = kd.System(x, v, MASSES, forces=[formula.force], units="nbody")
    found = _measured(system)
    with mpmath.workdps(DIGITS):
        wanted = formula.accelerations(
            [exact(row) for row in x], [exact(row) for row in v], [mpf(m) for m in MASSES], mpf(TIME)
        )
        worst = 0.0
        for row, a in zip(found, wanted, strict=True):
            miss, size = norm(exact(row) - a), norm(a)
            worst = max(worst, float(miss / size) if size else float(miss))
    return worst


def _measured(system: kd.System) -> np.ndarray:
    """Accelerations (n, 3) of the bodies, and below them those of the spins, where spins evolve."""
    if not further(system):
        return BoundForces(system).measure(TIME, system.state.phase).accelerations.T
    flow = flow_of(system, 1, jumps=True)
    return flow.derivative(TIME, flow.array(system.state))[1].T
