"""Growth, reactions, a circuit and a flow: first-order equations, some of them stiff, as Problems."""

import math

from kickdrift.errors import InputError
from kickdrift.model.problem import Problem
from kickdrift.odes.mechanics import Numbers, positive, start_values


def logistic(y0: Numbers = (1.0,), rate: float = 0.25, capacity: float = 20.0, t0: float = 0.0) -> Problem:
    """y' = rate y (1 - y / capacity). Closed form.

    Source: Verhulst 1838; Hull, Enright, Fellen & Sedgwick 1972, problem A4, doi:10.1137/0709052."""
    start = start_values(y0, 1)
    positive("capacity", capacity)

    def f(t, y):
        return (rate * y[0] * (1.0 - y[0] / capacity),)

    def jacobian(t, y):
        return [[rate * (1.0 - 2.0 * y[0] / capacity)]]

    def exact(t):
        return [start[0] * capacity / (start[0] + (capacity - start[0]) * math.exp(-rate * (t - t0)))]

    return Problem(f, start, jacobian, t0=t0, exact=exact, name="logistic")


def lotka_volterra(
    y0: Numbers = (10.0, 5.0),
    alpha: float = 1.5,
    beta: float = 1.0,
    gamma: float = 3.0,
    delta: float = 1.0,
    t0: float = 0.0,
) -> Problem:
    """x' = alpha x - beta x y, y' = delta x y - gamma y: prey and predators.

    ``energy`` is delta x - gamma ln x + beta y - alpha ln y.

    Source: Lotka 1925; Volterra 1926, doi:10.1038/118558a0; Hairer, Lubich & Wanner 2006, I.1.1,
    doi:10.1007/3-540-30666-8."""
    start = start_values(y0, 2)
    if not (start > 0).all():
        raise InputError(f"y0: expected populations above 0, got {start.tolist()}")

    def f(t, y):
        return alpha * y[0] - beta * y[0] * y[1], delta * y[0] * y[1] - gamma * y[1]

    def jacobian(t, y):
        return [[alpha - beta * y[1], -beta * y[0]], [delta * y[1], delta * y[0] - gamma]]

    def energy(t, y):
        if not (y[0] > 0 and y[1] > 0):
            return math.nan
        return delta * y[0] - gamma * math.log(y[0]) + beta * y[1] - alpha * math.log(y[1])

    return Problem(f, start, jacobian, t0=t0, energy=energy, name="lotka-volterra")


def van_der_pol(mu: float = 5.0, y0: Numbers = (2.0, 0.0), t0: float = 0.0) -> Problem:
    """x'' = mu (1 - x^2) x' - x; y is (x, x'). Stiff for large ``mu``, where the period is about 1.614 mu.

    Source: van der Pol 1926, doi:10.1080/14786442608564127; Hairer & Wanner 1996, IV.1, doi:10.1007/978-3-642-05221-7.
    """
    start = start_values(y0, 2)

    def f(t, y):
        return y[1], mu * (1.0 - y[0] * y[0]) * y[1] - y[0]

    def jacobian(t, y):
        return [[0.0, 1.0], [-2.0 * mu * y[0] * y[1] - 1.0, mu * (1.0 - y[0] * y[0])]]

    return Problem(f, start, jacobian, t0=t0, name="van-der-pol")


def robertson(
    y0: Numbers = (1.0, 0.0, 0.0), k1: float = 0.04, k2: float = 3e7, k3: float = 1e4, t0: float = 0.0
) -> Problem:
    """A -> B (k1), B + B -> B + C (k2), B + C -> A + C (k3); y is the amounts of A, B, C. Stiff.

    ``energy`` is the sum of the amounts.

    Source: Robertson 1966; Hairer & Wanner 1996, eq. IV.1.4, doi:10.1007/978-3-642-05221-7."""
    start = start_values(y0, 3)

    def f(t, y):
        first, second, third = k1 * y[0], k2 * y[1] * y[1], k3 * y[1] * y[2]
        return third - first, first - third - second, second

    def jacobian(t, y):
        return [
            [-k1, k3 * y[2], k3 * y[1]],
            [k1, -k3 * y[2] - 2.0 * k2 * y[1], -k3 * y[1]],
            [0.0, 2.0 * k2 * y[1], 0.0],
        ]

    def energy(t, y):
        return y[0] + y[1] + y[2]

    return Problem(f, start, jacobian, t0=t0, energy=energy, name="robertson")


