"""State-transition matrix: the derivatives of a motion's end with respect to its start."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from kickdrift.analysis.chaos.frames import carrier, length_of
from kickdrift.analysis.doubts import doubts_at
from kickdrift.analysis.tangents.columns import Columns, columns_of
from kickdrift.analysis.tangents.map_run import MapRun
from kickdrift.analysis.tangents.mapped import has_map, map_run, serves
from kickdrift.analysis.tangents.varied_run import DEFAULT, VariedRun
from kickdrift.display.showing import following
from kickdrift.errors import InputError
from kickdrift.forces.fields.shipped import Hill
from kickdrift.integrators import INTEGRATORS
from kickdrift.integrators.asked import Integrator, unpacked
from kickdrift.model.state import Floats, State
from kickdrift.model.system import System
from kickdrift.run.simulation import Simulation


@dataclass(frozen=True, eq=False)
class TransitionMatrix:
    """Derivatives of the state at the end of a run with respect to the state at its start.

    Rows are the n particles' positions x0, y0, z0, x1 … and then their velocities. Columns are positions and velocities
    of the varied bodies, in the same order.

    Attributes
    ----------
    matrix : (6 n, 6 k) for k varied bodies
    by_masses : (6 n, n), derivatives with respect to the masses; None if not asked for
    by_parameters : (6 n, p), derivatives with respect to the parameters; None if not asked for
    by_elements : (6 n, q), derivatives with respect to the orbital elements; None if not asked for
    second : (6 n, c, c), second derivatives by each two of the c columns above, in this order; None if not asked for
    bodies : rows of the varied bodies in the system
    start, end : State
    integrator : name of the method
    steps : number of steps
    by_differences : names of the forces whose slopes came from central differences, with a relative error of some
        1e-10; the slopes of all others are exact
    omega : angular frequency of the frame, 0 without the force ``hill``
    warnings : what is wrong with the trajectory, or doubtful in the forces
    """

    matrix: Floats
    by_masses: Floats | None
    by_parameters: Floats | None
    by_elements: Floats | None
    second: Floats | None
    bodies: tuple[int, ...]
    start: State
    end: State
    integrator: str
    steps: int
    by_differences: tuple[str, ...]
    omega: float = 0.0
    warnings: tuple[str, ...] = ()

    @property
    def symplectic_error(self) -> float | None:
        """The largest element of M^T J M - J, relative to the square of the largest element of M. Here M acts on
        canonical coordinates: positions and velocities times sqrt(m), in units of the start's distances and speeds. In
        Hill's frame the velocities are those of a frame at rest. None unless all bodies vary and have a mass.

        Forces that derive from a potential give zero up to round-off and the error of the method. A symplectic method
        gives round-off alone."""
        masses = self.start.masses
        if len(self.bodies) != len(masses) or not (masses > 0).all():
            return None
        distance, speed = (float(np.linalg.norm(each)) or 1.0 for each in self.start.phase)
        heavy, order = np.repeat(np.sqrt(masses), 3), self._order
        weights = np.concatenate([heavy / distance, heavy / speed])
        half = len(order) // 2
        still = np.eye(2 * half)  # from the frame's velocities to (v_x - omega y, v_y + omega x, v_z)
        x = np.arange(0, half, 3)
        still[half + x, x + 1], still[half + x + 1, x] = -self.omega, self.omega
        m = weights[:, None] * (still @ self.matrix[:, order] @ (2.0 * np.eye(2 * half) - still)) / weights
        j = np.zeros_like(m)
        j[:half, half:], j[half:, :half] = np.eye(half), -np.eye(half)
        return float(np.abs(m.T @ j @ m - j).max() / max(1.0, float(np.abs(m).max()) ** 2))

    @property
    def _order(self) -> Any:
        """Columns in the order of the system's rows."""
        rows = np.argsort(self.bodies)
        own = (3 * rows[:, None] + np.arange(3)).ravel()
        return np.concatenate([own, 3 * len(rows) + own])

    def __str__(self) -> str:
        rows, columns = self.matrix.shape
        words = [f"transition matrix {rows} x {columns} from t = {self.start.time:.6g} to {self.end.time:.6g}"]
        for name, found in (
            ("masses", self.by_masses),
            ("parameters", self.by_parameters),
            ("elements", self.by_elements),
        ):
            if found is not None:
                words.append(f"{found.shape[1]} columns by {name}")
        if self.second is not None:
            words.append("second derivatives {} x {} x {}".format(*self.second.shape))
        words.append(f"{self.integrator}, {self.steps} steps")
        if self.by_differences:
            words.append(f"by central differences: {', '.join(self.by_differences)}")
        words += [f"warning: {line}" for line in self.warnings]
        return "; ".join(words)


