"""Functions of lanes that take duals of lanes as well, so that one kernel gives forces and their slopes.

A kernel that imports these names runs on lanes as before. Where its arrays hold duals, what it loads and computes
becomes duals of lanes. In memory a `SINGLE` dual is a number followed by its slope. `dual_numbers` makes such arrays,
and `with_duals` shows them to compiled code.
"""

import math
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from kickdrift.jit.compile import as_written
from kickdrift.jit.duals import operators as operators  # operators of the duals that these functions return
from kickdrift.jit.duals.dual import SINGLE, Dual, dual, made, of_lanes
from kickdrift.jit.inner import by_type
from kickdrift.jit.lanes import functions as lanes
from kickdrift.jit.lanes import gathering, masks, memory, packing, single
from kickdrift.jit.lanes.vectors import F64, I32, WIDTH, half_single_type, lanes_type
from kickdrift.jit.numba_private import cgutils

_DTYPE = np.dtype([("value", np.float64), ("slope", np.float64)])
_DUALS = Dual(lanes_type, lanes_type)
_PAIRS = ir.VectorType(F64, 2 * WIDTH)
_APART = [list(range(part, 2 * WIDTH, 2)) for part in range(2)]
_TOGETHER = [k // 2 + WIDTH * (k % 2) for k in range(2 * WIDTH)]


def dual_numbers(shape: tuple[int, ...]) -> Any:
    """Array of duals with the fields ``value`` and ``slope``, all zero."""
    return memory.aligned((*shape, 2)).view(_DTYPE).reshape(shape)


def with_duals(kind: types.Type) -> Any:
    """The type of parts in compiled code: arrays of `dual_numbers` hold duals there."""
    if isinstance(kind, types.BaseNamedTuple):
        return types.BaseTuple.from_types([with_duals(each) for each in kind], kind.instance_class)
    if isinstance(kind, types.Array) and isinstance(kind.dtype, types.Record):
        return types.Array(SINGLE, kind.ndim, "C")
    return kind


def _of_duals(array: types.Type) -> bool:
    return isinstance(array, types.Array) and array.dtype == SINGLE


@by_type
def value_of(x):
    """Value of a dual; a number or lanes unchanged."""
    return (lambda x: x.value) if isinstance(x, Dual) else (lambda x: x)


# --- memory ---


def _place(context: Any, builder: Any, sig: Any, args: Any) -> ir.Value:
    data = context.make_array(sig.args[0])(context, builder, args[0]).data
    return builder.bitcast(builder.gep(data, [args[1]]), _PAIRS.as_pointer())


def _shuffled(builder: Any, a: ir.Value, b: ir.Value, order: list[int]) -> ir.Value:
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(I32, len(order)), order))


@intrinsic
def _load(typingctx, array, index):
    def codegen(context, builder, sig, args):
        both = builder.load(_place(context, builder, sig, args))
        both.align = 8
        return made(builder, *(_shuffled(builder, both, both, order) for order in _APART))

    return _DUALS(array, types.intp), codegen


@intrinsic
def _store(typingctx, array, index, value):
    def codegen(context, builder, sig, args):
        value, slope = (builder.extract_value(args[2], k) for k in range(2))
        written = builder.store(_shuffled(builder, value, slope, _TOGETHER), _place(context, builder, sig, args))
        written.align = 8
        return context.get_dummy_value()

    return types.void(array, types.intp, _DUALS), codegen


@by_type
def load(array, index):
    """See `memory.load`. An array of float32 gives lanes of float32."""
    if _of_duals(array):
        return lambda array, index: _load(array, index)
    return lambda array, index: memory.load_like(array, index, single.zeros_in(array))


# --- precision ---


@by_type
def in_precision_of(array, x):
    """Lanes in the precision of an array: of float32 for an array of float32; else as they are, duals too."""
    return (lambda array, x: single.narrowed(x)) if array.dtype == types.float32 else (lambda array, x: x)


@by_type
def in_double(x):
    """Lanes of float32 as float64; other lanes and duals as they are."""
    return (lambda x: lanes.in_eight(x)) if x == half_single_type else (lambda x: x)


@by_type
def store(array, index, value):
    """See `memory.store`. An array of duals takes lanes as duals without slopes."""
    if not _of_duals(array):
        return lambda array, index, value: memory.store(array, index, value)
    if of_lanes(value):
        return lambda array, index, value: _store(array, index, value)
    return lambda array, index, value: _store(array, index, dual(value, lanes.splat(0.0)))


