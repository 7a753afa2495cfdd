"""Rows of four numbers for eight lanes: loads of whole rows and a transposition, faster than LLVM's gathers."""

from __future__ import annotations

from functools import partial
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from kickdrift.jit.lanes.transposing import FIRST, HIGH, LAST, LOW, shuffle
from kickdrift.jit.lanes.vectors import F64, F64X8, I32, WIDTH, lanes_type
from kickdrift.jit.numba_private import cgutils

ROW = 4  # numbers in a row
_FOUR = ir.VectorType(F64, ROW)
_WHOLE = ir.IntType(64)
_INDICES = ir.VectorType(I32, ROW)
_FOUR_LANES = types.UniTuple(lanes_type, ROW)


def _transposed(builder: ir.IRBuilder, rows: list[ir.Value]) -> list[ir.Value]:
    """Four vectors of eight lanes from eight rows of four numbers."""
    shuffled = partial(shuffle, builder)
    both = [shuffled(rows[k], rows[k + 4], list(range(WIDTH))) for k in range(4)]
    even, other_even = shuffled(both[0], both[1], LOW), shuffled(both[2], both[3], LOW)
    odd, other_odd = shuffled(both[0], both[1], HIGH), shuffled(both[2], both[3], HIGH)
    halves = (even, other_even), (odd, other_odd)
    return [shuffled(a, b, order) for order in (FIRST, LAST) for a, b in halves]


def gathered(builder: ir.IRBuilder, data: ir.Value, starts: list[ir.Value]) -> list[ir.Value]:
    """Emit four vectors of eight lanes: the four numbers from each of eight starts on. ``data`` points to float64."""
    rows = []
    for start in starts:
        row = builder.load(builder.bitcast(builder.gep(data, [start]), _FOUR.as_pointer()))
        row.align = 8
        rows.append(row)
    return _transposed(builder, rows)


def places_in(context: Any, builder: Any, kind: types.Type, places: Any, first: ir.Value) -> list[ir.Value]:
    """Emit the eight numbers of an array of int32 from ``first`` on."""
    listed = context.make_array(kind)(context, builder, places).data
    found = (builder.load(builder.gep(listed, [builder.add(first, _WHOLE(k))])) for k in range(WIDTH))
    return [builder.sext(place, _WHOLE) for place in found]


def _columns(context: Any, builder: Any, sig: Any, table: Any, starts: list[ir.Value]) -> Any:
    data = context.make_array(sig.args[0])(context, builder, table).data
    return context.make_tuple(builder, sig.return_type, gathered(builder, data, starts))


@intrinsic
def rows_at(typingctx, table, places, first):
    """Return four lanes: the columns of the eight rows ``places[first:first + 8]`` of a flat table with four numbers in
    a row. ``places`` holds int32."""

    def codegen(context, builder, sig, args):
        places = places_in(context, builder, sig.args[1], args[1], args[2])
        starts = [builder.mul(place, _WHOLE(ROW)) for place in places]
        return _columns(context, builder, sig, args[0], starts)

    return _FOUR_LANES(table, places, types.intp), codegen


@intrinsic
def rows_of(typingctx, table, rows, stride, column):
    """Return four lanes: the numbers from ``column`` on of eight rows of a flat table with ``stride`` numbers in a row.
    ``rows`` are lanes of whole numbers."""

    def codegen(context, builder, sig, args):
        whole = builder.fptosi(args[1], ir.VectorType(_WHOLE, WIDTH))
        starts = [
            builder.add(builder.mul(builder.extract_element(whole, I32(k)), args[2]), args[3]) for k in range(WIDTH)
        ]
        return _columns(context, builder, sig, args[0], starts)

    return _FOUR_LANES(table, lanes_type, types.intp, types.intp), codegen


