"""Compiled field laws: eight particles at a time, on one thread, so that every sum has a fixed order.

A law with an energy is compiled twice, with its energy and without, so each operation is as written: a look never
changes a particle's path. A law without an energy is compiled once, and its products are fused with the sum.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from kickdrift.forces.seam.kernel import OK, kernel
from kickdrift.jit.compile import as_written, in_order, jit, never_inline
from kickdrift.jit.handle import Handle
from kickdrift.jit.inner import by_type
from kickdrift.jit.lanes import law_operators as law_operators  # operators of the vectors and lanes that a law takes
from kickdrift.jit.lanes.functions import lane_numbers, lane_sum, lanes_like, plus, splat
from kickdrift.jit.lanes.masks import select
from kickdrift.jit.lanes.memory import aligned, flat, load, masked_load, masked_store
from kickdrift.jit.lanes.vector3 import Vector3, joined, load3, store3, vector3
from kickdrift.jit.lanes.vectors import WIDTH, lanes_type
from kickdrift.jit.numba_private import NumbaError, UnsupportedBytecodeError, cgutils, cpu_target
from kickdrift.model.box.cell import Cell, cell_of, nearest_image

if TYPE_CHECKING:
    from kickdrift.model.subject import Subject


class FieldWork(NamedTuple):
    """A field law bound to a System."""

    law: Any  # the parameters: a number, three numbers, or a row of either for all particles, padded to whole lanes
    masses: NDArray[np.float64]  # coherent, padded
    inverse_masses: NDArray[np.float64] | None  # padded; None for a law per mass
    images: Any = None  # Images, for a law of the image nearest to a place in a periodic box


class Images(NamedTuple):
    """A box, and the place of each particle near which its image is taken."""

    cell: Cell
    about: NDArray[np.float64]  # (3, n)
    room: NDArray[np.float64]  # (3, n) the images


def bound_field(force: Any, values: dict[str, Any], system: Subject) -> FieldWork:
    """Bind a field force; ``values`` are its parameters for this System's particles."""
    cls = force.Parameters
    if "compiled_law" not in vars(cls):
        cls.compiled_law, cls.fused_law = as_written(cls.law), in_order(cls.law)
        cls.compiled_clock = in_order(cls.clock) if hasattr(cls, "clock") else None
    masses = system.coherent_masses
    inverse = None if force.per_mass else _padded(1.0 / masses)
    law = cls(**{key: _packed(value) for key, value in values.items()})
    return FieldWork(law, _padded(masses), inverse, _images(force, values, system))


def _images(force: Any, values: dict[str, Any], system: Subject) -> Images | None:
    if not (force.nearest and system.box.periodic):
        return None
    shape = (len(system), 3)
    about = np.ascontiguousarray(np.broadcast_to(np.asarray(values[force.nearest], dtype=float), shape).T)
    return Images(cell_of(system.box), about.copy(), np.zeros(shape[::-1]))


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
    never_inline()
    x = nearest_images(force.images, x)
    n, x, v, a = x.shape[1], flat(x), flat(v), flat(a)
    energy, whole, t = splat(0.0), n - n % WIDTH, clocked(force, t)
    for i in range(0, whole, WIDTH):
        u, total = accelerated(force, i, load3(x, i, n), load3(v, i, n), load3(a, i, n), t)
        store3(a, i, n, total)
        if sums is not None:
            energy = plus(energy, u)
    count = n - whole
    if count > 0:
        u, total = accelerated(
            force, whole, some3(x, whole, n, count), some3(v, whole, n, count), some3(a, whole, n, count), t
        )
        masked_store(a, whole, total.x, count)
        masked_store(a, n + whole, total.y, count)
        masked_store(a, 2 * n + whole, total.z, count)
        if sums is not None:
            energy = plus(energy, select(lane_numbers() < float(count), u, 0.0))
    if sums is not None:
        sums[0] += lane_sum(energy)
    return OK


@by_type(forceinline=True)
def nearest_images(images, x):
    """Positions x (3, n), or their images nearest to the law's place."""
    if isinstance(images, types.NoneType):
        return lambda images, x: x

    def near(images, x):
        room = images.room
        for i in range(room.shape[1]):
            image_near(images, x, i, room)
        return room

    return near


@jit
def image_near(images, x, i, room):
    """Store the image of particle i at x in column i of ``room``."""
    d = np.empty(3, x.dtype)
    for k in range(3):
        d[k] = x[k, i] - images.about[k, i]
    nearest_image(images.cell, d)
    for k in range(3):
        room[k, i] = images.about[k, i] + d[k]


@in_order
def clocked(force, t):
    """Return what the law gets as its time."""
    never_inline()
    return clock_of(force.law, t)


@by_type
def clock_of(law, t):
    """The time, or what the law's class makes of it."""
    clock = (law.kind if isinstance(law, Handle) else law).instance_class.compiled_clock
    return (lambda law, t: clock(parameters_at(law, 0), t)) if clock else (lambda law, t: t)


