"""Bound forces by reference.

A NamedTuple of arrays unpacks into hundreds of numbers, which made compiling ten times slower. Compiled functions pass
one pointer instead, and threads can share it. ``handle(value)`` puts a NamedTuple, or a tuple of them, on the caller's
stack and returns a ``Handle``, whose attributes are the value's. A handle is valid during the call that made it, and
keeps nothing alive.
"""

from __future__ import annotations

import ctypes
import struct
from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np
from llvmlite import ir
from numba import typeof, types
from numba.extending import intrinsic, lower_getattr_generic, models, register_model
from numpy.typing import NDArray

from kickdrift.jit.numba_private import (
    AttributeTemplate,
    as_dtype,
    cgutils,
    cpu_target,
    impl_ret_borrowed,
    infer_getattr,
)


class Handle(types.Type):
    """Pointer to a value of the numba type ``kind``."""

    def __init__(self, kind: types.BaseTuple) -> None:
        self.kind = kind
        super().__init__(name=f"Handle({kind.name})")

    @property
    def key(self) -> Any:
        """What tells two handles apart: the type itself, since two classes may have one name."""
        return self.kind

    def field(self, name: str) -> tuple[int, types.Type]:
        """Position and type of an attribute of a NamedTuple."""
        index = self.kind.fields.index(name)
        return index, self.kind.types[index]


@register_model(Handle)
class _HandleModel(models.PrimitiveModel):
    def __init__(self, dmm: Any, fe_type: Handle) -> None:
        super().__init__(dmm, fe_type, dmm.lookup(fe_type.kind).get_value_type().as_pointer())


def _leaves(kind: types.Type) -> Iterator[types.Type]:
    if isinstance(kind, types.BaseTuple):
        for part in kind:
            yield from _leaves(part)
    else:
        yield kind


def _read(kind: types.Type) -> types.Type:
    """Type of a part when read: a handle for a tuple that holds arrays, else the value's own type."""
    by_reference = isinstance(kind, types.BaseTuple) and any(isinstance(leaf, types.Array) for leaf in _leaves(kind))
    return Handle(kind) if by_reference else kind


@infer_getattr
class _HandleAttributes(AttributeTemplate):
    key = Handle

    def generic_resolve(self, handle: Handle, name: str) -> Any:
        if isinstance(handle.kind, types.BaseNamedTuple) and name in handle.kind.fields:
            return _read(handle.field(name)[1])
        return None


def _part(context: Any, builder: ir.IRBuilder, pointer: ir.Value, index: int, kind: types.Type) -> ir.Value:
    inside = cgutils.gep_inbounds(builder, pointer, 0, index)
    if _read(kind) is not kind:
        return inside
    return _unowned(context, builder, kind, builder.load(inside))


def _unowned(context: Any, builder: ir.IRBuilder, kind: types.Type, value: ir.Value) -> ir.Value:
    """Drop an array's owner, so that references are not counted; counting is atomic and takes longer than a step of a
    few bodies. Other values stay unchanged."""
    if not isinstance(kind, types.Array):
        return impl_ret_borrowed(context, builder, kind, value)
    array = cgutils.create_struct_proxy(kind)(context, builder, value=value)
    array.meminfo = cgutils.get_null_value(array.meminfo.type)
    array.parent = cgutils.get_null_value(array.parent.type)
    return array._getvalue()


@lower_getattr_generic(Handle)
def _attribute(context, builder, handle, pointer, name):
    return _part(context, builder, pointer, *handle.field(name))


@intrinsic
def handle(typingctx, value):
    """Return a Handle of the value, on the caller's stack."""

    def codegen(context, builder, sig, args):
        return cgutils.alloca_once_value(builder, args[0])

    return Handle(value)(value), codegen


@intrinsic
def unowned(typingctx, array):
    """Return the same array without reference counting. The caller must keep the array alive."""

    def codegen(context, builder, sig, args):
        return _unowned(context, builder, array, args[0])

    return array(array), codegen


@intrinsic
def address(typingctx, of):
    """Return a handle as a whole number, since tasks on threads take only numbers."""

    def codegen(context, builder, sig, args):
        return builder.ptrtoint(args[0], context.get_value_type(types.intp))

    return types.intp(of), codegen


def memory_of(value: tuple[Any, ...]) -> NDArray[np.int64]:
    """Copy a NamedTuple into memory in the layout of compiled code, for `handle_at`. It keeps no array alive."""
    kind = typeof(value)
    context = cpu_target.target_context
    memory = np.zeros(-(-context.get_abi_sizeof(context.get_value_type(kind)) // 8), np.int64)
    _put(value, kind, memory.ctypes.data)
    return memory


def _put(value: Any, kind: types.Type, place: int) -> None:
    if isinstance(value, tuple):
        for part, inner, offset in zip(value, kind, _offsets(kind), strict=True):
            _put(part, inner, place + offset)
    elif isinstance(value, np.ndarray):
        put_array(value, place)
    elif value is not None:
        number = as_dtype(kind).type(value)
        ctypes.memmove(place, number.tobytes(), number.nbytes)


@cache
def _offsets(kind: types.BaseTuple) -> tuple[int, ...]:
    """Byte offsets of the parts of a tuple of this type in LLVM's layout."""
    context = cpu_target.target_context
    whole = context.get_value_type(kind)
    if isinstance(whole, ir.ArrayType):
        size = context.get_abi_sizeof(whole.element)
        return tuple(range(0, size * whole.count, size))
    return tuple(whole.get_element_offset(context.target_data, k) for k in range(len(kind)))


def put_array(array: NDArray[Any], place: int) -> None:
    """Write the structure of an array to the memory at ``place``, in numba's layout: no owner, no parent, the number of
    items, their size, their address, shape and strides."""
    address = array.__array_interface__["data"][0]
    numbers = (0, 0, array.size, array.itemsize, address, *array.shape, *array.strides)
    structure = struct.pack(f"{len(numbers)}n", *numbers)
    ctypes.memmove(place, structure, len(structure))


def handle_at(kind: Handle) -> Any:
    """Return the compiled inverse of ``address`` for this type of handle."""

    @intrinsic
    def restore(typingctx, number):
        def codegen(context, builder, sig, args):
            return builder.inttoptr(args[0], context.get_value_type(kind))

        return kind(types.intp), codegen

    return restore
