"""Reference for the errors of a comparison, and its own error: a closed form, a tight run, or the energy."""

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil, log
from typing import Any

import numpy as np

from kickdrift.analysis.compare.pilot import OutOfTime, Subject, Track, follow, vector
from kickdrift.errors import RunError
from kickdrift.integrators import integrator
from kickdrift.model.problem import Problem
from kickdrift.model.state import Floats
from kickdrift.model.system import System

EPSILON = float(np.finfo(float).eps)
STIFF = ("bdf", "radau", "rosenbrock", "lsoda", "backward-euler")  # a file with one of these is stiff
STIFF_DECADES = 1e4  # least product of the fastest decay rate and the pilot's length for a stiff problem
# rtol of the reference, and of the run that estimates its error; gauss-radau15's error scales as rtol^(15/7)
TIGHT = {
    "dop853": ((1e-13, 1e-12), (1e-11, 1e-10), (1e-9, 1e-8), (1e-7, 1e-6)),
    "radau": ((1e-11, 1e-10), (1e-9, 1e-8), (1e-7, 1e-6)),  # order 5 is too slow at smaller rtol
    "gauss-radau15": ((1e-12, 1e-11), (1e-10, 1e-9), (1e-8, 1e-7), (1e-5, 1e-4)),
}
MODERATE = {"dop853": 1e-9, "radau": 1e-9, "gauss-radau15": 1e-10}  # for the divergence of neighbouring runs
# Methods of fixed steps, for constraints: the same as parts of the file's step in the place of rtol.
HELD, HELD_LOOSE = "yoshida8", "velocity-verlet"
TIGHT[HELD] = ((0.25, 0.5), (0.5, 1.0), (1.0, 2.0))
MODERATE[HELD] = 1.0
ATOL = 1e-2  # ratio of atol to rtol times the unknowns' size, if the file gives no tolerances
LOST = log(1e12)  # exponent of growth over a run that leaves no digit of double precision
PERTURBATION = 1e-8  # relative change of the start, for the divergence of neighbours
PROBED = 251  # samples of these two runs
NEAR = 1e-3  # largest relative distance of neighbours
EXPONENTIAL = 10.0  # growth of a perturbation from one half of a run to the next; a power law's is 2 or 4
AGREED = 1e-6  # largest own error of a reference for a chaotic problem without an energy

Measure = str  # "closed form", "reference" or "energy"


@dataclass(frozen=True)
class Reference:
    """Reference for the errors of a comparison.

    Attributes
    ----------
    measure : "closed form", "reference" (a run at tight tolerance) or "energy" (its relative error)
    text : the same as text, with the tolerances
    length : length of the pilot, which may be shorter than requested
    y : (S + 1, N) solution at the pilot's samples; None if the energy is measured
    scale : (m,) divisor for differences of the compared unknowns
    error : error of the reference itself; smaller errors are not believed
    lyapunov : rate of divergence of neighbouring solutions, per unit of time; 0 if no faster than a power law
    notes : remarks on the choice, for the user
    """

    measure: Measure
    text: str
    length: float
    y: Floats | None
    scale: Floats
    error: float
    lyapunov: float = 0.0
    notes: tuple[str, ...] = ()

    def error_of(self, track: Track, subject: Subject) -> Floats:
        """Errors (S + 1,) of a run at its samples: root mean square over the compared unknowns, each over its scale; or
        the modulus of the relative energy error."""
        if self.y is None:
            return relative_energy(track)
        return distance(compared(subject, track.y) - compared(subject, self.y), self.scale)


