"""Members go to Dask's workers a few at a time, and their rows come back as they are done.

Dask keeps the processes, sends the work, and gives the members of a worker that died to another. No more is in flight
than keeps the workers busy, so that an ensemble of any size fits into memory.
"""

from __future__ import annotations

import atexit
import logging
import os
import sys
import uuid
from collections import deque
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from itertools import count, islice
from multiprocessing import active_children, resource_tracker
from time import monotonic
from typing import Any

from kickdrift.disk.interrupt import whole
from kickdrift.ensemble.members import Member, Members
from kickdrift.ensemble.recipe import Recipe
from kickdrift.ensemble.rows import FAILED, LOST, Row, row_of
from kickdrift.ensemble.work import check, packed, timed_members
from kickdrift.errors import InputError, RunError
from kickdrift.text import counted

PATIENCE = 10.0  # seconds for a scheduler to answer
AHEAD = 3  # tasks in flight for each thread of the workers
TASK_SECONDS = 0.4  # members that take less go several in a task, at most MOST
MOST = 64
LOCAL = {  # what Dask does in a cluster of this machine's own
    "distributed.deploy.lost-worker-timeout": "1000 days",  # else a worker that dies while it restarts is no more
    "distributed.worker.profile.enabled": False,  # nobody looks, and it takes time from the members
    "distributed.admin.tick.interval": "2s",
    "distributed.admin.system-monitor.interval": "2s",
    "distributed.scheduler.work-stealing-interval": "1s",
    "distributed.scheduler.active-memory-manager.start": False,
}
REFRESH = 1.0  # seconds after which the workers are counted again


@contextmanager
def workers(number: int | None = None, scheduler: str | None = None) -> Iterator[Any]:
    """A client of the scheduler at that address, or of ``number`` new processes on this machine, one for each core
    unless told; they are started by spawn, have one thread each, and end with the context."""
    import dask
    import distributed
    from distributed.comm import get_address_host_port
    from distributed.utils import silence_logging_cmgr

    silent = partial(silence_logging_cmgr, logging.CRITICAL + 1)
    if scheduler is not None:
        with silent("distributed"), silent("distributed.client"):  # its errors are told in one line
            try:
                get_address_host_port(scheduler)  # a Client that was refused an address would wait for it to the end
                client = distributed.Client(scheduler, timeout=PATIENCE, set_as_default=False)
            except (OSError, ValueError) as error:
                why = " ".join(str(error).split())
                raise InputError(f"--scheduler {scheduler}: cannot be reached: {why}") from None
            with client:
                yield client
        return
    quiet_tracker()  # where it starts it lets this thread hear Ctrl-C
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
    """New processes on this machine; a RunError where one of them dies before all are there."""
    import distributed

    try:
        return distributed.LocalCluster(
            n_workers=number,
            threads_per_worker=1,
            processes=True,
            silence_logs=logging.CRITICAL,
            dashboard_address="127.0.0.1:0",  # one that is free; None means 8787, and a warning where it is taken
            preload="kickdrift.ensemble.preload",
        )
    except (RuntimeError, OSError) as error:
        raise RunError(f"ensemble: the workers cannot be started: {_line(error)}") from None
    except KeyboardInterrupt:  # the second; at the end of Python a cluster that is not there yet prints tracebacks
        atexit.unregister(distributed.deploy.spec.close_clusters)
        logging.getLogger("distributed").setLevel(logging.CRITICAL + 1)
        for child in active_children():
            child.kill()
            child.join()
        raise


def quiet_tracker() -> None:
    """Start the process in which Python tracks semaphores, with no standard error.

    After a worker was killed that process prints tracebacks of semaphores that are gone.
    """
    try:
        error = os.dup(2)
    except OSError:  # there is no standard error
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
    """A process that is spawned would run the user's script once more, up to its ``if __name__ == "__main__"``: what
    members need of it comes to them by value, so it does not have to."""
    main = sys.modules["__main__"]
    hidden: dict[str, Any] = {name: vars(main).pop(name) for name in ("__file__", "__spec__") if name in vars(main)}
    main.__spec__ = None
    try:
        yield
    finally:
        vars(main).update(hidden)


def rows(recipe: Recipe, members: Members, todo: Iterable[int], client: Any) -> Iterator[list[Row]]:
    """The rows of the members with these numbers, as they are done; as many go together as take about TASK_SECONDS.

    When workers die at a task, and take others with them, Dask gives up all that they were to do. Those members are
    `suspects`: each runs again, one at a time with no other under way, and is lost where workers still die at it.
    """
    import distributed

    cargo = packed(recipe)
    for answer in client.run(check, cargo, on_error="return").values():  # of one that dies meanwhile, how it died
        if isinstance(answer, InputError):
            raise answer
        if isinstance(answer, ImportError | AttributeError):
            raise InputError(f"ensemble: the workers cannot load the members' code: {answer}")
    left = iter(todo)
    name = f"kickdrift-{uuid.uuid4().hex[:12]}"
    tasks = distributed.as_completed(loop=client.loop)
    sent: dict[str, list[Member]] = {}
    suspects: deque[Member] = deque()
    together, number = 1, count()
    room, looked = 0, -REFRESH

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
        if monotonic() - looked >= REFRESH:  # which takes the scheduler as long as a task
            room, looked = AHEAD * max(1, sum(client.nthreads().values())), monotonic()
        while len(sent) < room and (batch := [members[i] for i in islice(left, together)]):
            send(batch)

    try:
        fill()
        for future in tasks:
            batch, alone = sent.pop(future.key), not sent
            if future.status == "finished":
                found, seconds, least = future.result()
                wanted = int(TASK_SECONDS * len(batch) / seconds)
                together = min(max(least, wanted - wanted % least), MOST)
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
        client.cancel(list(tasks.futures))


def _line(error: BaseException) -> str:
    """What went wrong, in one line."""
    return " ".join(f"{type(error).__name__}: {error}".split())
