"""Cost of an ensemble beside its runs, and gain from two workers.

Members are three bodies on a figure of eight, each pushed a little, run one by one (a function is measured on each).
With members of about 0.1 s, one worker and two workers take turns. The figure is the median of the ratios in the same
round. The cost of a member is the wall time of one worker less the time of the runs, over the number of members. This
cost includes reading the file, setting up, the samples' report, and Dask. 10,000 members (1000 in the short set) of
10 ms show whether memory stays bounded. The script compares the resident memory of its process and of the workers at
a tenth of the way and at the end.
"""

from collections.abc import Iterator
from contextlib import ExitStack
from time import perf_counter
from typing import Any

import numpy as np
import psutil

import kickdrift as kd
from kickdrift.ensemble.running import workers
from kickdrift_validation.claim import Claim, at_least, main, under

STEPS_A_SECOND = 8_000_000  # about
ROUNDS, MEMBERS = 5, 60
GAIN, COST, GROWTH = 1.8, 10.0, 1.5  # times, ms a member, times the memory


def last(sim: kd.Simulation) -> float:
    """Return where a body ends. Any function makes members run one by one."""
    return float(sim.state.positions[0, 0])


def ensemble(members: int, seconds: float) -> kd.Ensemble:
    """An ensemble of runs of about this many seconds."""
    steps = round(seconds * STEPS_A_SECOND)
    vary = {"particles.positions[0][0]": "normal:0.97000436:0.001"}
    return kd.Ensemble(
        "figure-eight", vary, replicas=members, measure=last, integrator="leapfrog", dt=1e-3, steps=steps, every=steps
    )


def timed(planned: kd.Ensemble, client: Any, progress: Any = None) -> tuple[float, float]:
    """Seconds of wall time, and seconds of the runs of all members together."""
    began = perf_counter()
    table = planned.run(client, progress=progress)
    assert (table["status"] == "done").all()
    return perf_counter() - began, float(table["wall_seconds"].sum())


def memory() -> np.ndarray:
    """Memory of this process and of its largest worker, in MB."""
    own = psutil.Process()
    kept = [child.memory_info().rss for child in own.children(recursive=True)]
    return np.array([own.memory_info().rss, max(kept)]) / 1e6


def claims(long: bool = False) -> Iterator[Claim]:
    with ExitStack() as stack:
        one, two = (stack.enter_context(workers(count)) for count in (1, 2))
        for client in (one, two):
            timed(ensemble(8, 0.1), client)  # compiles and loads everything
        planned = ensemble(MEMBERS, 0.1)
        pairs = [(timed(planned, one), timed(planned, two)) for _ in range(ROUNDS)]
    gains = [alone[0] / together[0] for alone, together in pairs]
    costs = [1e3 * (alone[0] - alone[1]) / MEMBERS for alone, _ in pairs]
    run = 1e3 * float(np.median([alone[1] for alone, _ in pairs])) / MEMBERS
    gain, cost = float(np.median(gains)), float(np.median(costs))
    print(f"  a run takes {run:.0f} ms; gains {np.round(gains, 2)}; costs {np.round(costs, 1)} ms")
    yield at_least(f"members of {run:.0f} ms: two workers over one", gain, GAIN, "one worker, in turns")
    yield under("a member beside its run, ms", cost, COST, "the runs' own wall time")
    count = 10_000 if long else 1000
    early: list[np.ndarray] = []

    def look(done: int, of: int, failed: int) -> None:
        if done >= of // 10 and not early:
            early.append(memory())

    with workers(2) as client:
        seconds, spent = timed(ensemble(count, 0.01), client, look)
        end = memory()
    print(f"  {count} members of {1e3 * spent / count:.0f} ms in {seconds:.0f} s; MB of this process and of a worker:")
    print(f"  {np.round(early[0])} at {count // 10}, {np.round(end)} at the end")
    grown = float((end / early[0]).max())
    yield under(f"memory after {count} members over that after {count // 10}", grown, GROWTH, "resident memory")


if __name__ == "__main__":
    main(claims, __doc__)
