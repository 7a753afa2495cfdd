"""Transit times of a planet in front of its star, with their derivatives.

The search is in the steps of a method that knows the state inside them, or between the steps of a map.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, fields
from itertools import pairwise
from typing import Any

import numpy as np

from kickdrift.analysis.chaos.frames import carrier
from kickdrift.analysis.derivatives.light import Retarded, arrival
from kickdrift.analysis.derivatives.transition import given_run
from kickdrift.analysis.doubts import doubts_at, warning_lines
from kickdrift.analysis.orbits.observed import speed_of_light, unit_vector
from kickdrift.analysis.tangents.columns import Columns, columns_of, rows_of
from kickdrift.analysis.tangents.map_run import MapRun
from kickdrift.analysis.tangents.mapped import has_map, map_run
from kickdrift.analysis.tangents.varied_run import DEFAULT, VariedRun
from kickdrift.display.showing import Lines, Shown, Table, following
from kickdrift.errors import InputError
from kickdrift.integrators import integrator as method_named
from kickdrift.integrators.asked import Integrator
from kickdrift.model.checks.limits import MOST_STEPS
from kickdrift.model.checks.values import positive
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.model.units.quantities import time_in
from kickdrift.model.units.unit_systems import UnitSystem
from kickdrift.run.simulation import Simulation
from kickdrift.text import measured

TURN = 0.5  # radians that the planet may move between two looks for a transit
WIDEST = 1.0  # radians that it may move in a step of a map
MOST = 60  # attempts to find a time: bisection alone needs some 50
Found = list[tuple[float, Floats, float, float]]  # times, their derivatives (columns,), distances and speeds
MOST_SHOWN = 20  # rows of the table
_COLUMNS = (("time", "time"), ("distance on the sky", "length"), ("speed on the sky", "velocity"))


def angle(a: Floats, b: Floats) -> float:
    """Angle between two vectors."""
    return math.atan2(float(np.linalg.norm(np.cross(a, b))), float(a @ b))


class Search:
    """Search of a run's steps for transits."""

    def __init__(
        self, run: VariedRun, pair: tuple[int, int], sight: Floats, end: float, within: float, light: float, told: Any
    ) -> None:
        self._run, self._pair, self._end, self._within, self._told = run, pair, end, within, told
        self._light, self._seen = light, Retarded(run, pair, sight, light)
        self._sky, self._sight = np.eye(3) - np.outer(sight, sight), sight
        self._found: Found = []
        self._last: tuple[float, Floats] = run.time, self._stepper.y.copy()
        self._begin = run.time

    @property
    def _stepper(self) -> Any:
        return self._run.sim.integration.stepper

    def found(self) -> Found:
        """The transits until the end."""
        self._run.advance(MOST_STEPS, self._visit, 1)
        return self._found

    def _relative(self, y: Floats) -> Floats:
        """Relative position and velocity (2, 3)."""
        one, other = self._pair
        return np.asarray(y[:, :, one] - y[:, :, other])

    def _rate(self, y: Floats) -> float:
        """Half the rate of the squared distance on the sky."""
        x, u = self._relative(y)
        return float(x @ self._sky @ u)

    def _visit(self) -> bool:
        """Look for transits in the last step. Return whether the time is over."""
        stepper, (t0, y0) = self._stepper, self._last
        t1, y1 = stepper.time, stepper.y.copy()
        turned = angle(self._relative(y0)[0], self._relative(y1)[0])
        inside = np.linspace(t0, t1, 1 + max(1, math.ceil(turned / TURN)))
        looks = [(t0, y0), *((float(t), stepper.at(float(t))) for t in inside[1:-1]), (t1, y1)]
        for (begin, before), (end, after) in pairwise(looks):
            if self._rate(before) < 0.0 <= self._rate(after) and self._relative(after)[0] @ self._sight > 0.0:
                t, y, slope = self._refined(begin, end)
                far = math.isinf(self._light)
                self._keep(*(self._found_at(t, y, slope) if far else self._seen.transit(t, y, t1 - t0)))
        self._last = t1, y1
        if self._told:
            self._told(int(1000 * min(1.0, (t1 - self._begin) / (self._end - self._begin))), 1000)
        planet, masses = self._pair[0], self._run.system.state.masses
        return arrival(t1, y1, masses, planet, self._sight, self._light) >= self._end

    def _refined(self, low: float, high: float) -> tuple[float, Floats, float]:
        """The time between two times, the state y there, and the slope of the rate."""
        t = 0.5 * (low + high)
        for _ in range(MOST):
            y = self._stepper.at(t)
            rate, slope = self._rate(y), self._slope(t, y)
            low, high = (t, high) if rate < 0.0 else (low, t)
            step = -rate / slope if slope > 0.0 else math.inf
            after = t + step if low <= t + step <= high else 0.5 * (low + high)
            if abs(after - t) <= 4e-16 * max(abs(t), high - low):
                break
            t = after
        return t, y, slope

    def _slope(self, t: float, y: Floats) -> float:
        flow: Any = self._run.sim.integration.flow
        (x, u), push = self._relative(y), flow.derivative(t, y)[1]
        one, other = self._pair
        return float(u @ self._sky @ u + x @ self._sky @ (push[:, one] - push[:, other]))

    def _found_at(self, t: float, y: Floats, slope: float) -> tuple[float, Floats, float, float]:
        """The transit at a time, if light takes no time."""
        (x, u), (_, slopes) = self._relative(y), self._run.split(y)
        distance, speed = (float(np.linalg.norm(self._sky @ each)) for each in (x, u))
        one, other = self._pair
        dx, du = slopes[:, :, one] - slopes[:, :, other]
        return t, -(u @ self._sky @ dx + x @ self._sky @ du) / slope, distance, speed

    def _keep(self, t: float, rates: Floats, distance: float, speed: float) -> None:
        if t <= self._end and distance <= self._within:
            self._found.append((t, rates, distance, speed))


