"""Stillinger and Weber's potential of silicon and its relatives."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from typing import Any, ClassVar, NamedTuple

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.many_body.base import TabledForce
from kickdrift.model.checks.arguments import checked_arguments

DIGITS = 1e-6  # the rounding of products of numbers in files


class SiliconOf1985(NamedTuple):
    """Stillinger & Weber 1985, doi:10.1103/PhysRevB.31.5262, table I, with epsilon 50 kcal/mol in eV and sigma in
    angstroms. The keys are those of LAMMPS' ``*.sw`` files, in their order."""

    epsilon: float = 2.1683
    sigma: float = 2.0951
    a: float = 1.80
    lambda_: float = 21.0
    gamma: float = 1.20
    cos_theta0: float = -1.0 / 3.0
    A: float = 7.049556277
    B: float = 0.6022245584
    p: float = 4.0
    q: float = 0.0
    tol: float = 0.0


@checked_arguments
@dataclass(frozen=True, repr=False)
class StillingerWeber(TabledForce):
    """Stillinger and Weber's potential: pairs, and triples that prefer an angle; silicon by default.

    U = sum of A epsilon (B (sigma/r)^p - (sigma/r)^q) exp(sigma / (r - a sigma)) over pairs, and of
    lambda epsilon (cos theta - cos_theta0)^2 exp(gamma sigma / (r_ij - a sigma) + gamma sigma / (r_ik - a sigma)) over
    triples with i in the middle. Energies are in eV, lengths in angstroms, units are ``metal``.

    Source: Stillinger & Weber 1985, doi:10.1103/PhysRevB.31.5262.

    Attributes
    ----------
    entries : {"Si-Si-Si": {key: number}} or the name of a file, optional
        Keys epsilon, sigma, a, lambda_, gamma, cos_theta0, A, B, p, q and tol for each triple of species; the first is
        in the middle. Pairs use the entry i-j-j, as in LAMMPS. ``tol`` is read and ignored. Default: silicon.
    file : str, optional
        A file ``*.sw`` in LAMMPS' form; its numbers become the entries.
    elements : {species: name}, optional
        The entries' name of a species that is called otherwise here, such as {"Si": "Si(D)"}.
    """

    entries: Mapping[str, Mapping[str, float]] | str | PathLike[str] | None = None
    file: str | None = None
    elements: Mapping[str, str] | None = None

    name: ClassVar[str] = "stillinger-weber"
    dimensions: ClassVar[dict[str, str]] = {}
    forms: ClassVar[Mapping[str, tuple[str, ...]]] = {".sw": SiliconOf1985._fields}
    default: ClassVar[Mapping[str, Any]] = {"Si-Si-Si": SiliconOf1985()._asdict()}
    default_name: ClassVar[str] = "silicon of Stillinger & Weber 1985, doi:10.1103/PhysRevB.31.5262"

    def __post_init__(self) -> None:
        self._settle()

    @property
    def cutoff(self) -> float:
        """Largest distance of particles that interact, in angstroms."""
        return max(each["a"] * each["sigma"] for each in self.table.values())

    def check_pair(self, where: str, numbers: Mapping[str, float]) -> None:
        """See TabledForce."""
        for key in ("epsilon", "sigma", "a", "lambda_", "gamma", "A", "B", "p", "q"):
            if numbers[key] < 0 or (key in ("sigma", "a") and numbers[key] == 0):
                raise InputError(f"{where}: {key} must not be negative, nor sigma or a zero, got {numbers[key]:g}")

    def law(self, species: tuple[str, ...]) -> Any:
        """See ManyBodyForce."""
        from kickdrift.forces.many_body.stillinger_weber_kernel import StillingerWeberLaw
        from kickdrift.jit.lanes.memory import aligned

        names = self.named(species)
        count = len(names)
        by_pair, by_triple = aligned((count, count, 8)), aligned((count, count, count, 4))
        for (a, i), (b, j) in itertools.product(enumerate(names), repeat=2):
            n = self.entry(i, j, j)
            pair = [n[key] for key in ("epsilon", "sigma", "a", "A", "B", "p", "q")]
            if pair != [self.entry(j, i, i)[key] for key in ("epsilon", "sigma", "a", "A", "B", "p", "q")]:
                raise InputError(f"{self.name}: entries {i}-{j}-{j} and {j}-{i}-{i} give the pair different numbers")
            epsilon, sigma, reach, A, B, p, q = pair
            by_pair[a, b] = (
                reach * sigma, sigma, n["gamma"] * sigma, A * epsilon, B * sigma**p, sigma**q, p, q,
            )  # fmt: skip
            for c, k in enumerate(names):
                m, other = self.entry(i, j, k), self.entry(i, k, j)
                both = np.array([(each["lambda_"] * each["epsilon"], each["cos_theta0"]) for each in (m, other)])
                if not np.allclose(both[0], both[1], DIGITS, DIGITS):
                    raise InputError(
                        f"{self.name}: entries {i}-{j}-{k} and {i}-{k}-{j} differ in lambda_ times epsilon or in "
                        "cos_theta0, so the energy would depend on the order of neighbours"
                    )
                weight, cosine = 0.5 * both.sum(0)
                by_triple[a, b, c] = weight, weight * cosine, weight * cosine**2, weight * (1.0 - cosine) ** 2
        return StillingerWeberLaw(
            by_pair.reshape(-1, 8),
            by_triple.reshape(-1, 4),
            count,
            bool((by_pair[..., 6] == 4.0).all() and (by_pair[..., 7] == 0.0).all()),
            kept=np.zeros((0, 0)),
            moments=np.zeros((0, 0)),
            forces=np.zeros((0, 0)),
        )
