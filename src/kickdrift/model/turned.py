"""A System in other axes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.state import Floats
from kickdrift.text import shown

VECTORS = ("pole", "spin", "angular_momentum")  # parameters of forces that turn with the bodies
SQUARE = 1e-9  # most that a rotation matrix times its transpose may differ from 1


def rotation_matrix(system: Any, turn: Any) -> Floats:
    """The matrix (3, 3) of a rotation, of an object with ``as_matrix``, or of the word "invariable"."""
    if isinstance(turn, str):
        if turn != "invariable":
            raise InputError(f'rotated: expected a rotation matrix or "invariable", got {shown(turn)}')
        m = system.state.masses
        return invariable_axes(m, *((y - (y @ m / m.sum())[:, None]).T for y in system.state.phase))
    given = turn.as_matrix() if hasattr(turn, "as_matrix") else turn
    try:
        matrix = np.asarray(given, dtype=float)
    except (TypeError, ValueError):
        matrix = np.zeros(0)
    if matrix.shape != (3, 3) or not np.isfinite(matrix).all():
        raise InputError(f"rotated: expected a rotation matrix (3, 3), got {shown(turn)}")
    if np.abs(matrix @ matrix.T - np.eye(3)).max() > SQUARE or np.linalg.det(matrix) < 0.0:
        raise InputError("rotated: this matrix is no rotation: its rows must be right-handed unit vectors")
    return matrix


def turned(system: Any, turn: Any) -> Any:
    """See ``System.rotated``."""
    if system.box.periodic:
        raise InputError("rotated: a periodic box cannot turn; give the System an open box")
    if system.fixed is not None and system.fixed.move:
        raise InputError("rotated: fixed particles that move cannot turn; fix them after the rotation")
    matrix = rotation_matrix(system, turn)
    if system.dimensions == 2 and abs(matrix[2, 2]) < 1.0 - SQUARE:
        raise InputError("rotated: two dimensions turn about z alone")
    forces = [_turned_force(force, matrix) for force in system.forces]
    x, v = (y.T @ matrix.T for y in system.state.phase)
    return system.remade(positions=x, velocities=v, forces=forces)


def _turned_force(force: Any, matrix: Floats) -> Any:
    if getattr(force, "external", False) and not (hasattr(force, "G") or hasattr(force, "central")):
        raise InputError(f"rotated: force {force.name!r} acts from outside and cannot turn; add it after the rotation")
    if getattr(force, "longitude", None) is not None:
        raise InputError(f"rotated: force {force.name!r} has longitude and latitude; give its pole as a vector")
    vectors = {key: getattr(force, key) for key in VECTORS if getattr(force, key, None) is not None}
    return replace(force, **{key: _turned(value, matrix) for key, value in vectors.items()}) if vectors else force


def _turned(value: Any, matrix: Floats) -> Any:
    """A vector, a row of vectors, or vectors by name, turned."""
    if isinstance(value, Mapping):
        return {key: _turned(each, matrix) for key, each in value.items()}
    found = np.asarray(value, dtype=float) @ matrix.T
    return tuple(map(tuple, found.tolist())) if found.ndim == 2 else tuple(found.tolist())


FLAT = 1e-10  # part of the sum of the bodies' own angular momenta: a smaller total has no direction


def invariable_axes(masses: Floats, x: Floats, v: Floats) -> Floats:
    """Axes of the invariable plane as rows, (3, 3), from positions and velocities (n, 3) relative to the barycentre.

    The third is along the total angular momentum, the first as near to x as possible. Without rotation, the axes are
    the file's own. A body that is gone has nan."""
    own = masses[:, None] * np.nan_to_num(np.cross(x, v))
    total = own.sum(axis=0)
    size = float(np.linalg.norm(total))
    if size <= FLAT * float(np.linalg.norm(own, axis=1).sum()):
        return np.eye(3)
    up = total / size
    near = np.eye(3)[0 if abs(up[0]) < 0.9 else 1]
    first = near - (near @ up) * up
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(up, first), up])
