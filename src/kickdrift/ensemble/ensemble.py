"""Ensemble: one system, run many times with varied values."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import nullcontext
from datetime import UTC, datetime
from importlib.util import find_spec
from typing import Any

import numpy as np

from kickdrift.display.showing import above, members_bar
from kickdrift.ensemble import running
from kickdrift.ensemble import table as tables
from kickdrift.ensemble.members import Members, members_of, path_of
from kickdrift.ensemble.recipe import INTEGRATOR, MEGNO, RUN, VERSION, Measure, Recipe, SystemMaker, SystemText, seeded
from kickdrift.ensemble.rows import COLUMNS, DONE, MEMBER, DataFrame, Row
from kickdrift.errors import InputError
from kickdrift.integrators import INTEGRATORS
from kickdrift.integrators import integrator as method_named
from kickdrift.integrators.asked import from_text, known_options, meant, takers_text, unpacked
from kickdrift.integrators.method import Method
from kickdrift.integrators.options import PRECISION, SEED
from kickdrift.integrators.own.registration import REGISTERED
from kickdrift.jit.compile import processor
from kickdrift.model.checks.limits import PROCESS_BYTES, check_room, whole_number
from kickdrift.model.problem import Problem
from kickdrift.model.stages import refuse_stages
from kickdrift.model.system import System
from kickdrift.run.plan.plan import check_run
from kickdrift.run.simulation import default_method
from kickdrift.systemfile.files import find, parsed
from kickdrift.systemfile.schema_run import run_keys
from kickdrift.text import choices, suggestion
from kickdrift.trajectory.layout.names import versions

Progress = Callable[[int, int, int], Any]


class Ensemble:
    """Many runs of one system, which differ by varied values and by their seeds.

    Parameters
    ----------
    system : a system file's path or name; or a System; or a function that makes a System from the varied values, and
        from ``seed`` if it has this parameter
    vary : for each key the values on a grid, or a random distribution for the members. All combinations of the grids
        are run. Keys are keys of the system file, such as ``"particles.elements[1].a"`` (entries by number from 0, or
        by name: ``"particles.elements[Saturn].a"``), and ``dt``, ``integrator`` and the other keys of its ``[run]``; or
        parameters of the function. Values are numbers in the system's units or texts with units, in a list or an array;
        integrators may be values that ``kickdrift.integrator`` makes;
        or a text: ``"5:6:64"`` for 64 values from 5 to 6 (``"log:…"`` evenly in the logarithm), ``"uniform:5:6"``,
        ``"normal:5.2:0.1"`` (mean and standard deviation), ``"log-uniform:1e-6:1e-3"``
    replicas : members of each combination, each with its own seed
    seed : root of all seeds. Member i has the same bits whatever the number of workers, their order, or the number
        of replicas
    measure : "run", the run's own report; "megno", whether the motion is chaotic; or a function of the Simulation
        after its run, which returns a number, or a dict of numbers and texts by name
    settings : integrator (a name, or a value that ``kickdrift.integrator`` makes), dt, steps, time and other keys of
        ``[run]``, for all members

    Raises
    ------
    InputError
        For an invalid argument.
    """

    def __init__(
        self,
        system: str | os.PathLike[str] | System | Problem | Callable[..., System],
        vary: Mapping[str, Any] | None = None,
        *,
        replicas: int = 1,
        seed: int = 0,
        measure: str | Measure = RUN,
        **settings: Any,
    ) -> None:
        _check_packages()
        integrator, rest = unpacked(settings.pop("integrator", None), settings)
        settings = {"integrator": integrator, **rest}
        known = run_keys()
        for key in settings:
            if key not in known:
                hint = meant(key) or suggestion(key, known)
                raise InputError(f"{key}: expected one of {choices(known, key)}{hint}")
        if not (callable(measure) or measure in (RUN, MEGNO)):
            raise InputError(f"measure: expected {RUN!r}, {MEGNO!r} or a function of the Simulation, got {measure!r}")
        given = {
            key: value.item() if isinstance(value, np.generic) else value
            for key, value in settings.items()
            if value is not None
        }
        self.members: Members = members_of(vary or {}, replicas, seed)
        self._recipe = Recipe(_subject(system), given, measure)
        _refuse_keys(self.members, given)
        drawn = self.members.draws or (self._recipe.drawn and not (measure != MEGNO and seeded(self.members.grids)))
        if replicas > 1 and not drawn:
            raise InputError(f"replicas: all {replicas} would be the same run: nothing in {self.name} is random")
        one = self._a_system()
        check_run(one.run)
        refuse_stages("ensemble", one)
        self._units = one.units.name if isinstance(one, System) else ""
        self._recipe = self._recipe.knowing(self._registered(one), one)
        if measure != MEGNO:
            self._refuse_unused(one)

    @property
    def name(self) -> str:
        """Name of the system."""
        return self._recipe.subject.name

    def __len__(self) -> int:
        """Number of members."""
        return len(self.members)

    def run(
        self,
        client: Any = None,
        *,
        workers: int | None = None,
        output: str | os.PathLike[str] | None = None,
        overwrite: bool = False,
        trajectories: str | os.PathLike[str] | None = None,
        progress: bool | Progress | None = None,
    ) -> DataFrame:
        """Run all members and return their table, a row for each, in order.

        A row has the member's number, replica and seed, the varied values, ``status`` ("done", "failed", or "lost" if
        every worker that ran the member died), the ``error`` and last good state of a failed member, and the measured
        values. All values but ``wall_seconds`` have the same bits however the member was run, on one kind of processor.

        Parameters
        ----------
        client : a ``distributed.Client``; default one with new processes on this machine
        workers : number of these processes; default one for each core
        output : a ``.parquet`` or ``.h5`` file for the table. A journal beside it keeps the rows until all are done.
            After Ctrl-C or a kill the same call continues; so does a call with more replicas
        overwrite : start anew, whatever the file or the folder of trajectories holds
        trajectories : a folder for a ``.h5md`` file of each member, ``.h5`` for an ODE
        progress : True shows a bar; a function is called as ``progress(done, of, failed)``

        Raises
        ------
        InputError
            If output holds another ensemble, or a package is missing.
        RunError
            If the scheduler is lost. Failed members raise nothing.
        """
        if workers is not None:
            workers = whole_number("workers", workers, 1)
            check_room("ensemble", workers, "workers", PROCESS_BYTES, "give fewer")
        if progress is True:
            with members_bar() as bar:
                return self.run(
                    client, workers=workers, output=output, overwrite=overwrite, trajectories=trajectories, progress=bar
                )
        progress = progress or None
        recipe = self._recipe if trajectories is None else self._recipe.writing(trajectories)
        if output is None:
            recipe.refuse_frames(overwrite)
            return tables.frame(self._all(recipe, {}, client, workers, progress, None), self.provenance(recipe))
        with tables.Journal(tables.checked_output(output), self.provenance(recipe)) as journal:
            known = {} if overwrite else journal.known()
            recipe.refuse_frames(overwrite or bool(known))
            journal.begin(known.values())
            table = tables.frame(self._all(recipe, known, client, workers, progress, journal), journal.provenance)
            journal.finish(table)
        return table

    def _all(
        self,
        recipe: Recipe,
        known: dict[int, Row],
        client: Any,
        workers: int | None,
        progress: Progress | None,
        journal: tables.Journal | None,
    ) -> Collection[Row]:
        """Rows of all members, including the ``known`` rows."""
        failed = sum(row["status"] != DONE for row in known.values())
        if progress:
            progress(len(known), len(self), failed)
        todo = [i for i in range(len(self)) if i not in known]
        for found in self._rows(recipe, todo, client, workers):
            if journal:
                journal.append(found)
            known |= {row[MEMBER]: row for row in found}
            failed += sum(row["status"] != DONE for row in found)
            if progress:
                progress(len(known), len(self), failed)
        return known.values()

    @staticmethod
    def read(path: str | os.PathLike[str]) -> DataFrame:
        """Table that ``run`` wrote to a file, with its provenance in ``table.attrs["kickdrift"]``."""
        _check_packages()
        return tables.read(path)

    @staticmethod
    def plot(table: DataFrame | str | os.PathLike[str], column: str | None = None) -> Any:
        """Draw a column of a table against the varied keys: a map, a curve, points or a histogram; a matplotlib Figure.

        Parameters
        ----------
        table : what ``run`` or ``read`` returned, or the path of a table
        column : a measured column; default the most informative one

        Raises
        ------
        InputError
            For an unknown column, a table without a measured number, and more than two keys on grids.
        """
        found = Ensemble.read(table) if isinstance(table, str | os.PathLike) else table
        return above("ensemble figure")(found, column)

    def provenance(self, recipe: Recipe | None = None) -> dict[str, Any]:
        """Provenance of the table."""
        members, recipe = self.members, recipe or self._recipe
        vary = {**members.grids, **members.draws}
        own = {"vary": repr(vary), "seed": str(members.seed), "version": VERSION}
        return {
            "identity": recipe.identity() | own,  # everything that distinguishes ensembles; more replicas do not
            "system": self.name,
            "units": self._units,
            "source": recipe.subject.text,
            "grids": members.grids,
            "draws": {key: list(draw) for key, draw in members.draws.items()},
            "replicas": members.replicas,
            "members": len(members),
            "seed": members.seed,
            "settings": dict(recipe.settings),
            "measure": recipe.measure_name,
            "begun": datetime.now(UTC).isoformat(timespec="seconds"),
            "command": " ".join(sys.argv),
            "versions": versions(),
            "processor": processor(),
        }

    def _a_system(self) -> System | Problem:
        """System of the first, the middle or the last member. Raises InputError if none of these can be built."""
        for index in (0, len(self) // 2, len(self) - 1):
            try:
                return self._recipe.system(self.members[index])
            except InputError as error:
                found = error
        raise found

    def _registered(self, system: System | Problem) -> list[Method]:
        """Integrators that members may name and that other processes do not have."""
        named = self._named(system)
        for name in named:
            method_named(name)  # or an InputError with a suggestion
        return [INTEGRATORS[name] for name in sorted(REGISTERED & named)]

    def _named(self, system: System | Problem) -> set[Any]:
        """Integrators that members name."""
        grids = [values for key, values in self.members.grids.items() if path_of(key) == INTEGRATOR]
        return {
            *([system.run.integrator] if system.run.integrator else []),
            *(from_text(value)[0] if isinstance(value, str) else value for values in grids for value in values),
        }

    def _refuse_unused(self, system: System | Problem) -> None:
        """Refuse an option of integrators that no member's integrator takes."""
        named = self._named(system) or {default_method(system)}
        for key in [*self.members.grids, *self.members.draws]:
            where, *name = path_of(key)
            if where != "run" or name[0] not in known_options() or name[0] in (PRECISION.name, SEED.name):
                continue
            if not any(name[0] in method_named(each).tunable for each in named):
                raise InputError(
                    f"vary: {key}: {' and '.join(sorted(named))} do{'' if named - {min(named)} else 'es'} not take it; "
                    f"{takers_text(name[0])} {name[0]}; name one by --integrator, or integrator=…"
                )

    def _rows(self, recipe: Recipe, todo: list[int], client: Any, workers: int | None) -> Iterator[list[Row]]:
        """Yield the rows of members as they finish, from the client or from own processes."""
        if not todo:
            return
        workers = workers and min(workers, len(todo))
        with running.workers(workers) if client is None else nullcontext(client) as own:
            yield from running.rows(recipe, self.members, todo, own)


def _refuse_keys(members: Members, given: Mapping[str, Any]) -> None:
    """Refuse keys that would be two columns, or a column of every table."""
    paths: dict[tuple[str, ...], str] = {path_of(key): key for key in given}
    for key in [*members.grids, *members.draws]:
        if key in COLUMNS:
            raise InputError(f"vary: {key}: every table has a column of this name; choose another")
        if path_of(key) in paths:
            raise InputError(f"vary: {key}: is given twice, as {paths[path_of(key)]} too")
        paths[path_of(key)] = key


def _subject(system: Any) -> SystemText | SystemMaker:
    if isinstance(system, System | Problem):
        return SystemMaker(system.name, system)
    if callable(system):
        return SystemMaker(getattr(system, "__name__", "system"), system)
    path = find(system)
    text, data = parsed(path)
    return SystemText(path.stem, text, data, path.parent.resolve())


def _check_packages() -> None:
    """Raise InputError with an install command if a package is missing."""
    missing = [name for name in ("distributed", "pandas", "pyarrow", "tomli_w") if find_spec(name) is None]
    if missing:
        raise InputError(f"ensemble: needs {' and '.join(missing)}: pip install 'kickdrift[ensemble]'")
