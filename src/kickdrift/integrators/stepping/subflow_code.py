"""Further flows as machine code, which the loop of splitting methods calls by address."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import carray, types
from numba.extending import intrinsic

from kickdrift.jit.compile import jit
from kickdrift.jit.handle import Bound, Handle, handle_at

_NUMBERS = types.CPointer(types.float64)
BODIES: dict[type, Any] = {}  # compiled bodies by the NamedTuple class of the parts


def subflow_body(parts: type) -> Callable[[Callable[..., int]], Callable[..., int]]:
    """Register the body of the flows whose parts are that NamedTuple class; see ``BoundSubflow``."""

    def register(body: Callable[..., int]) -> Callable[..., int]:
        BODIES[parts] = jit(body)
        parts.kernel_sources = (body,)  # type: ignore[attr-defined]
        return body

    return register


class BoundSubflow(Bound):
    """A flow of one run: its parts, and the machine code that lets it act.

    ``body(parts, t, x, v, span, step, stage) -> status`` lets the flow act on positions and velocities, both (3, n),
    for the time ``span`` from ``t`` on. ``step`` and ``stage`` are whole numbers: how many steps were done before, and
    the place in ``Splitting.stages``, another for each time that the flow acts in a step. A status other than 0 stops
    the run.
    """

    signature = types.int64(
        types.intp, types.int64, types.float64, types.float64, types.int64, types.int64, _NUMBERS, _NUMBERS
    )

    def _compute_for(self, kind: types.Type) -> Callable[..., int]:
        restore, body = handle_at(Handle(kind)), BODIES[type(self.parts)]

        def compute(work, n, t, span, step, stage, x, v):
            return body(restore(work), t, carray(x, (3, n)), carray(v, (3, n)), span, step, stage)

        return compute


@intrinsic
def call_subflow(typingctx, address, work, t, span, step, stage, x, v):
    """Let the flow at ``address`` with the parts at ``work`` act on x and v, contiguous arrays (3, n); a status."""

    def codegen(context, builder, sig, args):
        whole, double = ir.IntType(64), ir.DoubleType()
        numbers = double.as_pointer()
        kind = ir.FunctionType(whole, [whole, whole, double, double, whole, whole, numbers, numbers])
        at, velocities = (context.make_array(sig.args[k])(context, builder, args[k]) for k in (6, 7))
        n = builder.extract_value(at.shape, 1)
        where = builder.inttoptr(args[0], kind.as_pointer())
        return builder.call(where, [args[1], n, *args[2:6], at.data, velocities.data])

    return types.int64(address, work, types.float64, types.float64, types.int64, types.int64, x, v), codegen


# Steps done in this call, next stage, whether `work` holds the derivative at y (with groups of forces a bit for each
# group), rejected steps.
STEP, STAGE, FRESH, REJECTED = 1, 2, 3, 4
