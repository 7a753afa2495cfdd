"""Compiled field laws: eight particles at a time, on one thread, so that every sum has a fixed order.

The sum with the energy and the sum without are one piece of machine code, so a look never changes a particle's path.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from kickdrift.forces.kernel import OK, kernel
from kickdrift.jit import law_operators as law_operators  # operators of the vectors and lanes that a law takes
from kickdrift.jit.compile import in_order, jit, never_inline
from kickdrift.jit.handle import Handle
from kickdrift.jit.inner import overload
from kickdrift.jit.lanes import lane_numbers, lane_sum, lanes_like, splat
from kickdrift.jit.masks import select
from kickdrift.jit.memory import aligned, flat, load, masked_load, masked_store
from kickdrift.jit.numba_private import cgutils
from kickdrift.jit.vector3 import load3, store3, vector3
from kickdrift.jit.vector3_operators import Vector3, joined
from kickdrift.jit.vectors import F64X8, WIDTH, lanes_type

if TYPE_CHECKING:
    from kickdrift.model.subject import Subject


class FieldWork(NamedTuple):
    """A field law bound to a System."""

    law: Any  # the parameters: a number, three numbers, or a row of either for all particles, padded to whole lanes
    masses: NDArray[np.float64]  # coherent, padded
    inverse_masses: NDArray[np.float64] | None  # padded; None for a law per mass


def bound_field(force: Any, values: dict[str, Any], system: Subject) -> FieldWork:
    """Bind a field force; ``values`` are its parameters for this System's particles."""
    cls = force.Parameters
    if "compiled_law" not in vars(cls):
        cls.compiled_law = in_order(cls.law)
    masses = system.coherent_masses
    inverse = None if force.per_mass else _padded(1.0 / masses)
    return FieldWork(cls(**{key: _packed(value) for key, value in values.items()}), _padded(masses), inverse)


def _packed(value: Any) -> Any:
    if not isinstance(value, np.ndarray):
        return value if isinstance(value, tuple) else float(value)
    return _padded(value) if value.ndim == 1 else np.stack([_padded(row) for row in value.T])


def _padded(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """The values, and ones up to whole lanes."""
    made = aligned((-(-len(values) // WIDTH) * WIDTH,), 1.0)
    made[: len(values)] = values
    return made


@kernel(FieldWork)
def field_forces(force, t, x, v, a, sums):
    energy = swept(force, t, x, v, a)
    if sums is not None:
        sums[0] += energy
    return OK


@jit
def swept(force, t, x, v, a):
    """Add the accelerations of all particles to ``a``; return the energy."""
    never_inline()
    return sweep(force, t, flat(x), flat(v), flat(a), x.shape[1])


@in_order
def sweep(force, t, x, v, a, n):
    energy, whole = splat(0.0), n - n % WIDTH
    for i in range(0, whole, WIDTH):
        u, push = at_particles(force, i, load3(x, i, n), load3(v, i, n), t)
        store3(a, i, n, load3(a, i, n) + push)
        energy = energy + u
    count = n - whole
    if count > 0:
        u, push = at_particles(force, whole, some3(x, whole, n, count), some3(v, whole, n, count), t)
        total = some3(a, whole, n, count) + push
        masked_store(a, whole, total.x, count)
        masked_store(a, n + whole, total.y, count)
        masked_store(a, 2 * n + whole, total.z, count)
        energy = energy + select(lane_numbers() < float(count), u, 0.0)
    return lane_sum(energy)


@in_order
def some3(array, i, n, count):
    """Load the first ``count`` of eight vectors."""
    return vector3(masked_load(array, i, count), masked_load(array, n + i, count), masked_load(array, 2 * n + i, count))


@in_order
def at_particles(force, i, x, v, t):
    """Return the energies and accelerations of eight particles, from particle i on."""
    m = load(force.masses, i)
    energy, push = law_at(parameters_at(force.law, i), x, v, m, t)
    return whole(energy_like(energy, m), vector_like(push, m), m, force.inverse_masses, i)


@in_order
def whole(energy, push, m, inverse_masses, i):
    """Return energy and acceleration from the values of a law; inverse masses are None for a law per mass."""
    if inverse_masses is None:
        return m * energy, push
    return energy, load(inverse_masses, i) * push


def law_at(p: Any, x: Any, v: Any, m: Any, t: Any) -> Any:
    """Energy and force of the law for these parameters."""


@overload(law_at)
def _law_at(p, x, v, m, t):
    law = p.instance_class.compiled_law
    return lambda p, x, v, m, t: law(p, x, v, m, t)


def energy_like(energy: Any, like: Any) -> Any:
    """Energies as lanes; zero for None."""


@overload(energy_like)
def _energy_like(energy, like):
    if isinstance(energy, types.NoneType):
        return lambda energy, like: splat(0.0)
    return lambda energy, like: lanes_like(energy, like)


def vector_like(push: Any, like: Any) -> Any:
    """A vector, or three numbers, as a vector of lanes."""


@overload(vector_like)
def _vector_like(push, like):
    if isinstance(push, Vector3):
        if push.of == lanes_type:
            return lambda push, like: push
        return lambda push, like: vector3(splat(push.x), splat(push.y), splat(push.z))
    return lambda push, like: vector3(lanes_like(push[0], like), lanes_like(push[1], like), lanes_like(push[2], like))


@intrinsic
def parameters_at(typingctx, law, place):
    """Parameters of eight particles from ``place`` on: numbers and vectors, of lanes where they vary."""
    kind = law.kind if isinstance(law, Handle) else law
    result = types.NamedTuple([_read(each) for each in kind], kind.instance_class)

    def codegen(context, builder, sig, args):
        whole = builder.load(args[0]) if isinstance(law, Handle) else args[0]
        fields = []
        for k, each in enumerate(kind):
            value = builder.extract_value(whole, k)
            if isinstance(each, types.Array):
                value = _lanes_of(context, builder, each, value, args[1])
            elif isinstance(each, types.BaseTuple):
                value = joined(builder, [builder.extract_value(value, axis) for axis in range(3)])
            fields.append(value)
        return context.make_tuple(builder, sig.return_type, fields)

    return result(law, types.intp), codegen


def _read(kind: types.Type) -> types.Type:
    if isinstance(kind, types.Array):
        return lanes_type if kind.ndim == 1 else Vector3(lanes_type)
    return Vector3(types.float64) if isinstance(kind, types.BaseTuple) else types.float64


def _lanes_of(context: Any, builder: Any, kind: types.Array, value: Any, place: Any) -> Any:
    array = cgutils.create_struct_proxy(kind)(context, builder, value=value)
    shape = cgutils.unpack_tuple(builder, array.shape)
    parts = []
    for axis in range(kind.ndim if kind.ndim == 1 else 3):
        offset = builder.add(place, builder.mul(shape[-1], context.get_constant(types.intp, axis)))
        part = builder.load(builder.bitcast(builder.gep(array.data, [offset]), F64X8.as_pointer()))
        part.align = 8
        parts.append(part)
    return parts[0] if kind.ndim == 1 else joined(builder, parts)
