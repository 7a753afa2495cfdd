"""Does `kickdrift certify` pass right forces, and does it find and name planted faults?

The faults are planted in a Lennard-Jones force in NumPy: 32 particles in a periodic box, or 8 in open space. The clean
cases are forces of kickdrift and the NumPy force, with other positions each. The short set has 40 clean cases, the long
set 200.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import cycle, islice
from typing import Any

import numpy as np

import kickdrift as kd
from kickdrift.analysis.certify.certificate import ForceChecks
from kickdrift.errors import KickdriftError
from kickdrift.model.state import Floats
from kickdrift_validation.claim import Claim, claim, main

CUTOFF, START = 1.6, 1.2
EDGE = (32 / 0.8) ** (1 / 3)
STEPS = 500  # of the run at constant energy
SHORT, LONG = 40, 200  # clean cases
FALSE_ALARMS = 0.05


def pair(r2: Floats) -> tuple[Floats, Floats]:
    """Lennard-Jones energy, and force over r, brought to zero from START to CUTOFF by a polynomial of degree 7."""
    r = np.sqrt(r2)
    s6 = r2**-3.0
    e, w = 4 * (s6**2 - s6), 24 * (2 * s6**2 - s6) / r2
    s = np.clip((r - START) / (CUTOFF - START), 0.0, 1.0)
    switch = 1 - s**4 * (35 - 84 * s + 70 * s**2 - 20 * s**3)
    slope = -140 * s**3 * (1 - s) ** 3 / (CUTOFF - START)
    return e * switch, w * switch - e * slope / r


@dataclass
class Force:
    """The NumPy force. A fault replaces one of its parts.

    law : energy and force over r of r^2
    image : separations (n, n, 3) to the nearest images
    change : changes (forces, energy, virial), given positions, separations and the mask of pairs
    """

    law: Callable[[Floats], tuple[Floats, Floats]] = pair
    image: Callable[[Floats, Floats], Floats] = lambda d, edge: d - edge * np.round(d / edge)
    change: Callable[..., tuple[Floats, float, float]] | None = None
    pairs: Callable[[Floats], Floats] | None = None
    open: bool = False

    def __call__(self, x: Floats, v: Floats, t: float, box: Any) -> tuple[Floats, float, float | None]:
        d = x[:, None, :] - x[None, :, :]
        d = d if self.open else self.image(d, np.array(box.lengths))
        r2 = (d**2).sum(axis=2)
        np.fill_diagonal(r2, np.inf)
        near = r2 < CUTOFF**2
        if self.pairs is not None:
            near = near & self.pairs(near)
        e, w = np.zeros(r2.shape), np.zeros(r2.shape)
        e[near], w[near] = self.law(r2[near])
        forces, energy, virial = (
            (w[:, :, None] * d).sum(axis=1),
            e.sum() / 2,
            float((w * np.where(near, r2, 0)).sum() / 2),
        )
        if self.change is not None:
            forces, energy, virial = self.change(forces, float(energy), virial, x, d, near, w)
        return forces, float(energy), None if self.open else float(virial)


def system(force: Callable[..., Any], seed: int, space: bool = False, mixed: bool = False) -> kd.System:
    """The particles of a Python force: a liquid in a box, or a drop."""
    rng = np.random.default_rng(seed)
    n, side = (8, 2) if space else (32, 4)
    spacing = 1.15 if space else EDGE / 4
    x = np.indices((side, side, side)).reshape(3, -1).T[:: 1 if space else 2][:n] * spacing
    if not space:
        corners = np.array([[0, 0, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0]])
        places = np.indices((2, 2, 2)).reshape(3, -1).T[:, None, :]
        x = (EDGE / 2) * (places + corners).reshape(-1, 3)
    v = rng.normal(size=(n, 3))
    v -= v.mean(axis=0)
    masses = np.where(np.arange(n) % 2, 3.0, 1.0) if mixed else np.ones(n)
    return kd.System(
        x + rng.normal(size=(n, 3)) * 0.03, v / np.sqrt(masses)[:, None], masses, None if space else (EDGE,) * 3,
        forces=[kd.PythonForce(force, external=False)], species=["A", "B"] * (n // 2) if mixed else None,
    )  # fmt: skip


def certified(subject: kd.System, seed: int) -> ForceChecks:
    """The page of a system, with a short run."""
    return kd.analysis.force_checks(subject, dt=0.002, steps=STEPS, seed=seed)


def _list_once() -> Force:
    known: list[Floats] = []

    def pairs(near: Floats) -> Floats:
        known[:] = known or [near.copy()]
        return known[0]

    return Force(pairs=pairs)


def _counted() -> Force:
    calls = [0]

    def change(f: Floats, e: float, w: float, *_: Any) -> tuple[Floats, float, float]:
        calls[0] += 1
        return f * (1 + 1e-7 * (calls[0] > 40)), e * (1 + 1e-7 * (calls[0] > 40)), w

    return Force(change=change)


def _single(f: Floats, e: float, w: float, *_: Any) -> tuple[Floats, float, float]:
    return f.astype(np.float32).astype(float), float(np.float32(e)), w


def _one_sided(f: Floats, e: float, w: float, x: Floats, d: Floats, near: Floats, over_r: Floats) -> Any:
    return f - np.concatenate([(over_r[:1, :, None] * d[:1]).sum(axis=1), np.zeros((len(f) - 1, 3))]), e, w


def _turned(f: Floats, e: float, w: float, x: Floats, d: Floats, near: Floats, over_r: Floats) -> Any:
    across = np.cross(d, [0.0, 0.0, 1.0]) * near[:, :, None]
    return f + 1e-3 * across.sum(axis=1), e, w


def _direct(f: Floats, e: float, w: float, x: Floats, d: Floats, near: Floats, over_r: Floats) -> Any:
    counted = near.sum(axis=1)[:, None]
    return f * (1 + 1e-3 * (counted - counted.mean())), e, w


def _place(f: Floats, e: float, w: float, x: Floats, *_: Any) -> Any:
    k = 2 * np.pi / EDGE
    return f + 1e-3 * k * np.sin(k * x), e + 1e-3 * np.cos(k * x).sum(), w + 1e-3 * (x * k * np.sin(k * x)).sum()


def _stretched(d: Floats, edge: Floats) -> Floats:
    return (d - edge * np.round(d / edge)) * np.array([1.0, 1.0, 1.001])


def _marked(f: Floats, e: float, w: float, x: Floats, d: Floats, near: Floats, over_r: Floats) -> Any:
    one = 0.01 * (over_r[0, :, None] * d[0])
    energies = pair(np.where(near[0], (d[0] ** 2).sum(axis=1), 1.0))[0] * near[0]
    f = f.copy()
    f[0] += one.sum(axis=0)
    f -= one
    return f, e + 0.01 * energies.sum(), w + 0.01 * float((one * d[0]).sum())


def _cut(r2: Floats) -> tuple[Floats, Floats]:
    s6 = r2**-3.0
    return 4 * (s6**2 - s6), 24 * (2 * s6**2 - s6) / r2


def _table(r2: Floats) -> tuple[Floats, Floats]:
    """Energies from a table of 200 lines, forces from the formula."""
    grid = np.linspace(0.6, CUTOFF**2, 200)
    return np.interp(r2, grid, pair(grid)[0]), pair(r2)[1]


def _short(r2: Floats) -> tuple[Floats, Floats]:
    """Forces that end before the energy does."""
    e, w = pair(r2)
    return e, np.where(r2 < (0.85 * CUTOFF) ** 2, w, 0.0)


def _scaled(forces: float = 1.0, energy: float = 1.0, virial: float = 1.0) -> Callable[..., Any]:
    return lambda f, e, w, *_: (f * forces, e * energy, w * virial)


def _by_mass(f: Floats, e: float, w: float, *_: Any) -> Any:
    return f * np.where(np.arange(len(f)) % 2, 3.0, 1.0)[:, None] / 2.0, e, w


def _no_axis(f: Floats, e: float, w: float, x: Floats, d: Floats, near: Floats, over_r: Floats) -> Any:
    return f, e, float((over_r[:, :, None] * d**2)[:, :, :2].sum() / 2)


FAULTS: dict[str, tuple[Callable[[], Force], str, dict[str, bool]]] = {
    "a force of the wrong sign": (lambda: Force(change=_scaled(forces=-1.0)), "force = -dE/dx", {}),
    "a force 0.1 % too large": (lambda: Force(change=_scaled(forces=1.001)), "force = -dE/dx", {}),
    "an energy that counts each pair twice": (lambda: Force(change=_scaled(energy=2.0)), "force = -dE/dx", {}),
    "no nearest images": (lambda: Force(image=lambda d, edge: d), "periodic images", {}),
    "nearest images along two axes only": (
        lambda: Force(image=lambda d, edge: d - edge * [1, 1, 0] * np.round(d / edge)),
        "periodic images",
        {},
    ),
    "an edge 1 % too long in the images": (
        lambda: Force(image=lambda d, edge: d - 1.01 * edge * np.round(d / (1.01 * edge))),
        "periodic images",
        {},
    ),
    "a virial of half the size": (lambda: Force(change=_scaled(virial=0.5)), "virial = -dE/dV", {}),
    "a virial of the wrong sign": (lambda: Force(change=_scaled(virial=-1.0)), "virial = -dE/dV", {}),
    "a virial without one axis": (lambda: Force(change=_no_axis), "virial = -dE/dV", {}),
    "an energy that jumps at the cutoff": (lambda: Force(law=_cut), "smoothness", {}),
    "forces that end before the energy does": (lambda: Force(law=_short), "force = -dE/dx", {}),
    "energies from a coarse table": (lambda: Force(law=_table), "force = -dE/dx", {}),
    "a direct force that is no slope of an energy": (lambda: Force(change=_direct), "force = -dE/dx", {}),
    "a force across the pair's line": (lambda: Force(change=_turned, open=True), "sum of torques", {"space": True}),
    "energies and forces in float32": (lambda: Force(change=_single), "digits of the energy", {}),
    "a list of pairs that is never made anew": (_list_once, "exchange of like particles", {}),
    "forces multiplied by the masses": (lambda: Force(change=_by_mass), "force = -dE/dx", {"mixed": True}),
    "an action without its reaction": (lambda: Force(change=_one_sided), "sum of forces", {}),
    "a force that depends on the place": (lambda: Force(change=_place), "translation", {}),
    "a force that depends on the direction": (lambda: Force(image=_stretched), "rotation", {}),
    "one particle of another strength": (lambda: Force(change=_marked), "exchange of like particles", {}),
    "a force that depends on the number of calls": (_counted, "same bits again", {}),
}


def clean(seed: int) -> Iterator[kd.System]:
    """Systems with right forces, of many kinds, with other positions each."""
    rng = np.random.default_rng(seed)
    for k in cycle(range(6)):
        number = int(rng.integers(2**31))
        if k in (0, 1):
            yield system(Force(open=k == 1), number, space=k == 1, mixed=bool(number % 2))
        elif k in (2, 3):
            law = kd.LennardJones(cutoff=CUTOFF, truncation=("switch", "force-shift")[k - 2])
            yield system(Force(), number).remade(forces=[law])
        elif k == 4:
            bodies = system(Force(open=True), number, space=True)
            yield bodies.remade(forces=[kd.Gravity(G=1.0, softening=0.3)])
        else:
            drop = system(Force(open=True), number, space=True)
            springs = kd.Springs([(i, i + 1) for i in range(7)], 50.0, 1.1)
            yield drop.remade(forces=[springs, kd.HarmonicTrap(2.0)])


def claims(long: bool = False) -> Iterator[Claim]:
    """Yield one claim for each fault, and one for the clean cases."""
    for number, (name, (make, test, where)) in enumerate(FAULTS.items()):
        try:
            page = certified(system(make(), 100 + number, **where), number)
            named = [row.test for row in page.failed]
        except KickdriftError as error:
            named = [str(error)]
        yield claim(f"found: {name}", ", ".join(named) or "passed", f"names {test}", test in named, "planted fault")
    count = LONG if long else SHORT
    failed = [
        f"{k}: {', '.join(row.test for row in page.failed)}"
        for k, subject in enumerate(islice(clean(7), count))
        if not (page := certified(subject, k)).passed
    ]
    yield claim(
        f"share of {count} clean cases that fail", len(failed) / count, f"below {FALSE_ALARMS}",
        len(failed) < FALSE_ALARMS * count, "; ".join(failed) or "clean forces",
    )  # fmt: skip


if __name__ == "__main__":
    main(claims, __doc__)
