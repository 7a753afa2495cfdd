"""Machine code of a Problem's f, compiled once for equal functions.

Numbers and arrays in ``args`` are parameters: they lie in memory that belongs to the code, so that other values need no
compilation. All else in ``args`` is a constant of the code. A function is known by its description (see
``jit.cache.described``), so that the same code serves each call of ``kickdrift.solve`` with an equal function. Two
Problems never share code at the same time.
"""

from __future__ import annotations

import re
import warnings
import weakref
from collections import OrderedDict
from typing import Any

import numpy as np
from llvmlite import ir
from numba import carray, cfunc, types
from numba.extending import intrinsic

from kickdrift.errors import InputError
from kickdrift.jit.cache.described import Description
from kickdrift.jit.cache.package_files import UnknownSource
from kickdrift.jit.inner import by_type, inner
from kickdrift.jit.numba_private import NumbaWarning
from kickdrift.model.problem import Partial
from kickdrift.model.state import Floats

SIGNATURE = types.int64(types.float64, types.CPointer(types.float64), types.CPointer(types.float64))
KEPT = 64  # functions whose code is kept
FAILED, TIME, PARAMETERS = range(3)  # places in the code's memory: a flag, and the t of a call that raised; then its y


class CompileError(InputError):
    """A function that cannot run in compiled code, or has other values there."""


class Code:
    """Machine code of a function.

    Attributes
    ----------
    address : of the code
    memory : of the code; after FAILED and TIME come y of a call that raised, and the parameters
    user : weak reference to the one object that uses the code
    """

    user: Any = None

    def __init__(self, partial: Partial, given: Given, n: int, outputs: int) -> None:
        self.memory = np.zeros(PARAMETERS + n + len(given.parameters))
        self._kept = _compiled(partial, given, n, outputs, self.memory.ctypes.data)
        self.address: int = self._kept.address

    @property
    def free(self) -> bool:
        """Whether nobody uses the code any more."""
        return self.user is None or self.user() is None


class Given:
    """Further arguments of a function: expressions in the source of its caller, parameters and constants."""

    def __init__(self, args: tuple[Any, ...], first: int) -> None:
        self.expressions: list[str] = []
        self.constants: list[Any] = []
        found: list[Floats] = []
        for value in args:
            begin = first + sum(map(len, found))
            row = _parameters(value)
            if row is None:
                self.expressions.append(f"constant{len(self.constants)}")
                self.constants.append(_constant(value))
            else:
                found.append(np.ascontiguousarray(row).reshape(-1).view(np.float64))
                end = begin + len(found[-1])
                whole = f"memory[{begin}:{end}].view({row.dtype})"
                self.expressions.append(whole + (f".reshape({row.shape})" if isinstance(value, np.ndarray) else "[0]"))
        self.parameters: Floats = np.concatenate(found) if found else np.zeros(0)


def _constant(value: Any) -> Any:
    """The value; a tuple for a list, which numba takes as no constant."""
    return tuple(map(_constant, value)) if isinstance(value, list) else value


def _parameters(value: Any) -> Any:
    """The value as an array of a type that compiled code can read from memory; None for a constant."""
    if isinstance(value, np.ndarray):
        whole = value.dtype in (np.float64, np.int64, np.complex128) and type(value) is np.ndarray and value.size
        return value if whole else None
    if isinstance(value, bool | np.bool_) or not isinstance(value, int | float | complex | np.number):
        return None
    if isinstance(value, int | np.integer):
        return np.array([value], dtype=np.int64) if abs(int(value)) < 2**63 else None
    return np.array([value], dtype=np.complex128 if isinstance(value, complex | np.complexfloating) else np.float64)


_CODES: OrderedDict[Any, list[Code]] = OrderedDict()
_FAILURES: OrderedDict[Any, str] = OrderedDict()


def code_of(function: Any, n: int, outputs: int, what: str, user: Any) -> Code:
    """Code of a function of t and y (n,) that returns so many numbers, for the use of ``user`` alone.

    Raises CompileError, which begins with ``what``, if numba cannot compile the function."""
    partial = function if isinstance(function, Partial) else Partial(function)
    given = Given(partial.args, PARAMETERS + n)
    key = _key(partial, given, n, outputs)
    if key in _FAILURES:
        raise CompileError(f"{what} {_FAILURES[key]}")
    codes = _CODES.get(key, []) if key else []
    code = next((each for each in codes if each.free), None)
    if code is None:
        try:
            code = Code(partial, given, n, outputs)
        except Exception as error:  # numba's errors, and whatever numba itself stumbles over
            line = f"does not compile: {_culprit(error)}; compiled=False runs it as plain Python, slowly"
            if key:
                _keep(_FAILURES, key, line)
            raise CompileError(f"{what} {line}") from None
        codes.append(code)
    if key:
        _keep(_CODES, key, codes)
    code.user = weakref.ref(user)
    code.memory[:] = 0.0
    code.memory[PARAMETERS + n :] = given.parameters
    return code


