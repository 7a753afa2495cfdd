"""Less work in numba's front end, for the same code.

numba compares two sets of flags by reading forty properties of each. It also resolves a call such as ``a + b`` by
trying dozens of templates, again at each place where the call stands. Together these took a fifth of the time of a
compilation. Here flags compare by the values that were set, and each resolved call is remembered.

Three more cures follow. A slice's assignment raised an error whose text numba composed in compiled code. This text was
a tenth of each compilation that assigned slices. numba looked for new registrations at each function, and listed the
variables of each statement by trying all kinds of parts.

A version of numba that lacks a name keeps its own way there.
"""

from __future__ import annotations

from typing import Any

from numba import extending

from kickdrift.jit.numba_private import BaseFunction, ConfigStack, CPUContext, Inst, TargetConfig, Var


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
    registries = [*context._registries, *context.typing_context._registries]
    return sum(len(part) for registry in registries for part in vars(registry).values() if isinstance(part, list))


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


def _add_variables(value: Any, found: list[Any]) -> None:
    kind = type(value)
    if kind not in _parts_of:
        _parts_of[kind] = next((parts for of, parts in _PARTS.items() if issubclass(kind, of)), _NOTHING)
    parts = _parts_of[kind]
    if parts == _VARIABLE:
        found.append(value)
    elif parts == _INSTRUCTION:
        found += value.list_vars()
    elif parts != _NOTHING:
        for part in value.values() if parts == _TABLE else value:
            _add_variables(part, found)


def _variables(_: Any, value: Any) -> list[Any]:
    """Variables in a value, which may be a part of a statement, in order."""
    found: list[Any] = []
    _add_variables(value, found)
    return found


if hasattr(Inst, "_rec_list_vars"):
    Inst._rec_list_vars = _variables
