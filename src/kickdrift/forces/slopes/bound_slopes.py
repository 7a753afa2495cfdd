"""Slopes of bound forces by address: machine code that adds a force's accelerations at duals to duals."""

from __future__ import annotations

from collections.abc import Callable

from llvmlite import ir
from numba import carray, types
from numba.extending import intrinsic

from kickdrift.forces.slopes.dual_slopes import dual_slopes
from kickdrift.jit.bound import Bound
from kickdrift.jit.duals.dual import SLOT, dual_rows
from kickdrift.jit.handle import Handle, handle_at

_NUMBERS = types.CPointer(types.float64)
SIGNATURE = types.int64(types.intp, types.int64, types.float64, _NUMBERS, _NUMBERS, _NUMBERS)


class BoundSlopes(Bound):
    """A force of one System: its parts, and the machine code of its slopes along eight directions."""

    signature = SIGNATURE

    def _compute_for(self, kind: types.Type) -> Callable[..., int]:
        restore = handle_at(Handle(kind))

        def compute(work, n, t, x, v, a):
            shape = (3 * n * SLOT,)
            xs, vs, slopes = carray(x, shape), carray(v, shape), carray(a, shape)
            return dual_slopes(restore(work), t, dual_rows(xs, n), dual_rows(vs, n), dual_rows(slopes, n))

        return compute


@intrinsic
def call_slopes(typingctx, address, work, n, t, x, v, a):
    """Run the machine code at ``address`` with the parts at ``work``; return a status, NO_DUALS for a force without a
    formula on duals. x, v and a are rows of float64 that hold duals (3, n)."""
    if any(not isinstance(kind, types.Array) or kind.layout != "C" for kind in (x, v, a)):
        return None

    def codegen(context, builder, sig, args):
        whole, double = ir.IntType(64), ir.DoubleType()
        numbers = double.as_pointer()
        kind = ir.FunctionType(whole, [whole, whole, double, numbers, numbers, numbers])
        data = [
            context.make_array(of)(context, builder, array).data
            for of, array in zip(sig.args[4:], args[4:], strict=True)
        ]
        return builder.call(builder.inttoptr(args[0], kind.as_pointer()), [args[1], args[2], args[3], *data])

    return types.int64(types.int64, types.int64, types.int64, types.float64, x, v, a), codegen
