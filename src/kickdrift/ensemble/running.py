"""Distribution of members to Dask's workers, a few at a time, and collection of their rows.

Dask keeps the processes, sends the work, and gives the members of a dead worker to another. Only as many members are in
progress as keep the workers busy, so an ensemble of any size fits into memory.
"""

import atexit
import logging
import os
import sys
import uuid
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from itertools import count
from multiprocessing import active_children, resource_tracker
from threading import RLock
from time import monotonic
from typing import Any

from kickdrift.disk.interrupt import whole
from kickdrift.ensemble.members import Member, Members
from kickdrift.ensemble.recipe import Recipe
from kickdrift.ensemble.rows import FAILED, LOST, Row, row_of
from kickdrift.ensemble.work import COMPILING, check, packed, timed_members
from kickdrift.errors import InputError, RunError
from kickdrift.jit.cache.notices import announce
from kickdrift.text import counted

PATIENCE = 10.0  # seconds to wait for a scheduler's answer
AHEAD = 3  # tasks in progress for each thread of the workers
TASK_SECONDS = 0.4  # shorter members share a task, at most MOST
MOST = 64
BLOCK = 8  # members of one register: see ``together.TOGETHER``
LOCAL = {  # Dask's settings for a cluster on this machine
    "distributed.deploy.lost-worker-timeout": "1000 days",  # else a worker that dies while it restarts is given up
    "distributed.worker.profile.enabled": False,  # not used, and it takes time from the members
    "distributed.admin.tick.interval": "2s",
    "distributed.admin.system-monitor.interval": "2s",
    "distributed.scheduler.work-stealing-interval": "1s",
    "distributed.scheduler.active-memory-manager.start": False,
}
REFRESH = 1.0  # seconds between counts of the workers
_one_cluster = RLock()  # processes of its own need settings of this whole process, so threads wait for one another


@contextmanager
def workers(number: int | None = None, scheduler: str | None = None) -> Iterator[Any]:
    """Client of the scheduler at an address, or of ``number`` new processes on this machine, by default one for each
    core. The processes are started by spawn, have one thread each, and end with the context."""
    import dask
    import distributed
    from distributed.comm import get_address_host_port
    from distributed.utils import silence_logging_cmgr

    silent = partial(silence_logging_cmgr, logging.CRITICAL + 1)
    if scheduler is not None:
        with silent("distributed"), silent("distributed.client"):  # its errors are reported in one line
            try:
                get_address_host_port(scheduler)  # a Client with a refused address would wait until its timeout
                client = distributed.Client(scheduler, timeout=PATIENCE, set_as_default=False)
            except (OSError, ValueError) as error:
                why = " ".join(str(error).split())
                raise InputError(f"--scheduler {scheduler}: cannot be reached: {why}") from None
            with client:
                yield client
        return
    with _one_cluster:
        quiet_tracker()  # its start would unblock Ctrl-C in this thread
        with (
            _nobody_imports_main(),
            dask.config.set(LOCAL),
            silent("distributed"),
            silent("distributed.client"),
            ExitStack() as stack,
        ):
            try:
                with whole():
                    cluster = stack.enter_context(_cluster(number))
                    client = stack.enter_context(distributed.Client(cluster, set_as_default=False))
                yield client
            finally:
                with whole():
                    stack.close()


def _cluster(number: int | None) -> Any:
    """New processes on this machine. Raises RunError if one of them dies before all have started."""
    import distributed

    try:
        return distributed.LocalCluster(
            n_workers=number,
            threads_per_worker=1,
            processes=True,
            silence_logs=logging.CRITICAL,
            dashboard_address="127.0.0.1:0",  # a free port; None means 8787, with a warning if it is taken
            preload="kickdrift.ensemble.preload",
        )
    except (RuntimeError, OSError) as error:
        raise RunError(f"ensemble: the workers cannot be started: {_line(error)}") from None
    except KeyboardInterrupt:  # the second Ctrl-C; at exit, Python prints tracebacks of an unfinished cluster
        atexit.unregister(distributed.deploy.spec.close_clusters)
        logging.getLogger("distributed").setLevel(logging.CRITICAL + 1)
        for child in active_children():
            child.kill()
            child.join()
        raise


