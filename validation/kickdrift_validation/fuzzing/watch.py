"""The watch over a child: memory, processor time without that of compiling, and time without any work."""

import os
import resource
import signal
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from time import monotonic, sleep

from kickdrift_validation.fuzzing.flags import COMPILED, COMPILING, COMPUTING, FLAGS
from kickdrift_validation.fuzzing.rules import KILLED, Ended

GIB = 2**30
PAGE, TICK = resource.getpagesize(), os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True)
class Limits:
    """How much a command may take before its process is ended."""

    seconds: float = 10.0  # of processor time, without compiling
    wall: float = 60.0  # without compiling
    blocked: float = 5.0  # without any work
    compiling: float = 300.0
    computing: float = 2.0  # before a run that may be long is interrupted
    memory: int = GIB
    processes: int = 24


def figures(pid: int) -> tuple[str, float, int] | None:
    """A process's state, seconds of processor time and bytes of memory; None of one that is no more."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return None
    return stat[0], (int(stat[11]) + int(stat[12])) / TICK, int(stat[21]) * PAGE


def members(session: int) -> list[int]:
    """The processes of a session."""
    found = []
    for entry in os.listdir("/proc"):
        if entry.isdigit():
            with suppress(OSError, IndexError):
                if int(Path(f"/proc/{entry}/stat").read_text().rpartition(")")[2].split()[3]) == session:
                    found.append(int(entry))
    return found


def work(session: int) -> float:
    """Seconds of processor time of a session's processes."""
    return sum(each[1] for each in map(figures, members(session)) if each)


def end(session: int) -> None:
    for pid in members(session):
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


def worth(work: float, clock: float, family: bool) -> float:
    """Seconds of work, or a third of the clock's; a tenth where other processes do the work, and have to start."""
    return clock / 10 if family else max(work, clock / 3)


def watch(pid: int, limits: Limits, may_compute: bool, kill_after: float | None, ended: Ended) -> None:
    """Wait for a child, and end one that takes too much, or as the case asks."""
    began, pause, worked, last = monotonic(), 0.002, monotonic(), -1.0
    family = any("ensemble" in word for word in ended.command)
    interrupted = looked = others = 0.0
    while True:
        found, status, used = os.wait4(pid, os.WNOHANG)
        if found:
            ended.status = os.waitstatus_to_exitcode(status)
            ended.megabytes = used.ru_maxrss / 1024
            ended.seconds = used.ru_utime + used.ru_stime - FLAGS[COMPILED]
            break
        now, seen = monotonic(), figures(pid)
        if seen is None:
            continue
        state, cpu, memory = seen
        if cpu != last or state == "R" or (family and now - began < limits.wall):
            worked, last = now, cpu
        count = 1
        if family and now - looked > 0.3:
            looked, everyone = now, members(pid)
            count = len(everyone)
            memory = max([memory, *(each[2] for each in map(figures, everyone) if each)])
        free = cpu - FLAGS[COMPILED]
        compiling, ended.computing = bool(FLAGS[COMPILING]), FLAGS[COMPUTING] > 0
        reason = ""
        if kill_after is not None and (now - began if family else cpu + (now - began) / 20) > kill_after:
            reason = KILLED
        elif memory > limits.memory:
            reason = f"more than {limits.memory / GIB:g} GiB of memory"
        elif count > limits.processes:
            reason = f"more than {limits.processes} processes"
        elif compiling:
            reason = "compiles without end" if now - began > limits.compiling else ""
        elif interrupted and now - interrupted > limits.seconds:
            reason = f"does not stop {limits.seconds:g} s after Ctrl-C"
        elif now - worked > limits.blocked and (busy := work(pid)) != others:  # a process that this one waits for
            worked, others = now, busy
        elif now - worked > limits.blocked:
            reason = f"hangs: no work for {limits.blocked:g} s"
        elif free > limits.seconds:
            reason = f"hangs: more than {limits.seconds:g} s of work"
        elif now - began - FLAGS[COMPILED] > limits.wall:
            reason = f"hangs: more than {limits.wall:g} s"
        elif (
            may_compute and ended.computing and not interrupted and worth(free, now - began, family) > limits.computing
        ):
            interrupted, ended.stopped = now, "goes on"
            os.kill(pid, signal.SIGINT)
        if reason:
            ended.stopped = reason
            end(pid)
            os.wait4(pid, 0)
            ended.status, ended.megabytes = -signal.SIGKILL, memory / 2**20
            break
        sleep(pause)
        pause = min(0.02, pause * 1.3)
    if ended.stopped == "goes on" and ended.status in (0, 130):
        ended.computing = True
    if family or ended.stopped:
        end(pid)
