"""Other forces than gravity in tangent maps: their slopes, and what masses and parameters do in them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.analysis.tangents.columns import Columns
from kickdrift.forces.gravity.direct import Gravity
from kickdrift.forces.slopes.pushes import PairPush, Push, parameter_of, push_of_parameter, pushes_of_mass
from kickdrift.model.system import System

Pushes = list[tuple[int, Push | PairPush]]


class BoundOthers(NamedTuple):
    """Machine code of the other forces. It must live as long as its addresses are in use."""

    slopes: list[Any]
    pushes: list[Any]
    forces: NDArray[np.int64]  # (other forces, 2) addresses of the slopes of each, and of its parts
    table: NDArray[np.int64]  # (pushes, 3) the column of each, and addresses


def pushes_of(system: System, columns: Columns | None) -> Pushes:
    """What masses and parameters do in the forces other than gravity, each with its column."""
    made: Pushes = []
    if columns is None:
        return made
    of_masses = columns.of_masses(len(system))
    if of_masses is not None:
        for body, column in np.argwhere(of_masses):
            made += [(int(column), push) for push in pushes_of_mass(system, int(body), 0, 1.0)]
    for column, text in enumerate(columns.parameters, sum(columns.widths[:2])):
        if not isinstance(system.forces[parameter_of(system, text)[0]], Gravity):
            made.append((column, push_of_parameter(system, text, 0, 1.0)))
    return made


def bound_others(forces: list[Any], pushes: Pushes, system: System, threads: int) -> BoundOthers:
    """Bind the slopes of these forces, and these pushes."""
    from kickdrift.forces.seam.kernel import BoundForce
    from kickdrift.forces.slopes.dual_slopes import BoundSlopes

    slopes = [BoundSlopes(force.bind(system, threads)).ready() for force in forces]
    bound = [BoundForce(push.bind(system, threads)).ready() for _, push in pushes]
    rows = [(column, each.address, each.work) for (column, _), each in zip(pushes, bound, strict=True)]
    return BoundOthers(
        slopes, bound,
        np.array([(each.address, each.work) for each in slopes], np.int64).reshape(-1, 2),
        np.array(rows, np.int64).reshape(-1, 3),
    )  # fmt: skip
