"""Numbers between memory and eight lanes in other orders: rows gathered and transposed.

Rows of numbers are loaded whole and transposed, faster than LLVM's gathers. A table of float64 gives lanes of float64,
a table of float32 lanes of float32.
"""

from collections.abc import Iterable
from functools import partial
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from kickdrift.jit.lanes.vectors import F64, F64X8, I32, WIDTH, bytes_of, half_single_type, lanes_type, suffix
from kickdrift.jit.numba_private import cgutils

EIGHT = types.UniTuple(lanes_type, WIDTH)
LOW, HIGH = [0, 8, 2, 10, 4, 12, 6, 14], [1, 9, 3, 11, 5, 13, 7, 15]  # of each two rows
FIRST, LAST = [0, 1, 8, 9, 4, 5, 12, 13], [2, 3, 10, 11, 6, 7, 14, 15]  # of each two pairs of rows
_FRONT, _BACK = [0, 1, 2, 3, 8, 9, 10, 11], [4, 5, 6, 7, 12, 13, 14, 15]  # of both halves


def shuffle(builder: ir.IRBuilder, a: ir.Value, b: ir.Value, order: list[int]) -> ir.Value:
    """Emit eight of the numbers of a, counted from 0, and of b, counted on."""
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(I32, WIDTH), order))


def transposed_rows(builder: ir.IRBuilder, rows: list[Any]) -> list[Any]:
    """Emit eight vectors whose lane k has the numbers of row k."""
    shuffled = partial(shuffle, builder)
    pairs = [[shuffled(rows[k], rows[k + 1], order) for k in range(0, WIDTH, 2)] for order in (LOW, HIGH)]
    made: list[Any] = [None] * WIDTH
    for odd, pair in enumerate(pairs):
        for second, order in enumerate((FIRST, LAST)):
            halves = shuffled(pair[0], pair[1], order), shuffled(pair[2], pair[3], order)
            made[odd + 2 * second] = shuffled(*halves, _FRONT)
            made[odd + 2 * second + 4] = shuffled(*halves, _BACK)
    return made


@intrinsic
def transposed(typingctx, rows):
    """Eight lanes whose lane k has the numbers of row k, for a tuple of eight rows."""

    def codegen(context, builder, sig, args):
        return context.make_tuple(
            builder, sig.return_type, transposed_rows(builder, cgutils.unpack_tuple(builder, args[0]))
        )

    return (EIGHT(EIGHT), codegen) if rows == EIGHT else None


def _steps(builder: ir.IRBuilder, place: Any, stride: Any, count: Any) -> list[tuple[Any, Any]]:
    """For each lane: whether it is one of ``count``, and its index, the last one's for further lanes."""
    made = [(ir.Constant(ir.IntType(1), 1), place)]
    for lane in range(1, WIDTH):
        within = builder.icmp_signed("<", count.type(lane), count)
        made.append((within, builder.select(within, builder.add(made[-1][1], stride), made[-1][1])))
    return made


@intrinsic
def strided(typingctx, array, place, stride, count):
    """Lanes of the ``count`` numbers at ``place``, ``place + stride``, …; the last one fills further lanes."""

    def codegen(context, builder, sig, args):
        data = context.make_array(sig.args[0])(context, builder, args[0]).data
        made = ir.Constant(F64X8, ir.Undefined)
        for lane, (_, at) in enumerate(_steps(builder, *args[1:])):
            made = builder.insert_element(made, builder.load(builder.gep(data, [at])), I32(lane))
        return made

    return (lanes_type(array, *3 * (types.intp,)), codegen) if _plain(array) else None


@intrinsic
def add_strided(typingctx, array, place, stride, count, lanes):
    """Add the first lanes to the ``count`` numbers at ``place``, ``place + stride``, …"""

    def codegen(context, builder, sig, args):
        data = context.make_array(sig.args[0])(context, builder, args[0]).data
        steps = [(within, builder.gep(data, [at])) for within, at in _steps(builder, *args[1:4])]
        before, total = [builder.load(pointer) for _, pointer in steps], None
        for lane, (within, pointer) in enumerate(steps):  # further lanes store the last sum once more
            more = builder.fadd(before[lane], builder.extract_element(args[4], I32(lane)))
            total = more if total is None else builder.select(within, more, total)
            builder.store(total, pointer)
        return context.get_dummy_value()

    known = _plain(array) and lanes == lanes_type
    return (types.void(array, *3 * (types.intp,), lanes), codegen) if known else None


def _plain(array: types.Type) -> bool:
    return isinstance(array, types.Array) and array.layout == "C" and array.dtype == types.float64


ROW = 4  # numbers in a row
_WHOLE = ir.IntType(64)
_INDICES = ir.VectorType(I32, ROW)
_FOUR_LANES = types.UniTuple(lanes_type, ROW)


def lanes_in(array: types.Type) -> types.Type:
    """Type of eight lanes of an array's precision."""
    return half_single_type if array.dtype == types.float32 else lanes_type


