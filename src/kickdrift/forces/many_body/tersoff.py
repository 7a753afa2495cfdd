"""Tersoff's potential of silicon, carbon and their alloys."""

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

ZBL = ("Z_i", "Z_j", "zbl_cutoff", "zbl_scale")
PAIR_KEYS = ("A", "lambda1", "B", "lambda2", "beta", "n", "R", "D")
MOD = (
    "m", "lambda3", "cos_theta0", "n", "beta", "lambda2", "B", "R", "D", "lambda1", "A", "nu", "c1", "c2", "c3", "c4",
    "c5",
)  # fmt: skip
BOHR, PERMITTIVITY = 0.529, 0.00552635  # angstrom, e^2 / (eV angstrom), as in LAMMPS
TINY = 1e-16  # change of a bond that float64 cannot hold
SHARP = 1e-30  # angstroms in place of D = 0


class SiliconOf1988(NamedTuple):
    """Tersoff 1988, doi:10.1103/PhysRevB.37.6991, table I, the set of silicon with R = 3.0. The keys are those of
    LAMMPS' ``*.tersoff`` files, in their order."""

    m: float = 3.0
    gamma: float = 1.0
    lambda3: float = 1.3258
    c: float = 4.8381
    d: float = 2.0417
    cos_theta0: float = 0.0
    n: float = 22.956
    beta: float = 0.33675
    lambda2: float = 1.3258
    B: float = 95.373
    R: float = 3.0
    D: float = 0.2
    lambda1: float = 3.2394
    A: float = 3264.7


FORMS = {
    ".tersoff": SiliconOf1988._fields, ".tersoff.mod": MOD, ".tersoff.modc": (*MOD, "c0"),
    ".tersoff.zbl": (*SiliconOf1988._fields, *ZBL),
}  # fmt: skip


