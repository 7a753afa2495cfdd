"""A force bound to a System: machine code at an address, and its parameters in memory.

A force's ``bind(system, threads)`` returns its *parts*, a NamedTuple of numbers and arrays. The body registered for the
class of the parts is compiled once for each type of parts. Step loops call the body by its address. So a new force
compiles alone, and a step loop is compiled once for all forces.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import carray, types
from numba.extending import intrinsic

from kickdrift.jit.compile import jit
from kickdrift.jit.handle import Bound, Handle, handle_at
from kickdrift.jit.inner import by_type
from kickdrift.jit.numba_private import TypingError
from kickdrift.model.state import Floats

OK, GROW, BLOWN_UP = 0, 1, 2  # status of a force evaluation: done, a list is full, positions make no sense
RAISED = 4  # Python code inside raised, so no other step is tried; 3 is a stepper's STOPPED

# tasks of a bound force; the third is for pair lists alone, and those after it for forces that take steps
FORCES, FORCES_AND_SUMS, REMAKE, TAKE_STEPS, REFRESH, FORCES_ALONE = range(6)
KERNELS: dict[type, Any] = {}
_ROWS: dict[type, int] = {}
_NUMBERS = types.CPointer(types.float64)
SIGNATURE = types.int64(types.intp, types.int64, types.int64, types.float64, _NUMBERS, _NUMBERS, _NUMBERS, _NUMBERS)


def kernel(cls: type, rows: int = 3) -> Callable[[Callable[..., Any]], Any]:
    """Register the compiled body of a force whose parts are the NamedTuple class ``cls``.

    The body is ``body(force, t, x, v, a, sums) -> status``. It adds the accelerations at positions x and velocities v
    to ``a``; all three are (3, n). If ``sums`` is not None, the body adds the potential energy to ``sums[0]``, the
    virial (the sum of r . F over pairs) to ``sums[1]`` and the number of interacting pairs to ``sums[2]``. The status
    is 0, GROW or BLOWN_UP. ``rows`` is the number of rows of the arrays.
    """

    def register(body: Callable[..., Any]) -> Any:
        KERNELS[cls], _ROWS[cls] = jit(body), rows
        cls.kernel_sources = (body,)  # type: ignore[attr-defined]
        return KERNELS[cls]

    return register


class BoundForce(Bound):
    """A force of one System: its parts, and the machine code that sums its accelerations."""

    signature = SIGNATURE

    def _compute_for(self, kind: types.Type) -> Callable[..., int]:
        return compute_for(kind)

    @property
    def rows_along(self) -> int:
        """Rows of the virial along each axis that the force gives, see `lists.along`; 0 if it gives none."""
        return len(getattr(self.parts, "sums", (0,))) if hasattr(self.parts, "along") else 0

    def with_along(self, along: Floats) -> BoundForce:
        """The same force that sums its virial along each axis to these rows, if it gives one."""
        return type(self)(self.parts._replace(along=along)) if hasattr(self.parts, "along") else self


def compute_for(kind: types.Type) -> Callable[..., int]:
    """Return the body for this type of parts, as a function to compile for its address."""
    restore = handle_at(Handle(kind))
    rows = _ROWS[kind.instance_class]

    def compute(work, what, n, t, x, v, a, sums):
        force, shape = restore(work), (rows, n)
        if what == FORCES:
            return run_body(force, t, carray(x, shape), carray(v, shape), carray(a, shape), None)
        return run_body(force, t, carray(x, shape), carray(v, shape), carray(a, shape), carray(sums, (3,)))

    return compute


@by_type(forceinline=True)
def run_body(force, t, x, v, a, sums):
    """Run the body registered for the class of these parts; return its status."""
    kind = force.kind if isinstance(force, Handle) else force
    return KERNELS[kind.instance_class].py_func


@intrinsic
def call_force(typingctx, address, work, what, t, x, v, a, sums):
    """Run the machine code at ``address`` with the parts at ``work``; return a status.

    ``what`` selects the task. x, v and a are (rows, n). ``sums`` may be None. For TAKE_STEPS ``sums`` is a plan of
    ``t`` numbers; see `sorted_steps`."""
    arrays = [kind for kind in (x, v, a, sums) if isinstance(kind, types.Array)]
    if any(array.layout != "C" for array in arrays):
        raise TypingError("a force takes contiguous arrays")

    def codegen(context, builder, sig, args):
        whole, double = ir.IntType(64), ir.DoubleType()
        numbers = double.as_pointer()
        kind = ir.FunctionType(whole, [whole, whole, whole, double, numbers, numbers, numbers, numbers])
        made = [
            context.make_array(of)(context, builder, array)
            for of, array in zip(sig.args[4:], args[4:], strict=True)
            if isinstance(of, types.Array)
        ]
        n = builder.extract_value(made[0].shape, 1)
        data = [array.data for array in made] + [ir.Constant(numbers, None)] * (4 - len(made))
        return builder.call(builder.inttoptr(args[0], kind.as_pointer()), [args[1], args[2], n, args[3], *data])

    return types.int64(address, work, types.int64, types.float64, x, v, a, sums), codegen
