"""Steps of kicks and drifts with the particles in the order of their clusters.

A pair force can take whole steps by itself, if it acts alone. One sweep over the clusters kicks and drifts the
particles, brings them to their places in the list, and notes how far they moved. Then the pairs are summed. So a step
goes through memory once, in its order, beside the sum. Particles change to this order where steps begin, and back where
they end. A search for a new list needs the user's order too.

The machine code does not depend on the law. It is compiled when a run first needs such steps, and calls the force by
its address.

A sweep rounds like kicks, drifts and copies one after the other. So all runs have the same bits.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import carray, typeof, types
from numba.extending import intrinsic
from numpy.typing import NDArray

from kickdrift.forces.lists.clusters import BUILT, LANES, STRIDE, chunk_clusters, load_vector, store_vector, unsigned
from kickdrift.forces.lists.list_code import outlasts
from kickdrift.forces.lists.load import AT_ONCE, add_moves, note_moves, total_move
from kickdrift.forces.lists.pair_rows import copy_to_single
from kickdrift.forces.lists.sums import add_collected, collected_mean, forces_on, no_mean_yet
from kickdrift.forces.seam.kernel import FORCES_ALONE, OK, REFRESH, call_force
from kickdrift.forces.seam.samples import SUMMED, WITH_SUMS
from kickdrift.jit.compile import as_written, is_finite, jit, never_inline
from kickdrift.jit.handle import Handle, address, callback, handle, handle_at
from kickdrift.jit.lanes.functions import multiply_add, splat
from kickdrift.jit.lanes.memory import load, set_zero
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.jit.threads.chunks import chunk_task, each_chunk
from kickdrift.model.state import Floats

NONE, ROW, GIVEN = range(3)  # accelerations of a sweep: no kick, from a row of the caller's, from the sums of the pairs

# slots of a plan: the numbers of steps and evaluations that were taken, the stage that comes next, whether the
# accelerations are those at the positions, the number of steps to take, the step, the number of stages, the address of
# the force's machine code
TAKEN, EVALUATED, NEXT, HOLDS, STEPS, DT, STAGES, CODE, HEAD = range(9)
FEWEST_STEPS = 3  # steps that are worth a stretch


def plan_of(stages: Floats) -> Floats:
    """Return the plan of a word of kicks and drifts; ``stages`` is as in `Splitting.stages`. After its head come the
    weights of kicks, the weights of drifts, and room for the spans of one sweep's kicks."""
    count = stages.shape[1]
    plan = np.zeros(HEAD + 4 * count)
    plan[STAGES], plan[HEAD : HEAD + count], plan[HEAD + count : HEAD + 2 * count] = count, stages[0], stages[1]
    return plan


class Stepped(NamedTuple):
    """What steps need of a pair force; its fields are those of a PairWork."""

    pairs: Any  # a handle of a ClusterList
    chunks: Any
    mixed: Any
    inverse_masses: NDArray[np.float64]
    looks: NDArray[np.int64]


class Sweep(NamedTuple):
    """What the chunks of a sweep need."""

    pairs: Any  # a handle of a ClusterList
    chunks: Any
    source: int  # of the accelerations
    mean: Any  # None, or in mixed precision the mean acceleration, which is subtracted
    spans: NDArray[np.float64]  # (kicks,) time of each kick
    drift: float  # time of the drift after the kicks


class Crossing(NamedTuple):
    """What brings particles to the order of the clusters, and back."""

    pairs: Any  # a handle of a ClusterList
    chunks: Any
    inverse_masses: Any
    x: Any  # (3, n)
    v: Any  # (3, n)
    a: Any  # (3, n)


_CODES: dict[Any, Any] = {}  # machine code, by the types of the list and of the precision
_NUMBERS = types.CPointer(types.float64)
_SIGNATURE = types.void(types.intp, types.intp, types.int64, types.int64, _NUMBERS, _NUMBERS, _NUMBERS, _NUMBERS)


def steps_code(work: Any) -> int:
    """Return the address of the code that takes steps with a PairWork, compiled on first use."""
    kinds = Handle(typeof(work.pairs)), *(typeof(getattr(work, name)) for name in Stepped._fields[1:])
    kind = types.NamedTuple(kinds, Stepped)
    if kind not in _CODES:
        _CODES[kind] = callback(_steps_for(kind), _SIGNATURE, kind)
    return int(_CODES[kind].address)


def _steps_for(kind: types.BaseTuple) -> Callable[..., None]:
    restore = handle_at(Handle(kind))

    def steps(place, work, size, n, plan, x, v, a):
        take_steps(restore(place), work, carray(plan, (size,)), carray(x, (3, n)), carray(v, (3, n)), carray(a, (3, n)))

    return steps


