"""Lines on standard error that say what is compiled, while it is compiled."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import Any

from kickdrift.cli.console import say
from kickdrift.jit.cache.notices import heard


@contextmanager
def compilation_said(quiet: bool) -> Iterator[None]:
    """Say on standard error what is compiled in this context, once for each purpose."""
    said: set[str] = set()

    def hear(purpose: str, kept: bool) -> None:
        line = f"compiling{f' {purpose}' if purpose else ''}{' (once on this machine)' if kept else ''}"
        if line not in said:
            said.add(line)
            say(line, quiet)

    with heard(hear):
        yield


def telling(command: Callable[..., None]) -> Callable[..., None]:
    """Decorator of a command: the command says what it compiles, unless it has ``--quiet``."""

    @wraps(command)
    def told(**given: Any) -> None:
        with compilation_said(bool(given.get("quiet"))):
            command(**given)

    return told
