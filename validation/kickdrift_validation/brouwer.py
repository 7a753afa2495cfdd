"""Does what rounding does to the energy grow as the root of the time, and no faster, for every symplectic method?

On harmonic oscillators a symplectic method is a matrix of determinant 1, and conserves a quadratic form exactly
(Hairer, Lubich & Wanner 2006, VIII.5 and IX.3, doi:10.1007/3-540-30666-8): with the step from (x, v) to (A x + B v,
C x + D v) it is C x^2 + (D - A) x v - B v^2. The matrix comes from the method's coefficients in rational numbers, and
the form is taken of the very numbers that a run hands out: how far it moves is rounding, and rounding alone. Where that
is random it is a walk, and grows as the root of the number of steps (Brouwer 1937, doi:10.1086/105423); a bias would
make it grow as the number itself. Root mean squares over 200 oscillators of different frequencies, 20
where the method is implicit.
"""

from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import numpy as np

import kickdrift as kd
from kickdrift.integrators import Method, integrator
from kickdrift.integrators.splitting.method import Splitting
from kickdrift.integrators.splitting.stormer import Stormer
from kickdrift.plots.drawing import COLOURS, INK, new_axes, new_figure, save_figure
from kickdrift_validation.claim import Claim, claim, main
from kickdrift_validation.integrators import shipped
from kickdrift_validation.measures import EXPLICIT, fixed, oscillators

LOW, HIGH, DT = 0.5, 1.0, 0.1
COUNT, FEW = 200, 20  # oscillators; of implicit methods, which solve for all of them at once
SHORT, LONG = 32_768, 2_097_152  # steps
FIRST = 64
POWER, NEAR = 0.5, 0.15
MOST = 10.0  # of a step's roundings: some two a stage, of half a unit, in fifteen stages
LAW = "Brouwer 1937; the form is exact"
Matrix = tuple[tuple[Fraction, Fraction], tuple[Fraction, Fraction]]


def measured() -> list[str]:
    """The symplectic methods of fixed steps that run oscillators."""
    return [name for name in fixed() if integrator(name).symplectic and name in shipped()]


def product(p: Matrix, q: Matrix) -> Matrix:
    (a, b), (c, d) = p
    (e, f), (g, h) = q
    return (a * e + b * g, a * f + b * h), (c * e + d * g, c * f + d * h)


def step(method: Method, omega: Fraction, dt: Fraction) -> Matrix:
    """The matrix of a step on x'' = -omega^2 x, of (x, v)."""
    if isinstance(method, Stormer):  # the positions of velocity-verlet, and its velocities
        return step(integrator("velocity-verlet"), omega, dt)
    one, zero, pull = Fraction(1), Fraction(0), omega * omega
    if isinstance(method, Splitting):
        whole: Matrix = ((one, zero), (zero, one))
        for kick, drift in zip(*method.stages[:2], strict=True):
            whole = product(((one, zero), (-Fraction(kick) * dt * pull, one)), whole)
            whole = product(((one, Fraction(drift) * dt), (zero, one)), whole)
        return whole
    assert method.butcher is not None
    a, b = ([[Fraction(entry) for entry in row] for row in np.atleast_2d(part).tolist()] for part in method.butcher)
    columns = [stages(a, b[0], pull, dt, start) for start in ((one, zero), (zero, one))]
    return (columns[0][0], columns[1][0]), (columns[0][1], columns[1][1])


