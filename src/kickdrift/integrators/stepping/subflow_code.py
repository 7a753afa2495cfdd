"""Further flows as machine code, which the loop of splitting methods calls by address, and the barostat's place there.

A barostat that acts every few steps acts between two steps. The loop evaluates forces, energy and virial at the
particles. The barostat's machine code then proposes other edge lengths, and scales the particles. The loop evaluates
all again, and the barostat decides: it keeps the change, or takes it back. For a word without a barostat all this is
compiled out.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import carray, types
from numba.extending import intrinsic
from numpy.typing import NDArray

from kickdrift.forces.bound.table import fill_accelerations
from kickdrift.forces.seam.kernel import OK
from kickdrift.jit.compile import inlined, jit
from kickdrift.jit.handle import Bound, Handle, handle_at
from kickdrift.jit.inner import by_type
from kickdrift.model.state import Floats

_NUMBERS = types.CPointer(types.float64)
BODIES: dict[type, Any] = {}  # compiled bodies by the NamedTuple class of the parts


def subflow_body(parts: type) -> Callable[[Callable[..., int]], Callable[..., int]]:
    """Register the body of the flows whose parts are that NamedTuple class; see ``BoundSubflow``."""

    def register(body: Callable[..., int]) -> Callable[..., int]:
        BODIES[parts] = jit(body)
        parts.kernel_sources = (body,)  # type: ignore[attr-defined]
        return body

    return register


class BoundSubflow(Bound):
    """A flow of one run: its parts, and the machine code that lets it act.

    ``body(parts, t, x, v, span, step, stage) -> status`` lets the flow act on positions and velocities, both (3, n),
    for the time ``span`` from ``t`` on. ``step`` and ``stage`` are whole numbers: how many steps were done before, and
    the place in ``Splitting.stages``, another for each time that the flow acts in a step. A status other than 0 stops
    the run.
    """

    signature = types.int64(
        types.intp, types.int64, types.float64, types.float64, types.int64, types.int64, _NUMBERS, _NUMBERS
    )

    def _compute_for(self, kind: types.Type) -> Callable[..., int]:
        restore, body = handle_at(Handle(kind)), BODIES[type(self.parts)]

        def compute(work, n, t, span, step, stage, x, v):
            return body(restore(work), t, carray(x, (3, n)), carray(v, (3, n)), span, step, stage)

        return compute


@intrinsic
def call_subflow(typingctx, address, work, t, span, step, stage, x, v):
    """Let the flow at ``address`` with the parts at ``work`` act on x and v, contiguous arrays (3, n); a status."""

    def codegen(context, builder, sig, args):
        whole, double = ir.IntType(64), ir.DoubleType()
        numbers = double.as_pointer()
        kind = ir.FunctionType(whole, [whole, whole, double, double, whole, whole, numbers, numbers])
        at, velocities = (context.make_array(sig.args[k])(context, builder, args[k]) for k in (6, 7))
        n = builder.extract_value(at.shape, 1)
        where = builder.inttoptr(args[0], kind.as_pointer())
        return builder.call(where, [args[1], n, *args[2:6], at.data, velocities.data])

    return types.int64(address, work, types.float64, types.float64, types.int64, types.int64, x, v), codegen


# Steps done in this call, next stage, whether `work` holds the derivative at y (with groups of forces a bit for each
# group), rejected steps.
STEP, STAGE, FRESH, REJECTED = 1, 2, 3, 4


PROPOSE, DECIDE = 0, 1  # tasks of a barostat, in place of a stage
TAKEN_BACK = 100  # status of a decision: the particles are back where they were
SUMMED, PROPOSED, ACTED = range(3)  # slots of ``place``


class Pressed(NamedTuple):
    """The barostat of a word, as the loop uses it."""

    table: NDArray[np.int64]  # (2,) addresses of the machine code and of its parts; zeros if it is a flow of the word
    every: int  # steps from one action to the next
    place: NDArray[np.int64]  # (3,) whether `sums` are those at x, whether a change waits for its decision, and the
    # number of the step after the last action, plus 1
    sums: Floats  # (3,) potential energy, virial and pairs at the last evaluation with sums
    kept: Floats  # (3, n) accelerations before a proposal
    felt: Any = None  # (3, n) accelerations of the last evaluation with sums, where the barostat needs them


@inlined
def evaluate(barostat, bound, t, x, v, work, done, cursor):
    """work <- accelerations at x, after ``done`` steps; return a status. Energy and virial are summed if the barostat
    acts at the end of the step."""
    if barostat is not None:
        if (done + 1) % barostat.every == 0:
            return fill_with_sums(barostat, bound, t, x, v, work, cursor)
        barostat.place[SUMMED] = 0
    return fill_accelerations(bound, t, x, v, work, None, cursor)


@by_type
def keep_felt(felt, work):
    """felt <- accelerations, for a barostat that needs them."""
    if isinstance(felt, types.NoneType):
        return lambda felt, work: None
    return lambda felt, work: copy_rows(work, felt)


@jit
def fill_with_sums(barostat, bound, t, x, v, work, cursor):
    """work and the barostat's sums <- those at x; return a status."""
    for k in range(barostat.sums.size):
        barostat.sums[k] = 0.0
    status = fill_accelerations(bound, t, x, v, work, barostat.sums, cursor)
    keep_felt(barostat.felt, work)
    barostat.place[SUMMED] = int(status == OK)
    return status


@inlined
def press(barostat, bound, start, done, dt, x, v, work, cursor):
    """Let the barostat act before step ``done``, if its turn has come; return a status."""
    return OK if barostat is None else act_between(barostat, bound, start, done, dt, x, v, work, cursor)


@jit
def act_between(barostat, bound, start, done, dt, x, v, work, cursor):
    """Let the barostat act between two steps; after a full pair list the same call goes on where it was."""
    place = barostat.place
    if done % barostat.every != 0 or place[ACTED] == done + 1:
        return OK
    code, parts = barostat.table
    t, span = start + done * dt, barostat.every * dt
    if not place[PROPOSED]:
        if not (cursor[FRESH] and place[SUMMED]):
            status = fill_with_sums(barostat, bound, t, x, v, work, cursor)
            if status != OK:
                return status
            cursor[FRESH] = 1
        if code == 0:
            return OK
        copy_rows(work, barostat.kept)
        status = call_subflow(code, parts, t, span, done, PROPOSE, x, v)
        if status != OK:
            return status
        place[PROPOSED], cursor[FRESH] = 1, 0
    status = fill_with_sums(barostat, bound, t, x, v, work, cursor)
    if status != OK:
        return status
    status = call_subflow(code, parts, t, span, done, DECIDE, x, v)
    if status == TAKEN_BACK:
        copy_rows(barostat.kept, work)
        status = OK
    place[PROPOSED], place[ACTED], cursor[FRESH] = 0, done + 1, 1
    return status


@jit
def copy_rows(source, target):
    for k in range(target.shape[0]):
        for i in range(target.shape[1]):
            target[k, i] = source[k, i]