def found_by_map(
    run: MapRun,
    columns: Columns,
    pair: tuple[int, int],
    sight: Floats,
    end: float,
    within: float,
    light: float,
    told: Any,
) -> Found:
    """The transits of a run by a map. From the step point before a transit, the motion and its derivatives go on by
    gauss-radau15 up to the transit: a map has no states inside its steps."""
    found: Found = []
    sky, begin = np.eye(3) - np.outer(sight, sight), run.time
    phase, slopes = run.now()
    arrives = arrival(run.time, phase, run.system.state.masses, pair[0], sight, light)
    while arrives < end:
        start, before, rates = run.time, phase, slopes
        run.advance(1)
        phase, slopes = run.now()
        arrives = arrival(run.time, phase, run.system.state.masses, pair[0], sight, light)
        (x0, u0), (x1, u1) = (y[:, :, pair[0]] - y[:, :, pair[1]] for y in (before, phase))
        turned = angle(x0, x1)
        if turned > WIDEST:
            raise InputError(
                f"dt: {run.system.body(pair[0])} turns by {turned:.2g} radians in a step of {run.sim.integrator}; "
                f"transits need steps that turn it by at most {WIDEST:g}"
            )
        if x0 @ sky @ u0 < 0.0 <= x1 @ sky @ u1 and x1 @ sight > 0.0:
            onward = VariedRun(run.system.at(before, start), columns, DEFAULT, run.sim.threads, {}, begun=rates)
            until = min(end, arrives + 0.5 * run.dt)
            found += Search(onward, pair, sight, until, within, light, None).found()[:1]
        if told:
            told(int(1000 * min(1.0, (run.time - begin) / (end - begin))), 1000)
    return found


