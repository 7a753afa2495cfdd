"""Runge-Kutta rows of the registry: order conditions in exact arithmetic, and SciPy's own numbers.

A method has order p where sum_i b_i Phi_i(t) = 1 / gamma(t) for every rooted tree t of p vertices or fewer (Butcher
1963, doi:10.1017/S1446788700027932); what is left is given in units of eps times the absolute values of the terms, so
that 1 is a rounding. One tree of p + 1 vertices must fail by far, else the order stated is too low.
"""

from collections.abc import Iterator

import numpy as np
from scipy.integrate._ivp import rk

from kickdrift.integrators import INTEGRATORS, integrator
from kickdrift.integrators.own.registration import REGISTERED
from kickdrift_validation.claim import Claim, at_most, claim, largest, main
from kickdrift_validation.rooted_trees import Conditions

ROUNDING, WRONG = 8.0, 1e7
TREES = "rooted trees, exact arithmetic: Butcher 1963"
SCIPY = {"bogacki-shampine23": rk.RK23, "dormand-prince45": rk.RK45, "dop853": rk.DOP853}


def with_tableau() -> list[str]:
    """The methods that are a tableau; Rosenbrock methods have other conditions."""
    return [
        name
        for name, method in INTEGRATORS.items()
        if method.butcher is not None and method.family != "Rosenbrock" and name not in REGISTERED
    ]


def conditions(name: str) -> Iterator[Claim]:
    """Claims on the order conditions of the stated order and of the next one."""
    method = integrator(name)
    assert method.butcher is not None
    a, b = method.butcher
    rows = Conditions(a.tolist())
    left = max(rows.worst(b.tolist(), vertices) for vertices in range(1, method.order + 1))
    text = f"{name}: what is left of the conditions up to order {method.order}, in roundings"
    yield at_most(text, left, ROUNDING, TREES)
    beyond = rows.worst(b.tolist(), method.order + 1)
    text = f"{name}: what is left of those of order {method.order + 1}"
    yield claim(text, beyond, f"over {WRONG:g}", beyond > WRONG, TREES)


def beside_scipy(name: str) -> Claim:
    """The largest difference of an entry of a or b."""
    solver, (a, b) = SCIPY[name], integrator(name).butcher or (np.zeros(0), np.zeros(0))
    rows, columns = solver.A.shape
    off = largest(np.abs(a[:rows, :columns] - solver.A).max(), np.abs(b - solver.B).max())
    return claim(f"{name}: farthest entry from SciPy's", float(off), "at most 1e-14", off <= 1e-14, "scipy.integrate")


def claims(long: bool = False) -> Iterator[Claim]:
    """Claims on every method with a tableau."""
    for name in with_tableau():
        yield from conditions(name)
    for name in SCIPY:
        yield beside_scipy(name)


if __name__ == "__main__":
    main(claims, __doc__)
