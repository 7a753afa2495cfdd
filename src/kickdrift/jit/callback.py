"""Machine code by address: functions that compiled code calls without being compiled around them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import types

from kickdrift.jit.cache import CallbackCache
from kickdrift.jit.compile import FAST_MATH, no_collection
from kickdrift.jit.inner import OPTIONS
from kickdrift.jit.numba_private import CFunc


def callback(function: Callable[..., Any], of: Any, kind: types.Type) -> Any:
    """Compile a function with the signature ``of`` plain numbers and pointers, which code that knows its ``address``
    calls; ``kind`` is the type that it is made around, and its machine code is kept on disk for each."""
    made: Any = CFunc(function, (of.args, of.return_type), {}, OPTIONS | {"fastmath": FAST_MATH})
    made._cache = CallbackCache(function, kind)
    with no_collection():
        made.compile()
    return made
