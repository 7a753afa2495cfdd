"""The compiled sum over the cluster pair list: any pair law, any truncation, one species or many."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import carray, get_num_threads, typeof, types
from numba.core.errors import TypingError
from numba.extending import intrinsic
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.forces.chunks import Parallel, Serial, chunk_task, each_chunk
from kickdrift.forces.clusters import (
    BUILT,
    N_CLUSTERS,
    OUTER_BUILDS,
    ROOM_NEEDED,
    SHIFT_BITS,
    STRIDE,
    ClusterList,
    chunk_clusters,
    cluster_list,
    copy,
    load_vector,
    store_vector,
)
from kickdrift.forces.compiling import callback, driver, jit, never_inline
from kickdrift.forces.handle import Handle, handle_at, memory_of
from kickdrift.forces.inner import overload
from kickdrift.forces.kernel import OK, kernel
from kickdrift.forces.list_code import list_code, prune, refresh
from kickdrift.forces.pairlist import shift_particle
from kickdrift.forces.simd import (
    WIDTH,
    aligned,
    as_lanes,
    lane_numbers,
    lane_sum,
    multiply_add,
    named_lanes,
    select,
    splat,
)
from kickdrift.forces.truncation import AtCutoff, Cut, ForceShift, Shift, Switch, truncated
from kickdrift.state import Floats

if TYPE_CHECKING:
    from kickdrift.forces.pair_law import PairForce
    from kickdrift.system import System


THIN = 1e-3  # of the cutoff: a skin for rounding


class Tables(NamedTuple):
    """Numbers per pair of species, spread over the slots: ``law[k, species of i, slot of j]`` for the k-th
    parameter."""

    law: NDArray[np.float64]  # (parameters, species, slots)
    at_cutoff: NDArray[np.float64]  # (2, species, slots)
    law_pairs: NDArray[np.float64]  # (parameters, species, species)
    at_cutoff_pairs: NDArray[np.float64]  # (2, species, species)
    species: NDArray[np.int64]  # (n,)
    row: NDArray[np.int64]  # (slots,) the species in a slot


class PairWork(NamedTuple):
    """A pair law bound to a System."""

    law: Any  # the law's NamedTuple of parameters (of the first pair of species, where there are several)
    at_cutoff: AtCutoff  # likewise
    tables: Any  # Tables, or None for one species
    truncation: Any
    cutoff: float
    tail: tuple[float, float]  # energy and virial from beyond the cutoff
    inverse_masses: NDArray[np.float64]  # (n,)
    sums: NDArray[np.float64]  # (chunks, 3) energy, virial, pairs
    pairs: ClusterList
    threads: Serial | Parallel


class _Addresses(NamedTuple):
    compute: int
    work: int


class PairKernel(_Addresses):
    """A pair force as the loops know it: two addresses, so that they are compiled once for all laws, truncations and
    mixtures, and `compute` once for each.

    Attributes
    ----------
    compute : of the machine code; 0 until it is `ready`
    work : of the PairWork in memory
    parts : PairWork
    """

    parts: PairWork

    @classmethod
    def of(cls, parts: PairWork) -> PairKernel:
        """The force with these parts; nothing is compiled yet."""
        made = cls(0, 0)
        made.parts = parts
        return made

    def ready(self) -> PairKernel:
        """The same with its machine code, compiled if need be; the parts live as long as it does."""
        if self.compute:
            return self
        get_num_threads()  # starts numba's threads: machine code from the disk refers to them
        parts = self.parts._replace(pairs=self.pairs._replace(code=list_code(self.pairs, self.parts.threads)))
        kind = typeof(parts)
        if kind not in _COMPUTE:
            _COMPUTE[kind] = callback(compute_for(kind), _SIGNATURE, kind)
        memory = memory_of(parts)
        made = PairKernel(_COMPUTE[kind].address, memory.ctypes.data)
        made.parts, made._memory = parts, memory  # type: ignore[attr-defined]
        return made

    @property
    def pairs(self) -> ClusterList:
        """The list."""
        return self.parts.pairs

    def with_list(self, **changes: Any) -> PairKernel:
        """The same force with these parts of its list changed."""
        return PairKernel.of(self.parts._replace(pairs=self.pairs._replace(**changes)))

    def remake(self, built_at: Floats, pruned_at: Floats) -> int:
        """Make the list that was made at positions ``built_at`` (3, n) and last pruned where its ``inner_reference``
        was ``pruned_at``; a status."""
        return ask(self.compute, self.work, REMAKE, built_at, pruned_at, np.zeros(1))


FORCES, FORCES_AND_SUMS, REMAKE = range(3)  # what `compute` is asked for
_COMPUTE: dict[Any, Any] = {}  # by the type of PairWork
_NUMBERS = types.CPointer(types.float64)
_SIGNATURE = types.int64(types.intp, types.int64, types.int64, _NUMBERS, _NUMBERS, _NUMBERS)


@intrinsic
def call_pairs(typingctx, compute, work, what, x, a, sums):
    """Call the ``compute`` of a pair force: positions (3, n), and what is done with the other two arrays depends on
    what it is asked for; a status."""
    if any(array.layout != "C" for array in (x, a, sums)):
        raise TypingError("a pair force takes contiguous arrays")

    def codegen(context, builder, sig, args):
        whole, number = ir.IntType(64), ir.DoubleType().as_pointer()
        kind = ir.FunctionType(whole, [whole, whole, whole, number, number, number])
        arrays = [context.make_array(sig.args[k])(context, builder, args[k]) for k in (3, 4, 5)]
        n = builder.extract_value(arrays[0].shape, 1)
        pointer = builder.inttoptr(args[0], kind.as_pointer())
        return builder.call(pointer, [args[1], args[2], n, *(array.data for array in arrays)])

    return types.int64(compute, work, types.int64, x, a, sums), codegen


@driver
def ask(compute, work, what, x, a, sums):
    return call_pairs(compute, work, what, x, a, sums)


@kernel(PairKernel)
def pair_forces(force, t, x, v, a, sums):
    if sums is None:
        return call_pairs(force.compute, force.work, FORCES, x, a, a)
    return call_pairs(force.compute, force.work, FORCES_AND_SUMS, x, a, sums)


def compute_for(kind: types.Type) -> Callable[..., int]:
    """All that is done with a PairWork of that type, as a function to be compiled for its address."""
    restore = handle_at(Handle(kind))

    def compute(work, what, n, x, a, sums):
        force = restore(work)
        if what == REMAKE:
            return remake(force, carray(x, (3, n)), carray(a, force.pairs.x.shape))
        return add_forces(force, what == FORCES_AND_SUMS, carray(x, (3, n)), carray(a, (3, n)), carray(sums, (3,)))

    return compute


@jit
def remake(force, built_at, pruned_at):
    pairs = force.pairs
    pairs.counts[BUILT] = 0
    status = refresh(pairs, built_at, force.threads)
    if status == OK:
        copy(pruned_at, pairs.x)
        prune(pairs, force.threads)
        spread(force.tables, pairs)
    return status


@jit
def add_forces(force, wanted, x, a, sums):
    """a <- a + the accelerations (3, n); where ``wanted`` sums <- sums + energy, virial, pairs; a status."""
    pairs, threads = force.pairs, force.threads
    builds = pairs.counts[OUTER_BUILDS]
    status = refresh(pairs, x, threads)
    if status != OK:
        return status
    if pairs.counts[OUTER_BUILDS] != builds:
        spread(force.tables, pairs)
    if not wanted:
        each_chunk(force, threads, "chunk_forces")
    else:
        each_chunk(force, threads, "chunk_forces_and_sums")
        for c in range(threads.chunks):
            sums[0] += force.sums[c, 0]
            sums[1] += force.sums[c, 1]
            sums[2] += force.sums[c, 2]
        sums[0] += force.tail[0]
        sums[1] += force.tail[1]
    collect(pairs)
    place, total, inverse_masses = pairs.place, pairs.force[0], force.inverse_masses
    for i in range(place.size):
        p, w = place[i], inverse_masses[i]
        a[0, i] += total[p] * w
        a[1, i] += total[p + WIDTH] * w
        a[2, i] += total[p + 2 * WIDTH] * w
    return OK


def spread(tables: Any, pairs: ClusterList) -> None:
    """After a sort: put each pair of species' numbers where their slots now are."""


