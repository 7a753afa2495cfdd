"""Exact slopes of laws, called by address: their formulas on duals, along eight deviations at once."""

from collections.abc import Callable

import numpy as np
from llvmlite import ir
from numba import carray, types
from numba.extending import intrinsic

from kickdrift.forces.bonded.kernel import AngleKernel, BondKernel, DihedralKernel
from kickdrift.forces.fields.galaxy_kernel import GalaxyKernel
from kickdrift.forces.fields.restraint_kernel import RestraintKernel
from kickdrift.forces.laws.body_kernel import BodyWork
from kickdrift.forces.laws.field_kernel import FieldWork, clocked, image_near, parameters_of
from kickdrift.forces.seam.kernel import OK, run_body
from kickdrift.jit.compile import jit, never_inline
from kickdrift.jit.duals import arrays as arrays  # what duals, alone and in arrays, take part in
from kickdrift.jit.duals.dual import SLOT, dual_rows
from kickdrift.jit.duals.operators import dual_vector, vector_at
from kickdrift.jit.handle import Bound, Handle, handle_at
from kickdrift.jit.inner import by_type
from kickdrift.jit.numba_private import cpu_target

NO_DUALS = -1  # status of a force without a formula on duals
# Bodies of these take arrays of duals.
BODIES = (BodyWork, BondKernel, AngleKernel, DihedralKernel, GalaxyKernel, RestraintKernel)


@jit
def slopes_of_bodies(force, t, x, v, a):
    never_inline()
    return run_body(force, t, x, v, a, None)


@jit
def slopes_of_field(force, t, x, v, a):
    never_inline()
    t, x = clocked(force, t), dual_images(force.images, x)
    for i in range(x.shape[1]):
        push = push_of(parameters_of(force.law, i), vector_at(x, i), vector_at(v, i), force.masses[i], t)
        push = over_mass(push, force.inverse_masses, i)
        a[0, i] += push.x
        a[1, i] += push.y
        a[2, i] += push.z
    return OK


@by_type
def dual_images(images, x):
    """Positions x (3, n) as duals, or their images nearest to the law's place."""
    if isinstance(images, types.NoneType):
        return lambda images, x: x

    def near(images, x):
        room = np.empty(x.shape, x.dtype)
        for i in range(x.shape[1]):
            image_near(images, x, i, room)
        return room

    return near


@jit
def over_mass(push, inverse_masses, i):
    """Return a force over mass, or the acceleration of a law per mass."""
    if inverse_masses is None:
        return push
    return inverse_masses[i] * push


@by_type
def push_of(p, x, v, m, t):
    """The force of a law as a dual vector."""
    law = p.instance_class.fused_law
    return lambda p, x, v, m, t: dual_vector(law(p, x, v, m, t)[1])


@by_type
def dual_slopes(force, t, x, v, a):
    """Add the accelerations of a force at duals x and v to the duals ``a``, all (3, n). Return a status, which is
    NO_DUALS for a force without a formula that takes duals."""
    cls = (force.kind if isinstance(force, Handle) else force).instance_class
    code = slopes_of_field if cls is FieldWork else slopes_of_bodies
    if cls is FieldWork or cls in BODIES:
        try:
            cpu_target.typing_context.resolve_function_type(types.Dispatcher(code), (force, t, x, v, a), {})
        except Exception:  # whatever numba raises for a law with, say, functions of whole arrays
            return lambda force, t, x, v, a: NO_DUALS
        return lambda force, t, x, v, a: code(force, t, x, v, a)
    return lambda force, t, x, v, a: NO_DUALS


_NUMBERS = types.CPointer(types.float64)
SIGNATURE = types.int64(types.intp, types.int64, types.float64, _NUMBERS, _NUMBERS, _NUMBERS)


class BoundSlopes(Bound):
    """A force of one System: its parts, and the machine code of its slopes along eight directions."""

    signature = SIGNATURE

    def _compute_for(self, kind: types.Type) -> Callable[..., int]:
        restore = handle_at(Handle(kind))

        def compute(work, n, t, x, v, a):
            shape = (3 * n * SLOT,)
            xs, vs, slopes = carray(x, shape), carray(v, shape), carray(a, shape)
            return dual_slopes(restore(work), t, dual_rows(xs, n), dual_rows(vs, n), dual_rows(slopes, n))

        return compute


@intrinsic
def call_slopes(typingctx, address, work, n, t, x, v, a):
    """Run the machine code at ``address`` with the parts at ``work``; return a status, NO_DUALS for a force without a
    formula on duals. x, v and a are rows of float64 that hold duals (3, n)."""
    if any(not isinstance(kind, types.Array) or kind.layout != "C" for kind in (x, v, a)):
        return None

    def codegen(context, builder, sig, args):
        whole, double = ir.IntType(64), ir.DoubleType()
        numbers = double.as_pointer()
        kind = ir.FunctionType(whole, [whole, whole, double, numbers, numbers, numbers])
        data = [
            context.make_array(of)(context, builder, array).data
            for of, array in zip(sig.args[4:], args[4:], strict=True)
        ]
        return builder.call(builder.inttoptr(args[0], kind.as_pointer()), [args[1], args[2], args[3], *data])

    return types.int64(types.int64, types.int64, types.int64, types.float64, x, v, a), codegen
