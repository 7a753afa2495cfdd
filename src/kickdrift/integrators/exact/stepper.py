"""Integration with leapfrog on whole numbers: its scales, and conversion of floats to and from the lattice."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.forces.bound.table import SLOTS
from kickdrift.forces.gravity.direct import Gravity
from kickdrift.forces.laws.central import gravitational_constant
from kickdrift.forces.pairs.binding import first_pair, pair_numbers, truncation_of
from kickdrift.forces.seam.kernel import GROW
from kickdrift.integrators.exact.list import AXIS, BUILT, CULPRIT, POSITION, ROOM_NEEDED, WHAT, Particles
from kickdrift.integrators.exact.loop import FAR, ExactGravity, ExactPairs, SpeciesTables, exact_loop
from kickdrift.integrators.options import Options
from kickdrift.integrators.stepping.loops import STEP
from kickdrift.integrators.stepping.stepping import Regular
from kickdrift.model.memory import Memory
from kickdrift.model.state import Floats
from kickdrift.text import measured

if TYPE_CHECKING:
    from kickdrift.model.system import System

SKIN = 0.16  # fraction of the cutoff; with 1000 particles the speed varies by 5 % from 0.12 to 0.2
BITS = 63  # of an int64, beside its sign
ROOM_IN_SPACE = 6  # bits beyond the start's extent: particles may move at least 32 times as far
ROOM_IN_SPEED = 8  # bits beyond the largest momentum estimated from the start


Integers = NDArray[np.int64]


class Lattice(NamedTuple):
    """Positions and momenta as whole numbers. ``np.savez(path, **lattice._asdict())`` saves them, and
    ``Lattice(**np.load(path))`` loads them.

    Attributes
    ----------
    positions : (3, n) int64
        In steps of ``spacing``; in a periodic box the nearest image, so that the box is 2^64 steps long.
    images : (3, n) int64
        Whole box edges to add; zero in open space.
    momenta : (3, n) int64
        In steps of ``momentum``: of mass times velocity under pair forces alone, of velocity with gravity.
    spacing : (3,) lengths
    momentum : (n,) one step: equal for all, in the system's coherent mass unit times its velocity unit; or a step of
        velocity, finer for heavy particles
    time, steps_done
    """

    positions: Integers
    images: Integers
    momenta: Integers
    spacing: NDArray[np.float64]
    momentum: NDArray[np.float64]
    time: float = 0.0
    steps_done: int = 0

    def reversed(self) -> Lattice:
        """The same with all momenta negated: from here a run retraces its path."""
        return self._replace(momenta=-self.momenta)

    def same(self, other: Lattice) -> bool:
        """Tell whether positions, images and momenta are equal to the last bit."""
        return all(np.array_equal(getattr(self, key), getattr(other, key)) for key in self._fields[:5])


class ExactStepper(Regular):
    """``y`` shows the lattice in floats after each ``advance``. The run itself is ``method_state``, a `Lattice`, from
    which it can be resumed to the last bit.

    Its scales follow from the System's starting state, and from dt if nothing moves or attracts there. So they are
    equal in every process. A lattice put in place brings its own scales. A checkpoint holds the lattice, its scales,
    and the half kicks there. It needs no pair list, since whole numbers add up equally in any order.
    """

    saved = (
        "_cursor", "_start", "_momentum",
        "_particles.x", "_particles.images", "_particles.p", "_particles.kick", "_particles.spacing",
    )  # fmt: skip
    _lists = None
    _flow: Any

    def __init__(self, flow: Any, options: Options) -> None:
        assert options.dt is not None
        self._flow, self.dt = flow, options.dt
        system: System = flow.subject
        self.trouble = ""
        self._gravity = any(isinstance(force, Gravity) for force in system.forces)
        # Light and heavy bodies need similar steps of velocity; then action and reaction are not one whole number.
        self._weights = np.ones(len(system)) if self._gravity else system.coherent_masses
        self._cutoff = max((float(getattr(force, "cutoff", 0.0)) for force in system.forces), default=0.0)
        self._cursor = np.zeros(SLOTS, np.int64)
        system.box.cuboid("leapfrog-exact")
        self._particles = self._empty(system)
        self._set_scales(*self._scales(system))

    # --- scales ---

    def _scales(self, system: System) -> tuple[Floats, Floats]:
        """Spacing (3,) and steps of momentum (n,): 2^-64 of the box, else powers of two."""
        x, v = system.state.phase
        if system.box.lengths is not None:
            extent = self._cutoff or min(system.box.lengths)
            spacing = np.array(system.box.lengths) * 0.5 ** (BITS + 1)
        else:
            extent = float(np.abs(x).max()) or self._cutoff or 1.0
            spacing = np.full(3, _step(extent, ROOM_IN_SPACE))
        w, masses = self._weights, system.coherent_masses
        top = float((w * np.abs(v).max(axis=0)).max())
        measured = self._flow.forces.measure(0.0, system.state.phase)
        if measured is not None:
            kinetic = 0.5 * float(masses @ (v * v).sum(axis=0))
            energy = 2.0 * (kinetic + abs(measured.potential))
            fall = w * np.sqrt(np.linalg.norm(measured.accelerations, axis=0) * extent)
            shared = math.sqrt(energy / masses.sum()) if self._gravity and masses.sum() else 0.0
            if not self._gravity:
                shared = math.sqrt(energy / len(w) * float(w.max()))
            top = max(top, float(fall.max()), shared)
        top = top or extent / self.dt * float(w.max())
        tops = np.full(len(w), top)
        if self._gravity:  # a heavy body takes the momenta of the others
            heavy = masses > 0
            others = top * (masses.sum() - masses[heavy]) / masses[heavy]
            own = np.abs(v).max(axis=0)[heavy]
            tops[heavy] = np.where(others > 0, np.maximum(own, np.minimum(top, others)), top)
        return spacing, np.array([_step(float(largest), ROOM_IN_SPEED) for largest in tops])

    def _set_scales(self, spacing: Floats, momentum: Floats) -> None:
        system: System = self._flow.subject
        self._momentum = momentum
        particles = self._particles
        particles.spacing[:] = spacing
        particles.drift[:] = self.dt * momentum / self._weights / spacing[:, None]
        self._forces = tuple(self._bind(force, system) for force in system.forces)

    def _bind(self, force: Any, system: System) -> Any:
        half = 0.5 * self.dt / self._momentum
        if isinstance(force, Gravity):
            gravity = gravitational_constant(force.name, force.G, system)
            return ExactGravity(force.softening**2, gravity * system.state.masses, half)
        names, tables = system.species, None
        law, at_cutoff = first_pair(force, names)
        if len(names) > 1:
            numbers = pair_numbers(force, names)
            of_law, of_end = numbers[: len(law)].copy(), numbers[len(law) :].copy()
            tables = SpeciesTables(of_law, of_end, system.species_index.astype(np.int64))
        gain = half if not self._gravity else half / system.coherent_masses
        return ExactPairs(
            law=law,
            at_cutoff=at_cutoff,
            tables=tables,
            truncation=truncation_of(force, names),
            cutoff2=float(max(end.cutoff for end in force.ends(names))) ** 2,
            gain=gain,
            alike=not self._gravity,
            largest=float(gain.max()),
        )

    def _empty(self, system: System) -> Particles:
        n = len(system)
        integers = [np.zeros((3, n), np.int64) for _ in range(5)]
        skin = SKIN * self._cutoff
        return Particles(
            periodic=system.box.periodic,
            spacing=np.zeros(3),
            x=integers[0],
            images=integers[1],
            p=integers[2],
            kick=integers[3],
            drift=np.zeros((3, n)),
            radius=self._cutoff + skin,
            skin=skin,
            reference=integers[4],
            span=np.zeros((n, 2), np.int64),
            partners=np.zeros(32 * n if self._cutoff else 0, np.int32),
            counts=np.zeros(6, np.int64),
        )

    # --- state ---

    def reset(self, y: Floats, time: float, steps: int) -> None:
        particles = self._particles
        x, p = np.zeros_like(y[0]), np.rint(y[1] * (self._weights / self._momentum))
        images = np.zeros(particles.images.shape, np.int64)
        if particles.periodic:
            edges = np.array(self._flow.subject.box.lengths)[:, None]
            nearest = np.round(y[0] / edges)
            x = np.rint((y[0] - nearest * edges) / particles.spacing[:, None])
            nearest[x >= 2.0**63] += 1
            x[x >= 2.0**63] = -(2.0**63)
            images = nearest.astype(np.int64)
        else:
            x = np.rint(y[0] / particles.spacing[:, None])
        inside = np.abs(p) < FAR
        if not particles.periodic:
            inside &= np.abs(x) < FAR
        if not inside.all():
            i = np.argwhere(~inside)[0, 1]
            raise InputError(f"state: particle {i} is outside the range of its lattice, {self._reach(int(i))}")
        self._place(x.astype(np.int64), images, p.astype(np.int64), time, steps)

    def _place(self, x: Any, images: Any, p: Any, time: float, steps: int) -> None:
        particles = self._particles
        particles.x[:], particles.images[:], particles.p[:] = x, images, p
        particles.counts[BUILT] = 0
        self.steps_done, self._start = steps, time - steps * self.dt
        self._cursor[STEP:] = 0
        self._show()

    def _show(self) -> None:
        particles = self._particles
        x = particles.x * particles.spacing[:, None]
        if particles.periodic:
            x += particles.images * np.array(self._flow.subject.box.lengths)[:, None]
        self.y = np.array([x, particles.p * (self._momentum / self._weights)])

    def recall(self, memory: Memory) -> None:
        """Restore as Stepper does. The scales come first, since the state may not fit the start's scales."""
        spacing, momentum = np.array(memory["spacing"], dtype=float), np.array(memory["momentum"], dtype=float)
        if momentum.shape != self._momentum.shape or spacing.shape != self._particles.spacing.shape:
            raise InputError("checkpoint: its scales belong to another system")
        self._set_scales(spacing, momentum)
        super().recall(memory)
        self._show()

    @property
    def method_state(self) -> Lattice:
        """Copy of the state to the last bit."""
        particles = self._particles
        return Lattice(
            particles.x.copy(), particles.images.copy(), particles.p.copy(), particles.spacing.copy(),
            self._momentum.copy(), self.time, self.steps_done,
        )  # fmt: skip

    @method_state.setter
    def method_state(self, given: Lattice) -> None:
        shape = self._particles.x.shape
        for key in ("positions", "images", "momenta"):
            array = np.asarray(getattr(given, key))
            if array.shape != shape or array.dtype != np.int64:
                raise InputError(f"lattice: {key} must be int64 of shape {shape}, got {array.dtype} of {array.shape}")
        spacing, momentum = np.array(given.spacing, dtype=float), np.array(given.momentum, dtype=float)
        lengths = self._flow.subject.box.lengths
        if lengths is not None and not np.array_equal(spacing, np.array(lengths) * 0.5 ** (BITS + 1)):
            raise InputError(f"lattice: its spacing does not fit the system's box, {lengths}")
        for key, scale, count in (("spacing", spacing, 3), ("momentum", momentum, shape[1])):
            if scale.shape != (count,) or not (np.isfinite(scale).all() and (scale > 0).all()):
                raise InputError(f"lattice: {key} must be {count} positive numbers, got {scale}")
        if not self._gravity and (momentum != momentum[0]).any():
            raise InputError("lattice: momentum must be one number for all particles under pair forces alone")
        fits = (np.abs(np.asarray(given.momenta)) < FAR).all()
        if not self._particles.periodic:
            fits &= (np.abs(np.asarray(given.positions)) < FAR).all()
        if not fits:
            raise InputError("lattice: momenta, and positions in open space, must lie within 2^62 of zero")
        self._set_scales(spacing, momentum)
        self._place(given.positions, given.images, given.momenta, float(given.time), int(given.steps_done))

    # --- steps ---

    @property
    def last_step(self) -> float:
        return self.dt if self.steps_done else 0.0

    def advance(self, steps: int, until: float = np.inf) -> int:
        while (status := exact_loop(self._forces, self._particles, steps, self._cursor)) == GROW:
            room = int(1.3 * self._particles.counts[ROOM_NEEDED])
            self._particles = self._particles._replace(partners=np.zeros(room, np.int32))
        self.steps_done += int(self._cursor[STEP])
        self._cursor[STEP] = 0
        self._show()
        counts = self._particles.counts
        if counts[WHAT]:
            how = "lies" if counts[WHAT] == POSITION else "moves"
            self.trouble = (
                f"particle {counts[CULPRIT]} {how} beyond the lattice along {'xyz'[counts[AXIS]]}, which holds "
                f"{self._reach(int(counts[CULPRIT]))}: a start with a larger extent or faster particles enlarges it"
            )
            counts[WHAT] = 0
        return status

    def _reach(self, i: int) -> str:
        particles, units = self._particles, self._flow.subject.units
        speeds = FAR * self._momentum[i] / self._weights[i]
        fast = f"speeds to {measured(f'{speeds:.3g}', units.symbol('velocity'))}"
        if particles.periodic:
            return fast
        return f"positions to {measured(f'{FAR * particles.spacing[0]:.3g}', units.symbol('length'))} and {fast}"

    def reached(self, inside_step: bool) -> tuple[Floats, Floats]:
        return self.y, self.y[0] - self.dt * self.y[1]


def _step(largest: float, room: int) -> float:
    """Power of two whose 2^63-fold leaves ``room`` bits above ``largest``."""
    return 2.0 ** (math.frexp(largest)[1] + room - BITS)