def transposed_fours(builder: ir.IRBuilder, rows: list[ir.Value]) -> list[ir.Value]:
    """Emit four vectors, whose lane k has the numbers of row k, from eight or four rows of four numbers."""
    count = len(rows)

    def shuffled(a: ir.Value, b: ir.Value, order: list[int]) -> ir.Value:
        return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(I32, count), order))

    half = count // 2
    both = rows if count == ROW else [shuffled(rows[k], rows[k + half], list(range(WIDTH))) for k in range(half)]
    low, high, first, last = (
        (LOW, HIGH, FIRST, LAST) if count == WIDTH else ([0, 4, 2, 6], [1, 5, 3, 7], [0, 1, 4, 5], [2, 3, 6, 7])
    )
    even, other_even = shuffled(both[0], both[1], low), shuffled(both[2], both[3], low)
    odd, other_odd = shuffled(both[0], both[1], high), shuffled(both[2], both[3], high)
    halves = (even, other_even), (odd, other_odd)
    return [shuffled(a, b, order) for order in (first, last) for a, b in halves]


def gathered(builder: ir.IRBuilder, data: ir.Value, starts: list[ir.Value]) -> list[ir.Value]:
    """Emit four vectors of eight lanes: the four numbers from each of eight starts on."""
    rows, kind = [], ir.VectorType(data.type.pointee, ROW)
    for start in starts:
        row = builder.load(builder.bitcast(builder.gep(data, [start]), kind.as_pointer()))
        row.align = bytes_of(kind.element)
        rows.append(row)
    return transposed_fours(builder, rows)


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

    lanes = lanes_in(table)
    return types.UniTuple(lanes, ROW)(table, lanes, types.intp, types.intp), codegen


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
        front, back = (shuffled(columns[at], columns[at + 1], pair) for at in (0, 2))
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


def _rounding(name: str) -> Any:
    @intrinsic
    def rounded(typingctx, value):
        def codegen(context, builder, sig, args):
            vector = args[0].type
            kind = ir.FunctionType(vector, [vector])
            called = cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.{suffix(vector)}")
            return builder.call(called, args)

        return value(value), codegen

    return rounded


lane_floor = _rounding("floor")  # largest whole number not above each lane
lane_round = _rounding("rint")  # nearest whole number to each lane, ties to even


@intrinsic
def picked(typingctx, array, offset, places, at):
    """Lanes of the numbers at ``offset`` plus each of the eight ``places`` from ``at`` on."""

    def codegen(context, builder, sig, args):
        made = ir.Constant(F64X8, ir.Undefined)
        for lane, pointer in enumerate(_places(context, builder, sig, args)):
            made = builder.insert_element(made, builder.load(pointer), I32(lane))
        return made

    return (lanes_type(array, types.intp, places, types.intp), codegen) if _plain(array) else None


@intrinsic
def add_picked(typingctx, array, offset, places, at, lanes):
    """Add each lane to the number at ``offset`` plus its place, one after another; see `picked`."""

    def codegen(context, builder, sig, args):
        for lane, pointer in enumerate(_places(context, builder, sig, args)):
            more = builder.extract_element(args[4], I32(lane))
            builder.store(builder.fadd(builder.load(pointer), more), pointer)
        return context.get_dummy_value()

    known = _plain(array) and lanes == lanes_type
    return (types.void(array, types.intp, places, types.intp, lanes), codegen) if known else None


THREE = 3 * WIDTH  # numbers of eight groups of three


@intrinsic
def thirds(typingctx, array, place):
    """Three lanes of the 24 numbers from ``place`` on: the first, second and third numbers of eight groups of three."""

    def codegen(context, builder, sig, args):
        data = context.make_array(sig.args[0])(context, builder, args[0]).data
        whole = builder.load(_three(builder, builder.gep(data, [args[1]])), align=8)
        made = [_ordered(builder, whole, range(k, THREE, 3)) for k in range(3)]
        return context.make_tuple(builder, sig.return_type, made)

    return (types.UniTuple(lanes_type, 3)(array, types.intp), codegen) if _plain(array) else None


@intrinsic
def store_thirds(typingctx, array, place, first, second, third):
    """Store three lanes where `thirds` finds them."""

    def codegen(context, builder, sig, args):
        data = context.make_array(sig.args[0])(context, builder, args[0]).data
        pair = builder.shuffle_vector(args[2], args[3], ir.Constant(ir.VectorType(I32, 2 * WIDTH), [*range(2 * WIDTH)]))
        last = _ordered(builder, args[4], [*range(WIDTH)] * 2)
        order = [k // 3 + WIDTH * (k % 3) for k in range(THREE)]
        whole = builder.shuffle_vector(pair, last, ir.Constant(ir.VectorType(I32, THREE), order))
        builder.store(whole, _three(builder, builder.gep(data, [args[1]])), align=8)
        return context.get_dummy_value()

    known = _plain(array) and first == second == third == lanes_type
    return (types.void(array, types.intp, *3 * (lanes_type,)), codegen) if known else None


def _three(builder: ir.IRBuilder, pointer: ir.Value) -> ir.Value:
    return builder.bitcast(pointer, ir.VectorType(F64, THREE).as_pointer())


def _ordered(builder: ir.IRBuilder, vector: ir.Value, order: Iterable[int]) -> ir.Value:
    numbers = list(order)
    return builder.shuffle_vector(vector, vector, ir.Constant(ir.VectorType(I32, len(numbers)), numbers))


def _places(context: Any, builder: ir.IRBuilder, sig: Any, args: Any) -> list[Any]:
    """Pointers to the numbers of an array at ``offset`` plus eight adjacent whole numbers."""
    data = context.make_array(sig.args[0])(context, builder, args[0]).data
    numbers = context.make_array(sig.args[2])(context, builder, args[2]).data
    made = []
    for lane in range(WIDTH):
        place = builder.load(builder.gep(numbers, [builder.add(args[3], args[3].type(lane))]))
        made.append(builder.gep(data, [builder.add(args[1], place)]))
    return made
