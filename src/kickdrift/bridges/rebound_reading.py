"""Archives of rebound, which rebound reads in a process of its own: a damaged archive may end that process."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import warnings
from pathlib import Path
from threading import Timer
from typing import Any, NamedTuple

import numpy as np
from pydantic import TypeAdapter

from kickdrift.bridges import rebound_snapshot
from kickdrift.bridges.rebound_snapshot import CHOICES, COLUMNS, OPTIONS, Snapshot
from kickdrift.bridges.rebound_system import system_from
from kickdrift.disk.files import shown_path
from kickdrift.errors import InputError
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.text import shown

CLOCK_SECONDS, CLOCK_RATE = 60, 10**6  # limit by the clock: this, and the file's size at so many bytes a second
ANSWER_BYTES, ANSWER_SHARE = 2**20, 4  # most of an answer: this, and this many times the file's size
POINTERS = "reset function pointers"  # in rebound's warning about functions that no archive holds
OTHER_COUNT = "Number of particles found does not match"  # in its warning about a snapshot that is not whole


class Told(NamedTuple):
    """Answer of the process: the number of snapshots, rebound's warnings, and one snapshot; or an error."""

    snapshots: int = 0
    said: tuple[str, ...] = ()
    snapshot: Snapshot | None = None
    error: str = ""


def archived_system(path: Path, snapshot: int | None = None) -> System:
    """Return the System of a snapshot, by default the last, named after the file; see ``kickdrift.load``."""
    snapshot = -1 if snapshot is None else snapshot
    if isinstance(snapshot, bool) or not isinstance(snapshot, int | np.integer):
        raise InputError(f"snapshot: expected a whole number, got {shown(snapshot)}")
    told, table = _told(path, int(snapshot))
    count, found, said = told.snapshots, told.snapshot, told.said
    if found is None:
        raise InputError(f"{path}: has no snapshot {snapshot}; the archive holds {count}, from 0 to {count - 1}")
    if any(OTHER_COUNT in each for each in said):
        raise _damaged(path, "a snapshot lacks particles")
    if any("corrupt" in each for each in said):
        warnings.warn(f"{path}: the end of the archive is damaged; its {count} whole snapshots are read", stacklevel=4)
    lost = ["additional forces and other functions, which no archive holds"] if any(POINTERS in s for s in said) else []
    if found.collision != "none":
        lost.append(f"the action on collisions ({shown(found.collision)}); give the run events=[kd.Collision(…)]")
    try:
        system = system_from(found._replace(collision="none"), table)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    if lost:
        warnings.warn(f"{path}: left out: {'; '.join(lost)}", stacklevel=4)
    return system.remade(name=path.stem)


def snapshots_in(path: Path) -> int:
    """Number of an archive's whole snapshots."""
    return _told(path, None)[0].snapshots


def _told(path: Path, snapshot: int | None) -> tuple[Told, Floats]:
    """Answer of the process, and the table (bodies, columns) of the snapshot's bodies."""
    head, _, data = _answer(path, snapshot).partition(b"\n")
    try:
        told = TypeAdapter(Told).validate_json(head)
    except ValueError:
        raise _damaged(path, "its settings make no sense") from None
    if told.error:
        raise InputError(f"{shown_path(path)}: rebound cannot read this archive: {' '.join(told.error.split())}")
    bodies = told.snapshot.N if told.snapshot else 0
    if told.snapshot and not _whole(told.snapshot):
        raise _damaged(path, "its settings make no sense")
    if len(data) != 8 * len(COLUMNS) * bodies:
        raise _damaged(path, "a snapshot lacks particles")
    return told, np.frombuffer(data).reshape(len(COLUMNS), bodies).T


def _whole(found: Snapshot) -> bool:
    """Whether a snapshot has its method's options, numbers and words, and a name for each body or for none."""
    options = {key: key in CHOICES for key in OPTIONS.get(found.integrator, ())}
    return options == {key: isinstance(value, str) for key, value in found.options.items()} and (
        len(found.names) in (0, found.N)
    )


def _answer(path: Path, snapshot: int | None) -> bytes:
    """Run `rebound_snapshot` on the archive, and return its answer. Raises InputError if it dies or takes too long."""
    size = os.stat(path).st_size
    most, clock = ANSWER_BYTES + ANSWER_SHARE * size, Timer(CLOCK_SECONDS + size / CLOCK_RATE, lambda: process.kill())
    words = json.dumps([str(path), snapshot, [each for each in sys.path if each and isinstance(each, str)]])
    process: Any
    with subprocess.Popen(
        [sys.executable, "-I", rebound_snapshot.__file__, words], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL, env=os.environ | {"OMP_NUM_THREADS": "1"},
    ) as process:  # fmt: skip
        clock.start()
        try:
            answer: bytes = process.stdout.read(most + 1)
            if len(answer) > most:
                process.kill()
            process.wait()
        except BaseException:
            process.kill()
            raise
        finally:
            clock.cancel()
    if not answer or process.returncode:
        raise _damaged(path, _end(process.returncode))
    return answer


def _end(status: int) -> str:
    """How the process ended, in words."""
    if status in (-getattr(signal, "SIGXCPU", 0), -getattr(signal, "SIGKILL", 0)):
        return "rebound takes too much time or memory"
    try:
        return f"rebound ended with {signal.Signals(-status).name}"
    except ValueError:
        return f"rebound ended with status {status}"


def _damaged(path: Path, how: str) -> InputError:
    return InputError(f"{shown_path(path)}: rebound cannot read this archive, so it is damaged: {how}")
