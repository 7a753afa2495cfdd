"""A number with its derivatives as a compiled type: a value, and its slopes along eight directions.

A ``Dual`` carries a number and eight lanes of slopes, or a vector of three and its slopes. A dual of lanes carries
lanes of numbers, and one slope for each; `SINGLE` is one of these lanes. A dual of duals carries second derivatives:
its value is a dual along eight directions, and its slope is the change of this dual along one more. `operators`
and `functions` teach numba the arithmetic of forward differentiation (Griewank & Walther 2008, Evaluating
Derivatives, doi:10.1137/1.9780898717761, chapter 3). A formula of numbers then gives its exact slopes. The value is
computed once for eight directions.
"""

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic, lower_cast, lower_getattr_generic, models, register_model

from kickdrift.jit.lanes.vector3 import AXES, Vector3, components
from kickdrift.jit.lanes.vectors import WIDTH, Lanes, as_lanes, lanes_type
from kickdrift.jit.numba_private import AttributeTemplate, Conversion, cgutils, impl_ret_borrowed, infer_getattr

PARTS = ("value", "slope")
SLOT = 1 + WIDTH  # numbers of float64 in memory for one dual: the value and eight slopes


class Dual(types.Type):
    """A value of the type ``value``, and its slopes, of the type ``slope``. ``order`` counts the derivatives."""

    def __init__(self, value: types.Type, slope: types.Type) -> None:
        self.value, self.slope = value, slope
        self.order: int = 1 + getattr(value, "order", 0)
        super().__init__(name=f"Dual({value.name}, {slope.name})")

    def takes(self, other: types.Type) -> bool:
        """Whether a number, lanes, or a dual of lower order, may stand for this dual: as one without more slopes."""
        if isinstance(self.value, Dual):
            return other == self.value or self.value.takes(other)
        if isinstance(self.value, Lanes):
            return other == self.value
        return self.value == types.float64 and isinstance(other, types.Number)

    def unify(self, typingctx: Any, other: types.Type) -> Any:
        """The type of a variable that is a dual here and a number, or lanes, there: a dual."""
        return self if self.takes(other) else None

    def can_convert_from(self, typingctx: Any, other: types.Type) -> Any:
        """Whether a value of another type may stand for this dual."""
        return Conversion.safe if self.takes(other) else None


DUAL = Dual(types.float64, lanes_type)
SINGLE = Dual(types.float64, types.float64)
DUAL3 = Dual(Vector3(types.float64), Vector3(lanes_type))
TWICE, TWICE3 = Dual(DUAL, DUAL), Dual(DUAL3, DUAL3)  # with second derivatives, along one direction and eight others


def of_lanes(kind: types.Type) -> bool:
    """Tell whether this is the type of a dual of lanes."""
    return isinstance(kind, Dual) and isinstance(kind.value, Lanes)


@register_model(Dual)
class _DualModel(models.StructModel):
    def __init__(self, dmm: Any, fe_type: Dual) -> None:
        super().__init__(dmm, fe_type, [(part, getattr(fe_type, part)) for part in PARTS])

    # In memory a dual is packed, so that it may begin anywhere: numba's own arrays do not begin on 64-byte boundaries.

    def get_data_type(self) -> ir.Type:
        return ir.LiteralStructType([model.get_data_type() for model in self._models], packed=True)

    def as_data(self, builder: ir.IRBuilder, value: ir.Value) -> ir.Value:
        parts = [model.as_data(builder, part) for model, part in self._parts(builder, value)]
        return _joined(builder, parts, self.get_data_type())

    def from_data(self, builder: ir.IRBuilder, value: ir.Value) -> ir.Value:
        parts = [model.from_data(builder, part) for model, part in self._parts(builder, value)]
        return _joined(builder, parts, self.get_value_type())

    def _parts(self, builder: ir.IRBuilder, value: ir.Value) -> Any:
        return [(model, builder.extract_value(value, k)) for k, model in enumerate(self._models)]

    def load_from_data_pointer(self, builder: ir.IRBuilder, ptr: ir.Value, align: Any = None) -> ir.Value:
        return self.from_data(builder, builder.load(ptr, align=8))


def _joined(builder: ir.IRBuilder, parts: list[ir.Value], to: ir.Type) -> ir.Value:
    made = ir.Constant(to, ir.Undefined)
    for k, part in enumerate(parts):
        made = builder.insert_value(made, part, k)
    return made


def made(builder: ir.IRBuilder, value: ir.Value, slope: ir.Value) -> ir.Value:
    """Emit a dual."""
    return _joined(builder, [value, slope], ir.LiteralStructType([value.type, slope.type]))


