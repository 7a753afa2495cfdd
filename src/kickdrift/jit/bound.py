"""Parts in memory and the machine code for them, which step loops call by address."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

from numba import typeof, types

from kickdrift.jit.callback import callback
from kickdrift.jit.handle import memory_of


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