@overload(spread)
def _spread(tables, pairs):
    if isinstance(tables, types.NoneType):
        return lambda tables, pairs: None

    def spread_tables(tables, pairs):
        for i in range(pairs.place.size):
            p = pairs.place[i]
            s = p // STRIDE * WIDTH + p % STRIDE
            of_i = tables.species[i]
            tables.row[s] = of_i
            for row in range(tables.law.shape[1]):
                for k in range(tables.law.shape[0]):
                    tables.law[k, row, s] = tables.law_pairs[k, row, of_i]
                for k in range(2):
                    tables.at_cutoff[k, row, s] = tables.at_cutoff_pairs[k, row, of_i]

    return spread_tables


@jit
def collect(pairs):
    """Add the chunks' forces up in chunk 0's, in one order."""
    force, touched = pairs.force, pairs.touched
    total = force[0]
    for cluster in range(pairs.counts[N_CLUSTERS]):
        fx, fy, fz = splat(0.0), splat(0.0), splat(0.0)
        for c in range(force.shape[0]):
            if touched[c, cluster]:
                gx, gy, gz = load_vector(force[c], cluster)
                fx, fy, fz = fx + gx, fy + gy, fz + gz
        store_vector(total, cluster, fx, fy, fz)


@chunk_task
def chunk_forces(force, c):
    """Forces on the particles of chunk c and their reactions, into the chunk's own array."""
    never_inline()
    sum_pairs(force, None, c)


