"""Does an ensemble end in the same table when workers are killed while it runs?

A scheduler and two nannies of Dask's are started as programs of their own, as on a cluster, and an ensemble runs
through them by its address. Meanwhile one of the worker processes that the nannies keep is killed by SIGKILL at random
times. In the end all members must be done, and the table must be that of an ensemble on this machine that nothing was
done to, to the last bit, but for the wall time.
"""

import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from time import monotonic, sleep

import numpy as np
import psutil
from distributed import Client

import kickdrift as kd
from kickdrift_validation.claim import Claim, claim, main

SHORT, LONG = (120, 5), (500, 20)  # members, kills
WORKERS, SEED, PATIENCE = 2, 1, 60.0
STEPS, EVERY = 1_000_000, 100_000  # about 0.1 s


def ensemble(members: int) -> kd.Ensemble:
    """Three bodies on a figure of eight, pushed a little: each member its own way."""
    vary = {"particles.positions[0][0]": f"normal:0.97000436:{1e-3}"}
    return kd.Ensemble(
        "figure-eight", vary, replicas=members, seed=SEED, integrator="leapfrog", dt=1e-3, steps=STEPS, every=EVERY
    )


@contextmanager
def program(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    """A program that runs until the end of the context."""
    process = subprocess.Popen(
        [sys.executable, "-m", *arguments], stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL, text=True
    )
    try:
        yield process
    finally:
        process.terminate()
        process.wait()


@contextmanager
def cluster(folder: Path) -> Iterator[tuple[str, list[int]]]:
    """The address of a scheduler with workers, each in processes of their own, and the nannies' process numbers."""
    address_file = folder / "scheduler.json"
    with ExitStack() as stack:
        stack.enter_context(
            program("distributed.cli.dask_scheduler", "--port", "0", "--host", "127.0.0.1", "--dashboard-address",
                    "127.0.0.1:0", "--scheduler-file", str(address_file))
        )  # fmt: skip
        until = monotonic() + PATIENCE
        while not address_file.exists():
            assert monotonic() < until, "the scheduler does not start"
            sleep(0.05)
        nannies = [
            stack.enter_context(
                program("distributed.cli.dask_worker", "--scheduler-file", str(address_file), "--nthreads", "1",
                        "--no-dashboard", "--local-directory", str(folder))
            ).pid
            for _ in range(WORKERS)
        ]  # fmt: skip
        yield json.loads(address_file.read_text())["address"], nannies


def kill_at_random(nannies: list[int], kills: int, between: float, over: threading.Event, killed: list[int]) -> None:
    """Kill one worker now and then, about ``between`` and at most 1.5 times as many seconds apart, until that many are
    dead."""
    rng = np.random.default_rng(SEED)
    while len(killed) < kills and not over.wait(min(rng.exponential(between), 1.5 * between)):
        children = [child for nanny in nannies for child in psutil.Process(nanny).children()]
        workers = [child.pid for child in children if "spawn_main" in " ".join(child.cmdline())]
        if workers:
            killed.append(int(rng.choice(workers)))
            os.kill(killed[-1], signal.SIGKILL)


def claims(long: bool = False) -> Iterator[Claim]:
    """What is left of an ensemble whose workers die."""
    members, kills = LONG if long else SHORT
    planned = ensemble(members)
    began = monotonic()
    truth = planned.run(workers=WORKERS)
    seconds = monotonic() - began
    over, killed = threading.Event(), []
    with (
        tempfile.TemporaryDirectory() as folder,
        cluster(Path(folder)) as (address, nannies),
        Client(address) as client,
    ):
        client.wait_for_workers(WORKERS)
        killer = threading.Thread(target=kill_at_random, args=(nannies, kills, seconds / kills / 2, over, killed))
        killer.start()
        found = planned.run(client)
        over.set()
        killer.join()
    yield claim(f"workers killed while {members} members ran", len(killed), f"{kills}", len(killed) == kills, "SIGKILL")
    done = int((found["status"] == "done").sum())
    yield claim(f"members done, of {members}", done, f"all {members}", done == members, "the table's status")
    columns = [name for name in truth.columns if name != "wall_seconds"]
    same = found[columns].equals(truth[columns])
    reference = "the ensemble whose workers lived"
    yield claim("the table is the same to the last bit", "yes" if same else "no", "yes", same, reference)


if __name__ == "__main__":
    main(claims, __doc__)
