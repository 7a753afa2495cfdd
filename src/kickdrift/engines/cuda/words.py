"""Loads and stores of 16 bytes at once, which numba does not make from smaller ones; votes and words of a warp.

In numba's simulator a warp has one thread.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import config, cuda, types

WARP = 1 if config.ENABLE_CUDASIM else 32
ALL = 0xFFFFFFFF  # threads of a warp

if config.ENABLE_CUDASIM:

    def loaded(array: Any, place: Any) -> tuple[Any, ...]:
        """The two or four numbers of the 16 bytes at a place."""
        many = 16 // array.itemsize
        return tuple(array[many * int(place) + k] for k in range(many))

    def store(array: Any, place: Any, a: Any, b: Any, c: Any, d: Any) -> None:
        """Write the four numbers of the 16 bytes at a place."""
        array[4 * place], array[4 * place + 1], array[4 * place + 2], array[4 * place + 3] = a, b, c, d

    def numbers_in(kind: Any, first: int, columns: int) -> Any:
        """Function of a flat table and a row that returns a NamedTuple of the numbers from a column on."""
        return lambda table, row: kind(*table[int(row) * columns + first :][: len(kind._fields)])

    def votes(hit: Any) -> Any:
        """Threads with a hit, as bits."""
        return np.uint32(1 if hit else 0)

    def told(number: Any, thread: Any) -> Any:
        """The number of a thread."""
        return number

else:
    from numba.cuda.extending import intrinsic

    @cuda.jit(device=True)
    def votes(hit):
        """Threads of the warp with a hit, as bits."""
        return np.uint32(cuda.ballot_sync(ALL, hit))

    @cuda.jit(device=True)
    def told(number, thread):
        """The number of a thread of the warp."""
        return cuda.shfl_sync(ALL, number, thread)

    def _address(context: Any, builder: Any, signature: Any, args: Any) -> tuple[Any, int]:
        """Address of the 16 bytes at a place, and how many numbers they are."""
        kind, many = signature.args[0], 128 // signature.args[0].dtype.bitwidth
        data = context.make_array(kind)(context, builder, args[0]).data
        bytes16 = ir.VectorType(context.get_data_type(kind.dtype), many).as_pointer()
        return builder.gep(builder.bitcast(data, bytes16), [builder.zext(args[1], ir.IntType(64))]), many

    @intrinsic
    def loaded(typingctx, array, place):
        """The two or four numbers of the 16 bytes at a place, a uint32."""
        numbers = types.UniTuple(array.dtype, 128 // array.dtype.bitwidth)

        def codegen(context, builder, signature, args):
            address, many = _address(context, builder, signature, args)
            found = builder.load(address)
            found.align = 16
            parts = [builder.extract_element(found, ir.IntType(32)(k)) for k in range(many)]
            return context.make_tuple(builder, numbers, parts)

        return numbers(array, types.uint32), codegen

    @intrinsic
    def store(typingctx, array, place, a, b, c, d):
        """Write the four numbers of the 16 bytes at a place, a uint32."""

        def codegen(context, builder, signature, args):
            address, many = _address(context, builder, signature, args)
            value = ir.Constant(address.type.pointee, ir.Undefined)
            for k in range(many):
                value = builder.insert_element(value, args[2 + k], ir.IntType(32)(k))
            builder.store(value, address).align = 16
            return context.get_dummy_value()

        return types.none(array, types.uint32, *4 * (array.dtype,)), codegen

    def numbers_in(kind: Any, first: int, columns: int) -> Any:
        """Device function of a flat table and a row, a uint32, that returns numbers from a column on."""

        @intrinsic
        def numbers(typingctx, table, row):
            found = types.NamedUniTuple(table.dtype, len(kind._fields), kind)

            def codegen(context, builder, signature, args):
                data = context.make_array(signature.args[0])(context, builder, args[0]).data
                begin = builder.mul(builder.zext(args[1], ir.IntType(64)), ir.IntType(64)(columns))
                places = [builder.add(begin, ir.IntType(64)(first + k)) for k in range(len(kind._fields))]
                parts = [builder.load(builder.gep(data, [place])) for place in places]
                return context.make_tuple(builder, found, parts)

            return found(table, types.uint32), codegen

        return numbers
