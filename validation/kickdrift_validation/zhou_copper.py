"""Copper of Zhou, Johnson and Wadley, written as a file that kickdrift, ASE and LAMMPS read.

    python -m kickdrift_validation.zhou_copper [--smooth] FILE.eam.alloy

X. W. Zhou, R. A. Johnson and H. N. G. Wadley, Phys. Rev. B 69, 144113 (2004), doi:10.1103/PhysRevB.69.144113. The paper
leaves the cutoff to the user. Here it is sqrt(10) / 2 lattice constants, where the pair energy is 1e-6 eV. This is the
fifth shell of neighbours in the perfect crystal, where small strains make the energy jump. With ``--smooth`` density
and pair energy go to zero between the fourth and the fifth shell, and three derivatives with them.
"""

import argparse
import math
from pathlib import Path

import numpy as np

RE, FE, RHO_E, RHO_S = 2.556162, 1.554485, 21.175871, 21.175395
ALPHA, BETA, A, B, KAPPA, LAMBDA = 8.127620, 4.334731, 0.396620, 0.548085, 0.308782, 0.756515
LOW = (-2.170269, -0.263788, 1.088878, -0.817603)  # F_n0 to F_n3
MIDDLE = (-2.19, 0.0, 0.561830, -2.100595)  # F_0 to F_3
F_E, ETA = -2.186568, 0.310490
LATTICE, MASS = math.sqrt(2.0) * RE, 63.546
CUTOFF = math.sqrt(10.0) / 2.0 * LATTICE
TAPER = (5.2, 5.6)  # angstrom; the fourth and fifth shell are at 5.112 and 5.716
HIGHEST = 2.5 * RHO_E  # of the table of densities
POINTS = 2000  # intervals of each table


def decayed(strength: float, rate: float, shift: float, r: np.ndarray) -> np.ndarray:
    """strength exp(-rate (r / re - 1)) / (1 + (r / re - shift)^20)."""
    return np.asarray(strength * np.exp(-rate * (r / RE - 1.0)) / (1.0 + (r / RE - shift) ** 20))


def density(r: np.ndarray) -> np.ndarray:
    """Density at a distance r from an atom."""
    return decayed(FE, BETA, LAMBDA, r)


def pair_energy(r: np.ndarray) -> np.ndarray:
    """Pair energy at a distance r, in eV."""
    return decayed(A, ALPHA, KAPPA, r) - decayed(B, BETA, LAMBDA, r)


def embedding(rho: np.ndarray) -> np.ndarray:
    """Embedding energy at a density, in eV."""
    rho = np.asarray(rho, dtype=float)
    low, middle = rho / (0.85 * RHO_E) - 1.0, rho / RHO_E - 1.0
    ratio = np.maximum(rho / RHO_S, 1e-300) ** ETA
    high = F_E * (1.0 - np.log(ratio)) * ratio
    return np.where(
        rho < 0.85 * RHO_E,
        np.polyval(LOW[::-1], low),
        np.where(rho < 1.15 * RHO_E, np.polyval(MIDDLE[::-1], middle), high),
    )


def taper(r: np.ndarray) -> np.ndarray:
    """Factor that falls from 1 to 0 over the range of ``TAPER``, with three continuous derivatives."""
    u = np.clip((r - TAPER[0]) / (TAPER[1] - TAPER[0]), 0.0, 1.0)
    return np.asarray(1.0 - u**4 * (35.0 - u * (84.0 - u * (70.0 - 20.0 * u))))


def setfl(points: int = POINTS, smooth: bool = False) -> str:
    """Text of an ``.eam.alloy`` file with this number of intervals in each table."""
    cutoff = TAPER[1] if smooth else CUTOFF
    dr, drho = cutoff / points, HIGHEST / points
    r, rho = np.arange(points + 1) * dr, np.arange(points + 1) * drho
    factor = taper(r) if smooth else 1.0
    end = f", with a smooth end from {TAPER[0]} to {TAPER[1]} angstrom" if smooth else ""
    head = [
        "Copper of Zhou, Johnson & Wadley 2004, Phys. Rev. B 69, 144113, doi:10.1103/PhysRevB.69.144113",
        f"Tables of the published formulas{end}, written by kickdrift_validation.zhou_copper",
        "eV and angstroms; public formulas and numbers, without restriction on their use",
        "1 Cu",
        f"{points + 1} {drho!r} {points + 1} {dr!r} {cutoff!r}",
        f"29 {MASS} {LATTICE!r} fcc",
    ]
    tables = (embedding(rho), density(r) * factor, r * pair_energy(r) * factor)
    return "\n".join([*head, *(f"{value:.16e}" for table in tables for value in table), ""])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path)
    parser.add_argument("--smooth", action="store_true", help="an end between two shells of neighbours")
    given = parser.parse_args()
    given.file.write_text(setfl(smooth=given.smooth), encoding="ascii")
