"""Less work in numba's front end, for the same code.

numba compares two sets of flags by reading forty properties of each. It also resolves a call such as ``a + b`` by
trying dozens of templates, again at each place where the call stands. Together these took a fifth of the time of a
compilation. Here flags compare by the values that were set, and each resolved call is remembered.
"""

from __future__ import annotations

from typing import Any

from kickdrift.jit.numba_private import BaseFunction, ConfigStack, TargetConfig


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
    key = function, context, args, tuple(kws.items()), flags and flags.copy()
    if key not in _resolved:
        signature = _resolve(function, context, args, kws)
        _resolved[key] = signature, function._impl_keys[signature.args]
    signature, code = _resolved[key]
    function._impl_keys[signature.args] = code
    return signature


TargetConfig.values, TargetConfig.__eq__, TargetConfig.__hash__ = _values, _equal, _hash
BaseFunction.get_call_type = _call_type
