"""Setup of a local worker process: Dask runs ``dask_setup`` in it."""

import signal
from typing import Any


def dask_setup(worker: Any) -> None:
    """Ignore Ctrl-C, which a terminal sends to all processes. The process that started the ensemble handles it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
