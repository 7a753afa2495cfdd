"""Parameters of a mixture: each lane takes a number from a small table in registers.

A parameter has a value for each pair of species. `Tabled` holds them all in a vector, with the place of the value that
each lane takes. Sums and products of such numbers are made in the table, so they leave the loop over the pairs. Where a
formula mixes them with lanes, each lane takes its value by a permutation. For AVX-512 alone, whose permutation of a
vector is one operation.
"""

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic, lower_builtin, lower_cast, models, register_model

from kickdrift.jit.compile import features
from kickdrift.jit.lanes.vectors import (
    ARITHMETIC,
    F64X8,
    I32,
    WIDTH,
    Lanes,
    as_lanes,
    flags_of,
    lanes_type,
    register,
    single_type,
    whole_power,
)
from kickdrift.jit.numba_private import Conversion, cgutils, signature

ENTRIES = 16  # of a table, so four species; the tables of two species lie in the first eight


class Places(types.Type):
    """Places in a table, one for each of the ``lanes``."""

    def __init__(self, lanes: Lanes) -> None:
        self.lanes = lanes
        bits = 64 if lanes == lanes_type else 32
        self.vector = ir.VectorType(ir.IntType(bits), lanes.vector.count)
        super().__init__(name=f"Places({lanes})")


class Tabled(types.Type):
    """A number for each of the ``lanes``, from a table of ``parts`` vectors."""

    whole_powers = True

    def __init__(self, lanes: Lanes, parts: int) -> None:
        self.lanes, self.parts, self.places = lanes, parts, Places(lanes)
        super().__init__(name=f"Tabled({lanes}, {parts})")

    def can_convert_to(self, typingctx: Any, other: types.Type) -> Any:
        return Conversion.safe if other == self.lanes else None


@register_model(Places)
class _PlacesModel(models.PrimitiveModel):
    def __init__(self, dmm: Any, fe_type: Places) -> None:
        super().__init__(dmm, fe_type, fe_type.vector)


@register_model(Tabled)
class _TabledModel(models.StructModel):
    def __init__(self, dmm: Any, fe_type: Tabled) -> None:
        vectors = [(f"part{k}", fe_type.lanes) for k in range(fe_type.parts)]
        super().__init__(dmm, fe_type, [*vectors, ("places", fe_type.places)])


KINDS = tuple(Tabled(lanes, parts) for lanes, parts in ((lanes_type, 1), (lanes_type, 2), (single_type, 1)))


def _taken(builder: ir.IRBuilder, parts: list[ir.Value], places: ir.Value) -> ir.Value:
    """Emit lanes of the table's numbers at the places."""
    vector = parts[0].type
    if len(parts) == 1:
        name, given = f"permvar.{'df' if vector == F64X8 else 'sf'}.512", [parts[0], places]
    else:
        name, given = "vpermi2var.pd.512", [parts[0], places, parts[1]]
    kind = ir.FunctionType(vector, [each.type for each in given])
    called = cgutils.get_or_insert_function(builder.module, kind, f"llvm.x86.avx512.{name}")
    return builder.call(called, given)


def _vectors(builder: ir.IRBuilder, kind: Tabled, value: ir.Value) -> tuple[list[ir.Value], ir.Value]:
    """Parts and places of a value."""
    return [builder.extract_value(value, k) for k in range(kind.parts)], builder.extract_value(value, kind.parts)


def _made(context: Any, builder: ir.IRBuilder, kind: Tabled, parts: list[ir.Value], places: ir.Value) -> ir.Value:
    made = cgutils.create_struct_proxy(kind)(context, builder)
    for k, part in enumerate(parts):
        setattr(made, f"part{k}", part)
    made.places = places
    return made._getvalue()


@lower_cast(Tabled, Lanes)
def _as_lanes(context, builder, fromty, toty, value):
    return _taken(builder, *_vectors(builder, fromty, value))


