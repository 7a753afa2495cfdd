"""Displacements of particles in a box that changes during the run."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kickdrift.model.box.box import Box
from kickdrift.model.state import Floats


def travelled(positions: Floats, boxes: Sequence[Box]) -> Floats:
    """Positions (f, k, 3) that grow by what the particles move inside their boxes, from the first frame's positions on.

    A barostat scales every position x = w + n L with the box L, where w lies inside the box and n counts the edges. So
    a particle far from the origin moves with each change of the box, and more the further it has come. Its mean squared
    displacement then has no meaning. The scheme here keeps the view from inside the box, the toroidal view (von Bülow,
    Bullerjahn & Hummer 2020, J. Chem. Phys. 153, 021101, doi:10.1063/5.0008316):

    u' = u + (w' - w) + (n' - n) L',

    with the primed values of the next frame. The paper finds n' - n from the nearest image. Files of kickdrift hold n,
    so a particle may move further than half a box between two frames.
    """
    found = np.empty_like(positions)
    found[0] = positions[0]
    inside, crossed = _split(positions[0], boxes[0])
    for k in range(1, len(positions)):
        now, count = _split(positions[k], boxes[k])
        found[k] = found[k - 1] + (now - inside) + boxes[k].cartesian(count - crossed)
        inside, crossed = now, count
    return found


def _split(positions: Floats, box: Box) -> tuple[Floats, Floats]:
    """Positions (k, 3) inside the box, and the whole numbers (k, 3) of edges that lead there; 0 along open axes."""
    inside = box.wrap(positions)
    return inside, np.rint(box.fractional(positions - inside)) * box.periodic_axes
