"""Comparison of integrators on a user's own system: which method, and which step?"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from numpy.typing import ArrayLike

from kickdrift.analysis.compare import work_precision as work
from kickdrift.analysis.compare.comparison import Comparison
from kickdrift.analysis.compare.recommendation import recommendation
from kickdrift.analysis.compare.sampling import SamplingComparison, compare_sampling
from kickdrift.analysis.compare.work_precision import chosen_methods, have_baths
from kickdrift.display.showing import Bar, progress_bar
from kickdrift.errors import InputError
from kickdrift.integrators.asked import Integrator, in_units, known_options
from kickdrift.integrators.options import DT
from kickdrift.model.problem import Problem
from kickdrift.model.stages import refuse_stages
from kickdrift.model.system import System
from kickdrift.model.units.quantities import time_in
from kickdrift.systemfile.python_file import problem_of, refuse_beside
from kickdrift.systemfile.reading import load
from kickdrift.text import shown


def compare(
    subject: System | Problem | str | os.PathLike[str] | Callable[..., Any],
    integrators: str | Integrator | Sequence[str | Integrator] | None = None,
    *,
    time: float | str | None = None,
    accuracy: float | None = None,
    length: float | str | None = None,
    seed: int | None = None,
    threads: int = 1,
    progress: bool | Callable[[int, int], Any] | None = None,
    y0: ArrayLike | None = None,
    t_span: Sequence[float] | None = None,
    args: Sequence[Any] | None = None,
    jacobian: Callable[..., Any] | None = None,
    energy: Callable[..., Any] | None = None,
    exact: Callable[[float], Any] | None = None,
    **options: Any,
) -> Comparison | SamplingComparison:
    """Measure work against precision: the error and the cost of each integrator over steps or tolerances.

    Takes about a minute, as ``kickdrift compare`` does. Errors are against a closed form or a reference run with more
    correct digits; in chaos the energy error takes their place.

    Methods with a heat bath have no exact path. Their errors are those of the mean energies and of the pressure: means
    at a step less means at a step of zero, from paths at dt and dt/2 on the same noise. The first of four steps is
    ``dt``, or four times that of the file.

    Parameters
    ----------
    subject : System, Problem, a system file or a shipped system's name, or a function f(t, y), given with ``y0``
    integrators : names, or values of ``kickdrift.integrator``; default a choice that suits the subject
    time : length of the pilot runs, a number or a text such as "5 ps"; default about a minute's worth
    accuracy : wanted relative error, or with heat baths the wanted error of a particle's mean potential energy over k_B
        T; the result then has a ``recommendation`` of a method and a step
    length : length of the planned run; default the subject's
    seed : seed of random velocities of a system file
    threads : number of threads; they do not change the results but the seconds
    progress : True shows a bar; a function is called as ``progress(done, of)``
    y0, t_span, args, jacobian, energy, exact : beside a function: values at the start; the times of start and end; and
        as a `Problem` takes them
    options : options for the methods that take them, such as ``corrector=17``

    Returns
    -------
    Comparison, or SamplingComparison for methods with a heat bath
        With ``rows``, ``slopes``, ``recommendation``, ``plot()`` and ``as_json()``; ``print`` shows the tables.

    Raises
    ------
    InputError
        For arguments that make no sense, and methods that cannot run the subject.
    RunError
        For a subject with neither a reference nor an energy.
    """
    function = {"y0": y0, "t_span": t_span, "args": args, "jacobian": jacobian, "energy": energy, "exact": exact}
    found, asked = _subject(subject, seed, {key: value for key, value in function.items() if value is not None})
    if not (progress is None or isinstance(progress, bool) or callable(progress)):
        raise InputError(f"compare: progress must be True, False or a function, got {shown(progress)}")
    names = [integrators] if isinstance(integrators, str | Integrator) else integrators
    with progress_bar(quiet=progress is not True) as bar:
        label: Callable[[str], Bar] = bar
        if callable(progress) and not isinstance(progress, bool):
            told = progress
            label = lambda text: told  # noqa: E731
        return compared(found, names, label, time, accuracy, length, threads, options, asked)


def compared(
    subject: System | Problem,
    integrators: Sequence[str | Integrator] | None,
    bar: Callable[[str], Bar],
    time: float | str | None,
    accuracy: float | None,
    length: float | str | None,
    threads: int,
    options: dict[str, Any],
    asked: str = "",
    begin: Callable[[], None] = lambda: None,
) -> Comparison | SamplingComparison:
    """The Comparison of a System or Problem, with a recommendation for an ``accuracy``.

    ``begin`` is called after the arguments are checked, ``bar`` as ``bar(label)``; ``asked`` names the subject."""
    refuse_stages("compare", subject)
    units = subject.units if isinstance(subject, System) else None
    pilot: float | None = time_in(time, units, "time")
    whole: float | None = time_in(length, units, "length")
    options = in_units(options, [DT, *known_options().values()], units)
    work.check_arguments(pilot, whole, accuracy, threads)
    if isinstance(subject, System):
        if subject.events and not subject.forces:
            raise InputError(f"compare: {subject.name!r} moves by its hits alone, and a comparison follows no events")
        subject = subject.watched(())  # every method and step is compared with one reference trajectory
    if isinstance(subject, System) and have_baths(integrators):
        longest = options.pop(DT.name, None)
        methods = chosen_methods(subject, integrators, options)
        return compare_sampling(subject, methods, bar, pilot, accuracy, whole, threads, longest, begin, asked)
    chosen_methods(subject, integrators, options)
    work.check_reference(subject)
    begin()
    start = work.equilibrated(subject, threads, bar)
    found = work.work_precision(
        subject, integrators, pilot, whole=whole, accuracy=accuracy, start=start, threads=threads, options=options,
        progress=bar("comparing"),
    )  # fmt: skip
    advice = recommendation(found, accuracy) if accuracy is not None else None
    return replace(found, recommendation=advice, asked=asked)


def _subject(subject: Any, seed: int | None, function: dict[str, Any]) -> tuple[System | Problem, str]:
    """The System or Problem, and what the command line calls it."""
    if callable(subject) and not isinstance(subject, System | Problem | type):
        if seed is not None:
            raise InputError("seed: a function draws no velocities")
        return problem_of(subject, function.pop("y0", None), **function), ""
    refuse_beside(function, subject)
    if isinstance(subject, str | os.PathLike):
        return load(subject, seed), os.fspath(subject)
    if not isinstance(subject, System | Problem):
        raise InputError(f"compare: takes a System, a Problem, a system's name or a function, got {shown(subject)}")
    if seed is not None:
        raise InputError("seed: only a system file draws velocities here; this System has its own")
    return subject, ""
