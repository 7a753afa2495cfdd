"""Numbers packed: those that a mask selects stand side by side, without gaps.

Packing is a compress-store, with the processor's own instructions where it has them. *Places* are an array of int32,
which say where numbers of eight lanes lie in other arrays.
"""

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from kickdrift.jit.compile import features
from kickdrift.jit.lanes.gathering import transposed_rows
from kickdrift.jit.lanes.vectors import F64X8, I32, WIDTH, lanes_type, mask_type
from kickdrift.jit.numba_private import cgutils

_PLACES = ir.VectorType(I32, WIDTH)


def _packed(builder: ir.IRBuilder, numbers: ir.Value, mask: ir.Value) -> ir.Value:
    """Emit the selected numbers of eight, then any numbers."""
    vector = numbers.type
    if "avx512vl" in features():
        kind = ir.FunctionType(vector, [vector, vector, mask.type])
        name = "v8f64" if vector == F64X8 else "v8i32"
        move = cgutils.get_or_insert_function(builder.module, kind, f"llvm.x86.avx512.mask.compress.{name}")
        return builder.call(move, [numbers, numbers, mask])
    memory = cgutils.alloca_once_value(builder, numbers)
    first, made = builder.bitcast(memory, vector.element.as_pointer()), I32(0)
    for k in range(WIDTH):  # each is written, and the place advances if it is selected
        builder.store(builder.extract_element(numbers, I32(k)), builder.gep(first, [made]))
        made = builder.add(made, builder.zext(builder.extract_element(mask, I32(k)), I32))
    return builder.load(memory)


def _at(context: Any, builder: ir.IRBuilder, kind: types.Type, array: Any, index: ir.Value) -> ir.Value:
    data = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), _PLACES.as_pointer())


def _loaded(builder: ir.IRBuilder, pointer: ir.Value) -> ir.Value:
    value = builder.load(pointer)
    value.align = 4
    return value


def _copies(builder: ir.IRBuilder, number: ir.Value) -> ir.Value:
    """Emit a whole number eight times, as int32."""
    one = builder.insert_element(ir.Constant(_PLACES, ir.Undefined), builder.trunc(number, I32), I32(0))
    return builder.shuffle_vector(one, ir.Constant(_PLACES, ir.Undefined), ir.Constant(_PLACES, [0] * WIDTH))


def _write(builder: ir.IRBuilder, numbers: ir.Value, mask: ir.Value, pointer: ir.Value) -> ir.Value:
    """Emit the writing of the selected numbers, and return their count."""
    builder.store(_packed(builder, numbers, mask), pointer).align = 4
    return builder.ctpop(builder.zext(builder.bitcast(mask, ir.IntType(8)), ir.IntType(64)))


@intrinsic
def packed(typingctx, mask, value):
    """The selected lanes side by side from the first lane on; further lanes hold any numbers."""

    def codegen(context, builder, sig, args):
        return _packed(builder, args[1], args[0])

    return lanes_type(mask_type, lanes_type), codegen


@intrinsic
def pack_places(typingctx, target, at, places, first, mask):
    """Write the selected ones of ``places[first:first + 8]`` side by side to ``target`` from ``at`` on. Return their
    number. All eight numbers of the target are written."""

    def codegen(context, builder, sig, args):
        listed = _loaded(builder, _at(context, builder, sig.args[2], args[2], args[3]))
        return _write(builder, listed, args[4], _at(context, builder, sig.args[0], args[0], args[1]))

    return types.int64(target, types.intp, places, types.intp, mask_type), codegen


@intrinsic
def pack_counted(typingctx, target, at, start, mask):
    """Write ``start`` + k for each selected lane k, likewise."""

    def codegen(context, builder, sig, args):
        counted = builder.add(_copies(builder, args[2]), ir.Constant(_PLACES, list(range(WIDTH))))
        return _write(builder, counted, args[3], _at(context, builder, sig.args[0], args[0], args[1]))

    return types.int64(target, types.intp, types.intp, mask_type), codegen


@intrinsic
def fill_places(typingctx, target, at, place):
    """Write the same place to ``target[at:at + 8]``."""

    def codegen(context, builder, sig, args):
        pointer = _at(context, builder, sig.args[0], args[0], args[1])
        builder.store(_copies(builder, args[2]), pointer).align = 4
        return context.get_dummy_value()

    return types.void(target, types.intp, types.intp), codegen


@intrinsic
def transpose_places(typingctx, source, at, stride, target, to):
    """Write eight columns of eight numbers as rows: ``target[to + 8 k + j]`` is ``source[at + stride j + k]``."""

    def codegen(context, builder, sig, args):
        whole, rows = ir.IntType(64), []
        for j in range(WIDTH):
            index = builder.add(args[1], builder.mul(args[2], whole(j)))
            rows.append(_loaded(builder, _at(context, builder, sig.args[0], args[0], index)))
        for k, row in enumerate(transposed_rows(builder, rows)):
            pointer = _at(context, builder, sig.args[3], args[3], builder.add(args[4], whole(WIDTH * k)))
            builder.store(row, pointer).align = 4
        return context.get_dummy_value()

    return types.void(source, types.intp, types.intp, target, types.intp), codegen


