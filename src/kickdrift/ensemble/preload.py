"""What a worker process of this machine's own does first: Dask runs ``dask_setup`` in it."""

import signal
from typing import Any


def dask_setup(worker: Any) -> None:
    """Leave Ctrl-C, which a terminal sends to all processes, to the one that began the ensemble."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
