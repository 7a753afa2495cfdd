"""Charges: the error of the forces that the user asks, beside the error measured.

A warm crystal, a melt, a dilute electrolyte and a slab of a melt in vacuum, in rectangular and leaning boxes, by the
sum over waves and by a mesh. Errors are relative to the typical force, as the accuracy is. None of these configurations
was used to find the formulas of the errors.
"""

from collections.abc import Iterator

import numpy as np

import kickdrift as kd
from kickdrift.forces.charges.sampled import errors_of
from kickdrift_validation.claim import Claim, claim, main

EXACT = "an exact Ewald sum in NumPy"
LEAN = np.array([[1.0, 0.0, 0.0], [0.3, 1.0, 0.0], [-0.2, 0.25, 1.0]])
SHORT, LONG = (1e-2, 1e-4, 1e-6), (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)


def ions(kind: str, leans: bool) -> kd.System:
    """About 512 ions with charges of 1 and -1, half of each."""
    random, side = np.random.default_rng(11), 8
    sites = np.indices((side,) * 3).reshape(3, -1).T
    charges, shape, fractions = np.where(sites.sum(axis=1) % 2, -1.0, 1.0), np.ones(3), (sites + 0.5) / side
    if kind == "crystal":
        fractions = fractions + random.normal(scale=0.05, size=fractions.shape) / side
    elif kind == "melt":
        fractions = fractions + random.uniform(-0.4, 0.4, fractions.shape) / side
    elif kind == "electrolyte":
        fractions, shape = random.uniform(size=fractions.shape), 2.5 * np.ones(3)
    else:
        fractions = (fractions + random.uniform(-0.4, 0.4, fractions.shape) / side) * (1.0, 1.0, 0.4)
        shape = np.array([1.0, 1.0, 2.5])
    box = side * (LEAN if leans else np.eye(3)) @ np.diag(shape)
    return kd.System(fractions @ box, box=box, charges=charges)


def errors(long: bool) -> Iterator[Claim]:
    for kind in ("crystal", "melt", "electrolyte", "slab"):
        for leans in (False, True):
            system = ions(kind, leans)
            for method in ("ewald", "pme"):
                for accuracy in LONG if long else SHORT:
                    force = kd.Coulomb(method, accuracy=accuracy)
                    found = errors_of(force, system.with_forces(force))
                    assert found.measured is not None
                    ratio = found.measured / accuracy
                    yield claim(
                        f"{kind}, {'leaning' if leans else 'rectangular'} box, {method}: error over {accuracy:g}",
                        ratio, "0.2 to 1", 0.2 <= ratio <= 1.0, EXACT,
                    )  # fmt: skip


def claims(long: bool = False) -> Iterator[Claim]:
    yield from errors(long)


if __name__ == "__main__":
    main(claims, __doc__)
