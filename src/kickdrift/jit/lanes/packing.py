"""Compress-store: write the numbers selected by a mask side by side, with the processor's own instructions."""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from kickdrift.jit.compile import features
from kickdrift.jit.lanes.vectors import I32, WIDTH
from kickdrift.jit.numba_private import cgutils


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