@intrinsic
def numbers_at(typingctx, table, places, first):
    """Return lanes: the numbers of a table at ``places[first:first + 8]``, which holds int32."""

    def codegen(context, builder, sig, args):
        data = context.make_array(sig.args[0])(context, builder, args[0]).data
        made = ir.Constant(F64X8, ir.Undefined)
        for k, place in enumerate(places_in(context, builder, sig.args[1], args[1], args[2])):
            made = builder.insert_element(made, builder.load(builder.gep(data, [place])), I32(k))
        return made

    return lanes_type(table, places, types.intp), codegen


def _as_rows(builder: ir.IRBuilder, columns: list[ir.Value]) -> list[ir.Value]:
    """Eight rows, which hold the lanes of each column."""
    if len(columns) != ROW:
        rows = [ir.Constant(ir.VectorType(F64, len(columns)), ir.Undefined)] * WIDTH
        for at, column in enumerate(columns):
            numbers = [builder.extract_element(column, I32(k)) for k in range(WIDTH)]
            rows = [builder.insert_element(row, number, I32(at)) for row, number in zip(rows, numbers, strict=True)]
        return rows
    shuffled = partial(shuffle, builder)
    rows = []
    for pair in (LOW, HIGH):
        front, back = (shuffled(*columns[at : at + 2], pair) for at in (0, 2))
        rows.append([shuffled(front, back, order) for order in (FIRST, LAST)])
    halves = [
        [builder.shuffle_vector(each, each, ir.Constant(_INDICES, list(range(at, at + ROW)))) for at in (0, ROW)]
        for each in (rows[0][0], rows[1][0], rows[0][1], rows[1][1])
    ]
    return [half[upper] for upper in range(2) for half in halves]


def scattered(context: Any, builder: Any, sig: Any, args: Any, columns: list[ir.Value]) -> Any:
    """Emit the addition of columns of eight lanes to the rows of a flat table whose numbers are in ``places``. Rows are
    added one after another, so a row may stand there twice."""
    data = context.make_array(sig.args[0])(context, builder, args[0]).data
    data, width = builder.bitcast(data, F64.as_pointer()), _WHOLE(len(columns))
    places = places_in(context, builder, sig.args[1], args[1], args[2])
    for place, row in zip(places, _as_rows(builder, columns), strict=True):
        start = builder.bitcast(builder.gep(data, [builder.mul(place, width)]), row.type.as_pointer())
        before = builder.load(start)
        before.align = 8
        builder.store(builder.fadd(before, row), start).align = 8
    return context.get_dummy_value()


@intrinsic
def add_numbers_at(typingctx, table, places, first, lanes):
    """Add lanes to the numbers of a table at ``places[first:first + 8]``, which holds int32."""

    def codegen(context, builder, sig, args):
        return scattered(context, builder, sig, args, [args[3]])

    return types.void(table, places, types.intp, lanes_type), codegen


@intrinsic
def add_rows_at(typingctx, table, places, first, columns):
    """Add four lanes to the columns of the eight rows ``places[first:first + 8]`` of a flat table. A row has four
    numbers, and ``places`` holds int32."""

    def codegen(context, builder, sig, args):
        return scattered(context, builder, sig, args, cgutils.unpack_tuple(builder, args[3]))

    return types.void(table, places, types.intp, _FOUR_LANES), codegen


@intrinsic
def place_at(typingctx, places, index):
    """Return a number of an array of int32, at its place in memory."""

    def codegen(context, builder, sig, args):
        listed = context.make_array(sig.args[0])(context, builder, args[0]).data
        return builder.sext(builder.load(builder.gep(listed, [args[1]])), _WHOLE)

    return types.int64(places, types.intp), codegen


def _rounding(name: str) -> Any:
    @intrinsic
    def rounded(typingctx, value):
        def codegen(context, builder, sig, args):
            kind = ir.FunctionType(F64X8, [F64X8])
            called = cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v8f64")
            return builder.call(called, args)

        return lanes_type(lanes_type), codegen

    return rounded


lane_floor = _rounding("floor")  # largest whole number not above each lane
lane_round = _rounding("rint")  # nearest whole number to each lane, ties to even
