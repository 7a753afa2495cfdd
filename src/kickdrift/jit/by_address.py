"""Calls from compiled code to already compiled functions, by address. No second copy is compiled."""

from __future__ import annotations

from typing import Any

from numba import types
from numba.extending import intrinsic

from kickdrift.jit.numba_private import cgutils


def address_of(driver: Any, *args: Any) -> int:
    """Address of a driver's machine code for arguments of these types, for ``status_at``. It is valid while the driver
    lives."""
    kinds = tuple(driver.typeof_pyval(each) for each in args)
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
