"""Members that are small systems under gravity advance side by side, several in one register: see `kickdrift.batch`.
The choice depends on the member alone, so its bits do too."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from kickdrift.analysis.chaos.frames import carrier, length_of
from kickdrift.analysis.chaos.megno import megnos
from kickdrift.analysis.tangents.deviations import cadence
from kickdrift.batch.batch import Batch
from kickdrift.batch.members import refusal
from kickdrift.ensemble.members import Member
from kickdrift.ensemble.recipe import MEGNO, Recipe
from kickdrift.ensemble.rows import DONE, Row, megno_columns, row_of, run_columns
from kickdrift.errors import KickdriftError
from kickdrift.integrators import integrator
from kickdrift.integrators.asked import settled
from kickdrift.integrators.options import Options
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.model.checks.limits import steps_in
from kickdrift.model.problem import Problem
from kickdrift.model.system import System

TOGETHER = WIDTH  # members, or a multiple of this
STOPPING = 8 * WIDTH  # the same of members that events stop at different times: others take their lanes
NEAR = 1e-6  # allowed distance of a time from the grid of steps, in steps


class Kind(NamedTuple):
    """Properties shared by members that advance together."""

    integrator: str
    bodies: int
    steps: int
    every: int | None
    options: Options


def side_by_side(recipe: Recipe, members: Iterable[tuple[Member, System | Problem]]) -> dict[int, Row]:
    """Rows, by number, of those members that can advance together and end without a blow-up."""
    groups: dict[Kind, list[tuple[Member, System]]] = {}
    for member, system in members:
        kind = _kind(recipe, member, system)
        if kind and isinstance(system, System):
            groups.setdefault(kind, []).append((member, system))
    rows: dict[int, Row] = {}
    for kind, group in groups.items():
        try:
            columns = (_megno if recipe.measure == MEGNO else _run)(kind, group)
        except KickdriftError:  # a shared problem, such as too few steps: each member reports it alone
            continue
        rows |= {
            member.number: row_of(member, DONE, measured=found)
            for (member, _), found in zip(group, columns, strict=True)
            if found is not None
        }
    return rows


def _kind(recipe: Recipe, member: Member, system: System | Problem) -> Kind | None:
    """Kind of a member; None if it has to run alone, and reports its own error."""
    if callable(recipe.measure) or recipe.trajectories is not None:
        return None
    if not isinstance(system, System) or system.equilibration is not None or system.run.dt is None:
        return None
    try:
        chaos = recipe.measure == MEGNO
        name = carrier(system, recipe.carrier(member)) if chaos else system.run.integrator or "velocity-verlet"
        method = integrator(name)
        options = settled(method, {}, system.run, system.units)
        steps = _megno_steps(system) if chaos else _steps(system)
    except KickdriftError:
        return None
    if steps is None or refusal(system, method, options) or (chaos and not method.carries):
        return None
    return Kind(name, len(system), steps, system.run.every, options.changed(dt=None))


def _steps(system: System) -> int | None:
    """Number of steps that the system asks for; None if its time is not on their grid."""
    run = system.run
    if run.steps is not None and run.time is not None:
        return None
    if run.time is None or run.dt is None:
        return run.steps
    exact = steps_in("time", run.time, run.dt)
    steps = round(exact)
    return steps if abs(exact - steps) <= NEAR else None


def _megno_steps(system: System) -> int:
    assert system.run.dt is not None
    return cadence(length_of(system, None), system.run.dt)[0]


def _run(kind: Kind, group: Sequence[tuple[Member, System]]) -> list[Row | None]:
    batch = Batch([system for _, system in group], kind.integrator)
    batch.run(kind.steps)
    return [run_columns(report) if report else None for report in batch.reports()]


def _megno(kind: Kind, group: Sequence[tuple[Member, System]]) -> list[Row | None]:
    seeds, dts = [member.seed for member, _ in group], [system.run.dt or 0.0 for _, system in group]
    found = megnos([system for _, system in group], None, kind.integrator, dts, seeds=seeds)
    return [megno_columns(report) if report else None for report in found]