def transition_matrix(
    system: System | Simulation,
    time: float | str | None = None,
    integrator: str | Integrator | None = None,
    dt: float | str | None = None,
    *,
    bodies: Iterable[str | int] | str | int | None = None,
    masses: bool = False,
    parameters: Iterable[str] = (),
    elements: Iterable[str] = (),
    primary: str | int | None = None,
    second: bool = False,
    threads: int = 1,
    progress: bool | Callable[[int, int], Any] | None = None,
    **options: Any,
) -> TransitionMatrix:
    """Derivatives of a motion's end with respect to its start, from the variational equations.

    The same method moves particles and deviations, so with fixed steps the matrix is the derivative of the method's own
    map. Gravity, springs, many-body forces, and laws of fields, bodies, bonds and pairs have exact slopes: a formula
    runs on numbers that carry their derivatives (Griewank & Walther 2008, doi:10.1137/1.9780898717761). Other forces
    use central differences, and the result names them.

    Parameters
    ----------
    system : System, or a Simulation, whose current state and method are the defaults
    time : length of the run; default the system file's
    integrator, dt, options : as in a Simulation; default the system file's integrator if it carries variations, else
        gauss-radau15. With fixed steps the run has the nearest whole number of them. ``wisdom-holman`` and ``saba``
        use the tangent map of their Kepler drifts (Mikkola & Innanen 1999, doi:10.1023/A:1008312912468), for gravity
        and forces with exact slopes. So does ``trace``, for forces of velocity too; its switches between encounters and
        Kepler drifts have no derivative
    bodies : names or numbers of the bodies whose start varies; default all, and none where there are ``elements``
    masses : whether to differentiate by the masses of all bodies as well
    parameters : parameters of forces to differentiate by, such as ``"j2.radius"`` or ``"gravity.G"``; one number each.
        Slopes by parameters of pair laws are exact. Others, and those of masses in forces without a neighbour list
        other than gravity, are central differences of order 4 of the force
    elements : orbital elements of bodies at the start, such as ``"b.e"``: ``a`` or ``P``; ``e``, ``inc``, ``Omega``,
        ``omega`` and one of ``M``, ``f``, ``E``; or Pal's ``h``, ``k``, ``ix``, ``iy``, ``lambda`` (Pal 2009,
        doi:10.1111/j.1365-2966.2009.14853.x); and ``mass``. Angles are in degrees, as in system files. The other
        elements of the body's set stay the same, and so do the other bodies
    primary : the body that those with elements orbit; default the body that dominates the system
    second : whether to return second derivatives as well, for gravity alone and without ``parameters``, under every
        method that carries derivatives; c columns take the time of c (c + 1) / 2 more

    Returns
    -------
    TransitionMatrix

    Raises
    ------
    InputError
        For arguments that make no sense, and for a force without variational equations.
    RunError
        If the run blows up.
    """
    system, asked, given = given_run("transition_matrix", system, integrator, {"dt": dt, **options})
    length, columns = length_of(system, time), columns_of(system, bodies, masses, parameters, elements, primary)
    if second and columns.parameters:
        raise InputError("second: goes without parameters; leave one of the two out")
    mapped = _mapped(system, asked, given, columns)
    name = mapped or carrier(system, asked, DEFAULT)
    run: MapRun | VariedRun
    if mapped:
        run = map_run(system, columns, INTEGRATORS[mapped], threads, given, second)
    else:
        run = VariedRun(system, columns, name, threads, given, second)
    with following(progress, "running") as told:
        phase, slopes, end = run.to(length, told)
        reached = system.at(phase, end, run.steps).state
        doubts = tuple(doubts_at(system, reached))
    parts = columns.split(_flat(slopes))
    twice = _flat(run.second()) if second else None
    rate = next((force.omega for force in system.forces if isinstance(force, Hill)), 0.0)
    return TransitionMatrix(
        *parts, twice, columns.bodies, system.state, reached, name, run.steps, run.by_differences, rate,
        doubts,
    )  # fmt: skip


def _mapped(system: System, asked: str | None, given: dict[str, Any], columns: Columns) -> str | None:
    """Name of the method whose tangent map serves: the one asked for, or the system file's own where it can; else
    None."""
    named = INTEGRATORS.get(asked or system.run.integrator or "")
    if named is None or not has_map(named):
        return None
    return named.name if asked or serves(named, system, columns, given) else None


def given_run(
    what: str, system: System | Simulation, integrator: Any, options: dict[str, Any]
) -> tuple[System, str | None, dict[str, Any]]:
    """The System, the name of the integrator if one is asked for, and its options."""
    if not isinstance(system, System | Simulation):
        raise InputError(f"{what}: takes a System or a Simulation, got {type(system).__name__}")
    asked, given = unpacked(integrator, options)
    if isinstance(system, System):
        return system, asked, given
    sim, now = system, system.state
    own = sim.integration.system
    assert isinstance(own, System)
    if asked is None and (sim.method.carries or has_map(sim.method)):
        asked = sim.integrator
        kept = {"dt": sim.dt, **{key: sim.options.get(key) for key in sim.method.tunable}}
        given = kept | {key: value for key, value in given.items() if value is not None}
    return own.at(now.phase, sim.time), asked, given


def _flat(slopes: Floats) -> Floats:
    """Derivatives (2, 3, n, …) with rows in the order of a TransitionMatrix, (6 n, …)."""
    return slopes.swapaxes(1, 2).reshape(-1, *slopes.shape[3:])
