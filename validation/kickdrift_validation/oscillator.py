"""The harmonic oscillator, on which a step is a matrix that can be written down: methods whose weights are printed.

x'' = -x at dt = 0.1 (and one step of dt = 1): a method's step multiplies (x, v) by a matrix M, worked out here in 40
digits from the weights as their authors printed them, or from the stability function R(z) that the textbook has for
the method (Hairer & Wanner 1996, IV.3, doi:10.1007/978-3-642-05221-7), M = R(dt A), A = ((0, 1), (-1, 0)). One step of
kickdrift's must be M, and 20,000 steps M^20000. For velocity Verlet that is the closed form x_n = cos(n theta), theta =
2 arcsin(dt / 2) (Hairer, Lubich & Wanner 2006, I.5, doi:10.1007/3-540-30666-8): the phase is early by dt^2 / 24 of it.
"""

import math
from collections.abc import Sequence
from decimal import Decimal, localcontext

import numpy as np

import kickdrift as kd
from kickdrift.integrators import integrator
from kickdrift.integrators.runge_kutta.method import Tableau
from kickdrift_validation.claim import Claim, at_most, claim, main

DIGITS = 40
ONE, DT, STEPS = "1", "0.1", 20_000
PRINTED = 2e-12  # of a step: the eighth order weights were printed to 15 places and their errors multiply
ROUNDING = 1e-15  # of a step and its steps: a few roundings of numbers near 1
HAIRER = "Hairer & Wanner 1996, IV.3"
YOSHIDA = "weights printed by Yoshida 1990, doi:10.1016/0375-9601(90)90092-3"

Matrix = list[list[Decimal]]


def numbers(*texts: str) -> list[Decimal]:
    return [Decimal(text) for text in texts]


def fraction(text: str) -> Decimal:
    over, _, under = text.partition("/")
    return Decimal(over) / Decimal(under or "1")


def fractions(*texts: str) -> list[Decimal]:
    return [fraction(text) for text in texts]


def times(p: Matrix, q: Matrix) -> Matrix:
    return [[sum((p[i][k] * q[k][j] for k in range(2)), Decimal(0)) for j in range(2)] for i in range(2)]


def power(matrix: Matrix, exponent: int) -> Matrix:
    result: Matrix = [numbers("1", "0"), numbers("0", "1")]
    while exponent:
        if exponent % 2:
            result = times(result, matrix)
        matrix, exponent = times(matrix, matrix), exponent // 2
    return result


def split(kicks: Sequence[Decimal], drifts: Sequence[Decimal], first: str, dt: Decimal) -> Matrix:
    """Kicks v -= b dt x and drifts x += a dt v in turn."""
    matrix = power([], 0)
    one, none = numbers("1", "0")
    for stage in range(max(len(kicks), len(drifts))):
        parts = {"kick": kicks[stage : stage + 1], "drift": drifts[stage : stage + 1]}
        for kind in (first, "drift" if first == "kick" else "kick"):
            for weight in parts[kind]:
                shear = [[one, none], [-weight * dt, one]] if kind == "kick" else [[one, weight * dt], [none, one]]
                matrix = times(shear, matrix)
    return matrix


def jumps(weights: Sequence[Decimal], dt: Decimal, first: str = "kick") -> Matrix:
    """Leapfrog steps of lengths ``weights`` (from the middle outwards, without it) in a palindrome."""
    row = [*reversed(weights), 1 - 2 * sum(weights, Decimal(0)), *weights]
    half = [Decimal("0.5")] * 2
    matrix = power([], 0)
    for weight in row:
        parts = (half, [Decimal(1)]) if first == "kick" else ([Decimal(1)], half)
        matrix = times(split(*parts, first, weight * dt), matrix)
    return matrix


