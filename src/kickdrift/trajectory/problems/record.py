"""A Problem as a run's file keeps it, the file's first bytes, and the Problem back where kickdrift ships its equation.

``docs/file-format.md`` describes the whole file.
"""

import hashlib
import inspect
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import h5py
import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.problem import Partial, Problem
from kickdrift.model.state import Floats
from kickdrift.odes import ODES
from kickdrift.systemfile.schema import checked, ode_table
from kickdrift.text import shown
from kickdrift.trajectory.layout import checkpoints, checksums
from kickdrift.trajectory.layout.checkpoints import Stored
from kickdrift.trajectory.layout.named import about, run_of
from kickdrift.trajectory.layout.names import add_method, add_text, hashed, image, new_counts, new_run, new_samples
from kickdrift.trajectory.layout.problem_header import PROBLEM
from kickdrift.trajectory.layout.record import run_record, to_json

FUNCTIONS = ("f", "energy")  # whose source is compared
NEARBY = 2.0**-10  # relative distance from y0 to the second state where f is compared
ALIKE = 1e-9  # relative difference of f that another processor may make


class ProblemRecord(Protocol):
    """Facts in a run's file about its Problem; see ``ProblemRun``."""

    @property
    def path(self) -> Path: ...

    @property
    def problem_record(self) -> dict[str, Any]: ...

    @property
    def source(self) -> str: ...

    @property
    def y0(self) -> Floats: ...


def record_of(problem: Problem, slopes: Sequence[Floats], events: Sequence[str] = ()) -> dict[str, Any]:
    """All of a Problem but y0 and its source.

    Parameters
    ----------
    slopes : f at the states of `states_to_compare`
    events : the names of the events that the run watches for
    """
    shipped = is_shipped(problem)
    return {
        "name": problem.name,
        "unknowns": len(problem),
        "t0": problem.t0,
        "separable": problem.separable,
        "equation": problem.equation if shipped else "",
        "parameters": problem.parameters if shipped else {},
        "run": run_record(problem.run),
        "invariants": problem.invariants,
        "functions": {key: found for key in FUNCTIONS if (found := _source_hash(getattr(problem, key)))},
        "slopes": [each.tolist() for each in slopes if np.isfinite(each).all()],
        "events": list(events),
    }


def states_to_compare(problem: Problem) -> list[Floats]:
    """The start, and a state near it without zeros: y of shape (n,) at the time t0."""
    return [problem.y0.copy(), problem.y0 * (1.0 + NEARBY) + NEARBY]


def is_shipped(problem: Problem) -> bool:
    """Whether the Problem's f is that of its equation in ``kickdrift.odes``, with the same parameters."""
    if problem.equation not in ODES:
        return False
    try:
        made = ODES[problem.equation](y0=problem.y0.tolist(), t0=problem.t0, **problem.parameters)
    except (InputError, TypeError):  # another y0 or other parameters than that equation takes
        return False
    return made.separable == problem.separable and _same(made.f, problem.f) and _same(made.energy, problem.energy)


def _same(one: Any, other: Any) -> bool:
    """Whether two functions have the same code and the same values around it."""
    if one is None or other is None:
        return one is other
    if getattr(one, "__code__", None) is not getattr(other, "__code__", one):
        return False
    values = [[cell.cell_contents for cell in each.__closure__ or ()] for each in (one, other)]
    return all(np.array_equal(mine, its) for mine, its in zip(*values, strict=True))


def _source_hash(function: Any) -> str:
    """SHA-256 of a function's source; "" where Python has none."""
    try:
        own = function.function if isinstance(function, Partial) else function
        return hashlib.sha256(inspect.getsource(getattr(own, "py_func", own)).encode()).hexdigest()
    except (OSError, TypeError):
        return ""


def problem_of(run: ProblemRecord) -> Problem:
    """The Problem of a run whose equation kickdrift ships; an InputError for any other."""
    record = run.problem_record
    name = record.get("equation", "")
    if not name:
        raise InputError(
            f"{run.path}: its Problem was made in Python, and a file holds no functions; give the Problem: "
            "kd.resume(file, problem=problem)"
        )
    with about(run.path):
        if name not in ODES:
            raise InputError(f"equation {shown(name)} does not ship with this version of kickdrift; give the Problem")
        start = {"problem": name, "y0": run.y0.tolist(), "t0": record["t0"]}
        given = checked(ode_table(ODES[name]), record["parameters"] | start, None, "ode")
        parameters = {key: value for key, value in given if key != "problem"}
        return replace(
            ODES[name](**parameters),
            name=record["name"],
            run=run_of(record.get("run", {})),
            invariants=record.get("invariants", {}),
            source=run.source,
            equation=name,
            parameters={key: value for key, value in parameters.items() if key not in ("y0", "t0")},
        )


def differences(problem: Problem, run: ProblemRecord) -> list[str]:
    """Differences between a Problem and the Problem of a run, apart from f itself."""
    record = run.problem_record
    pairs = {
        "the number of unknowns": (len(problem), len(run.y0)),
        "y0": (problem.y0.tolist(), run.y0.tolist()),
        "t0": (problem.t0, record["t0"]),
        "separable": (problem.separable, record["separable"]),
    }
    return [key for key, (one, other) in pairs.items() if one != other]


def another_f(run: ProblemRecord, slopes: Sequence[Floats]) -> bool:
    """Whether f has other values than when the run began, by its ``slopes`` at `states_to_compare`."""
    here = [each for each in slopes if np.isfinite(each).all()]
    there = [np.array(each) for each in run.problem_record.get("slopes", ())]
    if [each.shape for each in here] != [each.shape for each in there]:
        return True
    pairs = zip(here, there, strict=True)
    return not all(np.abs(one - other).max() <= ALIKE * np.abs(other).max() for one, other in pairs)


def changed_functions(problem: Problem, run: ProblemRecord) -> list[str]:
    """The functions whose source is not what it was when the run began."""
    then = run.problem_record.get("functions", {})
    return [key for key in FUNCTIONS if then.get(key, "") != _source_hash(getattr(problem, key))]


def problem_image(
    problem: Problem,
    record: dict[str, Any],
    *,
    method: dict[str, Any],
    every: int,
    run_id: str,
    plan: Sequence[float] = (),
    start: Stored | None = None,
) -> bytes:
    """The bytes of a file that holds everything but samples; see `kickdrift.trajectory.layout.names.header_image`."""
    with image(run_id) as file:
        own = new_run(file, new_counts(file), run_id=run_id, every=every, compress=False, plan=plan)
        add_method(own, method)
        group = file.create_group(PROBLEM)
        add_text(group, "source", problem.source)
        add_text(group, "record", to_json(record))
        group.create_dataset("y0", data=problem.y0, track_times=False)
        own.attrs["sha256"] = problem_hash(file)
        new_samples(file)
        checksums.new_group(file, 0, 1, ())
        checkpoints.new_table(file, start)
        file.flush()
        return bytes(file.id.get_file_image())


def problem_hash(file: h5py.File) -> str:
    """SHA-256, in hexadecimal digits, of all that a file says but once of its run.

    In this order: the texts of ``problem/record``, ``problem/source``, ``method`` and ``versions`` of ``kickdrift``,
    with a zero byte after each; ``every`` and ``y0``, as little-endian float64.
    """
    own = file["kickdrift"]
    found = hashlib.sha256()
    for name in ("problem/record", "problem/source", "method", "versions"):
        found.update(hashed(own[name].asstr()[()]))
    found.update(hashed(own.attrs["every"]) + hashed(own["problem/y0"][()]))
    return found.hexdigest()
