"""Notices of compilation: whoever listens hears before machine code is made, and for what."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from time import perf_counter

Listener = Callable[[str, bool], None]


class MachineCode:
    """Seconds that this process has spent on compiling, or on loading compiled code from the disk."""

    def __init__(self) -> None:
        self.seconds, self._busy = 0.0, False

    @contextmanager
    def made(self) -> Iterator[None]:
        """Count the time of this context, once where one function needs another."""
        outer, self._busy, began = not self._busy, True, perf_counter()
        try:
            yield
        finally:
            if outer:
                self._busy = False
                self.seconds += perf_counter() - began


machine_code = MachineCode()
_listeners: list[Listener] = []
_purpose: ContextVar[str] = ContextVar("purpose", default="")


@contextmanager
def compiling_for(purpose: str) -> Iterator[None]:
    """Name what code compiled inside this context is for, such as "velocity-verlet for lennard-jones"."""
    token = _purpose.set(purpose)
    try:
        yield
    finally:
        _purpose.reset(token)


@contextmanager
def compiling_part(k: int, n: int, what: str) -> Iterator[None]:
    """Say that code compiled inside this context is for part ``k`` of ``n`` of the purpose, if there are several."""
    purpose = _purpose.get()
    with compiling_for(f"{purpose}, {what} {k} of {n}" if purpose and n > 1 else purpose):
        yield


@contextmanager
def heard(listener: Listener) -> Iterator[None]:
    """Call ``listener(purpose, kept)`` inside this context before each function that is compiled.

    ``purpose`` is "" where none is named. ``kept`` says whether the disk keeps the code, so that the machine compiles
    it once."""
    _listeners.append(listener)
    try:
        yield
    finally:
        _listeners.remove(listener)


def announce(kept: bool, purpose: str | None = None) -> None:
    """Tell the listeners that a function is about to be compiled, because the disk does not have its code.

    ``purpose`` replaces the one of the context, for a function that another process compiles."""
    for listener in tuple(_listeners):
        listener(_purpose.get() if purpose is None else purpose, kept)