@intrinsic
def _call(typingctx, code, place, work, plan, x, v, a):
    """Call the code at an address."""

    def codegen(context, builder, sig, args):
        whole, numbers = ir.IntType(64), ir.DoubleType().as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [whole, whole, whole, whole, *4 * [numbers]])
        made = [
            context.make_array(of)(context, builder, array) for of, array in zip(sig.args[3:], args[3:], strict=True)
        ]
        sizes = builder.extract_value(made[0].shape, 0), builder.extract_value(made[1].shape, 1)
        pointer = builder.inttoptr(args[0], kind.as_pointer())
        builder.call(pointer, [*args[1:3], *sizes, *(array.data for array in made)])
        return context.get_dummy_value()

    return types.void(code, place, types.intp, plan, x, v, a), codegen


@jit
def step_by(force, work, plan, x, v, a):
    """Let the pair force whose parts are at ``work`` take the steps of its plan."""
    stepped = handle(Stepped(force.pairs, force.chunks, force.mixed, force.inverse_masses, force.looks))
    _call(force.steps, address(stepped), work, plan, x, v, a)


@jit
def take_steps(force, work, plan, x, v, a):
    """Take up to ``plan[STEPS]`` steps, and note in the plan how far they came.

    The steps stop early if a list needs more room, or if particles flew apart: only the caller can evaluate then.

    The state and the accelerations are the caller's, (3, n). If numbers are not finite, the state stays as it was
    after the last search: the caller's own steps then fail at the right step."""
    pairs, chunks, count = force.pairs, force.chunks, int(plan[STAGES])
    kicks, drifts, spans = plan[HEAD : HEAD + count], plan[HEAD + count : HEAD + 2 * count], plan[HEAD + 2 * count :]
    fresh, stage, taken, evaluated, steps, dt = plan[HOLDS] != 0.0, 0, 0, 0, int(plan[STEPS]), plan[DT]
    if not pairs.counts[BUILT]:
        return
    code = int(plan[CODE])
    force.looks[SUMMED] = 0
    crossing = handle(Crossing(pairs, chunks, force.inverse_masses, x, v, a))
    each_chunk(crossing, chunks, "enter_chunk")
    if fresh:
        each_chunk(crossing, chunks, "enter_accelerations")
    else:
        each_chunk(handle(Sweep(pairs, chunks, NONE, no_mean_yet(force.mixed), spans[:0], 0.0)), chunks, "sweep_chunk")
    source, mean = ROW, no_mean_yet(force.mixed)
    while taken < steps:
        if not fresh and kicks[stage] != 0.0:
            if outlasts(pairs, chunks) != OK:
                each_chunk(crossing, chunks, "leave_chunk")
                note(plan, taken, evaluated, stage, fresh)
                if call_force(code, work, REFRESH, 0.0, x, v, a, None) != OK:
                    return
                each_chunk(crossing, chunks, "enter_chunk")
            call_force(code, work, FORCES_ALONE, 0.0, x, v, a, None)
            mean = collected_mean(force.mixed, pairs, chunks)
            fresh, source, evaluated = True, GIVEN, evaluated + 1
        kicked, drift = 0, 0.0
        while taken < steps and drift == 0.0 and (fresh or kicks[stage] == 0.0):
            if kicks[stage] != 0.0:
                spans[kicked] = kicks[stage] * dt
                kicked += 1
            drift = drifts[stage] * dt
            stage += 1
            if stage == count:
                stage, taken = 0, taken + 1
        sweep = Sweep(pairs, chunks, source if kicked else NONE, mean, spans[:kicked], drift)
        each_chunk(handle(sweep), chunks, "sweep_chunk")
        if not is_finite(total_move(pairs)):
            pairs.counts[BUILT] = 0
            return
        fresh = fresh and drift == 0.0
    each_chunk(crossing, chunks, "leave_chunk")
    if fresh and evaluated:
        set_zero(a)
        add_collected(force, mean, a)
        force.looks[SUMMED] = force.looks[WITH_SUMS]
    note(plan, taken, evaluated, stage, fresh)


@jit
def note(plan, taken, evaluated, stage, fresh):
    """Write to the plan how far the steps came."""
    plan[TAKEN], plan[EVALUATED], plan[NEXT], plan[HOLDS] = taken, evaluated, stage, fresh


@chunk_task
def enter_chunk(crossing, c):
    """Copy positions, velocities and inverse masses of the particles of chunk c's clusters to the order of the
    clusters. An empty place gets a particle that rests and feels nothing."""
    never_inline()
    pairs, x, v, inverse_masses = crossing.pairs, crossing.x, crossing.v, crossing.inverse_masses
    order, firsts, fillings, places, offset = pairs.order, pairs.first, pairs.filled, pairs.x, pairs.offset
    own_x, own_v, weights = moving_parts(pairs)
    begin, end = chunk_clusters(pairs, c)
    for cluster in range(begin, end):
        first, at = unsigned(firsts[cluster]), unsigned(STRIDE * cluster)
        filled, eight = unsigned(fillings[cluster]), unsigned(WIDTH * cluster)
        for lane in range(filled):
            i, p = unsigned(order[first + lane]), at + lane
            weights[eight + lane] = inverse_masses[i]
            own_x[p], own_x[p + LANES], own_x[p + LANES + LANES] = x[0, i], x[1, i], x[2, i]
            own_v[p], own_v[p + LANES], own_v[p + LANES + LANES] = v[0, i], v[1, i], v[2, i]
        for lane in range(filled, LANES):
            weights[eight + lane] = 0.0
            for k in range(3):
                p = at + LANES * unsigned(k) + lane
                own_x[p], own_v[p], offset[p] = places[p], 0.0, 0.0


