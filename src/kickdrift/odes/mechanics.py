"""Oscillators and orbits, as Problems."""

import math
from collections.abc import Callable, Sequence

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.problem import Problem, finite_numbers
from kickdrift.model.state import Floats

Numbers = Sequence[float]


def start_values(y0: Numbers, count: int) -> Floats:
    """Return y0 as an array of ``count`` numbers."""
    start = finite_numbers("y0", y0)
    if start.shape != (count,):
        got = len(start) if start.ndim == 1 else f"shape {start.shape}"
        raise InputError(f"y0: expected {count} number{'s' if count > 1 else ''}, got {got}")
    return start


def positive(key: str, value: float) -> float:
    """Return the value if it is positive, else raise InputError."""
    if not value > 0:
        raise InputError(f"{key}: expected a positive number, got {value!r}")
    return value


def harmonic_oscillator(y0: Numbers = (1.0, 0.0), omega: float = 1.0, t0: float = 0.0) -> Problem:
    """x'' = -omega^2 x; y is (x, x'). Closed form.

    Source: e.g. Hairer, Lubich & Wanner 2006, I.1.1, doi:10.1007/3-540-30666-8."""
    start = start_values(y0, 2)
    square = float(positive("omega", omega)) ** 2

    def f(t, y):
        return y[1], -square * y[0]

    def jacobian(t, y):
        return [[0.0, 1.0], [-square, 0.0]]

    def energy(t, y):
        return 0.5 * (y[1] * y[1] + square * y[0] * y[0])

    def exact(t):
        c, s = math.cos(omega * (t - t0)), math.sin(omega * (t - t0))
        return [start[0] * c + start[1] / omega * s, start[1] * c - start[0] * omega * s]

    return Problem(f, start, jacobian, t0=t0, separable=True, energy=energy, exact=exact, name="harmonic-oscillator")


def pendulum(y0: Numbers = (2.0, 0.0), omega: float = 1.0, t0: float = 0.0) -> Problem:
    """theta'' = -omega^2 sin(theta), omega^2 = g / l; y is (theta, theta').

    Source: Hairer, Lubich & Wanner 2006, eq. I.1.12, doi:10.1007/3-540-30666-8."""
    start = start_values(y0, 2)
    square = float(positive("omega", omega)) ** 2

    def f(t, y):
        return y[1], -square * math.sin(y[0])

    def jacobian(t, y):
        return [[0.0, 1.0], [-square * math.cos(y[0]), 0.0]]

    def energy(t, y):
        return 0.5 * y[1] * y[1] - square * math.cos(y[0])

    return Problem(f, start, jacobian, t0=t0, separable=True, energy=energy, name="pendulum")


def kepler(eccentricity: float = 0.5, y0: Numbers | None = None, t0: float = 0.0) -> Problem:
    """x'' = -x / |x|^3 in the plane; y is (x, y, x', y'). Closed form for elliptic orbits.

    Starts at the pericentre of an ellipse of semi-major axis 1 and period 2 pi, or at ``y0``.

    Source: Hull, Enright, Fellen & Sedgwick 1972, problems D, doi:10.1137/0709052."""
    if not 0 <= eccentricity < 1:
        raise InputError(f"eccentricity: expected a number from 0 to below 1, got {eccentricity!r}")
    e = float(eccentricity)
    start = start_values((1 - e, 0.0, 0.0, math.sqrt((1 + e) / (1 - e))) if y0 is None else y0, 4)
    if not start[:2].any():
        raise InputError("y0: the body is at the centre of attraction")

    def f(t, y):
        r2 = y[0] * y[0] + y[1] * y[1]
        factor = -1.0 / (r2 * math.sqrt(r2))
        return y[2], y[3], factor * y[0], factor * y[1]

    def energy(t, y):
        return 0.5 * (y[2] * y[2] + y[3] * y[3]) - 1.0 / math.hypot(y[0], y[1])

    bound = energy(t0, start) < 0
    return Problem(
        f, start, t0=t0, separable=True, energy=energy, exact=_ellipse(start, t0) if bound else None, name="kepler"
    )


def henon_heiles(y0: Numbers = (0.0, -0.25, 0.4208127057650866, 0.0), t0: float = 0.0) -> Problem:
    """Motion in the potential (x^2 + y^2) / 2 + x^2 y - y^3 / 3; y is (x, y, x', y'). Orbits of energies below
    1/6 stay, and are regular or chaotic. The default orbit has the energy 1/8 and is chaotic.

    Source: Hénon & Heiles 1964, eq. 11, doi:10.1086/109234."""
    start = start_values(y0, 4)

    def f(t, y):
        return y[2], y[3], -y[0] - 2.0 * y[0] * y[1], -y[1] - y[0] * y[0] + y[1] * y[1]

    def jacobian(t, y):
        return [
            [0.0, 0.0, 1.0, 0.0],
            [0.0, 0.0, 0.0, 1.0],
            [-1.0 - 2.0 * y[1], -2.0 * y[0], 0.0, 0.0],
            [-2.0 * y[0], -1.0 + 2.0 * y[1], 0.0, 0.0],
        ]

    def energy(t, y):
        kinetic = 0.5 * (y[2] * y[2] + y[3] * y[3])
        return kinetic + 0.5 * (y[0] * y[0] + y[1] * y[1]) + y[0] * y[0] * y[1] - y[1] ** 3 / 3.0

    return Problem(f, start, jacobian, t0=t0, separable=True, energy=energy, name="henon-heiles")