@intrinsic
def _rows_at(typingctx, table, places, first):
    def codegen(context, builder, sig, args):
        data = context.make_array(sig.args[0])(context, builder, args[0]).data
        data, whole, columns = builder.bitcast(data, F64.as_pointer()), ir.IntType(64), []
        places = gathering.places_in(context, builder, sig.args[1], args[1], args[2])
        for half in range(2):
            starts = [
                builder.add(builder.mul(place, whole(2 * gathering.ROW)), whole(half * gathering.ROW))
                for place in places
            ]
            a, b, c, d = gathering.gathered(builder, data, starts)
            columns += [made(builder, a, b), made(builder, c, d)]
        return context.make_tuple(builder, sig.return_type, columns)

    return types.UniTuple(_DUALS, gathering.ROW)(table, places, types.intp), codegen


@intrinsic
def _add_numbers_at(typingctx, table, places, first, lanes):
    def codegen(context, builder, sig, args):
        columns = [builder.extract_value(args[3], part) for part in range(2)]
        return gathering.scattered(context, builder, sig, args, columns)

    return types.void(table, places, types.intp, _DUALS), codegen


@intrinsic
def _add_rows_at(typingctx, table, places, first, columns):
    def codegen(context, builder, sig, args):
        duals = cgutils.unpack_tuple(builder, args[3])
        columns = [builder.extract_value(each, part) for each in duals for part in range(2)]
        return gathering.scattered(context, builder, sig, args, columns)

    return types.void(table, places, types.intp, types.UniTuple(_DUALS, gathering.ROW)), codegen


@by_type
def rows_at(table, places, first):
    """See `gathering.rows_at`."""
    if _of_duals(table):
        return lambda table, places, first: _rows_at(table, places, first)
    return lambda table, places, first: gathering.rows_at(table, places, first)


def _teach_adding(of_lanes_alone: Any, of_duals: Any) -> Any:
    """A function that adds to a table, by what the table holds."""

    @by_type
    def add(table, places, first, numbers):
        if _of_duals(table):
            return lambda table, places, first, numbers: of_duals(table, places, first, numbers)
        return lambda table, places, first, numbers: of_lanes_alone(table, places, first, numbers)

    return add


add_numbers_at = _teach_adding(gathering.add_numbers_at, _add_numbers_at)
add_rows_at = _teach_adding(gathering.add_rows_at, _add_rows_at)


# --- selection and sums ---


@by_type
def select(mask, yes, no):
    """See `masks.select`."""
    if not (of_lanes(yes) or of_lanes(no)):
        return lambda mask, yes, no: masks.select(mask, yes, no)
    if not of_lanes(no):
        return lambda mask, yes, no: dual(masks.select(mask, yes.value, no), masks.select(mask, yes.slope, 0.0))
    if not of_lanes(yes):
        return lambda mask, yes, no: dual(
            masks.select(mask, yes, no.value), masks.select(mask, lanes.splat(0.0), no.slope)
        )
    return lambda mask, yes, no: dual(masks.select(mask, yes.value, no.value), masks.select(mask, yes.slope, no.slope))


@by_type
def packed(mask, x):
    """See `packing.packed`."""
    if of_lanes(x):
        return lambda mask, x: dual(packing.packed(mask, x.value), packing.packed(mask, x.slope))
    return lambda mask, x: packing.packed(mask, x)


@by_type
def lane_sum(x):
    """See `lanes.lane_sum`."""
    if of_lanes(x):
        return lambda x: dual(lanes.lane_sum(x.value), lanes.lane_sum(x.slope))
    return lambda x: lanes.lane_sum(x)


# --- functions ---


def _teach(function: Any, of_single: Any, slope: Any) -> Any:
    """A function of lanes of both precisions and of duals; ``slope`` is its derivative, by argument and value."""
    rule = as_written(slope)

    def of_duals(x):
        value = function(x.value)
        return dual(value, rule(x.value, value) * x.slope)

    @by_type
    def either(x):
        if of_lanes(x):
            return of_duals
        return (lambda x: of_single(x)) if x == half_single_type else (lambda x: function(x))

    return either


inverse_sqrt = _teach(lanes.inverse_sqrt, as_written(lambda x: 1.0 / math.sqrt(x)), lambda x, y: -0.5 * (y * y * y))
lane_exp = _teach(lanes.lane_exp, single.single_exp, lambda x, y: y)
lane_log = _teach(lanes.lane_log, single.single_log, lambda x, y: 1.0 / x)


@by_type
def lane_sine_cosine(x):
    """See `lanes.lane_sine_cosine`."""

    def of_duals(x):
        sine, cosine = lanes.lane_sine_cosine(x.value)
        return dual(sine, cosine * x.slope), dual(cosine, -sine * x.slope)

    if of_lanes(x):
        return of_duals
    if x == half_single_type:
        return lambda x: single.single_sine_cosine(x)
    return lambda x: lanes.lane_sine_cosine(x)
