"""A number with its derivatives as a compiled type: a value, and its slopes along eight directions.

A ``Dual`` carries a number and eight lanes of slopes, or a vector of three and its slopes. `dual_operators` and
`dual_functions` teach numba the arithmetic of forward differentiation (Griewank & Walther 2008, Evaluating Derivatives,
doi:10.1137/1.9780898717761, chapter 3). A formula of numbers then gives its exact slopes. The value is computed once
for eight directions.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic, lower_cast, lower_getattr_generic, models, register_model

from kickdrift.jit.numba_private import AttributeTemplate, Conversion, impl_ret_borrowed, infer_getattr
from kickdrift.jit.vector3_operators import AXES, Vector3, components
from kickdrift.jit.vectors import WIDTH, constant, lanes_type

PARTS = ("value", "slope")
SLOT = 1 + WIDTH  # numbers of float64 in memory for one dual: the value and eight slopes


class Dual(types.Type):
    """A value of the type ``value``, and its slopes along eight directions, of the type ``slope``."""

    def __init__(self, value: types.Type, slope: types.Type) -> None:
        self.value, self.slope = value, slope
        super().__init__(name=f"Dual({value.name}, {slope.name})")

    def unify(self, typingctx: Any, other: types.Type) -> Any:
        """The type of a variable that is a dual here and a number there: a dual."""
        return self if self.value == types.float64 and isinstance(other, types.Number) else None

    def can_convert_from(self, typingctx: Any, other: types.Type) -> Any:
        """Whether a number may stand for a dual: as one without slopes."""
        return Conversion.safe if self.value == types.float64 and isinstance(other, types.Number) else None


DUAL = Dual(types.float64, lanes_type)
DUAL3 = Dual(Vector3(types.float64), Vector3(lanes_type))


@register_model(Dual)
class _DualModel(models.StructModel):
    def __init__(self, dmm: Any, fe_type: Dual) -> None:
        super().__init__(dmm, fe_type, [(part, getattr(fe_type, part)) for part in PARTS])

    # In memory a dual is packed, so that it may begin anywhere: numba's own arrays do not begin on 64-byte boundaries.

    def get_data_type(self) -> ir.Type:
        return ir.LiteralStructType([model.get_data_type() for model in self._models], packed=True)

    def as_data(self, builder: ir.IRBuilder, value: ir.Value) -> ir.Value:
        return _copied(builder, value, self.get_data_type())

    def from_data(self, builder: ir.IRBuilder, value: ir.Value) -> ir.Value:
        return _copied(builder, value, self.get_value_type())

    def load_from_data_pointer(self, builder: ir.IRBuilder, ptr: ir.Value, align: Any = None) -> ir.Value:
        return self.from_data(builder, builder.load(ptr, align=8))


def _copied(builder: ir.IRBuilder, value: ir.Value, to: ir.Type) -> ir.Value:
    made = ir.Constant(to, ir.Undefined)
    for k in range(len(PARTS)):
        made = builder.insert_value(made, builder.extract_value(value, k), k)
    return made


def made(builder: ir.IRBuilder, value: ir.Value, slope: ir.Value) -> ir.Value:
    """Emit a dual."""
    empty = ir.Constant(ir.LiteralStructType([value.type, slope.type]), ir.Undefined)
    return builder.insert_value(builder.insert_value(empty, value, 0), slope, 1)


@intrinsic
def dual(typingctx, value, slope):
    """Dual of a number and eight slopes, or of a vector of three and its slopes."""
    kind = {lanes_type: DUAL, DUAL3.slope: DUAL3}.get(slope)
    if kind is None or isinstance(value, Vector3) != (kind is DUAL3):
        return None

    def codegen(context, builder, sig, args):
        return made(builder, *args)

    return kind(kind.value, slope), codegen


@lower_cast(types.Number, Dual)
def _without_slopes(context, builder, fromty, toty, value):
    number = context.cast(builder, value, fromty, types.float64)
    return made(builder, number, constant(0.0))


@intrinsic
def as_dual(typingctx, number):
    """A number as a dual without slopes, or a dual unchanged."""

    def codegen(context, builder, sig, args):
        return context.cast(builder, args[0], sig.args[0], DUAL)

    return DUAL(number), codegen


@infer_getattr
class _Attributes(AttributeTemplate):
    """``value``, ``slope``, and of a vector ``x``, ``y`` and ``z``."""

    key = Dual

    def generic_resolve(self, kind: Dual, name: str) -> Any:
        if name in PARTS:
            return getattr(kind, name)
        return DUAL if kind == DUAL3 and name in AXES else None


@lower_getattr_generic(Dual)
def _attribute(context, builder, kind, value, name):
    parts = [builder.extract_value(value, k) for k in range(2)]
    if name in PARTS:
        return parts[PARTS.index(name)]
    return made(builder, *(components(builder, part)[AXES.index(name)] for part in parts))


def _rows(keeps: bool) -> Any:
    """Intrinsic that shows a row of float64 as duals; the array ``keeps`` the memory alive, or not."""

    @intrinsic
    def rows(typingctx, memory, columns):
        kind = types.Array(DUAL, 2, "C")

        def codegen(context, builder, sig, args):
            given = context.make_array(sig.args[0])(context, builder, args[0])
            view = context.make_array(kind)(context, builder)
            size = context.get_constant(types.intp, 8 * SLOT)
            three = context.get_constant(types.intp, 3)
            context.populate_array(
                view,
                data=builder.bitcast(given.data, view.data.type),
                shape=[three, args[1]],
                strides=[builder.mul(size, args[1]), size],
                itemsize=size,
                meminfo=given.meminfo if keeps else None,
            )
            return impl_ret_borrowed(context, builder, kind, view._getvalue()) if keeps else view._getvalue()

        plain = isinstance(memory, types.Array) and memory.layout == "C" and memory.dtype == types.float64
        return (kind(memory, types.intp), codegen) if plain else None

    return rows


# Array (3, columns) of duals in a row of float64, which holds SLOT numbers for each. The first kind costs nothing; the
# second may outlive the name of its memory.
dual_rows, kept_dual_rows = _rows(False), _rows(True)