def _lower_binary(function: Callable[..., Any], emit: Callable[..., ir.Value]) -> None:
    cases = [
        signature(kind, *pair)
        for kind in KINDS
        for pair in ((kind, kind), (kind, types.float64), (types.float64, kind))
    ]
    register(function, cases)
    for case in cases:

        def lowered(context, builder, sig, args):
            kind = sig.return_type
            sides, places = [], None
            for each, value in zip(sig.args, args, strict=True):
                if isinstance(each, Tabled):
                    parts, places = _vectors(builder, each, value)
                else:
                    parts = [as_lanes(builder, value, each, kind.lanes.vector)] * kind.parts
                sides.append(parts)
            made = [emit(builder, a, b, flags_of(context)) for a, b in zip(*sides, strict=True)]
            return _made(context, builder, kind, made, places)

        lower_builtin(function, *case.args)(lowered)


def _lower_unary(context: Any, builder: ir.IRBuilder, kind: Tabled, value: ir.Value, emit: Callable[..., Any]) -> Any:
    parts, places = _vectors(builder, kind, value)
    return _made(context, builder, kind, [emit(part) for part in parts], places)


for _function, _emit in ARITHMETIC.items():
    _lower_binary(_function, _emit)
register(operator.neg, [signature(kind, kind) for kind in KINDS])


@lower_builtin(operator.neg, Tabled)
def _negative(context, builder, sig, args):
    return _lower_unary(
        context, builder, sig.args[0], args[0], lambda part: builder.fneg(part, flags=flags_of(context))
    )


@lower_builtin(operator.pow, Tabled, types.IntegerLiteral)
def _whole_power(context, builder, sig, args):
    exponent = sig.args[1].literal_value
    return _lower_unary(
        context, builder, sig.args[0], args[0],
        lambda part: whole_power(builder, part, exponent, flags_of(context)),
    )  # fmt: skip


def _eight(context: Any, builder: ir.IRBuilder, kind: types.Type, array: Any, index: ir.Value, lanes: int) -> ir.Value:
    """Load adjacent whole numbers of an array, widened or cut to 64 bits for eight lanes, else to 32."""
    data = context.make_array(kind)(context, builder, array).data
    vector = ir.VectorType(data.type.pointee, lanes)
    found = builder.load(builder.bitcast(builder.gep(data, [index]), vector.as_pointer()))
    found.align = 1 if data.type.pointee.width == 8 else 8
    wanted = ir.VectorType(ir.IntType(64 if lanes == WIDTH else 32), lanes)
    return builder.zext(found, wanted) if data.type.pointee.width == 8 else _cut(builder, found, wanted)


def _cut(builder: ir.IRBuilder, found: ir.Value, wanted: ir.VectorType) -> ir.Value:
    return found if found.type == wanted else builder.trunc(found, wanted)


