"""Bound forces by reference, and calls of compiled code by address, without a second copy of the code.

A NamedTuple of arrays unpacks into hundreds of numbers, which made compiling ten times slower. Compiled functions pass
one pointer instead, and threads can share it. ``handle(value)`` puts a NamedTuple, or a tuple of them, on the caller's
stack and returns a ``Handle``, whose attributes are the value's. A handle is valid during the call that made it, and
keeps nothing alive.
"""

import ctypes
import struct
from collections.abc import Callable, Iterator
from functools import cache
from typing import Any, ClassVar

import numpy as np
from llvmlite import ir
from numba import typeof, types
from numba.extending import intrinsic, lower_getattr_generic, models, register_model
from numpy.typing import NDArray

from kickdrift.jit.cache.cache import CallbackCache
from kickdrift.jit.compile import FAST_MATH, no_collection
from kickdrift.jit.inner import OPTIONS
from kickdrift.jit.numba_private import (
    AttributeTemplate,
    CFunc,
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
        return tuple(size * k for k in range(whole.count))  # the size is zero for parts without numbers
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


def callback(function: Callable[..., Any], of: Any, kind: types.Type) -> Any:
    """Compile a function with the signature ``of`` plain numbers and pointers, for calls by ``address``. ``kind`` is
    the type for which it is compiled; the disk keeps the machine code of each type."""
    made: Any = CFunc(function, (of.args, of.return_type), {}, OPTIONS | {"fastmath": FAST_MATH})
    made._cache = CallbackCache(function, kind)
    with no_collection():
        made.compile()
    return made


def address_of(driver: Any, *args: Any) -> int:
    """Address of a driver's machine code for arguments of these types, for ``status_at``. It is valid while the driver
    lives."""
    return _address_for(driver, tuple(driver.typeof_pyval(each) for each in args))


def _address_for(driver: Any, kinds: tuple[Any, ...]) -> int:
    if kinds not in driver.overloads:
        driver.compile(kinds)
    compiled = driver.overloads[kinds]
    assert compiled.signature.return_type == types.intp, compiled.signature
    return int(compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name))


@intrinsic
def status_at(typingctx, address, args):
    """Return the whole number that the driver at an address returns. The tuple of arguments must have the driver's
    types."""

    def codegen(context, builder, sig, values):
        kinds = tuple(sig.args[1])
        kind = context.call_conv.get_function_type(types.intp, kinds)
        function = builder.inttoptr(values[0], kind.as_pointer())
        given = [builder.extract_value(values[1], k) for k in range(len(kinds))]
        status, found = context.call_conv.call_function(builder, function, types.intp, kinds, given)
        with cgutils.if_unlikely(builder, status.is_error):  # a user's function raised
            context.call_conv.return_status_propagate(builder, status)
        return found

    return types.intp(types.intp, args), codegen


class Bound:
    """Numbers and arrays, bound to the machine code that is compiled for their type.

    Attributes
    ----------
    parts : NamedTuple of numbers and arrays
    address, work : addresses of the machine code and of the parts in memory; 0 before `ready`
    signature : numba signature of the machine code, with plain numbers and pointers
    """

    address = work = 0
    signature: ClassVar[types.Type]
    _compiled_for: ClassVar[dict[Any, Any]]  # machine code by the type of parts; each kind of Bound has its own

    def __init_subclass__(cls) -> None:
        if "signature" in cls.__dict__:
            cls._compiled_for = {}

    def __init__(self, parts: Any) -> None:
        self.parts = parts

    def ready(self) -> Any:
        """Return the same with its machine code, compiled if necessary. The parts live as long as the result."""
        return self if self.work else self._compiled(self.parts)

    def _compiled(self, parts: Any) -> Any:
        kind = typeof(parts)
        if kind not in self._compiled_for:
            self._compiled_for[kind] = callback(self._compute_for(kind), self.signature, kind)
        made = type(self)(parts)
        made._memory = memory_of(parts)  # type: ignore[attr-defined]
        made.address, made.work = int(self._compiled_for[kind].address), int(made._memory.ctypes.data)  # type: ignore[attr-defined]
        return made

    def _compute_for(self, kind: types.Type) -> Callable[..., int]:
        """Function to compile for parts of this type."""
        raise NotImplementedError
