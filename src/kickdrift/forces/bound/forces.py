"""Compiled forces of a System, bound for use from Python."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.bound.holding import holding
from kickdrift.forces.bound.sites import around, weighed
from kickdrift.forces.bound.table import SLOTS, Forces, derivative, few_of, measure, table_of
from kickdrift.forces.external.kernel import ExternalKernel, Host, host_of
from kickdrift.forces.laws.law import not_compiled
from kickdrift.forces.lists.clusters import BUILT, JUMPS_ALLOWED, OUTER_BUILDS, PRUNES
from kickdrift.forces.lists.load import live_list
from kickdrift.forces.pairs.kernel import PairKernel
from kickdrift.forces.pairs.lists import grown, memory, recalled, thinned, tuned, with_moving_parts
from kickdrift.forces.seam.group import reach_of
from kickdrift.forces.seam.kernel import GROW, OK, BoundForce
from kickdrift.jit.cache.notices import compiling_part
from kickdrift.jit.numba_private import NumbaError, UnsupportedBytecodeError
from kickdrift.jit.threads.chunks import team_of
from kickdrift.model.box.cell import live_cell
from kickdrift.model.checks.values import number
from kickdrift.model.live_box import LiveBox
from kickdrift.model.state import Floats
from kickdrift.text import shown


class Measured(NamedTuple):
    """Result of one evaluation."""

    accelerations: Floats  # (3, n)
    potential: float
    virial: float  # sum over pairs of r . F
    pairs: int | None  # number of interacting pairs; None if unknown


def most_threads() -> int:
    """Return the largest number of threads that numba allows."""
    from numba import config

    return int(config.NUMBA_NUM_THREADS)


def check_threads(threads: Any) -> int:
    """Return ``threads`` as an int. Raises InputError unless it is a whole number from 1 to numba's limit."""
    found = number(threads)
    if not (found.is_integer() and 1 <= found <= most_threads()):
        raise InputError(f"threads must be 1 to {most_threads()} here, got {shown(threads)}")
    return int(found)


def _compiled(force: BoundForce) -> BoundForce:
    try:
        return force.ready()
    except (NumbaError, UnsupportedBytecodeError) as error:
        law = type(getattr(force.parts, "law", None))
        raise not_compiled(law if hasattr(law, "law") else type(force.parts), error) from None


def in_live_box(force: BoundForce, lengths: Floats, shortest: Floats, along: Floats | None) -> BoundForce:
    """Return the bound force in a box with its edges in this memory, see `LiveBox.lengths`.

    A force follows the box if its parts have a ``cell`` or a list. Unless ``along`` is None, the force sums its virial
    along each axis there. ``shortest`` (3,) are lengths to which the box may shrink."""
    if isinstance(force, PairKernel):
        force = force.with_list(**live_list(force.pairs, lengths, shortest))
    elif hasattr(force.parts, "cell"):
        force = type(force)(force.parts._replace(cell=live_cell(force.parts.cell, lengths)))
    return force if along is None else force.with_along(along)


def bound(system: UnderForces, threads: int, mixed: bool) -> tuple[BoundForce, ...]:
    """The System's forces, bound in their order. A force may give a part of its sum to another one, its host."""
    guests = {id(host): force for force in system.forces if hasattr(force, "host") and (host := force.host(system))}
    found = []
    for force in system.forces:
        made: Any
        if (guest := guests.get(id(force))) is not None:
            made = guest.bind_host(force, system, threads, mixed)
        else:
            made = force.bind(system, threads, *([mixed] if getattr(force, "has_pairs", False) else []))
        found.append(made if isinstance(made, BoundForce) else BoundForce(made))
    return tuple(found)


class UnderForces(Protocol):
    """A System to which forces are bound, or a Problem with its right-hand side as the only force."""

    @property
    def name(self) -> str: ...

    @property
    def forces(self) -> tuple[Any, ...]: ...