@intrinsic
def places_of(typingctx, row, i, code, place, lanes):
    """Return the places in a table for the particle in slot i and those at ``place`` and after it; for 16 ``lanes`` for
    four particles from slot i on and four from ``place`` on. They are ``row[i] + code[place]``."""
    kind = Places(lanes)

    def codegen(context, builder, sig, args):
        if lanes == lanes_type:
            data = context.make_array(sig.args[0])(context, builder, args[0]).data
            own = _all(builder, builder.load(builder.gep(data, [args[1]])))
            return builder.add(_eight(context, builder, sig.args[2], args[2], args[3], WIDTH), own)
        own = _eight(context, builder, sig.args[0], args[0], args[1], 4)
        other = _eight(context, builder, sig.args[2], args[2], args[3], 4)
        shuffled = [
            builder.shuffle_vector(each, each, ir.Constant(ir.VectorType(I32, 16), order))
            for each, order in ((own, [k // 4 for k in range(16)]), (other, [k % 4 for k in range(16)]))
        ]
        return builder.add(*shuffled)

    return kind(row, types.intp, code, types.intp, lanes), codegen


def _all(builder: ir.IRBuilder, number: ir.Value) -> ir.Value:
    vector, order = ir.VectorType(number.type, WIDTH), ir.VectorType(I32, WIDTH)
    one = builder.insert_element(ir.Constant(vector, ir.Undefined), number, I32(0))
    return builder.shuffle_vector(one, ir.Constant(vector, ir.Undefined), ir.Constant(order, [0] * WIDTH))


@intrinsic(prefer_literal=True)
def places_within(typingctx, row, i, code, place, turn):
    """Return the places in a table for the eight particles from slot i on, whose code begins at ``place``, each with
    the particle ``turn`` places further on, a literal."""
    if not isinstance(turn, types.IntegerLiteral):
        return None

    def codegen(context, builder, sig, args):
        own = _eight(context, builder, sig.args[0], args[0], args[1], WIDTH)
        other = _eight(context, builder, sig.args[2], args[2], args[3], WIDTH)
        order = [(k + turn.literal_value) % WIDTH for k in range(WIDTH)]
        return builder.add(own, builder.shuffle_vector(other, other, ir.Constant(ir.VectorType(I32, WIDTH), order)))

    return Places(lanes_type)(row, types.intp, code, types.intp, turn), codegen


@intrinsic
def tabled(typingctx, like, table, first, places, wide):
    """NamedTuple of the class of ``like``. Field k is the number of the row ``first + k`` of the table (rows, ENTRIES)
    at the places. ``wide`` is None if the numbers lie in the first eight entries."""
    parts = 1 if places.lanes == single_type or isinstance(wide, types.NoneType) else 2
    kind = Tabled(places.lanes, parts)
    result = types.NamedTuple([kind] * len(like), like.instance_class)

    def codegen(context, builder, sig, args):
        data = context.make_array(sig.args[1])(context, builder, args[1]).data
        begin = builder.gep(data, [builder.mul(args[2], context.get_constant(types.intp, ENTRIES))])
        fields = []
        for k in range(len(sig.args[0])):
            vectors = []
            for part in range(parts):
                offset = context.get_constant(types.intp, ENTRIES * k + WIDTH * part)
                pointer = builder.bitcast(builder.gep(begin, [offset]), places.lanes.vector.as_pointer())
                vectors.append(builder.load(pointer))
                vectors[-1].align = 4
            fields.append(_made(context, builder, kind, vectors, args[3]))
        return context.make_tuple(builder, sig.return_type, fields)

    return result(like, table, types.intp, places, wide), codegen


@intrinsic
def by_bytes(typingctx, table, word):
    """Return eight of the first eight numbers of a table: lane k takes the one that byte k of the word names."""

    def codegen(context, builder, sig, args):
        data = context.make_array(sig.args[0])(context, builder, args[0]).data
        eight = builder.bitcast(args[1], ir.VectorType(ir.IntType(8), WIDTH))
        if "avx512f" in features():
            numbers = builder.load(builder.bitcast(data, F64X8.as_pointer()))
            numbers.align = 8
            return _taken(builder, [numbers], builder.zext(eight, ir.VectorType(ir.IntType(64), WIDTH)))
        made = ir.Constant(F64X8, ir.Undefined)
        for lane in range(WIDTH):
            place = builder.zext(builder.extract_element(eight, I32(lane)), ir.IntType(64))
            made = builder.insert_element(made, builder.load(builder.gep(data, [place])), I32(lane))
        return made

    return lanes_type(table, types.int64), codegen


@intrinsic
def placed(typingctx, like, places):
    """NamedTuple of tabled numbers with other places."""

    def codegen(context, builder, sig, args):
        fields = []
        for kind, value in zip(like, cgutils.unpack_tuple(builder, args[0]), strict=True):
            fields.append(_made(context, builder, kind, _vectors(builder, kind, value)[0], args[1]))
        return context.make_tuple(builder, sig.return_type, fields)

    return like(like, places), codegen


@intrinsic
def all_taken(typingctx, values):
    """NamedTuple of tabled numbers as lanes."""
    result = types.NamedTuple([kind.lanes for kind in values], values.instance_class)

    def codegen(context, builder, sig, args):
        fields = zip(values, cgutils.unpack_tuple(builder, args[0]), strict=True)
        taken = [_taken(builder, *_vectors(builder, kind, value)) for kind, value in fields]
        return context.make_tuple(builder, sig.return_type, taken)

    return result(values), codegen
