"""Less work in numba's front end, for the same code.

numba compares two sets of flags by reading forty properties of each. It also resolves a call such as ``a + b`` by
trying dozens of templates, again at each place where the call stands. Together these took a fifth of the time of a
compilation. Here flags compare by the values that were set, and each resolved call is remembered.

More cures follow. A slice's assignment raised an error whose text numba composed in compiled code. This text was a
tenth of each compilation that assigned slices. numba looked for new registrations at each function, and listed the
variables of each statement by trying all kinds of parts. It computed after each pass which variables live where,
although only the lowering of a function asks for that. It reported each call of LLVM to timers, hashed types part by
part, and set up a terminal for each error that it caught itself. It took tuples of numbers apart to find arrays.

A version of numba that lacks a name keeps its own way there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import nullcontext
from functools import cache
from typing import Any

from llvmlite import binding
from numba import extending, types

from kickdrift.jit.numba_private import (
    BaseFunction,
    ConfigStack,
    CPUCodegen,
    CPUCodeLibrary,
    CPUContext,
    Inst,
    NRTContext,
    PostProcessor,
    TargetConfig,
    Var,
    VariableLifetime,
    canonicalize_cfg,
    errors,
    event,
    global_compiler_lock,
    itanium_mangler,
    lowering,
)


def _values(flags: Any) -> dict[str, Any]:
    """Values of all flags by name, as numba's own method returns them."""
    return _defaults(type(flags)) | flags._values


_known_defaults: dict[type, dict[str, Any]] = {}


def _defaults(kind: Any) -> dict[str, Any]:
    if kind not in _known_defaults:
        _known_defaults[kind] = {name: option.default for name, option in kind.options.items()}
    return _known_defaults[kind]


def _equal(flags: Any, other: Any) -> Any:
    if not isinstance(other, TargetConfig):
        return NotImplemented
    return flags._values == other._values or _values(flags) == _values(other)


def _hash(flags: Any) -> int:
    """Flags are few, and may change after they were hashed. numba's own hash does not depend on the values either."""
    return hash(TargetConfig)


_resolve = BaseFunction.get_call_type
_resolved: dict[Any, tuple[Any, Any]] = {}  # signature, and the key of its code


def _call_type(function: Any, context: Any, args: Any, kws: Any) -> Any:
    """Signature of a call of a function with arguments of these types. Failures are not remembered, because a template
    that is registered later may match."""
    flags = ConfigStack.top_or_none()
    key = function, context, tuple(args), tuple(kws.items()), flags and flags.copy()
    try:
        known, codes = key in _resolved, function._impl_keys
    except (TypeError, AttributeError):  # a type without a hash, or a version without this table
        return _resolve(function, context, args, kws)
    if not known:
        signature = _resolve(function, context, args, kws)
        _resolved[key] = signature, codes[signature.args]
    signature, code = _resolved[key]
    codes[signature.args] = code
    return signature


if hasattr(TargetConfig, "_values"):
    TargetConfig.values, TargetConfig.__eq__, TargetConfig.__hash__ = _values, _equal, _hash
BaseFunction.get_call_type = _call_type


# --- registrations ---

_refresh = CPUContext.refresh


def _registrations(context: Any) -> int:
    """Number of functions, attributes and casts that a context's registries have; registries only grow."""
    number = len(context._registries) + len(context.typing_context._registries)
    if getattr(context, "_kickdrift_lists", (-1,))[0] != number:
        registries = [*context._registries, *context.typing_context._registries]
        lists = [part for registry in registries for part in vars(registry).values() if isinstance(part, list)]
        context._kickdrift_lists = number, lists
    return sum(map(len, context._kickdrift_lists[1]))


def _refresh_if_new(context: Any) -> None:
    """Add what was registered since the last call."""
    counted = hasattr(context, "_registries") and hasattr(context.typing_context, "_registries")
    if not counted or getattr(context, "_kickdrift_registrations", None) != _registrations(context):
        _refresh(context)
        from numba.np import arrayobj

        if hasattr(arrayobj, "raise_with_shape_context"):
            arrayobj.raise_with_shape_context = _raise_shapes_differ
        if counted:
            context._kickdrift_registrations = _registrations(context)


def _raise_shapes_differ(source: Any, target: Any) -> None:
    """Raise the error of a slice's assignment from an array of another shape, in compiled code."""


@extending.overload(_raise_shapes_differ, target="generic")
def _shapes_differ(source, target):
    def shapes_differ(source, target):
        raise ValueError("cannot assign a slice from input of another shape")

    return shapes_differ


CPUContext.refresh = _refresh_if_new

# --- variables of statements ---

_NOTHING, _VARIABLE, _INSTRUCTION, _SEQUENCE, _TABLE = range(5)
_PARTS = {Var: _VARIABLE, Inst: _INSTRUCTION, list: _SEQUENCE, tuple: _SEQUENCE, dict: _TABLE}
_parts_of: dict[type, int] = {}  # by the type of a value


def _add_variables(values: Iterable[Any], found: list[Any]) -> None:
    for value in values:
        kind = type(value)
        if kind not in _parts_of:
            _parts_of[kind] = next((parts for of, parts in _PARTS.items() if issubclass(kind, of)), _NOTHING)
        parts = _parts_of[kind]
        if parts == _NOTHING:
            continue
        if parts == _VARIABLE:
            found.append(value)
        elif parts == _INSTRUCTION:
            found += value.list_vars()
        else:
            _add_variables(value.values() if parts == _TABLE else value, found)