def stages(
    a: list[list[Fraction]], b: list[Fraction], pull: Fraction, dt: Fraction, start: tuple[Fraction, Fraction]
) -> tuple[Fraction, Fraction]:
    """A step of a Runge-Kutta method, implicit or not: the stages' slopes k = f(start + dt a k), solved for exactly."""
    s = len(b)
    f = ((Fraction(0), Fraction(1)), (-pull, Fraction(0)))
    size = 2 * s
    rows = [[Fraction(int(i == j)) for j in range(size + 1)] for i in range(size)]
    for i in range(s):
        for p in range(2):
            rows[2 * i + p][size] = sum((f[p][q] * start[q] for q in range(2)), Fraction(0))
            for j in range(s):
                for q in range(2):
                    rows[2 * i + p][2 * j + q] -= dt * a[i][j] * f[p][q]
    for i in range(size):  # Gauss and Jordan; the pivots are near 1
        rows[i] = [entry / rows[i][i] for entry in rows[i]]
        for j in range(size):
            if j != i and rows[j][i]:
                rows[j] = [x - rows[j][i] * y for x, y in zip(rows[j], rows[i], strict=True)]
    k = [row[size] for row in rows]
    x, v = (start[p] + dt * sum((b[i] * k[2 * i + p] for i in range(s)), Fraction(0)) for p in range(2))
    return x, v


def errors(name: str, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """(k,) numbers of steps, and the root mean square of the relative error of the form after each."""
    many = COUNT if integrator(name).family in EXPLICIT else FEW
    sim = kd.Simulation(oscillators(LOW, HIGH, many), name, dt=DT)
    width = (HIGH - LOW) / (many - 1)
    forms = []
    for i in range(many):
        (a, b), (c, d) = step(integrator(name), Fraction(LOW + i * width), Fraction(DT))
        forms.append((c, d - a, -b))

    def values() -> list[Fraction]:
        x, v = ([Fraction(number) for number in part] for part in sim.state.y.reshape(2, many).tolist())
        return [p * y * y + q * y * w + r * w * w for (p, q, r), y, w in zip(forms, x, v, strict=True)]

    start, counts, found = values(), [], []
    count = FIRST
    while count <= steps:
        sim.run(count - sim.steps_done, every=2**40)
        off = np.array([float(now / then - 1) for now, then in zip(values(), start, strict=True)])
        counts.append(count)
        found.append(float(np.sqrt(np.mean(off**2))))
        count *= 2
    return np.array(counts), np.array(found)


def claims(long: bool = False, figures: Path | None = None) -> Iterator[Claim]:
    """The power of the number of steps, of each method."""
    curves = {}
    for name in measured():
        counts, found = curves[name] = errors(name, LONG if long else SHORT)
        power = float(np.polyfit(np.log(counts), np.log(found), 1)[0])
        print(f"{name:20} {power:6.3f}  {found[-1]:.1e} after {counts[-1]} steps", flush=True)
        text = f"{name}: power of the steps that rounding of the energy grows with"
        least, most = POWER - NEAR, POWER + NEAR
        yield claim(text, power, f"{least:g} to {most:g}", least <= power <= most, LAW)
        text, bound = f"{name}: what it has grown to after {counts[-1]} steps", MOST * 2.0**-52 * counts[-1] ** 0.5
        yield claim(text, float(found[-1]), f"at most {bound:.1e}", found[-1] <= bound, LAW)
    if figures:
        draw(curves, figures / "brouwer.png")


def draw(curves: dict[str, tuple[np.ndarray, np.ndarray]], target: Path) -> None:
    figure = new_figure(7.5, 5.0)
    axes = new_axes(figure, (1, 1, 1))
    for k, (name, (counts, found)) in enumerate(curves.items()):
        style = ("-", (0, (5, 2)), (0, (1, 1)))[k // len(COLOURS)]
        axes.plot(counts, found, color=COLOURS[k % len(COLOURS)], linewidth=1.3, linestyle=style, label=name)
    axes.plot(counts, 2.0**-53 * np.sqrt(counts), color=INK, linewidth=1.0, linestyle=(0, (1, 2)), label="ε √n / 2")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("steps")
    axes.set_ylabel("relative error of the form by rounding, RMS")
    axes.set_title("Brouwer's law: oscillators, ω dt from 0.05 to 0.1", color=INK)
    axes.legend(loc="upper left", fontsize=7, frameon=False, ncols=2)
    save_figure(figure, target)


if __name__ == "__main__":
    main(claims, __doc__)
