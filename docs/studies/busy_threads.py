"""Two threads over one on a machine whose cores are all busy.

    python -m docs.studies.busy_threads [--turns 15] [--seconds 0.2]

Meanwhile as many processes as there are cores count without end. The liquid is that of liquids.py, at three sizes. The
same run on one and on two threads takes turns (A B A B …) in one process. A figure is the median of the ratios of
neighbouring turns.
"""

import argparse
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from kickdrift.jit.threads.chunks import team_of
from kickdrift_validation.claim import Claim, claim, show, where
from kickdrift_validation.performance.liquids import again, melt
from kickdrift_validation.performance.turns import Native, ratio_of, turns

SIZES = (10**3, 22**3, 46**3)
MELT, LEAST = 100, 0.9


@contextmanager
def busy() -> Iterator[int]:
    """Run one counting process for each core, and yield their number."""
    count = len(os.sched_getaffinity(0))
    hogs = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield count
    finally:
        for each in hogs:
            each.kill()
            each.wait()


def claims(count: int = 15, seconds: float = 0.2) -> Iterator[Claim]:
    for n in SIZES:
        one = melt(n, MELT)
        two = again(one, 2)
        with busy() as hogs:
            found = turns([Native(one), Native(two)], seconds, count)
        ratio = ratio_of(found[:, 1], found[:, 0])
        print(f"  {n}: {ratio.low:.3f} to {ratio.high:.3f}; {team_of(2).helped} chunks by the second thread so far")
        text = f"{n} particles beside {hogs} processes that count: speed of two threads over one's"
        yield claim(text, ratio.median, f"at least {LEAST}", ratio.median >= LEAST, f"{count} turns")


def main() -> int:
    """Measure with the given options and print the claims."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--turns", type=int, default=15, help="of each")
    parser.add_argument("--seconds", type=float, default=0.2, help="length of a turn")
    given = parser.parse_args()
    print(where(), flush=True)
    return show(list(claims(given.turns, given.seconds)))


if __name__ == "__main__":
    sys.exit(main())
