"""Stages of a protocol, such as relax, heat, equilibrate and produce, each a run from the end of the one before."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from kickdrift.errors import InputError
from kickdrift.text import shown

NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.+-]*")  # a part of a file's name
MINIMIZE = ("method", "force", "steps", "max_displacement", "soft")


@dataclass(frozen=True, init=False)
class Stage:
    """One run of a protocol, for `kickdrift.run_stages` and ``[[stage]]``.

    Parameters
    ----------
    name : letters, digits, ``-`` and ``_``; the name of its file ends with it
    keep : whether the stage has a file
    minimize : True, or ``method``, ``force``, ``steps``, ``max_displacement`` and ``soft`` of
        `Simulation.minimize`, for a stage that moves the particles to a minimum of their energy in place of a run
    inherit : whether the stage takes from ``[run]`` what it does not say itself
    run : keys of ``[run]``: integrator, dt, steps or time, every, and options such as
        ``temperature={"from": 300, "to": 2500}``. They stand above those of ``[run]``

    Raises
    ------
    InputError
        For a name that no file can have, and for keys that do not fit.
    """

    name: str
    keep: bool = True
    minimize: Mapping[str, Any] | None = None
    inherit: bool = True
    run: Mapping[str, Any] = field(default_factory=dict, hash=False)

    def __init__(
        self,
        name: str,
        *,
        keep: bool = True,
        minimize: bool | Mapping[str, Any] | None = None,
        inherit: bool = True,
        **run: Any,
    ) -> None:
        if not (isinstance(name, str) and NAME.fullmatch(name)):
            raise InputError(f"stage: name must be letters, digits, - and _, such as heat, got {shown(name)}")
        if not isinstance(keep, bool):
            raise InputError(f"stage {name}: keep must be True or False, got {shown(keep)}")
        if not isinstance(inherit, bool):
            raise InputError(f"stage {name}: inherit must be True or False, got {shown(inherit)}")
        if not isinstance(minimize, bool | Mapping | None):
            raise InputError(f"stage {name}: minimize must be True or {', '.join(MINIMIZE)}, got {shown(minimize)}")
        given = None if minimize in (None, False) else {} if minimize is True else dict(minimize)  # type: ignore[arg-type]
        if strange := [key for key in given or () if key not in MINIMIZE]:
            raise InputError(f"stage {name}: minimize takes {', '.join(MINIMIZE)}, got {shown(strange[0])}")
        if given is not None and run:
            raise InputError(f"stage {name}: {next(iter(run))}: a stage that minimizes takes no steps in time")
        own = {"name": name, "keep": keep, "minimize": given, "inherit": inherit, "run": run}
        for key, value in own.items():
            object.__setattr__(self, key, value)

    def said(self) -> dict[str, Any]:
        """Values by key, as in ``[[stage]]``."""
        own: dict[str, Any] = {"name": self.name} | ({} if self.keep else {"keep": False})
        own |= {} if self.inherit else {"inherit": False}
        return own | ({} if self.minimize is None else {"minimize": dict(self.minimize) or True}) | dict(self.run)


def checked_stages(stages: Iterable[Stage]) -> tuple[Stage, ...]:
    """Stages as a tuple. Raises InputError for something else, and for two with one name."""
    found = tuple(stages)
    for k, each in enumerate(found):
        if not isinstance(each, Stage):
            raise InputError(f"stages[{k}]: expected a Stage, got {shown(each)}")
        if each.name in [other.name for other in found[:k]]:
            raise InputError(f"stages[{k}]: two stages are named {each.name}, and each has a file of its own")
    return found


def refuse_stages(command: str, subject: Any) -> None:
    """Refuse a System that has stages, for a command that takes single runs."""
    if getattr(subject, "stages", ()):
        raise InputError(f"{command}: {subject.name} has stages, which only `run` takes; leave out [[stage]]")
