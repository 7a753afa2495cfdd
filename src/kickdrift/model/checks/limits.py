"""Limits on counts: steps of a run, and, for every count in a small file or a command, the machine's memory."""

import math
import os
from pathlib import Path
from typing import Any

from kickdrift.disk.posix import memory_limits
from kickdrift.errors import InputError
from kickdrift.model.checks import values as checks
from kickdrift.model.checks.values import number

MOST_STEPS = 10**15  # a year of the fastest steps; floats are exact for nine times as many
NEVER = 2**62  # number of steps in a run without an end
MOST_DIGITS = 4000  # longest text for int(); Python's own limit is 4300


def whole_number(key: str, value: Any, least: int, most: int = MOST_STEPS) -> int:
    """Return the value as an int. Raises InputError unless it is a whole number from ``least`` to ``most``."""
    found = checks.whole_number(f"run: {key}", value, least)
    if found > most:
        raise InputError(f"run: {key} must be at most {most:,}, got {amount(checks.number(found))}")
    return found


def whole_text(text: str) -> int | None:
    """Whole number from a text of plain digits; None for other texts."""
    return int(text) if text.isascii() and text.isdigit() and len(text) <= MOST_DIGITS else None


def steps_in(key: str, length: float, dt: float) -> float:
    """Number of steps ``dt`` in a length of time, as a float. Raises InputError if there are too many for any run."""
    steps = float(length) / float(dt)
    if not steps <= MOST_STEPS:
        raise InputError(f"{key} {length:.12g} takes {amount(steps)} steps of {dt:g}; a run has at most {MOST_STEPS:,}")
    return steps


def amount(number: float) -> str:
    """A number for a message: in full if it is short, else in three digits."""
    if math.isinf(number):
        return "more than 1e308"
    return f"{number:,.0f}" if abs(number) < 1e15 and float(number).is_integer() else f"{number:.3g}"


PARTICLE_BYTES = 1000  # measured peak for a particle, from a system file to a run of Lennard-Jones
PROCESS_BYTES = 200 * 10**6  # for a process that computes
SHARE = 0.25  # part of the memory for one kind of thing; looks, output and analysis need some too
PARTICLES_SHARE = 0.5  # part of the memory for the particles of a run
_LIMITS = ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes")  # limits of a container


def check_particles(key: str, count: float, what: str = "particles") -> None:
    """Refuse a count of particles whose run takes too much of this machine's memory, as `check_room` does."""
    check_room(key, count, what, PARTICLE_BYTES, share=PARTICLES_SHARE)


def check_room(key: str, count: float, what: str, each: float, advice: str = "", share: float = SHARE) -> None:
    """Refuse a count of things of ``each`` bytes that takes more than a ``share`` of this machine's memory.

    The InputError begins with ``key`` and says how many fit, or gives the ``advice``.
    """
    there = memory()
    most = int(share * there / each)
    if not count <= most:
        needed = f"about {size(count * each)}" if count < 10**15 else "more memory than there is"
        raise InputError(
            f"{key}: {amount(number(count))} {what} take {needed}, and this machine has {size(there)} of memory; "
            f"{advice or f'the limit is {most:,} here'}"
        )


def memory() -> int:
    """Bytes that this process may use, limited by the machine, the container or ``ulimit -v``."""
    return min([_of_machine(), *(int(text) for text in map(_read, _LIMITS) if text.isdecimal()), *memory_limits()])


def _of_machine() -> int:
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):  # on Windows
        return 2**34


def _read(path: str) -> str:
    try:
        return Path(path).read_text().strip()
    except OSError:
        return ""


def size(count: float) -> str:
    """A number of bytes as text for people."""
    value, unit = float(count), "bytes"
    for unit in ("bytes", "KiB", "MiB", "GiB", "TiB"):
        if value < 1024 or unit == "TiB":
            break
        value /= 1024
    return f"{value:.3g} {unit}" if value < 1000 else f"{value:,.0f} {unit}"


def cores() -> int:
    """Number of the processor's cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