def hires(y0: Numbers = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0057), t0: float = 0.0) -> Problem:
    """Growth of a plant under light: eight reactants of phytochrome ("high irradiance responses"). Stiff.

    ``energy`` is y7 + y8, the amount of an enzyme, free and bound.

    Source: Schäfer 1975, doi:10.1007/BF00278230; Hairer & Wanner 1996, eq. IV.10.2, doi:10.1007/978-3-642-05221-7."""
    start = start_values(y0, 8)

    def f(t, y):
        bind = 280.0 * y[5] * y[7]
        return (
            -1.71 * y[0] + 0.43 * y[1] + 8.32 * y[2] + 0.0007,
            1.71 * y[0] - 8.75 * y[1],
            -10.03 * y[2] + 0.43 * y[3] + 0.035 * y[4],
            8.32 * y[1] + 1.71 * y[2] - 1.12 * y[3],
            -1.745 * y[4] + 0.43 * y[5] + 0.43 * y[6],
            -bind + 0.69 * y[3] + 1.71 * y[4] - 0.43 * y[5] + 0.69 * y[6],
            bind - 1.81 * y[6],
            -bind + 1.81 * y[6],
        )

    def jacobian(t, y):
        six, eight = 280.0 * y[5], 280.0 * y[7]
        return [
            [-1.71, 0.43, 8.32, 0.0, 0.0, 0.0, 0.0, 0.0],
            [1.71, -8.75, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            [0.0, 0.0, -10.03, 0.43, 0.035, 0.0, 0.0, 0.0],
            [0.0, 8.32, 1.71, -1.12, 0.0, 0.0, 0.0, 0.0],
            [0.0, 0.0, 0.0, 0.0, -1.745, 0.43, 0.43, 0.0],
            [0.0, 0.0, 0.0, 0.69, 1.71, -eight - 0.43, 0.69, -six],
            [0.0, 0.0, 0.0, 0.0, 0.0, eight, -1.81, six],
            [0.0, 0.0, 0.0, 0.0, 0.0, -eight, 1.81, -six],
        ]

    def energy(t, y):
        return y[6] + y[7]

    return Problem(f, start, jacobian, t0=t0, energy=energy, name="hires")


def orego(
    y0: Numbers = (1.0, 2.0, 3.0), s: float = 77.27, q: float = 8.375e-6, w: float = 0.161, t0: float = 0.0
) -> Problem:
    """The Oregonator: the oscillations of the Belousov-Zhabotinskii reaction. Stiff.

    Source: Field & Noyes 1974, doi:10.1063/1.1681288; Hairer & Wanner 1996, eq. IV.10.1, doi:10.1007/978-3-642-05221-7.
    """
    start = start_values(y0, 3)
    positive("s", s)

    def f(t, y):
        return (
            s * (y[1] + y[0] * (1.0 - q * y[0] - y[1])),
            (y[2] - (1.0 + y[0]) * y[1]) / s,
            w * (y[0] - y[2]),
        )

    def jacobian(t, y):
        return [
            [s * (1.0 - 2.0 * q * y[0] - y[1]), s * (1.0 - y[0]), 0.0],
            [-y[1] / s, -(1.0 + y[0]) / s, 1.0 / s],
            [w, 0.0, -w],
        ]

    return Problem(f, start, jacobian, t0=t0, name="orego")


def lorenz(
    y0: Numbers = (0.0, 1.0, 0.0), sigma: float = 10.0, rho: float = 28.0, beta: float = 8.0 / 3.0, t0: float = 0.0
) -> Problem:
    """x' = sigma (y - x), y' = x (rho - z) - y, z' = x y - beta z. Chaotic: neighbouring solutions diverge as exp(0.9
    t).

    Source: Lorenz 1963, eqs. 25 to 27, doi:10.1175/1520-0469(1963)020<0130:DNF>2.0.CO;2."""
    start = start_values(y0, 3)

    def f(t, y):
        return sigma * (y[1] - y[0]), y[0] * (rho - y[2]) - y[1], y[0] * y[1] - beta * y[2]

    def jacobian(t, y):
        return [[-sigma, sigma, 0.0], [rho - y[2], -1.0, -y[0]], [y[1], y[0], -beta]]

    return Problem(f, start, jacobian, t0=t0, name="lorenz")
