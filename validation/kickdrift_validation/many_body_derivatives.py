"""Derivatives of many-body forces: slopes beside sixty digits, a crystal beside LAMMPS's runs, and its matrix.

Energies of a few atoms in mpmath, written from the papers, and the cubics of LAMMPS' manual through the shipped table
of copper. Their second derivatives are differences in 60 digits. The motion along one deviation in a crystal of
silicon: differences of runs by LAMMPS. Is the matrix of velocity-verlet symplectic? What does a direction cost?
"""

import itertools
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

import kickdrift as kd
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.forces.many_body.stillinger_weber import SiliconOf1985
from kickdrift.forces.many_body.tersoff import SiliconOf1988
from kickdrift.forces.slopes.variations import varied
from kickdrift_validation.claim import Claim, at_most, claim, main, not_run
from kickdrift_validation.example_forces import crystal, example
from kickdrift_validation.pair_derivatives import beside_lammps, cost

DT, STEPS = 0.001, 100
BOUND = 1e-12  # of slopes, relative to the largest


def claims(long: bool = False) -> Iterator[Claim]:
    yield from slopes()
    yield from runs()
    yield from maps()
    yield from costs()


def slopes() -> Iterator[Claim]:
    cases: tuple[tuple[Any, Any, Callable[..., Any]], ...] = (
        ("silicon of Stillinger and Weber", kd.StillingerWeber(), stillinger_weber),
        ("silicon of Tersoff", kd.Tersoff(), tersoff),
        ("copper of the embedded-atom method", example(kd.EmbeddedAtom), embedded_atom),
    )
    bound, reference = f"at most {BOUND:g}", "the papers' energies in mpmath, differences with 60 digits"
    for name, force, energy in cases:
        text = f"slopes of the forces of {name} along a deviation of seven atoms, relative to the largest"
        try:
            import mpmath
        except ImportError:
            yield not_run(text, bound, reference)
            continue
        with mpmath.workdps(60):
            value = difference(mpmath, force, lambda x, energy=energy, mp=mpmath: energy(mp, x))
        yield claim(text, value, bound, value <= BOUND, reference)


def difference(mpmath: Any, force: Any, energy: Callable[[Any], Any]) -> float:
    """Largest difference of a slope, relative to the largest slope."""
    metal = isinstance(force, kd.EmbeddedAtom)
    rng, edge = np.random.default_rng(6), 2.5 if metal else 2.2
    x = edge * np.array([*itertools.product((0, 1), repeat=3)][:7]) + rng.uniform(-0.25, 0.25, (7, 3))
    system = kd.System(x, masses=50.0, forces=[force], units="metal", species=["Cu" if metal else "Si"] * 7)
    along = rng.normal(size=(7, 3))
    made = varied(system, np.array([along.T, np.zeros((3, 7))]))
    measured = BoundForces(made).measure(0.0, made.state.phase)
    assert measured is not None
    found = measured.accelerations[:, 7:] * system.coherent_masses
    h, exact = mpmath.mpf(10) ** -16, np.zeros((3, 7))
    for i, k in itertools.product(range(7), range(3)):
        total = mpmath.mpf(0)
        for one, two in itertools.product((1, -1), repeat=2):
            there = [[mpmath.mpf(x[j, m]) + one * h * mpmath.mpf(along[j, m]) for m in range(3)] for j in range(7)]
            there[i][k] += two * h
            total -= one * two * energy(there)
        exact[k, i] = float(total / (4 * h * h))
    return float(np.abs(found - exact).max() / np.abs(exact).max())


def separations(mpmath: Any, x: Any) -> tuple[Any, Any]:
    """Vectors from each atom to each, and their lengths."""
    d = [[[b - a for a, b in zip(one, two, strict=True)] for two in x] for one in x]
    return d, [[mpmath.sqrt(sum(each**2 for each in vector)) for vector in row] for row in d]


def cosine(d: Any, r: Any, i: int, j: int, k: int) -> Any:
    return sum(a * b for a, b in zip(d[i][j], d[i][k], strict=True)) / (r[i][j] * r[i][k])


def stillinger_weber(mpmath: Any, x: Any) -> Any:
    """Stillinger & Weber 1985, equations 2.1 to 2.5."""
    p, (d, r), total = SiliconOf1985(), separations(mpmath, x), mpmath.mpf(0)
    cut, sigma = mpmath.mpf(p.a) * mpmath.mpf(p.sigma), mpmath.mpf(p.sigma)
    for i in range(len(x)):
        near = [j for j in range(len(x)) if j != i and r[i][j] < cut]
        for j in near:
            pair = p.B * (sigma / r[i][j]) ** 4 - 1
            total += p.A * p.epsilon * pair * mpmath.exp(sigma / (r[i][j] - cut)) / 2
        for j, k in itertools.combinations(near, 2):
            decay = mpmath.exp(p.gamma * sigma / (r[i][j] - cut) + p.gamma * sigma / (r[i][k] - cut))
            total += p.lambda_ * p.epsilon * (cosine(d, r, i, j, k) - mpmath.mpf(p.cos_theta0)) ** 2 * decay
    return total