@checked_arguments
@dataclass(frozen=True, repr=False)
class Tersoff(TabledForce):
    """Tersoff's potential: bonds that weaken with the number and the angles of other bonds; silicon by default.

    U = 1/2 sum of fc(r_ij) (A exp(-lambda1 r_ij) - b_ij B exp(-lambda2 r_ij)) over all i and j, where
    b = (1 + (beta zeta)^n)^(-1 / 2n), zeta = sum over k of fc(r_ik) g(theta) exp((lambda3 (r_ij - r_ik))^m) and
    g = gamma (1 + c^2 / d^2 - c^2 / (d^2 + (cos_theta0 - cos theta)^2)). The cutoff fc falls from 1 at R - D to 0 at
    R + D. Energies are in eV, lengths in angstroms, units are ``metal``.

    Entries with other keys are other forms, those of LAMMPS' styles of the same name. ``tersoff/mod`` has
    b = (1 + (beta zeta)^n)^(-1 / 2 nu), g = c1 + c2 u / (c3 + u) (1 + c4 exp(-c5 u)) with
    u = (cos_theta0 - cos theta)^2, and fc = 1/2 - 9/16 sin x - 1/16 sin 3x with x = pi (r - R) / 2 D. ``tersoff/mod/c``
    adds c0 fc to each pair. ``tersoff/zbl`` multiplies the terms of a pair by
    F = 1 / (1 + exp(-zbl_scale (r - zbl_cutoff))), and adds 1 - F times Ziegler, Biersack & Littmark's repulsion for
    atomic numbers Z_i and Z_j.

    Source: Tersoff 1988, doi:10.1103/PhysRevB.37.6991; several elements: Tersoff 1989, doi:10.1103/PhysRevB.39.5566;
    mod: Kumagai et al. 2007, doi:10.1016/j.commatsci.2006.07.013; zbl: Devanathan et al. 1998,
    doi:10.1016/S0022-3115(97)00304-8.

    Attributes
    ----------
    entries : {"Si-Si-Si": {key: number}} or the name of a file, optional
        Keys m, gamma, lambda3, c, d, cos_theta0, n, beta, lambda2, B, R, D, lambda1 and A for each triple of species,
        or those of another form; the first is in the middle, the second at the end of the bond. Bonds use the entry
        i-j-j, as in LAMMPS.
        Default: silicon of 1988, which later papers call Si(B) or T2.
    file : str, optional
        A file ``*.tersoff``, ``*.tersoff.mod``, ``*.tersoff.modc`` or ``*.tersoff.zbl`` in LAMMPS' form; its numbers
        become the entries.
    elements : {species: name}, optional
        The entries' name of a species that is called otherwise here, such as {"Si": "Si(D)"}.
    """

    entries: Mapping[str, Mapping[str, float]] | str | PathLike[str] | None = None
    file: str | None = None
    elements: Mapping[str, str] | None = None

    name: ClassVar[str] = "tersoff"
    dimensions: ClassVar[dict[str, str]] = {}
    forms: ClassVar[Mapping[str, tuple[str, ...]]] = FORMS
    default: ClassVar[Mapping[str, Any]] = {"Si-Si-Si": SiliconOf1988()._asdict()}
    default_name: ClassVar[str] = "silicon of Tersoff 1988, doi:10.1103/PhysRevB.37.6991, called Si(B) or T2"

    def __post_init__(self) -> None:
        self._settle()

    @property
    def cutoff(self) -> float:
        """Largest distance of particles that interact, in angstroms."""
        return max(each["R"] + each["D"] for each in self.table.values())

    def check_pair(self, where: str, numbers: Mapping[str, float]) -> None:
        """See TabledForce."""
        for key in (*PAIR_KEYS, "c", *ZBL):  # D may be zero: a sharp cutoff
            if numbers.get(key, 0.0) < 0:
                raise InputError(f"{where}: {key} must not be negative, got {numbers[key]:g}")
        for key in ("n", "d", "R", "nu", "c3", "Z_i", "Z_j"):
            if numbers.get(key, 1.0) <= 0:
                raise InputError(f"{where}: {key} must be positive, got {numbers[key]:g}")
        if numbers["D"] >= numbers["R"]:
            raise InputError(f"{where}: D = {numbers['D']:g} must be less than R = {numbers['R']:g}")

    def law(self, species: tuple[str, ...]) -> Any:
        """See ManyBodyForce."""
        from kickdrift.forces.many_body.tersoff_forms_kernel import TersoffModLaw, TersoffZblLaw
        from kickdrift.forces.many_body.tersoff_kernel import TersoffLaw
        from kickdrift.jit.lanes.memory import aligned

        names = self.named(species)
        count, ends = len(names), False
        mod, zbl = self.form in (".tersoff.mod", ".tersoff.modc"), self.form == ".tersoff.zbl"
        by_pair, by_triple = (
            aligned((count, count, 16 if zbl else 12)),
            aligned((count, count, count, 12 if mod else 8)),
        )
        for (a, i), (b, j) in itertools.product(enumerate(names), repeat=2):
            n = self.entry(i, j, j)
            by_pair[a, b, :8] = [n[key] for key in PAIR_KEYS[:-1]] + [n["D"] or SHARP]
            by_pair[a, b, 8] = (2.0 * n.get("nu", n["n"]) * TINY) ** (1.0 / n["n"])
            if mod:
                by_pair[a, b, 9:11] = n["nu"], n.get("c0", 0.0)
            if zbl:
                by_pair[a, b, 12:] = (
                    n["Z_i"] * n["Z_j"] / (4.0 * np.pi * PERMITTIVITY),
                    0.8854 * BOHR / (n["Z_i"] ** 0.23 + n["Z_j"] ** 0.23),
                    n["zbl_cutoff"], n["zbl_scale"],
                )  # fmt: skip
            for c, k in enumerate(names):
                m, own = self.entry(i, j, k), self.entry(i, k, k)
                where = f"{self.name}: {i}-{j}-{k}"
                if m["m"] not in (1.0, 3.0):
                    raise InputError(f"{where}: m must be 1 or 3, got {m['m']:g}")
                if m.get("d", 1.0) <= 0:
                    raise InputError(f"{where}: d must be positive, got {m['d']:g}")
                ends |= (m["R"], m["D"]) != (own["R"], own["D"])
                by_triple[a, b, c, 4:8] = m["lambda3"], m["m"], m["R"], m["D"] or SHARP
                if mod:
                    by_triple[a, b, c, :4] = [m[key] for key in ("c1", "c2", "c3", "c4")]
                    by_triple[a, b, c, 8:10] = m["c5"], m["cos_theta0"]
                else:
                    by_triple[a, b, c, :4] = m["gamma"], m["c"] ** 2, m["d"] ** 2, m["cos_theta0"]
        kind: Any = TersoffModLaw if mod else TersoffZblLaw if zbl else TersoffLaw
        return kind(
            by_pair.reshape(count * count, -1),
            by_triple.reshape(count**3, -1),
            count,
            bool(by_triple[..., 4].any()),
            ends,
            bonds=np.zeros((0, 0)),
            others=np.zeros((0, 0)),
            forces=np.zeros((0, 0)),
        )