@chunk_task
def enter_accelerations(crossing, c):
    """Copy the accelerations to the order of the clusters."""
    never_inline()
    pairs, a = crossing.pairs, crossing.a
    row, order, firsts, fillings = pairs.force[0], pairs.order, pairs.first, pairs.filled
    begin, end = chunk_clusters(pairs, c)
    for cluster in range(begin, end):
        first, at = unsigned(firsts[cluster]), unsigned(STRIDE * cluster)
        store_vector(row, cluster, splat(0.0), splat(0.0), splat(0.0))
        for lane in range(unsigned(fillings[cluster])):
            i, p = unsigned(order[first + lane]), at + lane
            row[p], row[p + LANES], row[p + LANES + LANES] = a[0, i], a[1, i], a[2, i]


@chunk_task
def sweep_chunk(sweep, c):
    """Kick and drift the particles of chunk c's clusters, copy the positions to their places in the list, in mixed
    precision also as float32, and note the moves since the last pruning."""
    never_inline()
    pairs = sweep.pairs
    begin, end = chunk_clusters(pairs, c)
    largest, total, pulls = splat(0.0), splat(0.0), splat(0.0)
    for block in range(begin, end, AT_ONCE):
        last = min(block + AT_ONCE, end)
        pulls = sweep_clusters(sweep, block, last, pulls)
        copy_to_single(pairs, block, last)
        largest, total = add_moves(pairs, pairs.inner_reference, block, last, largest, total)
    note_moves(pairs, c, largest, total + pulls)


@as_written
def sweep_clusters(sweep, begin, end, pulls):
    """Kick and drift the particles of these clusters; return ``pulls`` with the sum of their accelerations."""
    pairs, spans, drift, source = sweep.pairs, sweep.spans, splat(sweep.drift), sweep.source
    x, v, weights = moving_parts(pairs)
    for cluster in range(begin, end):
        vx, vy, vz = load_vector(v, cluster)
        if source != NONE:
            if source == ROW:
                ax, ay, az = load_vector(pairs.force[0], cluster)
            else:
                w = load(weights, WIDTH * cluster)
                fx, fy, fz = forces_on(pairs, sweep.chunks, sweep.mean, cluster)
                ax, ay, az = pulled(sweep.mean, 0, fx, w), pulled(sweep.mean, 1, fy, w), pulled(sweep.mean, 2, fz, w)
            pulls = pulls + ax + ay + az
            for k in range(spans.size):
                span = splat(spans[k])
                vx, vy, vz = multiply_add(span, ax, vx), multiply_add(span, ay, vy), multiply_add(span, az, vz)
            store_vector(v, cluster, vx, vy, vz)
        own_x, own_y, own_z = load_vector(x, cluster)
        if sweep.drift != 0.0:
            own_x, own_y, own_z = (
                multiply_add(drift, vx, own_x),
                multiply_add(drift, vy, own_y),
                multiply_add(drift, vz, own_z),
            )
            store_vector(x, cluster, own_x, own_y, own_z)
        edge_x, edge_y, edge_z = load_vector(pairs.offset, cluster)
        store_vector(pairs.x, cluster, own_x - edge_x, own_y - edge_y, own_z - edge_z)
    return pulls


@as_written
def pulled(mean, k, force, weight):
    """Return the accelerations by forces along one axis, less a component of the mean, if there is one."""
    return multiply_add(force, weight, splat(0.0 if mean is None else -mean[k]))


@chunk_task
def leave_chunk(crossing, c):
    """Copy positions and velocities of chunk c's particles back to the user's order."""
    never_inline()
    place, x, v = crossing.pairs.place, crossing.x, crossing.v
    own_x, own_v, _ = moving_parts(crossing.pairs)
    n, chunks = x.shape[1], crossing.chunks.number
    for i in range(unsigned(c * n // chunks), unsigned((c + 1) * n // chunks)):
        p = unsigned(place[i])
        x[0, i], x[1, i], x[2, i] = own_x[p], own_x[p + LANES], own_x[p + LANES + LANES]
        v[0, i], v[1, i], v[2, i] = own_v[p], own_v[p + LANES], own_v[p + LANES + LANES]


@as_written
def moving_parts(pairs):
    """Return positions (3 slots,), velocities (3 slots,) and inverse masses (slots,) in the order of the clusters."""
    size = pairs.x.size
    return pairs.moving[:size], pairs.moving[size : 2 * size], pairs.moving[2 * size :]