@dataclass(frozen=True, eq=False, repr=False)
class Transits(Shown):
    """Times at which a planet is nearest to its star on the sky, in front of it, and the derivatives of these times.

    Attributes
    ----------
    times : (k,)
    jacobian : (k, 6 b), derivatives with respect to the start of the varied bodies: positions x0, y0, z0, x1 …, then
        velocities, as in a `TransitionMatrix`
    by_masses : (k, n), derivatives with respect to the masses; None if not asked for
    by_parameters : (k, p), derivatives with respect to the parameters; None if not asked for
    by_elements : (k, q), derivatives with respect to the orbital elements; None if not asked for
    distances : (k,) distances on the sky at these times
    speeds : (k,) speeds on the sky at these times
    planet, star : names
    integrator : name of the method
    by_differences : names of the forces whose slopes came from central differences
    units : the system's
    varied : names of the columns of all derivatives, in the order above: "b.x", "b.vx", "b.mass", "j2.radius", "b.e"
    warnings : what is wrong with the trajectory, or doubtful in the forces
    light_time : whether light takes its time, so that the times are those of its arrival
    """

    times: Floats
    jacobian: Floats
    by_masses: Floats | None
    by_parameters: Floats | None
    by_elements: Floats | None
    distances: Floats
    speeds: Floats
    planet: str
    star: str
    integrator: str
    by_differences: tuple[str, ...]
    units: UnitSystem
    varied: tuple[str, ...] = ()
    warnings: list[str] = field(default_factory=list)
    light_time: bool = False

    def __len__(self) -> int:
        return len(self.times)

    def _tables(self) -> list[Table]:
        columns = ["transit", *(_headed(name, self.units.symbol(kind)) for name, kind in _COLUMNS)]
        series = (self.times, self.distances, self.speeds)
        rows = [[str(k), *(f"{value:.13g}" for value in row)] for k, row in enumerate(zip(*series, strict=True))]
        return [(f"transits of {self.planet} in front of {self.star}", columns, rows[:MOST_SHOWN])]

    def _lines(self) -> Lines:
        given = (self.jacobian, self.by_masses, self.by_parameters, self.by_elements)
        count = sum(0 if part is None else part.shape[1] for part in given)
        lines = [("transits", f"{len(self)}, with derivatives by {count} numbers of the start")]
        if self.light_time:
            lines.append(("times", "when light arrives"))
        if len(self) > MOST_SHOWN:
            lines.append(("", f"the first {MOST_SHOWN} are shown"))
        lines.append(("integrator", self.integrator))
        if self.by_differences:
            lines.append(("by differences", ", ".join(self.by_differences)))
        return lines + warning_lines(self.warnings)

    def as_json(self) -> dict[str, Any]:
        """The transits as one JSON object."""
        kept = {each.name: getattr(self, each.name) for each in fields(self) if each.name != "units"}
        plain = {key: value.tolist() if isinstance(value, np.ndarray) else value for key, value in kept.items()}
        return plain | {"units": self.units.name}


