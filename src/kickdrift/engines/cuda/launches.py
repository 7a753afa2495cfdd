"""Launches of kernels, one after another, and graphs of launches.

A launch by numba costs the processor more time than a small kernel takes. A graph of CUDA holds many launches, and the
driver starts it as one.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Any

import numpy as np
from numba import config, cuda

THREADS = 32 if config.ENABLE_CUDASIM else 128  # of a block


class Launches:
    """A queue of the device, and the graphs of its repeated work."""

    def __init__(self) -> None:
        self.stream = cuda.stream()
        self._done: set[Hashable] = set()
        self._graphs: dict[Hashable, Any] = {}

    def over(self, count: int, kernel: Any, *args: Any) -> None:
        """Launch a kernel with one thread for each of ``count``."""
        self.grid(max(1, -(-count // THREADS)), THREADS, kernel, *args)

    def grid(self, blocks: Any, threads: int, kernel: Any, *args: Any) -> None:
        """Launch a kernel on a grid."""
        kernel[blocks, threads, self.stream](*args)

    def read(self, array: Any) -> Any:
        """Copy of an array, after all that was launched before."""
        found = array.copy_to_host(stream=self.stream)
        self.stream.synchronize()
        return found

    def repeat(self, key: Hashable, work: Callable[[], None]) -> None:
        """Do work that launches the same kernels with the same arguments whenever its key is the same.

        The first time compiles the kernels, the second makes a graph, and later times launch this graph."""
        if config.ENABLE_CUDASIM or key not in self._done:
            work()
            self._done.add(key)
            return
        if key not in self._graphs:
            self._graphs[key] = self._graph(work)
        from cuda.bindings import driver

        _checked(driver.cuGraphLaunch(self._graphs[key], self._handle))

    def forget(self) -> None:
        """Forget all graphs: arrays that they use are gone."""
        self._graphs.clear()

    @property
    def _handle(self) -> Any:
        from cuda.bindings import driver

        return driver.CUstream(int(self.stream.handle))

    def _graph(self, work: Callable[[], None]) -> Any:
        from cuda.bindings import driver

        mode = driver.CUstreamCaptureMode.CU_STREAM_CAPTURE_MODE_RELAXED
        _checked(driver.cuStreamBeginCapture(self._handle, mode))
        work()
        graph = _checked(driver.cuStreamEndCapture(self._handle))
        return _checked(driver.cuGraphInstantiate(graph, 0))


def _checked(result: tuple[Any, ...]) -> Any:
    """The value of a call of the driver. Raises RuntimeError for an error."""
    status, *values = result
    if int(status):
        raise RuntimeError(f"CUDA driver: {status.name}")
    return values[0] if values else None


def zeros(shape: Any, kind: Any) -> Any:
    """Array of zeros on the device."""
    return cuda.to_device(np.zeros(shape, kind))
