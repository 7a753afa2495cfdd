"""MEGNO and the largest Lyapunov exponent of a motion, from a run with a deviation, or of many small systems at once.

See `kickdrift.analysis.chaos.report` for the definitions and their sources.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from kickdrift.analysis.chaos.frames import MovingFrame, carrier, checked_seed, frame_of, length_of
from kickdrift.analysis.chaos.report import ChaosReport, report_of
from kickdrift.analysis.tangents.deviations import (
    LARGEST,
    LARGEST_OF_PROBLEM,
    cadence,
    direction,
    first_deviation,
    scale_of,
)
from kickdrift.batch.members import common, members_of, run_lanes
from kickdrift.display.showing import following
from kickdrift.errors import InputError
from kickdrift.forces.gravity.batch import LOOK, measure_in_lanes
from kickdrift.integrators.asked import Integrator, unpacked
from kickdrift.integrators.stepping.batch_loops import Deviations, Members, from_lanes, to_lanes
from kickdrift.jit.cache.notices import compiling_for
from kickdrift.jit.lanes.memory import aligned
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.looks.observers import Energies
from kickdrift.model.checks.limits import MOST_STEPS
from kickdrift.model.problem import Problem
from kickdrift.model.state import Floats
from kickdrift.model.system import System


class Growths(NamedTuple):
    """Growth of each system's deviation over k looks."""

    integrator: str
    steps: int
    dt: Floats  # dt of each system (members,)
    times: Floats  # (members, k) since the start
    growth: Floats  # (members, k) ln of the deviation's length, 0 at the start
    begin: Floats  # (members, 3) kinetic, potential, total energy
    end: Floats  # (members, 3) the same at the end