@chunk_task
def chunk_forces_and_sums(force, c):
    """The same, and the chunk's energy and virial."""
    never_inline()
    sum_pairs(force, force.sums, c)


@jit
def sum_pairs(force, sums, c):
    pairs = force.pairs
    entries, shifts, span, filled, touched = (
        pairs.inner[c],
        pairs.shifts,
        pairs.inner_span,
        pairs.filled,
        pairs.touched[c],
    )
    x, forces, shifted = pairs.x, pairs.force[c], np.empty(3 * 4 * WIDTH)
    zero = splat(0.0)
    for cluster in range(pairs.counts[N_CLUSTERS]):
        if touched[cluster]:
            store_vector(forces, cluster, zero, zero, zero)
    cutoff2 = force.cutoff**2
    laws = force.law, force.at_cutoff, force.truncation, force.tables
    energy_sum, virial_sum, pair_count = zero, zero, zero
    begin, end = chunk_clusters(pairs, c)
    for cluster in range(begin, end):
        x_own, y_own, z_own = load_vector(x, cluster)
        # forces on the cluster's own eight stay in registers: a store of one and a load of eight would wait for each
        # other
        own_x, own_y, own_z = zero, zero, zero
        for lane in range(filled[cluster]):
            i, p = WIDTH * cluster + lane, STRIDE * cluster + lane
            shift_particle(x, p, shifts, shifted)
            xi, yi, zi = splat(x[p]), splat(x[p + WIDTH]), splat(x[p + 2 * WIDTH])
            # the pairs inside the cluster: the lanes after this one
            dx, dy, dz = xi - x_own, yi - y_own, zi - z_own
            r2 = dx * dx + dy * dy + dz * dz
            inside = (r2 < cutoff2) & (lane_numbers() > float(lane))
            energy, force_over_r = pair_terms(laws, i, WIDTH * cluster, r2)
            force_over_r = select(inside, force_over_r, zero)
            fx, fy, fz = force_over_r * dx, force_over_r * dy, force_over_r * dz
            own_x, own_y, own_z = own_x - fx, own_y - fy, own_z - fz
            if sums is not None:
                energy_sum = energy_sum + select(inside, energy, zero)
                virial_sum = virial_sum + force_over_r * select(inside, r2, zero)
                pair_count = pair_count + select(inside, splat(1.0), zero)
            for k in range(span[i, 0], span[i, 1]):
                entry = entries[k]
                other, s = entry >> SHIFT_BITS, entry & 31
                xj, yj, zj = load_vector(x, other)
                xi, yi, zi = splat(shifted[s]), splat(shifted[s + 32]), splat(shifted[s + 64])
                dx, dy, dz = xi - xj, yi - yj, zi - zj
                r2 = dx * dx + dy * dy + dz * dz
                inside = r2 < cutoff2
                energy, force_over_r = pair_terms(laws, i, WIDTH * other, r2)
                force_over_r = select(inside, force_over_r, zero)
                fx = multiply_add(force_over_r, dx, fx)
                fy = multiply_add(force_over_r, dy, fy)
                fz = multiply_add(force_over_r, dz, fz)
                hx, hy, hz = load_vector(forces, other)
                reaction = -force_over_r
                hx = multiply_add(reaction, dx, hx)
                hy = multiply_add(reaction, dy, hy)
                hz = multiply_add(reaction, dz, hz)
                store_vector(forces, other, hx, hy, hz)
                if sums is not None:
                    energy_sum = energy_sum + select(inside, energy, zero)
                    virial_sum = virial_sum + force_over_r * select(inside, r2, zero)
                    pair_count = pair_count + select(inside, splat(1.0), zero)
            me = lane_numbers() == float(lane)
            own_x = own_x + select(me, splat(lane_sum(fx)), zero)
            own_y = own_y + select(me, splat(lane_sum(fy)), zero)
            own_z = own_z + select(me, splat(lane_sum(fz)), zero)
        hx, hy, hz = load_vector(forces, cluster)
        store_vector(forces, cluster, hx + own_x, hy + own_y, hz + own_z)
    if sums is not None:
        sums[c, 0] = lane_sum(energy_sum)
        sums[c, 1] = lane_sum(virial_sum)
        sums[c, 2] = lane_sum(pair_count)


