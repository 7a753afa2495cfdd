"""The compiled laws of tables.

A gather of four numbers for each of eight lanes costs more than a pair of Lennard-Jones, so the pairs of a step without
a sample read one row each.
"""

import math

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from kickdrift.forces.tables.layout import EDGE, LISTED_ROW, PAIR_ROW, SHIFT
from kickdrift.jit.compile import as_written
from kickdrift.jit.duals import functions as functions  # what duals take part in
from kickdrift.jit.duals.lanes import value_of
from kickdrift.jit.lanes.functions import lanes_like
from kickdrift.jit.lanes.gathering import transposed_fours
from kickdrift.jit.lanes.masks import select
from kickdrift.jit.lanes.vectors import F64, I32, Lanes, copied

NAN = math.nan
WHOLE = ir.IntType(64)
MANTISSA = (1 << 52) - 1


def _constant(vector: ir.VectorType, value: int) -> ir.Constant:
    return ir.Constant(ir.VectorType(WHOLE, vector.count), [value] * vector.count)


def _pointers(builder: ir.IRBuilder, base: ir.Value, r2: ir.Value, kind: ir.Type, size: int) -> list[ir.Value]:
    """Pointers to the cells of r2. ``base`` are lanes of MARK plus the address of cell 0, whose size is in bytes."""
    whole = ir.VectorType(WHOLE, r2.type.count)
    cells = builder.lshr(builder.bitcast(r2, whole), _constant(r2.type, SHIFT))
    address = builder.and_(builder.bitcast(base, whole), _constant(r2.type, MANTISSA))
    address = builder.add(address, builder.mul(cells, _constant(r2.type, size)))
    return [builder.inttoptr(builder.extract_element(address, I32(k)), kind.as_pointer()) for k in range(r2.type.count)]


def _base(rows: types.Type, r2: Lanes) -> types.Type:
    return types.float64 if isinstance(rows, types.Number) else r2


def _spread(builder: ir.IRBuilder, base: ir.Value, vector: ir.VectorType) -> ir.Value:
    return base if base.type == vector else copied(builder, base, vector)


@intrinsic
def cell_start(typingctx, r2):
    """Return the left end of the cell of each r2."""

    def codegen(context, builder, sig, args):
        whole = builder.bitcast(args[0], ir.VectorType(WHOLE, args[0].type.count))
        kept = builder.and_(whole, _constant(args[0].type, -1 << SHIFT))
        return builder.bitcast(kept, args[0].type)

    return r2(r2), codegen


@intrinsic
def rows_of_cells(typingctx, rows, r2):
    """Return lanes of the four numbers in the row of the cell of each r2."""

    def codegen(context, builder, sig, args):
        base, found = _spread(builder, args[0], args[1].type), []
        for pointer in _pointers(builder, base, args[1], ir.VectorType(F64, PAIR_ROW), 8 * PAIR_ROW):
            row = builder.load(pointer)
            row.align = 32
            found.append(row)
        return context.make_tuple(builder, sig.return_type, transposed_fours(builder, found))

    return types.UniTuple(r2, PAIR_ROW)(_base(rows, r2), r2), codegen


@intrinsic
def energies_of_cells(typingctx, energies, r2):
    """Return lanes of the energy at the left end of the cell of each r2."""

    def codegen(context, builder, sig, args):
        base, made = _spread(builder, args[0], args[1].type), ir.Constant(args[1].type, ir.Undefined)
        for lane, pointer in enumerate(_pointers(builder, base, args[1], F64, 8)):
            made = builder.insert_element(made, builder.load(pointer), I32(lane))
        return made

    return r2(_base(energies, r2), r2), codegen


@as_written
def pair_table(p, r2):
    """See `PairTable`: nan nearer than the table's start. Beyond its end no pair counts."""
    s = value_of(r2)
    first, last = lanes_like(p.first, s), lanes_like(p.last, s)
    s = select(s < last, s, last)
    s = select(s > first, s, first)
    d = r2 - cell_start(s)
    c0, c1, c2, c3 = rows_of_cells(p.rows, s)
    energy = energies_of_cells(p.energies, s)
    energy = energy - d * (0.5 * c0 + d * (0.25 * c1 + d * (c2 * (1.0 / 6.0) + d * (0.125 * c3))))
    return energy, c0 + d * (c1 + d * (c2 + d * c3))


@intrinsic
def row_at(typingctx, rows, cell):
    """Return the first six numbers of a row."""

    def codegen(context, builder, sig, args):
        base = builder.and_(builder.bitcast(args[0], WHOLE), WHOLE(MANTISSA))
        row = builder.inttoptr(builder.add(base, builder.mul(args[1], WHOLE(8 * LISTED_ROW))), F64.as_pointer())
        found = [builder.load(builder.gep(row, [WHOLE(k)])) for k in range(6)]
        return context.make_tuple(builder, sig.return_type, found)

    return types.UniTuple(types.float64, 6)(types.float64, types.int64), codegen


@as_written
def listed_table(p, x):
    """See `ListedTable`: nan beyond the table's ends."""
    at = (value_of(x) - p.first) * p.per
    inside = at >= -EDGE and at <= p.last + 1.0 + EDGE
    cell = int(min(max(math.floor(at), 0.0), p.last)) if inside else 0
    missing = 0.0 if inside else NAN
    q = (x - p.first) * p.per - cell
    c0, c1, c2, c3, c4, c5 = row_at(p.rows, cell)
    slope = c1 + q * (2.0 * c2 + q * (3.0 * c3 + q * (4.0 * c4 + q * (5.0 * c5))))
    return c0 + missing + q * (c1 + q * (c2 + q * (c3 + q * (c4 + q * c5)))), p.per * (slope + missing)
