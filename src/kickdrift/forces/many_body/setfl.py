"""Files of embedded-atom potentials (eam.alloy, eam.fs), read through ASE, as cubic splines.

LAMMPS and ASE join the same table by different cubics. Here the cubics are those of LAMMPS (``pair_eam.cpp``): a
Hermite spline whose slopes are differences over five points, of r times the pair energy. ASE's are twice continuously
differentiable, of the pair energy. Both are of fourth order in the spacing of the table.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.forces.many_body.entries import potential_file
from kickdrift.text import shown

FORMS = (".eam.alloy", ".eam.fs")


class Potential(NamedTuple):
    """Content of a file, as cubics c3 p^3 + c2 p^2 + c1 p + c0 with p from 0 to 1 in each interval."""

    elements: tuple[str, ...]
    cutoff: float
    dr: float
    drho: float
    density: NDArray[np.float64]  # (elements, elements, intervals, 4) at the first element, from the second
    rphi: NDArray[np.float64]  # (elements, elements, intervals, 4) r times the pair energy
    embedding: NDArray[np.float64]  # (elements, intervals, 4)
    digest: str  # SHA-256 of the file


def hermite(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return LAMMPS' cubics (…, n - 1, 4) between values (…, n) at equal spacing, highest power first."""
    f = np.asarray(values, dtype=float)
    slope = np.empty_like(f)
    slope[..., 0], slope[..., -1] = f[..., 1] - f[..., 0], f[..., -1] - f[..., -2]
    slope[..., 1], slope[..., -2] = 0.5 * (f[..., 2] - f[..., 0]), 0.5 * (f[..., -1] - f[..., -3])
    slope[..., 2:-2] = ((f[..., :-4] - f[..., 4:]) + 8.0 * (f[..., 3:-1] - f[..., 1:-3])) / 12.0
    rise, low, high = np.diff(f), slope[..., :-1], slope[..., 1:]
    return np.stack([low + high - 2.0 * rise, 3.0 * rise - 2.0 * low - high, low, f[..., :-1]], axis=-1)


def read_setfl(name: str, file: str) -> Potential:
    """Read a file of an embedded-atom potential. Raises an InputError that begins with ``name`` and names the file."""
    path = Path(file)
    if not path.name.endswith(FORMS):
        raise InputError(f"{name}: file: expected a name that ends in {' or '.join(FORMS)}, got {shown(file)}")
    content = potential_file(name, file)
    try:
        from ase.calculators.eam import EAM
    except ImportError:
        raise InputError(f"{name}: files of potentials are read by ASE: pip install 'kickdrift[ase]'") from None
    try:
        found = EAM(potential=str(path))
    except Exception as error:  # whatever a file of another kind makes ASE raise
        raise InputError(f"{name}: file: {file}: ASE finds no potential in it ({error})") from None
    density = np.asarray(found.density_data, dtype=float)
    count = len(found.elements)
    density = density.swapaxes(0, 1) if density.ndim == 3 else np.broadcast_to(density, (count, *density.shape))
    rphi = np.array(found.rphi_data, dtype=float)
    for a in range(count):
        for b in range(a):
            rphi[a, b] = rphi[b, a]
    tables = (density, rphi, np.asarray(found.embedded_data, dtype=float))
    if min(each.shape[-1] for each in tables) < 5 or not all(np.isfinite(each).all() for each in tables):
        raise InputError(f"{name}: file: {file}: expected tables of five finite numbers or more")
    if not (0 < found.cutoff < np.inf and 0 < found.dr < np.inf and 0 < found.drho < np.inf):
        raise InputError(f"{name}: file: {file}: expected a positive cutoff and positive spacings")
    return Potential(
        tuple(found.elements),
        float(found.cutoff),
        float(found.dr),
        float(found.drho),
        hermite(tables[0]),
        hermite(tables[1]),
        hermite(tables[2]),
        hashlib.sha256(content).hexdigest(),
    )
