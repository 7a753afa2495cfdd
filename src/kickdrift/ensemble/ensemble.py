"""An Ensemble: one system, run many times with what varies from run to run."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import nullcontext
from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import kickdrift
from kickdrift.ensemble import running
from kickdrift.ensemble import table as tables
from kickdrift.ensemble.keys import path_of
from kickdrift.ensemble.members import Members, members_of
from kickdrift.ensemble.recipe import MEGNO, RUN, Measure, Recipe, SystemMaker, SystemText
from kickdrift.ensemble.rows import DONE, LOST, Row
from kickdrift.errors import InputError
from kickdrift.forces.compiling import processor
from kickdrift.integrators import INTEGRATORS
from kickdrift.integrators import integrator as method_named
from kickdrift.integrators.method import Method
from kickdrift.integrators.registration import REGISTERED
from kickdrift.problem import Problem
from kickdrift.schema import RunTable
from kickdrift.system import System
from kickdrift.systemfile import find, parsed
from kickdrift.trajectory.layout import versions
from kickdrift.units import suggestion

if TYPE_CHECKING:
    from pandas import DataFrame

Progress = Callable[[int, int, int], Any]


class Ensemble:
    """Many runs of one system, which differ by values that vary and by their seeds.

    Parameters
    ----------
    system : a system file's path or name; or a System; or a function that makes a System of what varies, and of
        ``seed`` if it takes that
    vary : of each key the values on a grid, of which every combination is run, or how to draw one for each member.
        Keys are those of the system file, such as ``"particles.elements[1].a"`` (entries by number from 0, or by name:
        ``"particles.elements[Saturn].a"``), and ``dt``, ``integrator`` and the others of its ``[run]``; or parameters
        of the function. Values are numbers in the system's units or texts with theirs, in a list or an array; or a
        text: ``"5:6:64"`` for 64 values from 5 to 6 (``"log:…"`` evenly in the logarithm), ``"uniform:5:6"``,
        ``"normal:5.2:0.1"`` (mean and standard deviation), ``"log-uniform:1e-6:1e-3"``
    replicas : runs of each combination, with seeds of their own
    seed : the root of all seeds. Member i is the same bits whatever the number of workers, their order, or the number
        of replicas
    measure : "run", what a run reports of itself; "megno", whether the motion is chaotic; or a function of the
        Simulation after its run, which gives a number, or a dict of numbers and texts by name
    settings : integrator, dt, steps, time and what else ``[run]`` has, for all members

    Raises InputError where an argument makes no sense.
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
        for key in settings:
            if key not in RunTable.model_fields:
                hint = suggestion(key, RunTable.model_fields)
                raise InputError(f"{key}: expected one of {', '.join(RunTable.model_fields)}{hint}")
        if not (callable(measure) or measure in (RUN, MEGNO)):
            raise InputError(f"measure: expected {RUN!r}, {MEGNO!r} or a function of the Simulation, got {measure!r}")
        given = {key: value for key, value in settings.items() if value is not None}
        self.members: Members = members_of(vary or {}, replicas, seed)
        self._recipe = Recipe(_subject(system), given, measure)
        for key in self.members.draws | self.members.grids:
            if key in given:
                raise InputError(f"{key}: varies, and was given as {given[key]!r} too")
        if replicas > 1 and not self.members.draws and not self._recipe.drawn:
            raise InputError(f"replicas: all {replicas} would be the same run: {self.name} leaves nothing to a seed")
        one = self._a_system()
        self._units = one.units.name if isinstance(one, System) else ""
        self._recipe = self._recipe.knowing(self._registered(one))

    @property
    def name(self) -> str:
        """The system's."""
        return self._recipe.subject.name

    def __len__(self) -> int:
        """How many members there are."""
        return len(self.members)

    def run(
        self,
        client: Any = None,
        *,
        workers: int | None = None,
        output: str | os.PathLike[str] | None = None,
        overwrite: bool = False,
        trajectories: str | os.PathLike[str] | None = None,
        progress: Progress | None = None,
    ) -> DataFrame:
        """Run all members and return their table, a row for each, in order.

        A row has the member's number, replica and seed, the values that varied, ``status`` ("done", "failed", or "lost"
        where every worker that ran it died), the ``error`` of one that failed with its last good state, and what was
        measured. All but ``wall_seconds`` is the same bits however it was run.

        Parameters
        ----------
        client : a ``distributed.Client``; default one of new processes on this machine
        workers : how many of these; default one for each core
        output : a ``.parquet`` or ``.h5`` file for the table. Rows are kept in a journal beside it until all are done:
            after Ctrl-C or a kill the same call goes on where it stopped, as it does with more replicas
        overwrite : begin anew where the file holds another ensemble
        trajectories : a folder for a ``.h5md`` file of each member
        progress : called as ``progress(done, of, failed)``

        Raises InputError where output holds another ensemble or a package is missing, RunError where the scheduler is
        lost; members that fail raise nothing.
        """
        _check_packages()
        recipe = self._recipe if trajectories is None else self._recipe.writing(trajectories)
        path = None if output is None else tables.checked_output(output)
        provenance = self.provenance()
        journal = None if path is None else tables.Journal(path, provenance)
        known = self._done(path, journal) if path and journal and not overwrite else {}
        todo = [i for i in range(len(self)) if i not in known]
        failed = sum(row["status"] != DONE for row in known.values())
        if journal:
            journal.begin(list(known.values()))
        try:
            if progress:
                progress(len(known), len(self), failed)
            for found in self._rows(recipe, todo, client, workers):
                known |= {row["member"]: row for row in found}
                failed += sum(row["status"] != DONE for row in found)
                if journal:
                    journal.append(found)
                if progress:
                    progress(len(known), len(self), failed)
        finally:
            if journal:
                journal.close(done=False)
        table = tables.frame(known.values(), provenance)
        if path and journal:
            tables.write(table, path)
            journal.close(done=True)
        return table

    @staticmethod
    def read(path: str | os.PathLike[str]) -> DataFrame:
        """The table that ``run`` wrote to a file; what made it is in ``table.attrs["kickdrift"]``."""
        _check_packages()
        return tables.read(path)

    def provenance(self) -> dict[str, Any]:
        """All that the table came from."""
        subject, members = self._recipe.subject, self.members
        return {
            "identity": self._identity(),
            "system": self.name,
            "units": self._units,
            "source": subject.text if isinstance(subject, SystemText) else "",
            "grids": members.grids,
            "draws": {key: list(draw) for key, draw in members.draws.items()},
            "replicas": members.replicas,
            "members": len(members),
            "seed": members.seed,
            "settings": dict(self._recipe.settings),
            "measure": self._recipe.measure_name,
            "begun": datetime.now(UTC).isoformat(timespec="seconds"),
            "command": " ".join(sys.argv),
            "versions": versions(),
            "processor": processor(),
        }

    def _identity(self) -> dict[str, str]:
        """What makes another ensemble of it, by name; more replicas do not."""
        members = self.members
        vary = {**members.grids, **members.draws}
        own = {"vary": repr(vary), "seed": str(members.seed), "version": kickdrift.__version__}
        return self._recipe.identity() | own

    def _a_system(self) -> System | Problem:
        """A member's, of the first, the middle and the last; an InputError where none of these can be built."""
        for index in (0, len(self) // 2, len(self) - 1):
            try:
                return self._recipe.system(self.members[index])
            except InputError as error:
                found = error
        raise found

    def _registered(self, system: System | Problem) -> list[Method]:
        """The integrators that members may name and other processes do not know."""
        grids = [values for key, values in self.members.grids.items() if path_of(key)[-1] == "integrator"]
        named = {
            *([system.run.integrator] if system.run.integrator else []),
            *(value for values in grids for value in values),
        }
        for name in named:
            method_named(name)  # or an InputError that suggests another
        return [INTEGRATORS[name] for name in sorted(REGISTERED & named)]

    def _done(self, output: Path, journal: tables.Journal) -> dict[int, Row]:
        """The members that are done already, by number; those whose workers died are not."""
        began, found = journal.read()
        if began is None and output.exists():
            table = tables.read(output)
            began, found = table.attrs[tables.PROVENANCE], table.to_dict("records")
        if began is None:
            return {}
        there = began.get("identity", {})
        for key, here in self._identity().items():
            if there.get(key) != here:
                raise InputError(f"{output}: holds an ensemble with another {key}; give --overwrite to begin anew")
        known = {row["member"]: row for row in found if row["status"] != LOST}
        if known and max(known) >= len(self):
            raise InputError(
                f"{output}: holds {len(known)} members of this ensemble, more than the {len(self)} asked for"
            )
        return known

    def _rows(self, recipe: Recipe, todo: list[int], client: Any, workers: int | None) -> Iterator[list[Row]]:
        """The rows of members as they are done, from the client or from processes of its own."""
        if not todo:
            return
        with running.workers(workers) if client is None else nullcontext(client) as own:
            yield from running.rows(recipe, self.members, todo, own)


def _subject(system: Any) -> SystemText | SystemMaker:
    if isinstance(system, System | Problem):
        return SystemMaker(system.name, system)
    if callable(system):
        return SystemMaker(getattr(system, "__name__", "system"), system)
    path = find(system)
    text, data = parsed(path)
    return SystemText(path.stem, text, data, path.parent.resolve())


def _check_packages() -> None:
    """Say what to install where a package is missing."""
    missing = [name for name in ("distributed", "pandas", "pyarrow", "tomli_w") if find_spec(name) is None]
    if missing:
        raise InputError(f"ensemble: needs {' and '.join(missing)}: pip install 'kickdrift[ensemble]'")
