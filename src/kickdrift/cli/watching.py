"""A run while it goes on: --live and --imd show it, and Ctrl-C ends it with one line on what is kept."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Annotated, Self

import typer

import kickdrift as kd
from kickdrift.cli.console import say
from kickdrift.cli.options import option
from kickdrift.display.pace import silent
from kickdrift.engines import ENGINES
from kickdrift.errors import InputError, KickdriftError
from kickdrift.model.checks.limits import NEVER
from kickdrift.model.problem import Problem
from kickdrift.model.system import System
from kickdrift.text import clean, counted

ImdOption = Annotated[
    int | None, option("[PORT]", "Stream the run to MDAnalysis: imd://localhost:PORT (default 8888).")
]
ImdWaitOption = Annotated[
    bool, typer.Option("--imd-wait", help="With --imd: wait whenever no program reads the stream.")
]
LiveOption = Annotated[
    int | None, option("[PORT]", "Show the run in a browser; the terminal says the address (default: a free port).")
]


def check_watching(subject: System | Problem, live: int | None, imd: int | None, imd_wait: bool, quiet: bool) -> None:
    """Refuse options that make no sense, before anything runs."""
    if imd_wait and imd is None:
        raise InputError("--imd-wait: needs --imd")
    if live is not None and quiet:
        raise InputError("--live: says the address on the terminal, which --quiet keeps silent; give one of them")
    for flag, port, act in (("--live", live, "show"), ("--imd", imd, "stream")):
        if port is not None and not isinstance(subject, System):
            raise InputError(f"{flag}: a Problem has no particles to {act}")
        if port is not None and (flag, port) != ("--live", 0):
            _check_port(port, flag)


@contextmanager
def watched(sim: kd.Simulation, live: int | None, imd: int | None, imd_wait: bool, quiet: bool) -> Iterator[None]:
    """Say where the Simulation streams, and serve its page during equilibration and run."""
    from kickdrift.run.followers import watched_live

    if imd is not None:
        from kickdrift.run.watchers.imd import HOST

        say(f"streams to imd://{HOST}:{imd}{'; waits for a program that reads' if imd_wait else ''}", quiet)
    with silent(quiet), watched_live(sim, False if live is None else live):
        yield


def _check_port(port: int, option: str) -> None:
    """Raise InputError if the port is taken or no port."""
    from kickdrift.run.watchers.imd import listening

    listening(port, option).close()


INTERRUPTED = 130  # exit status


def warn_of_version(sim: kd.Simulation, quiet: bool) -> None:
    """Warn of an untested version of an engine, and of what the system lacks, before the first step."""
    from kickdrift.run.report.warnings import begins_badly

    for warning in [*ENGINES[sim.engine].warnings, *begins_badly(sim.system)]:
        say(f"warning: {warning}", quiet)


class Interrupted(KickdriftError):
    """Raised when Ctrl-C ends a command. The message names the files that are kept."""

    exit_status = INTERRUPTED


class Interruption:
    """Context of a run that turns Ctrl-C into Interrupted.

    Parameters
    ----------
    output : the run's file, if the run writes one
    particles : whether the run is of particles, not of a Problem
    resumed : whether the file holds the run's earlier frames

    Attributes
    ----------
    sim : kd.Simulation or None
        Set when steps of the run begin; before that, nothing is kept.
    end_step, end_time : planned end of the run
    """

    def __init__(self, output: Path | None, particles: bool = True, resumed: bool = False) -> None:
        self.output, self.particles, self.resumed = output, particles, resumed
        self.sim: kd.Simulation | None = None
        self.end_step, self.end_time, self._begin_time = NEVER, float("inf"), 0.0
        self._before = None if resumed else _identity(output)

    def begins(self, sim: kd.Simulation, steps: int | None = None, until: float | None = None) -> None:
        """Note that the run begins, and its end."""
        self.sim, self._begin_time = sim, sim.time
        self.end_step = NEVER if steps is None else steps
        self.end_time = float("inf") if until is None else until

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        if kind is not None and issubclass(kind, KeyboardInterrupt):
            raise Interrupted(f"{self._where()}; {self._kept()}") from None

    def _where(self) -> str:
        sim = self.sim
        if sim is None:
            return f"stopped before the first {'new ' if self.resumed else ''}step"
        if self.end_step < NEVER:
            return f"stopped at step {sim.steps_done:,} of {self.end_step:,}"
        return f"stopped at time {sim.time:.6g} of {self.end_time:.6g}, step {sim.steps_done:,}"

    def _reached(self, time: float) -> bool:
        """Whether the run, forward or back in time, has come to its end."""
        return time >= self.end_time if self.end_time >= self._begin_time else time <= self.end_time

    def _kept(self) -> str:
        nothing = "nothing is kept"
        if self.output is None:
            return f"{nothing}; --output FILE{'.h5md' if self.particles else '.h5'} keeps a run"
        if not self.resumed and (self.sim is None or _identity(self.output) in (None, self._before)):
            return nothing

        try:
            with kd.open(self.output) as run:
                steps = getattr(run, "all_steps", getattr(run, "steps", None))  # of frames, of samples; none in a table
                what = counted(len(run), "frame" if hasattr(run, "all_steps") else "sample", ",")
                until = f" up to step {int(steps[-1]):,}" if steps is not None and len(steps) else ""
                checkpoints = getattr(run, "checkpoints", None)
                resumable = checkpoints is not None and len(checkpoints.steps) > 0
        except (KickdriftError, OSError):
            return nothing
        name = clean(str(self.output))
        text = f"{name} holds {what}{until}"
        sim = self.sim
        over = sim is not None and (sim.steps_done >= self.end_step or self._reached(sim.time))
        return text + (f"; continue with: kickdrift resume {shlex.quote(name)}" if resumable and not over else "")


def _identity(path: Path | None) -> tuple[int, int, int] | None:
    """Numbers that change if another file takes a file's place, or if the file is written."""
    try:
        found = os.stat(path) if path is not None else None
    except (OSError, ValueError):
        return None
    return None if found is None else (found.st_ino, found.st_size, found.st_mtime_ns)