def _variables(_: Any, value: Any) -> list[Any]:
    """Variables in a value, which may be a part of a statement, in order."""
    found: list[Any] = []
    _add_variables((value,), found)
    return found


if hasattr(Inst, "_rec_list_vars"):
    Inst._rec_list_vars = _variables


# --- lives of variables ---

_post_process = PostProcessor.run


def _post_process_if_asked(processor: Any, emit_dels: bool = False, extend_lifetimes: bool = False) -> None:
    """Compute which variables live where only for a pass that frees them, or for a generator."""
    function = processor.func_ir
    if emit_dels or function.is_generator:
        _post_process(processor, emit_dels, extend_lifetimes)
        return
    function.blocks = canonicalize_cfg(function.blocks)
    function.variable_lifetime, function.generator_info = VariableLifetime(function.blocks), None


PostProcessor.run = _post_process_if_asked

# --- timers ---

_install_timer = event.install_timer
_LOCKS = "numba:compiler_lock", "numba:llvm_lock"


def _install_outer_timer(kind: Any, callback: Any) -> Any:
    """Time the locks of the function that Python calls, not again those of each function that is compiled inside."""
    inside = kind in _LOCKS and global_compiler_lock.is_locked()
    return nullcontext() if inside else _install_timer(kind, callback)


def _if_heard(tell: Callable[[], None]) -> Callable[[], None]:
    return lambda: tell() if event._registered.get(_LOCKS[1]) else None


event.install_timer = _install_outer_timer
_calls = getattr(getattr(binding.ffi.lib, "_lock", None), "_cblist", [])
_calls[:] = [tuple(map(_if_heard, pair)) for pair in _calls]

# --- types ---

_reduce = types.Type.__reduce__


def _hash_of_type(kind: Any) -> int:
    try:
        return int(kind._kickdrift_hash)
    except AttributeError:
        kind._kickdrift_hash = hash(kind.key)
        return int(kind._kickdrift_hash)


def _equal_types(kind: Any, other: Any) -> bool:
    return kind is other or (kind.__class__ is other.__class__ and kind.key == other.key)


def _reduced(kind: Any) -> Any:
    """numba's own pickle of a type, without the hash, which differs in each process."""
    make, (made_by, args, state) = _reduce(kind)
    if isinstance(state, dict):
        state = {name: value for name, value in state.items() if name != "_kickdrift_hash"}
    return make, (made_by, args, state)


# The check of abstract classes takes longer, and no type needs it.
setattr(type(types.Type), "__instancecheck__", type.__instancecheck__)  # noqa: B010
types.Type.__hash__, types.Type.__eq__, types.Type.__reduce__ = _hash_of_type, _equal_types, _reduced

_sizes: dict[str, int] = {}
_size_of = CPUContext.get_abi_sizeof


def _known_size_of(context: Any, kind: Any) -> int:
    """Bytes of an LLVM type, which llvmlite finds by parsing a module of its own."""
    text = str(kind)
    if "%" in text:  # a name, which another module may give to another type
        return int(_size_of(context, kind))
    if text not in _sizes:
        _sizes[text] = _size_of(context, kind)
    return _sizes[text]


CPUContext.get_abi_sizeof = _known_size_of

# --- reference counts ---

_meminfos = NRTContext.get_meminfos


def _meminfos_in(context: Any, builder: Any, kind: Any, value: Any) -> list[Any]:
    """Memory that a value owns. Most types own none."""
    model = context._context.data_model_manager[kind]
    if not hasattr(model, "_kickdrift_owns"):
        model._kickdrift_owns = model.contains_nrt_meminfo()
    return list(_meminfos(context, builder, kind, value)) if model._kickdrift_owns else []


NRTContext.get_meminfos = _meminfos_in

# --- LLVM's passes over single functions ---


def _optimize_functions(library: Any, module: Any) -> None:
    """Run these passes with one manager for all functions of a module, and not for declarations."""
    module.data_layout = library._codegen._data_layout
    manager, builder = library._codegen._function_pass_manager()
    for function in module.functions:
        if not function.is_declaration:
            with library._recorded_timings.record(f"Function passes on {function.name!r}", builder):
                manager.run(function, builder)


if CPUCodegen._function_pass_manager.__code__.co_argcount == 1:  # older versions have other managers
    CPUCodeLibrary._optimize_functions = _optimize_functions

# --- texts ---

itanium_mangler._escape_string = cache(itanium_mangler._escape_string)


def _coloured(_: Any, text: str, color: str | None = None, style: str | None = None) -> str:
    return f"{color or ''}{style or errors.Style.BRIGHT}{text}{errors.Style.RESET_ALL}"


if hasattr(errors, "HighlightColorScheme"):  # where colorama is installed
    errors.HighlightColorScheme._markup = _coloured


class _ErrorContext:
    """numba's context of an error, without a generator, because each statement has one."""

    __slots__ = ("args", "kwargs", "text")

    def __init__(self, text: str, *args: Any, **kwargs: Any) -> None:
        self.text, self.args, self.kwargs = text, args, kwargs

    def __enter__(self) -> None:
        place = self.kwargs.get("loc")
        if place is not None and not place.filename.startswith(errors._numba_path):
            errors.loc_info.update(self.kwargs)

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        if isinstance(error, errors.NumbaError):
            error.add_context(errors._format_msg(self.text, self.args, self.kwargs))


if hasattr(errors, "_numba_path") and hasattr(errors, "_format_msg") and hasattr(errors, "loc_info"):
    errors.new_error_context = lowering.new_error_context = _ErrorContext
