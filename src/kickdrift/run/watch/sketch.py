"""States inside a step from what is known without f, for a quick test of events.

Methods know their stages or a polynomial. Of particles and of separable Problems, positions follow Hermite's cubic
through the positions and velocities at both ends. All others follow a polynomial through the last ends of steps.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from kickdrift.integrators.stepping.stepper import INNER
from kickdrift.model.state import Floats
from kickdrift.run.watch.zeros import PAST, Rough

State = Sequence[Any]  # time, y, and what else belongs to a step
_S, _LAST = INNER, INNER**2 * (3.0 - 2.0 * INNER)
# Weights (2, INNER, 4) of x0, h v0, x1, h v1 in positions, and of x0 / h, v0, x1 / h, v1 in velocities.
_CUBIC = np.array(
    [
        [1.0 - _LAST, _S * (1.0 - _S) ** 2, _LAST, _S * _S * (_S - 1.0)],
        [-6.0 * _S * (1.0 - _S), (1.0 - _S) * (1.0 - 3.0 * _S), 6.0 * _S * (1.0 - _S), _S * (3.0 * _S - 2.0)],
    ]
).swapaxes(1, 2)


def sketch(stepper: Any, begin: State, end: State, past: Sequence[State]) -> Rough | None:
    """States (INNER, *y.shape) between ``begin`` and ``end`` of a stepper's last step; None where nothing tells.

    ``past`` has the ends of steps up to ``end``."""
    if hasattr(type(stepper), "sketch"):
        return Rough(stepper.sketch())
    if len(begin[1]) == 2:
        return Rough(cubic(begin, end))
    if len(past) < PAST:
        return None
    known = [past[k] for k in range(-PAST, 0)]
    h = end[0] - begin[0]
    inside, foretelling = _through(tuple([round((each[0] - end[0]) / h, 6) for each in known]))
    return Rough((inside @ np.array([each[1].reshape(-1) for each in known])).reshape((-1, *end[1].shape)), foretelling)


@lru_cache(64)
def _through(ends: tuple[float, ...]) -> tuple[Floats, list[float]]:
    """Weights (INNER, ends) of values at ends of steps, where -1 and 0 are the ends of the last step; and weights of
    all but the last value that foretell this one."""
    nodes = np.array(ends)
    return _lagrange(nodes, INNER - 1.0), _lagrange(nodes[:-1], np.zeros(1))[0].tolist()


def _lagrange(nodes: Floats, times: Floats) -> Floats:
    """Weights (times, nodes) of the polynomial through values at the nodes."""
    apart = nodes[:, None] - nodes
    np.fill_diagonal(apart, 1.0)
    off = times[:, None] - nodes
    others = np.array([np.delete(off, i, axis=1).prod(axis=1) for i in range(len(nodes))])
    return (others / apart.prod(axis=1)[:, None]).T


def cubic(begin: State, end: State) -> Floats:
    """States (INNER, 2, …) on Hermite's cubic, with the velocities of that cubic."""
    (t0, y0), (t1, y1) = begin, end
    h = t1 - t0
    found: Floats = (_CUBIC * np.array([[[1.0, h, 1.0, h]], [[1.0 / h, 1.0, 1.0 / h, 1.0]]])) @ np.array(
        [y0[0].reshape(-1), y0[1].reshape(-1), y1[0].reshape(-1), y1[1].reshape(-1)]
    )
    return found.swapaxes(0, 1).reshape((len(INNER), *y0.shape))