@as_written
def some3(array, i, n, count):
    """Load the first ``count`` of eight vectors."""
    return vector3(masked_load(array, i, count), masked_load(array, n + i, count), masked_load(array, 2 * n + i, count))


@as_written
def accelerated(force, i, x, v, a, t):
    """Return the energies of eight particles, from particle i on, and their accelerations ``a`` with this force's."""
    m = load(force.masses, i)
    return law_added(parameters_at(force.law, i), x, v, m, t, a, force.inverse_masses, i)


@by_type
def law_added(p, x, v, m, t, a, inverse_masses, i):
    """Energies of the law for these parameters, and ``a`` with the law's accelerations."""
    law, fused = p.instance_class.compiled_law, p.instance_class.fused_law
    if not _returns_energy(law, p, x, v, m, t):

        def without_energy(p, x, v, m, t, a, inverse_masses, i):
            push = fused(p, x, v, m, t)[1]
            return splat(0.0), sum_in_order(a, vector_like(push, m), inverse_masses, i)

        return without_energy

    def with_energy(p, x, v, m, t, a, inverse_masses, i):
        energy, push = law(p, x, v, m, t)
        return scaled(lanes_like(energy, m), m, inverse_masses), sum_as_written(
            a, vector_like(push, m), inverse_masses, i
        )

    return with_energy


def _returns_energy(law: Any, *arguments: types.Type) -> bool:
    """Tell whether a law returns an energy for arguments of these types; also True for a law that does not compile."""
    try:
        returned = cpu_target.typing_context.resolve_function_type(types.Dispatcher(law), arguments, {}).return_type
    except (NumbaError, UnsupportedBytecodeError):  # the law's own call then shows the reason
        return True
    return not (isinstance(returned, types.BaseTuple) and isinstance(returned[0], types.NoneType))


def plus_accelerations(a, push, inverse_masses, i):
    """Return ``a`` plus a force over mass, or plus an acceleration if the inverse masses are None."""
    if inverse_masses is None:
        return a + push
    return a + load(inverse_masses, i) * push


sum_as_written, sum_in_order = as_written(plus_accelerations), in_order(plus_accelerations)


@as_written
def scaled(energy, m, inverse_masses):
    """Return the energy of particles from the value of a law, which is per mass if the inverse masses are None."""
    if inverse_masses is None:
        return m * energy
    return energy


@by_type
def vector_like(push, like):
    """A vector, or three numbers, as a vector of lanes."""
    if isinstance(push, Vector3):
        if push.of == lanes_type:
            return lambda push, like: push
        return lambda push, like: vector3(splat(push.x), splat(push.y), splat(push.z))
    return lambda push, like: vector3(lanes_like(push[0], like), lanes_like(push[1], like), lanes_like(push[2], like))


def _reading(of: types.Type) -> Any:
    """Intrinsic that reads the parameters of eight particles as lanes, or of one particle as numbers."""

    @intrinsic
    def parameters(typingctx, law, place):
        kind = law.kind if isinstance(law, Handle) else law
        result = types.NamedTuple([_read(each, of) for each in kind], kind.instance_class)

        def codegen(context, builder, sig, args):
            whole = builder.load(args[0]) if isinstance(law, Handle) else args[0]
            fields = []
            for k, each in enumerate(kind):
                value = builder.extract_value(whole, k)
                if isinstance(each, types.Array):
                    value = _numbers_of(context, builder, each, value, args[1], context.get_value_type(of))
                elif isinstance(each, types.BaseTuple):
                    value = joined(builder, [builder.extract_value(value, axis) for axis in range(3)])
                fields.append(value)
            return context.make_tuple(builder, sig.return_type, fields)

        return result(law, types.intp), codegen

    return parameters


def _read(kind: types.Type, of: types.Type) -> types.Type:
    if isinstance(kind, types.Array):
        return of if kind.ndim == 1 else Vector3(of)
    return Vector3(types.float64) if isinstance(kind, types.BaseTuple) else types.float64


def _numbers_of(context: Any, builder: Any, kind: types.Array, value: Any, place: Any, to: Any) -> Any:
    array = cgutils.create_struct_proxy(kind)(context, builder, value=value)
    shape = cgutils.unpack_tuple(builder, array.shape)
    parts = []
    for axis in range(kind.ndim if kind.ndim == 1 else 3):
        offset = builder.add(place, builder.mul(shape[-1], context.get_constant(types.intp, axis)))
        part = builder.load(builder.bitcast(builder.gep(array.data, [offset]), to.as_pointer()))
        part.align = 8
        parts.append(part)
    return parts[0] if kind.ndim == 1 else joined(builder, parts)


# Numbers and vectors of eight particles from a place on, as lanes where they vary, and of one particle.
parameters_at, parameters_of = _reading(lanes_type), _reading(types.float64)