def _keep(kept: OrderedDict[Any, Any], key: Any, value: Any) -> None:
    kept[key] = value
    kept.move_to_end(key)
    if len(kept) > KEPT:
        kept.popitem(last=False)


def _key(partial: Partial, given: Given, n: int, outputs: int) -> Any:
    """Key of the code; None if the function cannot be described."""
    shape = (n, outputs, partial.backward, partial.paired, partial.column, partial.turned, *given.expressions)
    try:
        return (Description().of((partial.function, *given.constants)), shape)
    except (UnknownSource, RecursionError):
        return None


@intrinsic
def _place(typingctx, address):
    """Pointer to the numbers at an address."""

    def codegen(context, builder, sig, args):
        return builder.inttoptr(args[0], ir.DoubleType().as_pointer())

    return types.CPointer(types.float64)(types.int64), codegen


def _compiled(partial: Partial, given: Given, n: int, outputs: int, address: int) -> Any:
    """Compile the function's caller."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NumbaWarning)  # about the user's code, such as slow products of matrices
        return cfunc(SIGNATURE, error_model="numpy")(caller(partial, given, n, outputs, address))


def caller(partial: Partial, given: Given, n: int, outputs: int, address: int) -> Any:
    """The function's caller, to compile. Its arguments are t and pointers to y and to the function's value; the code's
    memory is at ``address``."""
    function = partial.function
    own = function if hasattr(function, "py_func") else inner()(function)
    complex_numbers = ".view(complex128)" if partial.paired else ""
    column = f".reshape(({n >> partial.paired}, 1))" if partial.column else ""
    y = f"given{complex_numbers}{column}"
    sign = "-" if partial.backward else ""
    turned = [f"    for i in range({n // 2}, {n}):"]
    lines = [
        "def call(t, y, dy):",
        f"    memory = carray(place({address}), ({PARAMETERS + n + len(given.parameters)},))",
        f"    given, value = carray(y, ({n},)){'.copy()' if partial.turned else ''}, carray(dy, ({outputs},))",
        *([*turned, "        given[i] = -given[i]"] if partial.turned else []),
        "    try:",
        f"        write(value{complex_numbers}, own({', '.join([f'{sign}t', y, *given.expressions])}))",
        "    except Exception:",
        f"        memory[{FAILED}], memory[{TIME}] = 1.0, t",
        f"        for i in range({n}):",
        f"            memory[{PARAMETERS} + i] = y[i]",
        "        return 1",
        *([f"    for i in range({outputs}):", "        value[i] = -value[i]"] if partial.backward else []),
        *([*turned, "        value[i] = -value[i]"] if partial.turned else []),
        "    return 0",
    ]
    constants = {f"constant{k}": value for k, value in enumerate(given.constants)}
    numbers = {"float64": np.float64, "int64": np.int64, "complex128": np.complex128}
    scope = {"carray": carray, "place": _place, "write": write, "own": own, **numbers, **constants}
    exec("\n".join(lines), scope)
    return scope["call"]


def _culprit(error: Exception) -> str:
    """Return numba's line about what it cannot compile, and where."""
    plain = re.sub(r"\x1b\[[0-9;]*m", "", str(error))  # numba colours its messages if colorama is installed
    lines = [line.strip() for line in plain.splitlines() if line.strip()]
    telling = [line for line in lines if not line.startswith(("Failed in", "During:", "-", "The error", "["))]
    where = [line for line in lines if line.startswith("File ") and not re.search(r"equation_code\.py|<string>", line)]
    return " ".join([*telling[:1], *where[:1]]) or type(error).__name__


@by_type
def write(out, values):
    """out <- the values that a user's function returned (array, list, tuple or number)."""
    if isinstance(values, types.Number):

        def number(out, values):
            out[0] = values

        return number

    if isinstance(values, types.BaseTuple) and not isinstance(values, types.UniTuple):
        lines = [f"    out[{k}] = values[{k}]" for k in range(len(values))]
        scope: dict[str, Any] = {}
        exec("\n".join(["def each(out, values):", *lines]), scope)
        return scope["each"]
    if isinstance(values, types.Array) and values.ndim == 2:

        def rows(out, values):
            for i in range(values.shape[0]):
                for j in range(values.shape[1]):
                    out[i * values.shape[1] + j] = values[i, j]

        return rows

    if isinstance(getattr(values, "dtype", None), types.List):

        def nested(out, values):
            for i in range(len(values)):
                for j in range(len(values[i])):
                    out[i * len(values[i]) + j] = values[i][j]

        return nested

    def items(out, values):
        for i in range(len(values)):
            out[i] = values[i]

    return items