def transits(
    system: System | Simulation,
    planet: str | int,
    star: str | int | None = None,
    *,
    until: float | str,
    direction: Sequence[float] = (0.0, 0.0, 1.0),
    within: float | str | None = None,
    light_time: bool = False,
    bodies: Iterable[str | int] | str | int | None = None,
    masses: bool = False,
    parameters: Iterable[str] = (),
    elements: Iterable[str] = (),
    primary: str | int | None = None,
    integrator: str | Integrator | None = None,
    dt: float | str | None = None,
    threads: int = 1,
    progress: bool | Callable[[int, int], Any] | None = None,
    **options: Any,
) -> Transits:
    """Transit times of a planet, with their derivatives with respect to the start.

    A transit is a time of least distance on the sky with the planet in front of the star: x . u = 0 for the relative
    position x and velocity u in the plane of the sky, and x . u grows (Winn 2010, arXiv:1001.2010, section 2.1). The
    true motion is solved for this time by Newton's method. The derivatives follow from the variational equations:
    dt/dp = -(d(x . u)/dp) / (d(x . u)/dt). By default light takes no time.

    Parameters
    ----------
    system : System, or a Simulation, whose current state and method are the defaults
    planet, star : names or numbers; default star the most massive body
    until : last time
    direction : from the system towards the observer; default z
    within : largest distance on the sky that counts; default the sum of both radii if the system has radii, else any
    light_time : whether each body is seen where it was when its light left, and times are those at which this light
        arrives, on a clock that agrees with the system's for light from the barycentre; see ``radial_velocities``
    bodies : bodies whose start varies; default all, and none where there are ``elements``
    masses : whether to differentiate by the masses of all bodies as well
    parameters, elements, primary : parameters of forces, and orbital elements at the start, to differentiate by, as in
        ``transition_matrix``
    integrator, dt, options : a method that knows the state inside its steps; default the system file's if it does, else
        gauss-radau15. ``wisdom-holman``, ``saba`` and ``trace`` serve as well: from the step point before each transit
        the motion goes on by gauss-radau15

    Returns
    -------
    Transits

    Raises
    ------
    InputError
        For arguments that make no sense, for ``light_time`` in units without a speed of light, and if there is no
        transit.
    RunError
        If the run blows up.
    """
    system, asked, given = given_run("transits", system, integrator, {"dt": dt, **options})
    name = _method(system, asked, integrator is None)
    pair = _pair(system, planet, star)
    sight, end = unit_vector("direction", direction), float(time_in(until, system.units, "until"))
    if not (math.isfinite(end) and end > system.state.time):
        raise InputError(f"until: expected a time after the start, {system.state.time:g}, got {until!r}")
    most, light = _within(system, pair, within), speed_of_light(system.units, light_time)
    columns = columns_of(system, bodies, masses, parameters, elements, primary)
    with following(progress, "running") as told:
        chosen, method = given if name == asked else {"dt": dt, **options}, method_named(name)
        if has_map(method):
            mapped = map_run(system, columns, method, threads, chosen)
            found, differ = found_by_map(mapped, columns, pair, sight, end, most, light, told), mapped.by_differences
            phase, reached = mapped.now()[0], mapped.time
        else:
            run = VariedRun(system, columns, name, threads, chosen)
            found, differ = Search(run, pair, sight, end, most, light, told).found(), run.by_differences
            phase, reached = run.split(run.sim.integration.stepper.y)[0], run.sim.integration.stepper.time
        doubts = doubts_at(system, system.at(phase, reached).state)
    who, whom = (system.body(row) for row in pair)
    if not found:
        near = "" if most == math.inf else f" within {most:.6g} on the sky"
        seen = ", ".join(f"{value:g}" for value in direction)
        last = measured(f"{end:.10g}", system.units.symbol("time"))
        raise InputError(
            f"transits: {who} does not pass in front of {whom}{near} until t = {last}, seen from ({seen}); "
            "direction moves the observer"
        )
    times, rates, distances, speeds = (np.array(each) for each in zip(*found, strict=True))
    return Transits(
        times, *columns.split(rates), distances, speeds, who, whom, name, differ, system.units, columns.names(system),
        doubts, bool(light_time),
    )  # fmt: skip


def _headed(name: str, unit: str) -> str:
    return f"{name}, {unit}" if unit else name


def _method(system: System, asked: str | None, by_default: bool) -> str:
    if asked is not None and has_map(method_named(asked)):
        return asked
    name = carrier(system, asked, DEFAULT)
    if method_named(name).chooses_steps:
        return name
    if by_default:
        return DEFAULT
    raise InputError(f"integrator: {name} does not know the state inside its steps; gauss-radau15 and dop853 do")


def _pair(system: System, planet: Any, star: Any) -> tuple[int, int]:
    one = rows_of(system, [planet], "planet")[0]
    other = int(np.argmax(system.state.masses)) if star is None else rows_of(system, [star], "star")[0]
    if one == other:
        raise InputError(f"planet: {system.body(one)} is the star")
    return one, other


def _within(system: System, pair: tuple[int, int], given: Any) -> float:
    if given is not None:
        return positive("within", time_in(given, system.units, "within", "length"))
    return math.inf if system.radii is None else float(system.radii[list(pair)].sum())
