"""Modified (shadow) Hamiltonian that velocity Verlet conserves: the true one plus even powers of the step."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.problem import Problem
from kickdrift.model.state import Floats
from kickdrift.run.simulation import Simulation

Potential = Sequence[Callable[[Any], Any]]


def pendulum_potential(omega: float = 1.0) -> Potential:
    """V(q) = -omega^2 cos q and its first four derivatives, as in ``odes.pendulum``."""
    w = omega * omega
    return (
        lambda q: -w * np.cos(q),
        lambda q: w * np.sin(q),
        lambda q: w * np.cos(q),
        lambda q: -w * np.sin(q),
        lambda q: -w * np.cos(q),
    )


def modified_hamiltonian(q: Any, p: Any, dt: float, potential: Potential, order: int = 4) -> Any:
    """H + dt^2 H2 + dt^4 H4 of velocity Verlet (kick, drift, kick) for H = p^2 / 2 + V(q), one degree of freedom.

        H2 = p^2 V'' / 12 - V'^2 / 24
        H4 = -p^4 V'''' / 720 + p^2 V' V''' / 120 + p^2 V''^2 / 60 - V'^2 V'' / 240

    The method is exp(dt B / 2) exp(dt A) exp(dt B / 2), with the flows A of p^2 / 2 and B of V. The symmetric formula
    of Baker, Campbell and Hausdorff gives its logarithm as nested commutators, which are Poisson brackets of the two:
    third-degree brackets in dt^2, fifth-degree brackets in dt^4. Since the kinetic energy is quadratic, four terms
    remain in dt^4. The result oscillates by dt^6, while H oscillates by dt^2.

    Parameters
    ----------
    q, p : numbers or arrays, the position and the velocity of a unit mass
    dt : the step
    potential : V and its derivatives, four for ``order`` 4 and two for 2
    order : 0 (H itself), 2 or 4

    Source: Hairer, Lubich & Wanner 2006, IX.3 and III.4, doi:10.1007/3-540-30666-8; Skeel & Hardy 2001,
    doi:10.1137/S1064827599350204.
    """
    if order not in (0, 2, 4):
        raise InputError(f"order of the modified Hamiltonian: expected 0, 2 or 4, got {order!r}")
    if len(potential) < order + 1:
        raise InputError(f"potential: order {order} needs V and {order} derivatives, got {len(potential)} functions")
    v = [derivative(q) for derivative in potential[: order + 1]]
    total = 0.5 * p**2 + v[0]
    if order >= 2:
        total = total + dt**2 * (p**2 * v[2] / 12 - v[1] ** 2 / 24)
    if order >= 4:
        total = total + dt**4 * (
            -(p**4) * v[4] / 720 + p**2 * v[1] * v[3] / 120 + p**2 * v[2] ** 2 / 60 - v[1] ** 2 * v[2] / 240
        )
    return total


@dataclass(frozen=True)
class ShadowRun:
    """H and its modifications along a run of velocity Verlet.

    Attributes
    ----------
    dt : the step
    times : (k,)
    values : by order, 0, 2 and 4: difference from the value at the start, (k,)
    """

    dt: float
    times: Floats
    values: dict[int, Floats]

    def oscillation(self, order: int) -> float:
        """Half the range from the lowest to the highest value."""
        return float(np.ptp(self.values[order])) / 2


def shadow_run(problem: Problem, potential: Potential, dt: float, length: float) -> ShadowRun:
    """Run velocity Verlet on a separable Problem of one degree of freedom. Record H, and H to second and to fourth
    order, at every step."""
    if not (problem.separable and len(problem) == 2):
        raise InputError(
            f"{problem.name}: the modified Hamiltonian needs a separable problem with one degree of freedom"
        )
    seen: list[tuple[float, float, float]] = []
    sim = Simulation(problem, "velocity-verlet", dt=dt, compensated=True)  # plain sums would round by more than dt^6
    sim.run(round(length / dt), every=1, observe=lambda sim: seen.append((sim.time, *sim.state.y)))
    times, q, p = np.array(seen).T
    values = {order: modified_hamiltonian(q, p, dt, potential, order) for order in (0, 2, 4)}
    return ShadowRun(dt, times, {order: value - value[0] for order, value in values.items()})