def splitting_step(name: str, dt: Decimal) -> tuple[Matrix, str] | None:
    """A splitting's matrix, and where its weights come from."""
    one, half = numbers("1", "0.5")
    triple = [1 / (2 - Decimal(2) ** (Decimal(1) / 3))]
    leapfrog = "leapfrog's shears"
    rows = {
        "symplectic-euler": lambda: (split([one], [one], "kick", dt), "shears"),
        "symplectic-euler-dk": lambda: (split([one], [one], "drift", dt), "shears"),
        "velocity-verlet": lambda: (split([half, half], [one], "kick", dt), leapfrog),
        "leapfrog-dkd": lambda: (split([one], [half, half], "drift", dt), leapfrog),
        "ruth3": lambda: (
            split(fractions("7/24", "3/4", "-1/24"), fractions("2/3", "-2/3", "1"), "kick", dt),
            "Ruth 1983, doi:10.1109/TNS.1983.4332919",
        ),
        "yoshida4": lambda: (jumps(triple, dt), "1 / (2 - 2^(1/3))"),
        "forest-ruth": lambda: (jumps(triple, dt, "drift"), "1 / (2 - 2^(1/3))"),
        "yoshida6": lambda: (
            jumps(numbers("-1.17767998417887", "0.235573213359357", "0.784513610477560"), dt), f"{YOSHIDA}, solution A"
        ),
        "yoshida8": lambda: (
            jumps(
                numbers(
                    "0.102799849391985", "-1.96061023297549", "1.93813913762276", "-0.158240635368243",
                    "-1.44485223686048", "0.253693336566229", "0.914844246229740",
                ), dt,
            ), f"{YOSHIDA}, solution D",
        ),
        "pefrl": lambda: (pefrl(dt), "Omelyan, Mryglod & Folk 2002, doi:10.1016/S0010-4655(02)00451-4"),
    }  # fmt: skip
    return rows[name]() if name in rows else None


def pefrl(dt: Decimal) -> Matrix:
    """Their equation 20, in their letters."""
    xi, lam, chi = numbers("0.1786178958448091", "-0.2123418310626054", "-0.06626458266981849")
    drifts = [xi, chi, 1 - 2 * (chi + xi), chi, xi]
    return split([(1 - 2 * lam) / 2, lam, lam, (1 - 2 * lam) / 2], drifts, "drift", dt)


# --- Runge-Kutta ---

# Numerator and denominator of R(z), from the constant term on.
STABILITY: dict[str, tuple[list[str], list[str]]] = {
    "euler": (["1", "1"], ["1"]),
    "midpoint": (["1", "1", "1/2"], ["1"]),
    "rk4": (["1", "1", "1/2", "1/6", "1/24"], ["1"]),
    "backward-euler": (["1"], ["1", "-1"]),
    "implicit-midpoint": (["1", "1/2"], ["1", "-1/2"]),
    "gauss-legendre4": (["1", "1/2", "1/12"], ["1", "-1/2", "1/12"]),
}
ADAPTIVE: dict[str, list[str]] = {
    "bogacki-shampine23": ["1", "1", "1/2", "1/6"],
    "dormand-prince45": ["1", "1", "1/2", "1/6", "1/24", "1/120", "1/600"],
}