@intrinsic
def dual(typingctx, value, slope):
    """Dual of a number and eight slopes or one, of a vector of three and its slopes, of lanes and a slope for each, or
    of two duals."""
    kind: Dual | None = Dual(value, value) if isinstance(value, Lanes) or value in (DUAL, DUAL3) else None
    if slope == types.float64:
        kind = SINGLE
    if kind is None:
        kind = {lanes_type: DUAL, DUAL3.slope: DUAL3}.get(slope)
        if kind is None or isinstance(value, Vector3) != (kind is DUAL3):
            return None

    def codegen(context, builder, sig, args):
        return made(builder, *args)

    return kind(kind.value, slope), codegen


@intrinsic
def dual_fields(typingctx, values, slopes, like):
    """NamedTuple of the class of ``values``, with duals of as many lanes as ``like`` has as fields. The fields of both
    NamedTuples are numbers or lanes."""
    kind = Dual(like, like)
    result = types.NamedTuple([kind] * len(values), values.instance_class)

    def codegen(context, builder, sig, args):
        fields = []
        for k in range(len(values)):
            both = [
                as_lanes(builder, builder.extract_value(part, k), of[k], like.vector)
                for part, of in zip(args, sig.args[:2], strict=False)
            ]
            fields.append(made(builder, *both))
        return context.make_tuple(builder, sig.return_type, fields)

    return result(values, slopes, like), codegen


@lower_cast(types.Number, Dual)
def _without_slopes(context, builder, fromty, toty, value):
    number = context.cast(builder, value, fromty, toty.value)
    return made(builder, number, context.get_constant_null(toty.slope))


lower_cast(Dual, Dual)(_without_slopes)


@lower_cast(Lanes, Dual)
def _lanes_without_slopes(context, builder, fromty, toty, value):
    return made(builder, value, context.get_constant_null(toty.slope))


@intrinsic
def as_dual(typingctx, number):
    """A number as a dual without slopes, or a dual unchanged."""

    def codegen(context, builder, sig, args):
        return context.cast(builder, args[0], sig.args[0], sig.return_type)

    return (number if isinstance(number, Dual) else DUAL)(number), codegen


@infer_getattr
class _Attributes(AttributeTemplate):
    """``value``, ``slope``, and of a vector ``x``, ``y`` and ``z``."""

    key = Dual

    def generic_resolve(self, kind: Dual, name: str) -> Any:
        if name in PARTS:
            return getattr(kind, name)
        return {DUAL3: DUAL, TWICE3: TWICE}.get(kind) if name in AXES else None


@lower_getattr_generic(Dual)
def _attribute(context, builder, kind, value, name):
    parts = [builder.extract_value(value, k) for k in range(2)]
    if name in PARTS:
        return parts[PARTS.index(name)]
    if kind == TWICE3:
        return made(builder, *(_attribute(context, builder, DUAL3, part, name) for part in parts))
    return made(builder, *(components(builder, part)[AXES.index(name)] for part in parts))


@intrinsic
def dual_rows(typingctx, memory, columns):
    """Array (3, ``columns``) of duals in a row of float64, which holds ``SLOT`` numbers for each. Memory (numbers, 2)
    holds duals with second derivatives. The memory must live as long."""

    def codegen(context, builder, sig, args):
        shape = [context.get_constant(types.intp, 3), args[1]]
        return _shown(context, builder, sig, args[0], shape, False)

    kind = {1: DUAL, 2: TWICE}.get(memory.ndim) if _plain(memory) else None
    return (types.Array(kind, 2, "C")(memory, types.intp), codegen) if kind else None


@intrinsic
def kept_duals(typingctx, memory, shape):
    """Array of duals of this shape, a tuple, in an array of float64 that holds ``SLOT`` numbers for each. The array
    keeps the memory alive."""
    kind = types.Array(DUAL, len(shape), "C") if isinstance(shape, types.UniTuple) else None

    def codegen(context, builder, sig, args):
        found = _shown(context, builder, sig, args[0], cgutils.unpack_tuple(builder, args[1]), True)
        return impl_ret_borrowed(context, builder, sig.return_type, found)

    return (kind(memory, shape), codegen) if kind and _plain(memory) else None


def _plain(memory: types.Type) -> bool:
    return isinstance(memory, types.Array) and memory.layout == "C" and memory.dtype == types.float64


def _shown(context: Any, builder: Any, sig: Any, memory: Any, shape: list[Any], keeps: bool) -> Any:
    """Emit a view of float64 as duals."""
    given = context.make_array(sig.args[0])(context, builder, memory)
    view = context.make_array(sig.return_type)(context, builder)
    size = 8 * SLOT * sig.return_type.dtype.order
    strides = [context.get_constant(types.intp, size)]
    for length in reversed(shape[1:]):
        strides.insert(0, builder.mul(strides[0], length))
    context.populate_array(
        view,
        data=builder.bitcast(given.data, view.data.type),
        shape=shape,
        strides=strides,
        itemsize=context.get_constant(types.intp, size),
        meminfo=given.meminfo if keeps else None,
    )
    return view._getvalue()