@intrinsic
def append_members(typingctx, rows, at, listed, members, start, count, bit, plus):
    """Append selected numbers to a matrix and return their count.

    Selects from the eight whole numbers ``listed[start:start + 8]``, at most ``count``, those whose ``members`` has
    ``bit`` set. Adds ``plus`` to each and writes it to the matrix ``rows`` of two int32, from row ``at`` on. May
    overwrite up to eight rows after the last.
    """
    whole = ir.IntType(64)
    eight = ir.VectorType(whole, WIDTH)

    def codegen(context, builder, sig, args):
        target, source, chosen = (context.make_array(sig.args[k])(context, builder, args[k]).data for k in (0, 2, 3))

        def spread(value):
            one = builder.insert_element(ir.Constant(eight, ir.Undefined), value, I32(0))
            zeros = ir.Constant(ir.VectorType(I32, WIDTH), [0] * WIDTH)
            return builder.shuffle_vector(one, ir.Constant(eight, ir.Undefined), zeros)

        def loaded(data):
            value = builder.load(builder.bitcast(builder.gep(data, [args[4]]), eight.as_pointer()))
            value.align = 8
            return value

        given = builder.icmp_signed("<", ir.Constant(eight, list(range(WIDTH))), spread(args[5]))
        both = builder.and_(loaded(chosen), spread(args[6]))
        mask = builder.and_(given, builder.icmp_unsigned("!=", both, ir.Constant(eight, [0] * WIDTH)))
        pointer = builder.gep(builder.bitcast(target, whole.as_pointer()), [args[1]])
        numbers = builder.add(loaded(source), spread(args[7]))
        pack = _with_avx512 if "avx512f" in features() else _with_avx2 if "avx2" in features() else _one_by_one
        return pack(builder, numbers, mask, pointer)

    return types.int64(rows, types.intp, listed, members, types.intp, types.int64, types.int64, types.int64), codegen


def _with_avx512(builder: ir.IRBuilder, numbers: ir.Value, mask: ir.Value, pointer: ir.Value) -> ir.Value:
    """Write selected numbers side by side from the pointer on, and return their count. AVX-512's instruction moves them
    in a register, and all eight are written: the same instruction to memory takes a hundred cycles on some processors.
    """
    kind = ir.FunctionType(numbers.type, [numbers.type, numbers.type, mask.type])
    move = cgutils.get_or_insert_function(builder.module, kind, "llvm.x86.avx512.mask.compress.v8i64")
    packed = builder.call(move, [numbers, numbers, mask])
    written = builder.store(packed, builder.bitcast(pointer, packed.type.as_pointer()))
    written.align = 8
    return builder.ctpop(builder.zext(builder.bitcast(mask, ir.IntType(8)), ir.IntType(64)))


def _with_avx2(builder: ir.IRBuilder, numbers: ir.Value, mask: ir.Value, pointer: ir.Value) -> ir.Value:
    """The same, four at a time, with a table of permutations."""
    whole, pairs = ir.IntType(64), ir.VectorType(I32, WIDTH)
    kind = ir.FunctionType(pairs, [pairs, pairs])
    permute = cgutils.get_or_insert_function(builder.module, kind, "llvm.x86.avx2.permd")
    orders = [([k for k in range(4) if bits >> k & 1] + 4 * [0])[:4] for bits in range(16)]
    table = ir.Constant(
        ir.ArrayType(pairs, 16),
        [ir.Constant(pairs, [2 * k + part for k in order for part in (0, 1)]) for order in orders],
    )
    place = cgutils.global_constant(builder, "first_of_four", table)
    bits = builder.zext(builder.bitcast(mask, ir.IntType(8)), whole)
    low = builder.and_(bits, whole(15))
    for half, (which, made) in enumerate(((low, whole(0)), (builder.lshr(bits, whole(4)), builder.ctpop(low)))):
        lanes = ir.Constant(ir.VectorType(I32, 4), [4 * half + k for k in range(4)])
        four = builder.bitcast(builder.shuffle_vector(numbers, numbers, lanes), pairs)
        packed = builder.call(permute, [four, builder.load(builder.gep(place, [whole(0), which]))])
        written = builder.store(packed, builder.bitcast(builder.gep(pointer, [made]), pairs.as_pointer()))
        written.align = 8
    return builder.ctpop(bits)


def _one_by_one(builder: ir.IRBuilder, numbers: ir.Value, mask: ir.Value, pointer: ir.Value) -> ir.Value:
    """The same, one after the other: each number is written, and the place advances if it is selected. LLVM's own way
    has eight unpredictable branches."""
    ones, made = builder.zext(mask, numbers.type), ir.IntType(64)(0)
    for k in range(WIDTH):
        written = builder.store(builder.extract_element(numbers, I32(k)), builder.gep(pointer, [made]))
        written.align = 8
        made = builder.add(made, builder.extract_element(ones, I32(k)))
    return made