def tersoff(mpmath: Any, x: Any) -> Any:
    """Tersoff 1988, equations 1 to 9."""
    p, (d, r), total = SiliconOf1988(), separations(mpmath, x), mpmath.mpf(0)

    def smooth(distance: Any) -> Any:
        if distance < p.R - mpmath.mpf(p.D):
            return 1
        return (1 - mpmath.sin(mpmath.pi / 2 * (distance - p.R) / p.D)) / 2

    for i in range(len(x)):
        near = [j for j in range(len(x)) if j != i and r[i][j] < p.R + mpmath.mpf(p.D)]
        for j in near:
            zeta = mpmath.mpf(0)
            for k in near:
                if k != j:
                    away = p.cos_theta0 - cosine(d, r, i, j, k)
                    c2, d2 = mpmath.mpf(p.c) ** 2, mpmath.mpf(p.d) ** 2
                    angle = p.gamma * (1 + c2 / d2 - c2 / (d2 + away**2))
                    zeta += smooth(r[i][k]) * angle * mpmath.exp((p.lambda3 * (r[i][j] - r[i][k])) ** 3)
            order = (1 + (p.beta * zeta) ** p.n) ** (-1 / (2 * mpmath.mpf(p.n)))
            both = p.A * mpmath.exp(-p.lambda1 * r[i][j]) - order * p.B * mpmath.exp(-p.lambda2 * r[i][j])
            total += smooth(r[i][j]) * both / 2
    return total


def embedded_atom(mpmath: Any, x: Any) -> Any:
    """Daw & Baskes 1984, with the tables of the shipped copper."""
    lines = Path(example(kd.EmbeddedAtom).file).read_text().splitlines()
    points, drho, more, dr, cutoff = (float(each) for each in lines[4].split())
    n, m = int(points), int(more)
    numbers = [float(each) for line in lines[6:] for each in line.split()]
    embedding, density, rphi = numbers[:n], numbers[n : n + m], numbers[n + m : n + 2 * m]
    (_, r), total = separations(mpmath, x), mpmath.mpf(0)
    for i in range(len(x)):
        rho = mpmath.mpf(0)
        for j in range(len(x)):
            if j != i and r[i][j] < cutoff:
                rho += joined(mpmath, density, dr, r[i][j])
                total += joined(mpmath, rphi, dr, r[i][j]) / r[i][j] / 2
        total += joined(mpmath, embedding, drho, rho)
    return total


def joined(mpmath: Any, values: list[float], spacing: float, at: Any) -> Any:
    """Hermite's cubic between two points of a table, whose tangents are differences over five points."""
    p = at / mpmath.mpf(spacing)
    k = int(p)
    p -= k
    f, g = mpmath.mpf(values[k]), mpmath.mpf(values[k + 1])

    def tangent(m: int) -> Any:
        a, b, c, e = (mpmath.mpf(values[m + q]) for q in (-2, -1, 1, 2))
        return (a - 8 * b + 8 * c - e) / 12

    return (
        f * (1 + 2 * p) * (1 - p) ** 2 + tangent(k) * p * (1 - p) ** 2
        + g * p**2 * (3 - 2 * p) + tangent(k + 1) * p**2 * (p - 1)
    )  # fmt: skip


def runs() -> Iterator[Claim]:
    text = "a deviation in a crystal of 512 silicon atoms after 100 steps, relative to its largest number"
    yield beside_lammps(text, crystal(kd.StillingerWeber()), DT, 1e-4, (45, -9, 1), "1e-6")


def maps() -> Iterator[Claim]:
    for force in (kd.StillingerWeber(), kd.Tersoff(), example(kd.EmbeddedAtom)):
        system = crystal(force, few=True)
        value = kd.transition_matrix(system, STEPS * DT, "velocity-verlet", DT).symplectic_error
        assert value is not None
        text = f"M^T J M - J of {len(system)} atoms of {force.name} after {STEPS} steps of velocity-verlet, relative"
        yield at_most(text, value, 1e-14, "zero: the map is symplectic")


def costs() -> Iterator[Claim]:
    for force in (kd.StillingerWeber(), kd.Tersoff(), example(kd.EmbeddedAtom)):
        for many in (1, 8):
            value, bound = cost(crystal(force), DT, many, 100, 12), 1.3 if many == 1 else 2.2
            yield claim(
                f"processor time of each of {many} deviations of a crystal of {force.name} over that of a step",
                value, f"at most {bound}", value <= bound, "the run without deviations, in turns in one process",
            )  # fmt: skip


if __name__ == "__main__":
    main(claims, __doc__)
