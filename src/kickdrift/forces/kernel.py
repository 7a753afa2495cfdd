"""Forces dispatch on type inside compiled code: one generic ``accelerate``, one compiled body per NamedTuple class.

A force that a user hands over is *bound* to a System first: ``force.bind(system, threads)`` returns a NamedTuple of
numbers and arrays, and the body registered for its class is what the step loop is compiled around.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import types

from kickdrift.jit.compile import jit
from kickdrift.jit.handle import Handle, part
from kickdrift.jit.inner import overload

OK, GROW, BLOWN_UP = 0, 1, 2  # what a force evaluation can end in: done, a list has no room, positions make no sense
RAISED = 4  # Python code inside raised, and no other step is to be tried; 3 is a stepper's STOPPED

KERNELS: dict[type, Any] = {}


def kernel(cls: type) -> Callable[[Callable[..., Any]], Any]:
    """Register the compiled body of a force whose bound form is the NamedTuple class ``cls``.

    The body is ``body(force, t, x, v, a, sums) -> status``: it adds the accelerations (3, n) of positions x and
    velocities v, both (3, n), to ``a``; where ``sums`` is not None it adds the potential energy to ``sums[0]``, the
    virial (the sum of r . F over pairs) to ``sums[1]`` and the number of interacting pairs to ``sums[2]``; it returns
    0, or what went wrong (GROW, BLOWN_UP).
    """

    def register(body: Callable[..., Any]) -> Any:
        KERNELS[cls] = jit(body)
        cls.kernel_sources = (body,)  # type: ignore[attr-defined]
        return KERNELS[cls]

    return register


def accelerate(force: Any, t: float, x: Any, v: Any, a: Any, sums: Any) -> int:
    """Add the accelerations of one bound force, or of a tuple of them, to ``a``; the status of the first that fails."""
    raise NotImplementedError("for compiled code")


@overload(accelerate, forceinline=True)
def _accelerate(force, t, x, v, a, sums):
    kind = force.kind if isinstance(force, Handle) else force  # a force of numbers alone comes by value
    if isinstance(kind, types.BaseNamedTuple):
        return KERNELS[kind.instance_class].py_func
    return sum_of_forces(len(kind))


def sum_of_forces(count: int) -> Callable[..., Any]:
    """The body for a tuple of ``count`` forces."""
    lines = [
        f"    status = accelerate(part(force, {k}), t, x, v, a, sums)\n    if status: return status"
        for k in range(count)
    ]
    scope = {"accelerate": accelerate, "part": part}
    exec("\n".join(["def each(force, t, x, v, a, sums):", *lines, "    return 0"]), scope)
    return scope["each"]
