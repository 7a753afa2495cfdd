"""Loads of 16 bytes at once, which numba does not make from two loads of 8."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import config, types

if config.ENABLE_CUDASIM:

    def two_at(array: Any, place: Any) -> tuple[Any, Any]:
        """The numbers at an even place and after it."""
        return array[place], array[place + 1]

else:
    from numba.cuda.extending import intrinsic

    @intrinsic
    def two_at(typingctx, array, place):
        """The numbers of 64 bits at an even place, a uint32, and after it."""
        two = types.UniTuple(array.dtype, 2)

        def codegen(context, builder, sig, args):
            data = context.make_array(sig.args[0])(context, builder, args[0]).data
            pair = ir.VectorType(context.get_data_type(array.dtype), 2)
            address = builder.gep(data, [builder.zext(args[1], ir.IntType(64))])
            loaded = builder.load(builder.bitcast(address, pair.as_pointer()))
            loaded.align = 16
            parts = [builder.extract_element(loaded, ir.IntType(32)(k)) for k in range(2)]
            return context.make_tuple(builder, two, parts)

        return two(array, types.uint32), codegen