def _ellipse(start: Floats, t0: float) -> Callable[[float], Floats]:
    """Bound orbit of the Kepler problem through ``start``, from Kepler's equation in the difference of eccentric
    anomaly and Lagrange's f and g (Danby 1988, Fundamentals of Celestial Mechanics, 6.3)."""
    x, v = start[:2], start[2:]
    r0 = float(np.hypot(*x))
    a = 1.0 / (2.0 / r0 - float(v @ v))
    n = a**-1.5
    e_cos, e_sin = 1.0 - r0 / a, float(x @ v) / math.sqrt(a)

    def exact(t: float) -> Floats:
        mean = math.remainder(n * (t - t0), 2 * math.pi)

        def excess(u: float) -> float:
            return u - e_cos * math.sin(u) + e_sin * (1.0 - math.cos(u)) - mean

        low, high = mean - 2.0, mean + 2.0  # the difference is below 1 + e
        while high - low > 1e-3:  # Newton's method converges from here
            middle = 0.5 * (low + high)
            low, high = (low, middle) if excess(middle) > 0 else (middle, high)
        u = 0.5 * (low + high)
        for _ in range(8):
            u -= excess(u) / (1.0 - e_cos * math.cos(u) + e_sin * math.sin(u))
        r = a * (1.0 - e_cos * math.cos(u) + e_sin * math.sin(u))
        f, g = 1.0 - a / r0 * (1.0 - math.cos(u)), (mean - u + math.sin(u)) / n
        df, dg = -n * a * a * math.sin(u) / (r * r0), 1.0 - a / r * (1.0 - math.cos(u))
        return np.concatenate([f * x + g * v, df * x + dg * v])

    return exact


def arenstorf(
    y0: Numbers = (0.994, 0.0, 0.0, -2.00158510637908252240537862224), mu: float = 0.012277471, t0: float = 0.0
) -> Problem:
    """Satellite between Earth and Moon: the plane restricted three-body problem in rotating axes. y is (x, y, x', y').

    The default is a closed orbit of four loops and period 17.0652165601579625588917206249. ``energy`` is minus half of
    Jacobi's integral.

    Source: Arenstorf 1963, Am. J. Math. 85, 27; Hairer, Nørsett & Wanner 1993, eq. II.0.1,
    doi:10.1007/978-3-540-78862-1.
    """
    start = start_values(y0, 4)
    if not 0 <= mu <= 1:
        raise InputError(f"mu: expected the Moon's fraction of the mass, from 0 to 1, got {mu!r}")
    rest = 1.0 - mu

    def f(t, y):
        ahead, behind = y[0] + mu, y[0] - rest
        earth, moon = ahead * ahead + y[1] * y[1], behind * behind + y[1] * y[1]
        earth, moon = rest / (earth * math.sqrt(earth)), mu / (moon * math.sqrt(moon))
        return (
            y[2],
            y[3],
            y[0] + 2.0 * y[3] - earth * ahead - moon * behind,
            y[1] - 2.0 * y[2] - earth * y[1] - moon * y[1],
        )

    def energy(t, y):
        attraction = rest / math.hypot(y[0] + mu, y[1]) + mu / math.hypot(y[0] - rest, y[1])
        return 0.5 * (y[2] * y[2] + y[3] * y[3] - y[0] * y[0] - y[1] * y[1]) - attraction

    return Problem(f, start, t0=t0, energy=energy, name="arenstorf")


_PLEIADES = (
    *(3.0, 3.0, -1.0, -3.0, 2.0, -2.0, 2.0),  # x
    *(3.0, -3.0, 2.0, 0.0, 0.0, -4.0, 4.0),  # y
    *(0.0, 0.0, 0.0, 0.0, 0.0, 1.75, -1.5),  # x'
    *(0.0, 0.0, 0.0, -1.25, 1.0, 0.0, 0.0),  # y'
)


def pleiades(y0: Numbers = _PLEIADES, t0: float = 0.0) -> Problem:
    """Seven stars in the plane, of masses 1 to 7, with close encounters; y is seven x, seven y, and their velocities.

    Source: Hairer, Nørsett & Wanner 1993, eq. II.10.3, doi:10.1007/978-3-540-78862-1."""
    start = start_values(y0, 28)

    def f(t, y):
        dy = np.zeros(28)
        for i in range(14):
            dy[i] = y[14 + i]
        for i in range(7):
            for j in range(i):
                dx, dz = y[j] - y[i], y[7 + j] - y[7 + i]
                r2 = dx * dx + dz * dz
                r3 = r2 * math.sqrt(r2)
                dy[14 + i] += (j + 1) * dx / r3
                dy[21 + i] += (j + 1) * dz / r3
                dy[14 + j] -= (i + 1) * dx / r3
                dy[21 + j] -= (i + 1) * dz / r3
        return dy

    def energy(t, y):
        total = 0.0
        for i in range(7):
            total += 0.5 * (i + 1) * (y[14 + i] ** 2 + y[21 + i] ** 2)
            for j in range(i):
                total -= (i + 1) * (j + 1) / math.hypot(y[j] - y[i], y[7 + j] - y[7 + i])
        return total

    return Problem(f, start, t0=t0, separable=True, energy=energy, name="pleiades")