def quiet_tracker() -> None:
    """Start Python's tracker of semaphores without standard error.

    After the kill of a worker the tracker prints tracebacks of missing semaphores.
    """
    try:
        error = os.dup(2)
    except OSError:  # no standard error
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        resource_tracker.ensure_running()
    finally:
        os.dup2(error, 2)
        os.close(error)
        os.close(nowhere)


@contextmanager
def _nobody_imports_main() -> Iterator[None]:
    """Keep spawned processes from running the user's script again, up to its ``if __name__ == "__main__"``. Members get
    everything that they need from the script by value."""
    main = sys.modules["__main__"]
    hidden: dict[str, Any] = {name: vars(main).pop(name) for name in ("__file__", "__spec__") if name in vars(main)}
    main.__spec__ = None
    try:
        yield
    finally:
        vars(main).update(hidden)


def rows(recipe: Recipe, members: Members, todo: Sequence[int], client: Any) -> Iterator[list[Row]]:
    """Yield the rows of the members with these numbers as they finish. Members that take about TASK_SECONDS together
    form one task.

    If workers die at a task, Dask also gives up their other tasks. Those members become `suspects`: each runs again,
    with no other member at the same time, and is lost if workers still die.
    """
    import distributed

    cargo = packed(recipe)
    for answer in client.run(check, cargo, on_error="return").values():  # or the error of a worker that dies
        if isinstance(answer, InputError):
            raise answer
        if isinstance(answer, ImportError | AttributeError):
            raise InputError(f"ensemble: the workers cannot load the members' code: {answer}")
    left = deque(todo)
    name = f"kickdrift-{uuid.uuid4().hex[:12]}"
    tasks = distributed.as_completed(loop=client.loop)
    sent: dict[str, list[Member]] = {}
    suspects: deque[Member] = deque()
    together, number = 1, count()
    room, looked = 0, -REFRESH
    if recipe.in_turns:  # as many in one call as there are for each thread
        together = min(MOST, -(-len(todo) // max(1, sum(client.nthreads().values()))))

    def send(batch: list[Member]) -> None:
        key = f"{name}-{batch[0].number}-{next(number)}"
        sent[key] = batch
        tasks.add(client.submit(timed_members, cargo, batch, key=key, pure=False))

    def fill() -> None:
        if suspects:
            if not sent:
                send([suspects.popleft()])
            return
        nonlocal room, looked
        if monotonic() - looked >= REFRESH:  # this takes the scheduler as long as a task
            room, looked = AHEAD * max(1, sum(client.nthreads().values())), monotonic()
        while len(sent) < room and (batch := [members[i] for i in taken(left, together)]):
            send(batch)

    client.subscribe_topic(COMPILING, _announced)
    try:
        fill()
        for future in tasks:
            batch, alone = sent.pop(future.key), not sent
            if future.status == "finished":
                found, seconds, least = future.result()
                wanted = int(TASK_SECONDS * len(batch) / seconds)
                least = fair(least, len(left), room // AHEAD)
                together = together if recipe.in_turns else min(max(least, wanted - wanted % least), MOST)
                yield found
            elif future.status != "error":
                raise RunError(f"ensemble: lost the scheduler, with {counted(len(sent) + 1, 'task')} running")
            elif not isinstance(raised := future.exception(), distributed.KilledWorker):
                yield [row_of(member, FAILED, _line(raised)) for member in batch]
            elif alone and len(batch) == 1:
                yield [row_of(batch[0], LOST, "each worker that ran it died")]
            else:
                suspects.extend(batch)
            future.release()
            fill()
    finally:
        client.unsubscribe_topic(COMPILING)
        client.cancel(list(tasks.futures))


def taken(numbers: deque[int], count: int) -> list[int]:
    """Take up to ``count`` numbers from the front."""
    return [numbers.popleft() for _ in range(min(count, len(numbers)))]


def fair(least: int, left: int, threads: int) -> int:
    """Fewer members for a task than ``least``, if there would be none for some thread; whole blocks of lanes stay."""
    share = -(-left // max(1, threads))
    return min(least, max(BLOCK, share - share % BLOCK))


def _announced(event: tuple[Any, Any]) -> None:
    """Announce what a worker compiles."""
    purpose, kept = event[1]
    announce(bool(kept), str(purpose))


def _line(error: BaseException) -> str:
    """One line about an error."""
    return " ".join(f"{type(error).__name__}: {error}".split())