def pair_terms(laws: tuple[Any, ...], i: int, j: int, r2: Any) -> Any:
    """Energy and force over r of particle i with the eight in slots j to j + 7, truncated; the cutoff is not yet
    applied."""


@overload(pair_terms)
def _pair_terms(laws, i, j, r2):
    law = laws[0].instance_class.compiled_law
    if isinstance(laws[3], types.NoneType):

        def one_species(laws, i, j, r2):
            parameters, at_cutoff, truncation, _ = laws
            energy, force_over_r = law(parameters, r2)
            return truncated(truncation, at_cutoff, r2, as_lanes(energy), as_lanes(force_over_r))

        return one_species

    def many_species(laws, i, j, r2):
        like, like_at_cutoff, truncation, tables = laws
        row = tables.row[i]
        energy, force_over_r = law(named_lanes(like, tables.law, row, j), r2)
        at_cutoff = named_lanes(like_at_cutoff, tables.at_cutoff, row, j)
        return truncated(truncation, at_cutoff, r2, as_lanes(energy), as_lanes(force_over_r))

    return many_species


def law_class(force: PairForce) -> Any:
    """The class of a force's parameters, as compiled code takes it."""
    cls = force.Parameters
    if "compiled_law" not in vars(cls):
        cls.compiled_law = jit(cls.law)
    return cls