def polynomial(coefficients: Sequence[str], dt: Decimal) -> Matrix:
    """Polynomial of dt A: a matrix a + b A with A^2 = -1."""
    a = sum((fraction(c) * dt**k * (-1) ** (k // 2) for k, c in enumerate(coefficients) if k % 2 == 0), Decimal(0))
    b = sum((fraction(c) * dt**k * (-1) ** (k // 2) for k, c in enumerate(coefficients) if k % 2), Decimal(0))
    return [[a, b], [-b, a]]


def rational_step(name: str, dt: Decimal) -> tuple[Matrix, str] | None:
    """R(dt A)."""
    if name not in STABILITY:
        return None
    over, under = (polynomial(part, dt) for part in STABILITY[name])
    a, b = under[0]
    size = a * a + b * b
    return times(over, [[a / size, -b / size], [b / size, a / size]]), HAIRER


def step(name: str, dt: Decimal) -> tuple[Matrix, str] | None:
    return splitting_step(name, dt) or rational_step(name, dt)


def two_oscillators() -> kd.Problem:
    """x'' = -x twice, one started at x = 1 and one at v = 1: the columns of the matrix."""

    def f(t, y):
        return y[2], y[3], -y[0], -y[1]

    return kd.Problem(f, [1.0, 0.0, 0.0, 1.0], separable=True, name="two oscillators")


def worst(off: dict[str, float]) -> str:
    return max(off, key=lambda name: off[name])


def claims(long: bool = False) -> list[Claim]:
    rows, subject = [], two_oscillators()
    single: dict[str, float] = {}
    after: dict[str, float] = {}
    with localcontext() as context:
        context.prec = DIGITS
        for name in (*(row for row in _names()), *STABILITY):
            found = step(name, Decimal(ONE))
            assert found is not None
            sim = kd.Simulation(subject, name, dt=float(ONE))
            sim.run(1)
            single[name] = difference(sim.state.y, found[0])
            many = step(name, Decimal(DT))
            assert many is not None
            sim = kd.Simulation(subject, name, dt=float(DT))
            sim.run(STEPS, every=STEPS)
            expected = power(many[0], STEPS)
            size = max(1.0, *(abs(float(number)) for row in expected for number in row))
            after[name] = difference(sim.state.y, expected) / size
            print(f"  {name:20} one step of {ONE}: {single[name]:.1e}; {STEPS} of {DT}: {after[name]:.1e}; {found[1]}")
        for name, coefficients in ADAPTIVE.items():
            method = integrator(name)
            assert isinstance(method, Tableau)
            off = max(abs(float(fraction(c)) - m) for c, m in zip(coefficients, moments(method), strict=True))
            rows.append(at_most(f"{name}: coefficients of R(z), of the tableau", off, ROUNDING, HAIRER))
    off, bound = single[worst(single)], PRINTED
    text = f"one step of dt = {ONE} as a matrix, largest difference of {len(single)} methods: {worst(single)}"
    rows.append(at_most(text, off, bound, "weights as printed; R(z); in 40 digits"))
    exact = {name: off for name, off in single.items() if name != "yoshida8"}
    off, bound = exact[worst(exact)], 20 * ROUNDING
    text = f"the same without yoshida8, whose printed weights are 2e-13 off: {worst(exact)}"
    rows.append(claim(text, off, f"at most {bound:g}", off <= bound, "weights as printed; R(z); in 40 digits"))
    off, bound = after[worst(after)], STEPS * ROUNDING
    text = f"{STEPS} steps of dt = {DT}: (x, v) over its size, largest difference: {worst(after)}"
    rows.append(at_most(text, off, bound, "the matrix's power, in 40 digits"))
    return [*rows, *phase(subject)]


def _names() -> list[str]:
    with localcontext() as context:
        context.prec = DIGITS
        return [name for name in kd.integrators() if splitting_step(name, Decimal(DT))]


def difference(y: np.ndarray, matrix: Matrix) -> float:
    expected = np.array([[float(number) for number in row] for row in matrix])
    return float(np.abs(np.asarray(y).reshape(2, 2) - expected).max())


def moments(method: Tableau) -> list[float]:
    """The coefficients of R(z): 1, then b A^k 1."""
    butcher = method.butcher
    assert butcher is not None
    a, b, ones = np.asarray(butcher[0], dtype=float), np.asarray(butcher[1], dtype=float), np.ones(len(butcher[1]))
    found = [1.0]
    for _ in range(len(b)):
        found.append(float(b @ ones))
        ones = a @ ones
    return found


def phase(subject: kd.Problem) -> list[Claim]:
    """Velocity Verlet's closed form."""
    dt, theta = float(DT), 2.0 * math.asin(float(DT) / 2)
    seen: list[tuple[int, float]] = []
    sim = kd.Simulation(subject, "velocity-verlet", dt=dt)
    sim.run(STEPS, every=100, observe=lambda sim: seen.append((sim.steps_done, float(sim.state.y[0]))))
    n, x = np.array(seen).T
    off, bound = float(np.abs(x - np.cos(n * theta)).max()), STEPS * ROUNDING
    text = f"velocity-verlet: x_n - cos(n theta) over {STEPS} steps"
    rows = [claim(text, off, f"at most {bound:g}", off <= bound, "theta = 2 arcsin(dt / 2)")]
    early = theta / dt - 1.0
    text = "its phase error for each unit of phase, over dt^2 / 24"
    value = early / (dt**2 / 24)
    rows.append(claim(text, value, "1 within dt^2 / 2", abs(value - 1) < dt**2 / 2, "Taylor's series of theta"))
    return rows


if __name__ == "__main__":
    main(claims, __doc__)
