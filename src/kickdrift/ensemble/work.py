"""Work of a worker: members, each run to a row of the table. No member can stop the others."""

import math
import platform
from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from time import perf_counter
from typing import Any

from kickdrift.ensemble.members import Member
from kickdrift.ensemble.recipe import MEGNO, VERSION, Recipe
from kickdrift.ensemble.rows import DONE, FAILED, Row, last_columns, megno_columns, row_of, run_columns
from kickdrift.errors import InputError, KickdriftError
from kickdrift.jit.cache.notices import heard
from kickdrift.model.problem import Problem
from kickdrift.model.system import System
from kickdrift.text import shown

COMPILING = "kickdrift-compiling"  # Dask's topic of what workers compile


def packed(recipe: Recipe) -> bytes:
    """Pack a Recipe for other processes. Dask gets plain bytes, since a worker that cannot load what it receives fails
    silently."""
    import cloudpickle

    try:
        return cloudpickle.dumps((VERSION, recipe))
    except Exception as error:  # whatever a user's function holds
        why = " ".join(str(error).split())
        raise InputError(f"ensemble: the members' code cannot be sent to other processes: {why}") from None


def unpacked(cargo: bytes) -> Recipe:
    """Unpack the Recipe. Raises InputError if another version of kickdrift packed it."""
    import cloudpickle

    version, recipe = cloudpickle.loads(cargo)
    if version != VERSION:
        here = platform.node()
        raise InputError(f"ensemble: the worker on {here} has kickdrift {VERSION}, this process has {version}")
    return recipe


def check(cargo: bytes) -> None:
    """Test whether the Recipe can be unpacked here."""
    unpacked(cargo)


def timed_members(cargo: bytes, members: Sequence[Member]) -> tuple[list[Row], float, int]:
    """Run members by a packed Recipe. Return a row for each, the seconds, and the number of members for one task."""
    began = perf_counter()
    recipe = unpacked(cargo)
    recipe.begin()
    with heard(_tell):
        rows, together = _rows(recipe, members)
    return rows, perf_counter() - began, together


def _tell(purpose: str, kept: bool) -> None:
    """Tell the process of the ensemble what this worker compiles."""
    from distributed import get_worker

    with suppress(ValueError):  # this process is no worker
        get_worker().log_event(COMPILING, [purpose, kept])


def _rows(recipe: Recipe, members: Sequence[Member]) -> tuple[list[Row], int]:
    """Return a row for each member, and the number of members for one task."""
    from kickdrift.ensemble.together import STOPPING, TOGETHER, side_by_side  # loads the compiler
    from kickdrift.forces.external.turns import in_turns

    systems = {member.number: system for member in members if (system := _built(recipe, member)) is not None}
    if recipe.in_turns:
        works = [partial(run_member, recipe, each, systems.get(each.number)) for each in members]
        return in_turns(works), len(works)
    found = side_by_side(recipe, [(member, systems[member.number]) for member in members if member.number in systems])
    rows = [found.get(each.number) or run_member(recipe, each, systems.get(each.number)) for each in members]
    stops = any(getattr(system, "events", ()) for system in systems.values())
    return rows, (STOPPING if stops else TOGETHER) if found else 1


def _built(recipe: Recipe, member: Member) -> System | Problem | None:
    """The member's system; None if it cannot be built, which its single run reports."""
    try:
        return recipe.system(member)
    except Exception:
        return None


def run_member(recipe: Recipe, member: Member, system: System | Problem | None = None) -> Row:
    """Row of a member: its values, its status, and its measured values or, after a failure, its last good state."""
    try:
        system = system or recipe.system(member)
        return row_of(member, DONE, measured=(_megno if recipe.measure == MEGNO else _run)(recipe, member, system))
    except KickdriftError as error:
        return row_of(member, FAILED, str(error)) | last_columns(getattr(error, "state", None), system)
    except Exception as error:  # whatever a user's function raises
        return row_of(member, FAILED, " ".join(f"{type(error).__name__}: {error}".split()))


def _run(recipe: Recipe, member: Member, system: System | Problem) -> Row:
    from kickdrift.run.equilibration import equilibrate_as_told
    from kickdrift.run.simulation import Simulation
    from kickdrift.run.times import length_of

    sim = Simulation(system)
    length_of(sim, system.name)  # or its error, before anything runs
    if isinstance(system, System):
        equilibrate_as_told(sim)
    folder = recipe.trajectories
    suffix = ".h5" if isinstance(system, Problem) else ".h5md"
    report = sim.run(
        **length_of(sim, system.name), output=folder and folder / f"member-{member.number:06d}{suffix}", overwrite=True
    )
    measured = {} if isinstance(recipe.measure, str) else _measured(recipe.measure, sim)
    return run_columns(report, measured, _volume(system))


def _volume(system: System | Problem) -> float:
    """Volume of a system's box, or its area in two dimensions; nan for an open box and a Problem."""
    if not isinstance(system, System):
        return math.nan
    found = system.box.area if system.dimensions == 2 else system.box.volume
    return found if math.isfinite(found) else math.nan


def _measured(measure: Any, sim: Any) -> Row:
    """Result of a user's function on a run, as columns."""
    found = measure(sim)
    if not isinstance(found, dict):
        found = {getattr(measure, "__name__", "measure"): found}
    row = {
        str(key): value.item() if hasattr(value, "item") and not value.ndim else value for key, value in found.items()
    }
    for key, value in row.items():
        if not isinstance(value, int | float | str | None):
            raise InputError(f"measure: expected numbers and texts, got {shown(value)} for {key}")
    return row


def _megno(recipe: Recipe, member: Member, system: System | Problem) -> Row:
    from kickdrift.analysis.chaos.megno import megno

    rtol, atol = (system.run.options.get(key) for key in ("rtol", "atol"))
    return megno_columns(
        megno(system, None, recipe.carrier(member), system.run.dt, seed=member.seed, rtol=rtol, atol=atol)
    )
