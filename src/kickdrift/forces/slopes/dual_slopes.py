"""Exact slopes of laws: their formulas on duals, along eight deviations at once."""

from __future__ import annotations

from typing import Any

from numba import types

from kickdrift.forces.bonded.kernel import AngleKernel, BondKernel, DihedralKernel
from kickdrift.forces.laws.body_kernel import BodyWork
from kickdrift.forces.laws.field_kernel import FieldWork, clocked, parameters_of
from kickdrift.forces.seam.kernel import OK, run_body
from kickdrift.jit.compile import jit, never_inline
from kickdrift.jit.duals import arrays as arrays  # what duals, alone and in arrays, take part in
from kickdrift.jit.duals.operators import dual_vector, vector_at
from kickdrift.jit.handle import Handle
from kickdrift.jit.inner import overload
from kickdrift.jit.numba_private import cpu_target

NO_DUALS = -1  # status of a force without a formula on duals
BODIES = (BodyWork, BondKernel, AngleKernel, DihedralKernel)  # their bodies take arrays of duals as they are


@jit
def slopes_of_bodies(force, t, x, v, a):
    never_inline()
    return run_body(force, t, x, v, a, None)


@jit
def slopes_of_field(force, t, x, v, a):
    never_inline()
    t = clocked(force, t)
    for i in range(x.shape[1]):
        push = push_of(parameters_of(force.law, i), vector_at(x, i), vector_at(v, i), force.masses[i], t)
        push = over_mass(push, force.inverse_masses, i)
        a[0, i] += push.x
        a[1, i] += push.y
        a[2, i] += push.z
    return OK


@jit
def over_mass(push, inverse_masses, i):
    """Return a force over mass, or the acceleration of a law per mass."""
    if inverse_masses is None:
        return push
    return inverse_masses[i] * push


def push_of(p: Any, x: Any, v: Any, m: Any, t: Any) -> Any:
    """The force of a law as a dual vector."""


@overload(push_of)
def _push_of(p, x, v, m, t):
    law = p.instance_class.fused_law
    return lambda p, x, v, m, t: dual_vector(law(p, x, v, m, t)[1])


def dual_slopes(force: Any, t: float, x: Any, v: Any, a: Any) -> int:
    """Add the accelerations of a force at duals x and v to the duals ``a``, all (3, n). Return a status, which is
    NO_DUALS for a force without a formula that takes duals."""
    raise NotImplementedError("for compiled code")


@overload(dual_slopes)
def _dual_slopes(force, t, x, v, a):
    cls = (force.kind if isinstance(force, Handle) else force).instance_class
    code = slopes_of_field if cls is FieldWork else slopes_of_bodies
    if cls is FieldWork or cls in BODIES:
        try:
            cpu_target.typing_context.resolve_function_type(types.Dispatcher(code), (force, t, x, v, a), {})
        except Exception:  # whatever numba raises for a law with, say, functions of whole arrays
            return lambda force, t, x, v, a: NO_DUALS
        return lambda force, t, x, v, a: code(force, t, x, v, a)
    return lambda force, t, x, v, a: NO_DUALS
