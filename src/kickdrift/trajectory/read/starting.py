"""The frame of a run's file at which a new run begins."""

import os
from collections.abc import Iterator
from contextlib import contextmanager

from kickdrift.errors import InputError
from kickdrift.model.system import System
from kickdrift.trajectory.layout.record import system_of
from kickdrift.trajectory.read import reader
from kickdrift.trajectory.read.frames import Frame


@contextmanager
def opened_at(path: str | os.PathLike[str], number: int | None = None) -> Iterator[Frame]:
    """A frame of a run's file, which stays open: counted from 0, or from -1 backwards; the last one by default."""
    with reader.open(path) as run:
        k = -1 if number is None else number
        if not -len(run) <= k < len(run):
            raise InputError(f"{path}: has no frame {k}; it holds {len(run)}")
        yield run[k]


def start_at(path: str | os.PathLike[str], number: int | None = None) -> System:
    """The bodies of the System at a frame, without its forces and events."""
    with opened_at(path, number) as frame:
        frame._run.refuse_changed()
        return system_of(frame._run, frame.index, forces=(), events=())