@np.errstate(all="ignore")  # systems may blow up
def growths(
    systems: Sequence[System],
    lengths: Sequence[float],
    integrator: str | None,
    dt: Any,
    seeds: Sequence[int],
    options: dict[str, Any],
) -> Growths:
    """Run systems with deviations from these seeds for times ``lengths``."""
    name, method, own, steps_of = common(tuple(systems), integrator, dt, options)
    taken = [cadence(length, h) for length, h in zip(lengths, steps_of, strict=True)]
    (steps, every), n = taken[0], len(systems[0])
    for k, (mine, _) in enumerate(taken):
        if mine != steps:
            raise InputError(
                f"system {k}: all systems of a batch need the same steps; it has {mine}, system 0 has {steps}"
            )
    phase = np.array([system.state.phase for system in systems])
    accelerations, begin = _measured_in_lanes(members_of(systems, steps_of, phase))
    scale = scale_of(phase, accelerations)
    drawn = np.array([first_deviation(n, seed) for seed in seeds]) * scale
    members = members_of(systems, steps_of, np.concatenate([phase, drawn], axis=-1))
    stepper = method.in_lanes(members, own)
    counts = np.full(-(-steps // every), every, np.int64)
    counts[-1] = steps - (len(counts) - 1) * every
    watch = Deviations(to_lanes(1.0 / scale[..., 0, 0]), LARGEST)
    looks, exponents = run_lanes(stepper, counts, 0, watch)
    sizes, count = looks[:, 0, : len(systems)], len(systems)
    scaled = np.cumsum(exponents[:, :count], axis=0) - exponents[:, :count]  # before each look
    growth = np.concatenate([np.zeros((1, count)), np.log(sizes) + scaled * math.log(2.0)])
    passed = np.concatenate([[0], np.cumsum(counts)])
    start = from_lanes(members.start, count)[:, None]
    return Growths(
        integrator=name,
        steps=steps,
        dt=steps_of,
        times=(start + passed * steps_of[:, None]) - start,
        growth=np.ascontiguousarray(growth.T),
        begin=begin,
        end=_measured_in_lanes(members._replace(y=stepper.y))[1],
    )


def _measured_in_lanes(members: Members) -> tuple[Floats, Floats]:
    """Accelerations of the bodies (members, 3, n), and kinetic, potential and total energy (members, 3)."""
    blocks, n = len(members.y), members.gm.shape[1]
    a, found = aligned((blocks, *members.y.shape[2:])), aligned((blocks, LOOK, WIDTH))
    for block in range(blocks):
        measure_in_lanes(members.bodies(block), members.y[block], a[block], found[block])
    energies = from_lanes(found, len(members.systems))[:, :2]
    return from_lanes(a, len(members.systems))[..., :n], np.column_stack([energies, energies.sum(axis=1)])


def megno(
    system: System | Problem,
    time: float | str | None = None,
    integrator: str | Integrator | None = None,
    dt: float | str | None = None,
    *,
    seed: int = 0,
    threads: int = 1,
    progress: bool | Callable[[int, int], Any] | None = None,
    **options: Any,
) -> ChaosReport:
    """Run a System or a Problem with a deviation vector, and tell whether the motion is chaotic.

    The deviation obeys the variational equation, d' = J(t, y) d with the Jacobian J of the right-hand side. The same
    method integrates both.

    Parameters
    ----------
    system : gravity, fields, bonds, pair laws and many-body forces have exact slopes. A Problem gives J by its
        ``jacobian`` if that compiles; else central differences along d stand in
    time : length of the run; default the system file's. A regular motion shows after some hundred of its longest
        periods, a chaotic one after some tens of Lyapunov times. A Lyapunov time longer than the run looks regular
    integrator, dt, options : as in a Simulation; default the system file's integrator if it carries variations, else
        dop853. With fixed steps, particles move as without deviations, to the last bit. A Problem takes any method.
        ``wisdom-holman``, ``saba`` and ``trace`` move the deviation by their tangent map
    seed : seed of the first deviation, a random direction in phase space with positions in units of their scatter; of a
        Problem, a random direction of y
    progress : True shows a bar; a function is called as ``progress(done, of)``

    Raises
    ------
    InputError
        For arguments that make no sense.
    RunError
        If the run blows up.
    """
    if not isinstance(system, System | Problem):
        raise InputError(f"megno: takes a System or a Problem, got {type(system).__name__}")
    seed = checked_seed(seed)
    asked, given = unpacked(integrator, {"dt": dt, **options})
    length = length_of(system, time)
    n = len(system)
    first = direction(n, seed) if isinstance(system, Problem) else first_deviation(n, seed)
    frame = frame_of(system, asked, given, threads, first.reshape(-1, 1))
    with compiling_for(frame.sim.integration.purpose), following(progress, "running") as told:
        begin = frame.energy()
        times, growth = _growth(frame, length, LARGEST_OF_PROBLEM if isinstance(system, Problem) else LARGEST, told)
        end = frame.energy()
    phase = frame.sim.integration.y[:, :, :n] if isinstance(system, System) else None
    chosen = None if frame.sim.method.chooses_steps else frame.sim.dt
    name, steps = frame.sim.integrator, frame.steps_done
    return report_of(system, name, chosen, steps, seed, (begin, end), times, growth, phase)


def megnos(
    systems: Sequence[System],
    time: float | Sequence[float] | None = None,
    integrator: str | Integrator | None = None,
    dt: float | Sequence[float] | None = None,
    *,
    seeds: int | Sequence[int] = 0,
    **options: Any,
) -> list[ChaosReport | None]:
    """Run ``megno`` for many small systems with equal numbers of bodies, side by side as in a `kickdrift.batch.Batch`.

    Parameters
    ----------
    systems : Systems that a Batch takes
    time, integrator, dt, seeds, options : as in ``megno``, one for all or one for each; the number of steps must be the
        same for all. Methods: splittings and Runge-Kutta with fixed steps

    Returns
    -------
    The report of ``megno`` for each system, up to round-off. A system that blows up, or whose deviation vanishes,
    gives None; ``megno`` for this system gives the reason. Each report holds three series of up to 10,000 samples.

    Raises
    ------
    InputError
        For arguments that make no sense, with the system's index.
    """
    systems = tuple(systems)
    count = len(systems)
    asked, options = unpacked(integrator, {"dt": dt, **options})
    dt = options.pop("dt", None)
    names = {carrier(system, asked) if isinstance(system, System) else "" for system in systems}
    if len(names) > 1:
        raise InputError(
            f"integrator: a batch needs one integrator for all systems; theirs are {', '.join(sorted(names))}"
        )
    drawn = [checked_seed(seed) for seed in _each("seeds", seeds, count)]
    lengths = [length_of(*pair) for pair in zip(systems, _each("time", time, count), strict=True)]
    found = growths(systems, lengths, min(names, default=asked), dt, drawn, options)
    reports: list[ChaosReport | None] = []
    for k, (system, seed) in enumerate(zip(systems, drawn, strict=True)):
        begin, end, growth = found.begin[k], found.end[k], found.growth[k]
        sound = np.isfinite(growth).all() and np.isfinite([*begin, *end]).all()
        step, times = float(found.dt[k]), found.times[k]
        reports.append(
            report_of(
                system, found.integrator, step, found.steps, seed, (Energies(*begin), Energies(*end)), times, growth
            )
            if sound
            else None
        )
    return reports


def _each(key: str, value: Any, count: int) -> list[Any]:
    """One value for each system."""
    values = [value] * count if value is None or np.ndim(value) == 0 else list(value)
    if len(values) != count:
        raise InputError(f"{key}: expected one or {count}, one for each system, got {len(values)}")
    return values


def _growth(
    frame: MovingFrame, length: float, largest: float, progress: Callable[[int, int], Any] | None
) -> tuple[Floats, Floats]:
    """Run. Return times since the start, and ln of the deviation's length at these times. A deviation that grows or
    falls by ``largest`` is scaled back."""
    start, sim = frame.time, frame.sim
    steps, every = (MOST_STEPS, 1) if sim.method.chooses_steps else cadence(length, sim.dt or length)
    times, growth, scaled, exponent = [0.0], [0.0], 0.0, 0

    def visit(_: Any) -> bool:
        """Record the deviation's length. Return whether the time is over or the deviation needs scaling."""
        nonlocal scaled, exponent
        size = frame.size()
        if not size > 0.0:
            raise InputError("megno: the deviation vanished: these forces lose every trace of the start")
        times.append(frame.time - start)
        growth.append(math.log(size) + scaled)
        exponent = 0 if 1.0 / largest < size < largest else round(math.log2(size))
        scaled += exponent * math.log(2.0)
        if progress and len(times) % 64 == 0:
            progress(int(1000 * min(1.0, times[-1] / length)), 1000)
        return exponent != 0 or over()

    def over() -> bool:
        return frame.steps_done >= steps or (steps == MOST_STEPS and times[-1] >= length)

    while not over():
        frame.advance(steps - frame.steps_done, every=every, visit=visit)
        if exponent:
            frame.scale(2.0**-exponent)  # scaling by a power of two changes no digit
            exponent = 0
    return np.array(times), np.array(growth)
