"""Machine code by address: compiled code calls these functions without being compiled together with them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import types

from kickdrift.jit.cache.cache import CallbackCache
from kickdrift.jit.compile import FAST_MATH, no_collection
from kickdrift.jit.inner import OPTIONS
from kickdrift.jit.numba_private import CFunc


def callback(function: Callable[..., Any], of: Any, kind: types.Type) -> Any:
    """Compile a function with the signature ``of`` plain numbers and pointers, for calls by ``address``. ``kind`` is
    the type for which it is compiled; the disk keeps the machine code of each type."""
    made: Any = CFunc(function, (of.args, of.return_type), {}, OPTIONS | {"fastmath": FAST_MATH})
    made._cache = CallbackCache(function, kind)
    with no_collection():
        made.compile()
    return made