class BoundForces:
    """Forces of a System or a Problem, with their pair lists.

    The lists live as long as this object, and sums depend on earlier calls (to round-off). So the run loop has its own
    instance, and observers another. If a particle moves further than a pair force's range between two calls, the run
    has blown up; ``jumps`` allows such moves. ``thin`` lists are cheaper to make and suit particles that hardly move.
    With ``mixed``, pair forces are in mixed precision. The forces follow a ``live`` box, with ``apart`` one whose edges
    change apart. With ``hold``, fixed particles have no accelerations; energy and virial are those of all forces.

    Attributes
    ----------
    along : (rows, 3) or (rows, 2, 3) virial at the last evaluation with sums, in parts, see `lists.along`; None unless
        edges vary apart
    """

    def __init__(
        self,
        system: UnderForces,
        threads: int = 1,
        jumps: bool = True,
        thin: bool = False,
        mixed: bool = False,
        live: LiveBox | None = None,
        apart: bool = False,
        hold: bool = False,
    ) -> None:
        self.threads = check_threads(threads)
        if mixed and not any(getattr(force, "has_pairs", False) for force in system.forces):
            raise InputError(f"precision: mixed needs pair forces; {system.name!r} has none")
        sites = getattr(system, "virtual_sites", None) is not None
        self.forces = bound(weighed(system) if sites else system, threads, mixed)
        if sites:
            self.forces = around(system, self.forces)
        if hold:
            self.forces += holding(system)
        self._varies = live is not None
        self.along: Floats | None = None
        if live is not None:
            form = () if not apart else (2, 3) if live.free else (3,)
            self._follow(live.lengths, live.lengths_of_height(2.0 * reach_of(system)), form)
        self._table: tuple[tuple[BoundForce, ...], Forces] | None = None  # bound forces and their table
        self.hosts: tuple[Host | None, ...] = tuple(host_of(force.parts) for force in self.forces)
        if thin:
            self.forces = tuple(thinned(force) for force in self.forces)
        for force in self.forces:
            if isinstance(force, PairKernel):
                force.pairs.counts[JUMPS_ALLOWED] = jumps

    def _follow(self, lengths: Floats, shortest: Floats, form: tuple[int, ...]) -> None:
        """Put all forces in a box with its edges in this memory. A virial along the axes has this form, if any."""
        rows = [force.rows_along for force in self.forces]
        ends = np.cumsum(rows)
        self.along = np.zeros((sum(rows), *form)) if form else None
        self.forces = tuple(
            in_live_box(force, lengths, shortest, None if self.along is None else self.along[end - count : end])
            for force, count, end in zip(self.forces, rows, ends, strict=True)
        )

    def call(self, compiled: Callable[..., int], *args: Any) -> int:
        """Call ``compiled(table, *args)`` and return its status; if a list was too small, enlarge it and call again."""
        table = self.table
        if self.threads > 1:
            team_of(self.threads).start()
        while (status := compiled(table, *args)) == GROW:
            self.forces = tuple(grown(force) for force in self.forces)
            table = self.table
        return status

    @property
    def table(self) -> Forces:
        """Table of forces for compiled code, compiled on first use.

        A law that numba cannot compile raises an InputError of one line. The table is valid until a list grows or
        changes its skins."""
        if self._table is None or self._table[0] is not self.forces:
            few = few_of(self.forces)
            own, count = [], len(self.forces)
            for k, force in enumerate(self.forces, 1):
                with compiling_part(k, count, "force"):
                    own.append(force if force is few else _compiled(force))
            self.forces = tuple(own)
            self._table = self.forces, table_of(self.forces)
        return self._table[1]

    def compile(self) -> None:
        """Compile the forces now, so that a law that numba cannot compile ends in its line; see `table`."""
        _ = self.table

    def measure(self, time: float, phase: Floats) -> Measured | None:
        """Return accelerations and energies at ``phase`` (2, 3, n), positions and velocities; None if not finite."""
        a, sums = np.zeros(phase.shape[1:]), np.zeros(3)
        if self.call(measure, time, phase, a, sums, np.zeros(SLOTS, np.int64)) != OK:
            return None
        return Measured(a, float(sums[0]), float(sums[1]), None if np.isnan(sums[2]) else int(sums[2]))

    def derivative(self, time: float, y: Floats) -> Floats:
        """Return f(t, y) for y of shape (2, rows, n) or (1, 1, n); all nan if y is not finite or the run has blown
        up."""
        y = np.ascontiguousarray(y)  # a Problem's function receives this memory
        dy = np.empty(y.shape)
        if self.call(derivative, time, y, dy, np.zeros(SLOTS, np.int64)) != OK:
            dy[...] = np.nan
        return dy

    @property
    def takes_steps(self) -> bool:
        """Whether a pair law acts alone, and can take steps by itself; see `sorted_steps`. Subclasses of
        `PairKernel` do not: their forces have other sums, or their runs carry more than particles."""
        return [type(force) for force in self.forces] == [PairKernel]

    @property
    def sums_before_samples(self) -> bool:
        """Whether a force sums energy and virial in the evaluation before a sample, so that a sample by these forces
        costs little; see `forces.seam.samples`. Samples with forces of Python have forces of their own."""
        large = (force for force in self.forces if force is not few_of(self.forces))
        return any(hasattr(force.parts, "looks") for force in large) and not any(self.hosts)

    def keep_sorted(self) -> None:
        """Give the force that takes steps its memory for particles in the order of the clusters."""
        self.forces = tuple(with_moving_parts(force) for force in self.forces)

    def tune(self, stride: float) -> None:
        """Choose the cheapest pair lists; the next evaluation makes them.

        ``stride`` is the distance that the fastest particle moves between two evaluations."""
        self.forces = tuple(tuned(force, stride) for force in self.forces)
        self.forget()

    def forget(self) -> None:
        """Discard all pair lists; the next evaluation makes them again."""
        for force in self.forces:
            if isinstance(force, PairKernel):
                force.pairs.counts[BUILT] = 0
        for host in self.hosts:
            if host is not None:
                host.begin_anew()

    def memory(self) -> list[dict[str, Any] | None]:
        """Return copies of each force's pair list or other memory, on which later sums depend; None without any."""
        found: list[dict[str, Any] | None] = []
        for force, host in zip(self.forces, self.hosts, strict=True):
            own = None if host is None else host.memory(self._varies)
            found.append(memory(force, self._varies) if isinstance(force, PairKernel) else own)
        return found

    def recall(self, memory: list[dict[str, Any] | None]) -> None:
        """Restore the pair lists from this memory."""
        pairs = zip(self.forces, memory, strict=True)
        self.forces = tuple(
            recalled(force, kept) if isinstance(force, PairKernel) and kept is not None else force
            for force, kept in pairs
        )
        for host, kept in zip(self.hosts, memory, strict=True):
            if host is not None and kept is not None:
                host.recall(kept)

    def follow(self, run: BoundForces) -> None:
        """Share the answers of Python with the forces of a run, whose samples these serve."""
        self.hosts = (None,) * len(self.forces)
        self.forces = tuple(
            BoundForce(own.parts._replace(aside=True)) if isinstance(own.parts, ExternalKernel) else force
            for force, own in zip(self.forces, run.forces, strict=True)
        )

    @property
    def list_builds(self) -> tuple[int, int]:
        """Return how often the pair lists were searched and pruned."""
        lists = [force.pairs.counts for force in self.forces if isinstance(force, PairKernel)]
        return int(sum(c[OUTER_BUILDS] for c in lists)), int(sum(c[PRUNES] for c in lists))