def bind(force: PairForce, system: System, threads: int) -> PairKernel:
    """A pair force for this System, on this many threads."""
    cls = law_class(force)
    n, names = len(system), system.species
    laws = [[force.pair_law(a, b) for b in names] for a in names]
    cutoff = float(force.cutoff or 0.0)
    at_cutoff = [[AtCutoff(*(float(u) for u in p.law(cutoff**2))) for p in row] for row in laws]
    pairs = cluster_list(n, system.box, cutoff)
    tables = None
    if len(names) > 1:
        law_pairs = np.array(laws, dtype=float).transpose(2, 0, 1).copy()
        at_cutoff_pairs = np.array(at_cutoff).transpose(2, 0, 1).copy()
        slots = pairs.x.size // 3
        tables = Tables(
            law=aligned((len(law_pairs), len(names), slots), 1.0),
            at_cutoff=aligned((2, len(names), slots)),
            law_pairs=law_pairs,
            at_cutoff_pairs=at_cutoff_pairs,
            species=system.species_index.astype(np.int64),
            row=np.zeros(slots, np.int64),
        )
    chunks = pairs.force.shape[0]
    work = PairWork(
        law=cls(*(float(value) for value in laws[0][0])),
        at_cutoff=at_cutoff[0][0],
        tables=tables,
        truncation=truncation_of(force),
        cutoff=cutoff,
        tail=force.tail_corrections(system),
        inverse_masses=1.0 / system.coherent_masses,
        sums=np.zeros((chunks, 3)),
        pairs=pairs,
        threads=Parallel(chunks) if threads > 1 else Serial(chunks),
    )
    return PairKernel.of(work)


def truncation_of(force: PairForce) -> Any:
    """The compiled truncation that a pair force names."""
    cutoff, start = float(force.cutoff or 0.0), float(force.switch_start or 0.0)
    return {
        "cut": Cut(),
        "shift": Shift(),
        "force-shift": ForceShift(cutoff),
        "switch": Switch(start**2, 1.0 / (cutoff**2 - start**2)),
    }[force.truncation]


def ready(bound: Any) -> Any:
    """The bound force with its machine code, where it has its own."""
    return bound.ready() if isinstance(bound, PairKernel) else bound


def grown(bound: Any) -> Any:
    """The bound force with room in its list for what the last search found, where it had run out; else as it is."""
    if not isinstance(bound, PairKernel):
        return bound
    pairs = bound.pairs
    if pairs.counts[ROOM_NEEDED] <= pairs.outer.shape[1]:
        return bound
    return with_room(bound, int(1.3 * pairs.counts[ROOM_NEEDED]))


def thinned(bound: Any) -> Any:
    """The bound force with a list for one set of positions: its skins are for rounding, and for differences of
    Jacobians, alone."""
    if not isinstance(bound, PairKernel):
        return bound
    pairs = bound.pairs
    skin = min(THIN * pairs.cutoff, pairs.inner_skin)
    return bound.with_list(inner_skin=skin, outer_skin=skin)


def with_room(bound: PairKernel, room: int) -> PairKernel:
    """The bound force with empty lists of so many entries a chunk."""
    pairs = bound.pairs
    outer, inner = (np.empty((len(pairs.made), room), np.int32) for _ in range(2))
    return bound.with_list(outer=outer, inner=inner)


def memory(bound: PairKernel) -> dict[str, Any]:
    """What the order of sums depends on: the positions that the list was sorted and searched at and those that it was
    last pruned at, which make it anew; and its room, since growing takes an evaluation more."""
    pairs = bound.pairs
    room = pairs.outer.shape[1]
    if not pairs.counts[BUILT]:
        return {"room": room, "built_at": None, "pruned_at": None}
    return {"room": room, "built_at": pairs.built_at.copy(), "pruned_at": pairs.inner_reference.copy()}


def recalled(bound: PairKernel, memory: dict[str, Any]) -> PairKernel:
    """The bound force with the list that had this memory."""
    bound = with_room(bound, memory["room"]).ready()
    bound.pairs.counts[BUILT] = 0
    if memory["built_at"] is not None and bound.remake(memory["built_at"], memory["pruned_at"]) != OK:
        raise InputError("checkpoint: the positions of its pair list make no list here")
    return bound