def compared(subject: Subject, y: Floats) -> Floats:
    """Unknowns that are compared: positions if there are velocities, else all; y (…, N)."""
    half = isinstance(subject, System) or subject.separable
    return y[..., : y.shape[-1] // 2] if half else y


def distance(difference: Floats, scale: Floats) -> Floats:
    """Root mean square over the unknowns, each over its scale; nan if a solution is unknown."""
    return np.sqrt(np.mean((difference / scale) ** 2, axis=-1))


def natural_scale(subject: Subject, y: Floats) -> Floats:
    """Scales (m,) of the compared unknowns, from the samples ``y`` (S + 1, N).

    Positions share one length, the largest root mean square distance from their centroid, so errors are relative to the
    size of the system. Each other unknown has its largest modulus."""
    known = compared(subject, y)
    if isinstance(subject, System):
        x = known.reshape(len(known), 3, -1)
        if x.shape[2] > 1:
            x = x - x.mean(axis=2, keepdims=True)
        known = x.reshape(len(known), -1)
    if isinstance(subject, System) or subject.separable:
        size = float(np.sqrt(np.mean(known**2, axis=1)).max())
        return np.full(known.shape[1], size or 1.0)
    largest = np.abs(known).max(axis=0)
    return np.where(largest > 0, largest, 1.0)


def relative_energy(track: Track) -> Floats:
    """|E(t) - E(0)| at the samples (S + 1,), over the scale in a run's report."""
    error = track.energy
    assert error is not None
    scale = {"initial energy": abs(error.initial), "kinetic energy": track.kinetic}.get(error.relative_to, 1.0)
    return np.abs(track.energies - error.initial) / scale


def tolerances(subject: Subject, start: Any, rtol: float, name: str) -> dict[str, Any]:
    """rtol, and an atol if the method takes one: in the file's proportion, else 1e-2 times the unknowns' size."""
    if "atol" not in integrator(name).tunable:
        return {"rtol": rtol}
    given = subject.run.options
    if given.get("rtol") and given.get("atol"):
        return {"rtol": rtol, "atol": float(np.min(rtol * np.asarray(given["atol"]) / given["rtol"]))}
    y = vector(start)
    halves = y.reshape(2, -1) if isinstance(subject, System) or subject.separable else y.reshape(1, -1)
    sizes = [float(np.sqrt(np.mean(half**2))) for half in halves]
    return {"rtol": rtol, "atol": ATOL * rtol * min((size for size in sizes if size > 0), default=1.0)}


def fineness(subject: Subject, start: Any, rtol: float, name: str, length: float, samples: int) -> dict[str, Any]:
    """What makes a run of a reference's method that precise: tolerances, or the steps of a method of fixed steps, whose
    ``rtol`` is a part of the file's step."""
    if name not in (HELD, HELD_LOOSE):
        return tolerances(subject, start, rtol, name)
    dt = rtol * float(subject.run.dt or length)
    return {"steps": samples * max(1, ceil(length / (samples * dt) - 1e-9))}


def is_held(subject: Subject) -> bool:
    """Tell whether constraints or virtual sites leave a System to methods of fixed steps."""
    return bool(getattr(subject, "tied_by", ""))


def is_stiff(subject: Subject, state: Any, length: float) -> bool:
    """Tell whether the file's own integrator is for stiff problems, or a mode decays over 1e4 times within the length,
    by the eigenvalues at that state."""
    if isinstance(subject, System) or len(subject) > 64:
        return False
    if subject.run.integrator in STIFF:
        return True
    from kickdrift.analysis.compare.stiffness import stiffness

    return float(-stiffness(subject, [state])[0].eigenvalues.real.min()) * length > STIFF_DECADES


def loose_method(subject: Subject, stiff: bool) -> str:
    """Method of runs at a loose tolerance, which estimate the least cost of a solution."""
    if is_held(subject):
        return HELD_LOOSE
    return "radau" if stiff else "dop853"


def reference_method(subject: Subject, stiff: bool) -> str:
    """Method of tight runs: gauss-radau15, except for stiff problems, for particles with a force cutoff, which makes
    its high order useless, and for constraints, which it does not keep."""
    if is_held(subject):
        return HELD
    broken = isinstance(subject, System) and any(hasattr(force, "cutoff") for force in subject.forces)
    return loose_method(subject, stiff) if stiff or broken else "gauss-radau15"


def perturbed(start: Any, y: Floats, state_at: Callable[..., Any]) -> Any:
    """Return the start with every unknown changed by about 1e-8 of the unknowns' size, always in the same way."""
    random = np.random.default_rng(1)
    return state_at(start, y + PERTURBATION * np.sqrt(np.mean(y**2)) * random.standard_normal(y.size), start.time)


def lyapunov_rate(subject: Subject, first: Track, second: Track) -> float:
    """Rate at which two runs diverge while they are near (1e-3 of the scale). The rate is 0 if the largest distances in
    the two halves of that time grow no faster than a power law."""
    difference = compared(subject, first.y) - compared(subject, second.y)
    apart = distance(difference, natural_scale(subject, first.y))
    near = int(np.argmax(apart > NEAR)) if (apart > NEAR).any() else len(apart)
    passed = first.times - first.times[0]
    if near == 0:  # the change of the start is not small, so its growth says nothing
        return 0.0
    if near <= 8:  # gone within a few samples
        return log(NEAR / PERTURBATION) / float(passed[near])
    begin, end = apart[1 : near // 2].max(), apart[near // 2 : near].max()
    return 2.0 * log(end / begin) / float(passed[near - 1]) if end > EXPONENTIAL * begin > 0 else 0.0


def reference(
    subject: Subject,
    start: Any,
    length: float,
    whole: float,
    samples: int,
    stiff: bool,
    threads: int,
    limit: float,
    probe: float,
) -> Reference:
    """Choose, by measurement, the reference for errors over ``length``.

    A Problem with a closed form uses that. Otherwise two runs of length ``probe`` from slightly different starts
    measure chaos. If they diverge so fast that no digit would remain over the ``whole`` length, the energy error
    replaces the error of positions. Else the reference is a run at tight tolerance, and another at ten times the
    tolerance gives its error. A chaotic Problem without an energy is compared for as long as these two agree.
    """
    if isinstance(subject, Problem) and subject.exact is not None:
        return _closed_form(subject, start.time, length, samples)
    from kickdrift.analysis.compare.pilot import state_at

    name = reference_method(subject, stiff)
    run: dict[str, Any] = {"threads": threads, "limit": limit}
    rate, has_energy = 0.0, isinstance(subject, System) or (subject.energy is not None and not stiff)
    try:
        moderate = fineness(subject, start, MODERATE[name], name, probe, PROBED)
        off = perturbed(start, vector(start), state_at)
        here = follow(subject, start, name, probe, PROBED, **moderate, **run)
        there = follow(subject, off, name, probe, PROBED, **moderate, **run)
        rate = lyapunov_rate(subject, here, there)
        if has_energy and rate * whole > LOST:
            note = (
                f"chaos: neighbouring solutions diverge as exp({rate:.2g} t), so no run in double precision predicts "
                f"positions after t = {LOST / rate:.3g}; the energy error is compared instead"
            )
            return _energy(length, rate, note)
        return _tight(subject, start, name, length, samples, rate, run)
    except (OutOfTime, RunError) as error:
        if not has_energy:
            raise RunError(f"compare: no reference: {name} at tight tolerance: {error}") from error
        return _energy(length, rate, f"no reference ({name} at tight tolerance: {error}): the energy error is compared")


def _energy(length: float, rate: float, note: str) -> Reference:
    text = "root mean square relative energy error"
    return Reference("energy", text, length, None, np.ones(1), 8 * EPSILON, rate, (note,))


def _closed_form(problem: Problem, begin: float, length: float, samples: int) -> Reference:
    assert problem.exact is not None
    times = begin + length * np.arange(samples + 1) / samples
    y = np.array([np.asarray(problem.exact(t), dtype=float) for t in times])
    later = np.array([np.asarray(problem.exact(t + np.spacing(t - begin)), dtype=float) for t in times])
    scale = natural_scale(problem, y)
    rounding = float(distance(compared(problem, later - y), scale).max()) + 8 * EPSILON
    return Reference("closed form", "closed form", length, y, scale, rounding)


def _tight(
    subject: Subject, start: Any, name: str, length: float, samples: int, rate: float, run: dict[str, Any]
) -> Reference:
    failure: Exception | None = None
    for rtol, looser in TIGHT[name]:
        given, coarser = (fineness(subject, start, each, name, length, samples) for each in (rtol, looser))
        try:
            best = follow(subject, start, name, length, samples, **given, **run)
            other = follow(subject, start, name, length, samples, **coarser, **run)
        except (OutOfTime, RunError) as error:
            failure = error
            continue
        scale = natural_scale(subject, best.y)
        apart = distance(compared(subject, best.y) - compared(subject, other.y), scale)
        said = {"dt": length / given["steps"]} if "steps" in given else given
        text = f"{name} at " + ", ".join(f"{key} = {value:.2g}" for key, value in said.items())
        agreed = int(np.argmax(apart > AGREED)) if (apart > AGREED).any() else samples
        if agreed < max(7, samples // 8):
            raise RunError(f"two runs of {name}, rtol = {rtol:g} and {looser:g}, differ by {apart.max():.2g}")
        if agreed < samples:
            shorter = length * (agreed - 1) / samples
            note = (
                f"two runs at rtol = {rtol:g} and {looser:g} differ by {apart.max():.2g} at t = {length:.4g}: compared "
                f"up to t = {shorter:.4g}, where they agree to {AGREED:g}"
            )
            found = _tight(subject, start, name, shorter, samples, rate, run)
            return Reference("reference", found.text, found.length, found.y, found.scale, found.error, rate, (note,))
        error_of_best = max(float(apart.max()), 8 * EPSILON)
        return Reference("reference", text, length, best.y, scale, error_of_best, rate)
    assert failure is not None
    raise failure
