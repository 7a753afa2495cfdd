"""Options of commands whose run can be seen while it goes on: --live and --imd."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated

import typer

from kickdrift.cli.console import say
from kickdrift.display.pace import silent
from kickdrift.errors import InputError

if TYPE_CHECKING:
    from kickdrift.model.problem import Problem
    from kickdrift.model.system import System
    from kickdrift.run.simulation import Simulation

ImdOption = Annotated[
    int | None,
    typer.Option(metavar="[PORT]", help="Stream the run to MDAnalysis: imd://localhost:PORT (default 8888)."),
]
ImdWaitOption = Annotated[
    bool, typer.Option("--imd-wait", help="With --imd: wait whenever no program reads the stream.")
]
LiveOption = Annotated[
    int | None,
    typer.Option(
        metavar="[PORT]", help="Show the run in a browser; the terminal says the address (default: a free port)."
    ),
]


def check_watching(subject: System | Problem, live: int | None, imd: int | None, imd_wait: bool, quiet: bool) -> None:
    """Refuse options that make no sense, before anything runs."""
    from kickdrift.model.system import System as Particles

    if imd_wait and imd is None:
        raise InputError("--imd-wait: needs --imd")
    if live is not None and quiet:
        raise InputError("--live: says the address on the terminal, which --quiet keeps silent; give one of them")
    for option, port, act in (("--live", live, "show"), ("--imd", imd, "stream")):
        if port is not None and not isinstance(subject, Particles):
            raise InputError(f"{option}: a Problem has no particles to {act}")
        if port is not None and (option, port) != ("--live", 0):
            _check_port(port, option)


@contextmanager
def watched(sim: Simulation, live: int | None, imd: int | None, imd_wait: bool, quiet: bool) -> Iterator[None]:
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
