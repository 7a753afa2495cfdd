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

    def least(number: Any) -> Any:
        """The least number of the threads."""
        return number

    def together() -> None:
        """Wait for the threads, so that each sees what others wrote to shared memory."""

else:
    from itertools import count

    from numba.cuda.extending import intrinsic
    from numba.np.numpy_support import from_dtype

    COUNTER = count()

    @cuda.jit(device=True)
    def votes(hit):
        """Threads of the warp with a hit, as bits."""
        return np.uint32(cuda.ballot_sync(ALL, hit))

    @cuda.jit(device=True)
    def told(number, thread):
        """The number of a thread of the warp."""
        return cuda.shfl_sync(ALL, number, thread)

    @cuda.jit(device=True)
    def least(number):
        """The least number of the warp's threads."""
        step = WARP // 2
        while step > 0:
            number = min(number, cuda.shfl_xor_sync(ALL, number, step))
            step //= 2
        return number

    @cuda.jit(device=True)
    def together():
        """Wait for the warp's threads, so that each sees what others wrote to shared memory."""
        cuda.syncwarp()

    def shared_numbers(size: int, kind: Any) -> Any:
        """Device function that returns an array in shared memory, which begins at a multiple of 16 bytes."""

        @intrinsic
        def numbers(typingctx):
            found = types.Array(from_dtype(np.dtype(kind)), 1, "C")

            def codegen(context, builder, signature, args):
                each = context.get_data_type(found.dtype)
                memory = ir.ArrayType(each, size)
                place = ir.GlobalVariable(builder.module, memory, f"shared_numbers_{next(COUNTER)}", addrspace=3)
                place.align, place.initializer = 16, ir.Constant(memory, ir.Undefined)
                data = builder.addrspacecast(place, ir.PointerType(ir.IntType(8)))
                array, bytes_each = context.make_array(found)(context, builder), np.dtype(kind).itemsize
                whole = [context.get_constant(types.intp, number) for number in (size, bytes_each)]
                context.populate_array(
                    array, data=builder.bitcast(data, array.data.type), shape=whole[:1], strides=whole[1:],
                    itemsize=whole[1], meminfo=None,
                )  # fmt: skip
                return array._getvalue()

            return found(), codegen

        return numbers

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
