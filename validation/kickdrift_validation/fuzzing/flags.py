"""What a child tells the worker that watches it, through shared memory: whether it compiles, or computes a run."""

import struct
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from mmap import mmap
from time import process_time
from typing import Any

COMPILED, COMPILING, COMPUTING = 0, 1, 2
# Where long work begins: (module, class or "", function).
WORK = (
    ("kickdrift.run.simulation", "Simulation", "run"), ("kickdrift.run.simulation", "Simulation", "equilibrate"),
    ("kickdrift.analysis.chaos.megno", "", "megno"),
    ("kickdrift.analysis.compare.work_precision", "", "work_precision"),
    ("kickdrift.analysis.compare.work_precision", "", "equilibrated"), ("kickdrift.ensemble", "Ensemble", "run"),
    ("kickdrift.analysis.derivatives.transits", "", "transits"),
    ("kickdrift.analysis.certify.force_testing", "", "force_checks"),
    ("kickdrift.analysis.certify.certifying", "", "engine_checks"), ("kickdrift.plots.movie", "", "movie"),
    ("kickdrift.analysis.compare.bench", "", "plan"), ("kickdrift.analysis.compare.bench", "", "lj_energy"),
)  # fmt: skip


class Flags:
    """What a child tells: seconds of compiling so far, whether it is compiling, and whether it is computing a run."""

    def __init__(self) -> None:
        self.renew()

    def renew(self) -> None:
        """Memory that is shared with children that are forked from now on."""
        self._map = mmap(-1, 64)

    def clear(self) -> None:
        self._map[:24] = bytes(24)

    def __getitem__(self, k: int) -> float:
        return float(struct.unpack_from("d", self._map, 8 * k)[0])

    def __setitem__(self, k: int, value: float) -> None:
        struct.pack_into("d", self._map, 8 * k, value)


FLAGS = Flags()


def mark_work() -> None:
    """Have long work say that it has begun."""

    def marked(function: Callable[..., Any]) -> Callable[..., Any]:
        def inner(*arguments: Any, **options: Any) -> Any:
            FLAGS[COMPUTING] += 1
            try:
                return function(*arguments, **options)
            finally:
                FLAGS[COMPUTING] -= 1

        return inner

    for module, owner, name in WORK:
        with suppress(ImportError, AttributeError):
            place = import_module(module)
            place = getattr(place, owner) if owner else place
            setattr(place, name, marked(getattr(place, name)))


def listen_to_compiler() -> None:
    """Have numba say when it compiles, so that the first use of a method on a machine is no hang."""
    from numba.core import event

    class Listener(event.Listener):
        began = 0.0

        def on_start(self, event: Any) -> None:
            self.began, FLAGS[COMPILING] = process_time(), 1.0

        def on_end(self, event: Any) -> None:
            FLAGS[COMPILED] += process_time() - self.began
            FLAGS[COMPILING] = 0.0

    event.register("numba:compiler_lock", Listener())
