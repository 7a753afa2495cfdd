"""Barostats: what a run at constant pressure needs, refuses and keeps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.pairs.law import PairForce
from kickdrift.forces.seam.group import reach_of
from kickdrift.integrators.options import (
    APART,
    BAROSTAT,
    BAROSTATS,
    C_RESCALE,
    COMPRESSIBILITY,
    FULL,
    MONTE_CARLO,
    MTK,
    OF_PRESSURE,
    OF_SOME,
    PRESSURE,
    PRESSURE_EVERY,
    PRESSURE_TAU,
    STRESS,
    TEMPERATURE,
    coupling_of,
)
from kickdrift.integrators.splitting.barostats import (
    c_rescale,
    c_rescale_shape,
    monte_carlo,
    monte_carlo_shape,
    mtk,
    mtk_shape,
)
from kickdrift.integrators.splitting.barostats.piston import TOO_SHORT, TOO_STRAINED, TOO_TILTED, Piston
from kickdrift.integrators.splitting.barostats.shape import START, shape_of
from kickdrift.integrators.splitting.baths.bath import SHORTEST_TAU, Bathed, bathed
from kickdrift.integrators.splitting.baths.nose_hoover import energy_of
from kickdrift.integrators.splitting.constraints.flows import Manifold, on_manifold
from kickdrift.integrators.splitting.subflows import rows_of
from kickdrift.integrators.stepping.subflow_code import ACTED, SUMMED, BoundSubflow, Pressed
from kickdrift.looks.centres import parted
from kickdrift.model.box.cell import LENGTHS
from kickdrift.model.freedom import NONE
from kickdrift.model.memory import Memory, by_value
from kickdrift.model.state import Floats
from kickdrift.model.system import System

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.options import Options

GROUPS = {"isotropic": (0, 0, 0), "semi-isotropic": (0, 0, 1), "per-axis": (0, 1, 2), FULL: (0, 0, 0)}
FEWEST_ACTIONS, USUAL_ACTIONS = 5, 10  # in a time constant; the latter by default
MOST_STEPS, USUAL_STEPS = 30, 10  # from one action to the next by default, of c-rescale and monte-carlo
ALONG, SUMS = "along", "sums"  # names in a memory: virials along the axes; energy, virial and pairs
OF_PAIRS = 2  # place of the number of pairs, which is nan if a force does not know it
FAR = 0.15  # largest difference of two stretches of a box that holds its shape
WANDERS = (
    f"coupling: the shape of the box has changed by more than {FAR:.0%}; a fluid does not hold the shape of its box, "
    "so the shape wanders; take coupling = isotropic for a fluid"
)
NEVER = np.iinfo(np.int64).min


class Lettered(Protocol):
    """A method as its barostat sees it; see ``Splitting``."""

    @property
    def name(self) -> str: ...

    @property
    def word(self) -> str: ...

    @property
    def weights(self) -> tuple[float, ...]: ...

    @property
    def further(self) -> str: ...

    @property
    def drags(self) -> bool: ...

    @property
    def groups(self) -> int: ...


def check_options(kind: str, options: Options, method: Lettered) -> None:
    """Refuse a bath that the barostat does not go with, and options that are missing or not the barostat's."""
    if method.groups:
        raise InputError(
            f"pressure: {method.name} kicks by groups of forces; a barostat needs kicks by all, as of baoab"
        )
    if kind == MTK and method.further != "N":
        raise InputError(
            f"barostat: mtk goes with nose-hoover, not with {method.name}; c-rescale goes with any heat bath"
        )
    needed, taken = BAROSTATS[kind]
    for name in needed:
        if options.get(name) is None:
            raise InputError(f"{name} is needed: barostat {kind} has no default {name}")
    for option in OF_SOME:
        if option.name not in (*needed, *taken) and options.get(option.name) is not None:
            raise InputError(
                f"{option.name}: barostat {kind} does not take it; it takes {', '.join((*needed, *taken))}"
            )


def every_of(kind: str, options: Options) -> int:
    """Steps from one action of the barostat to the next. Each action of c-rescale evaluates all forces once more."""
    if given := options.get(PRESSURE_EVERY.name):
        return int(given)
    if kind == C_RESCALE and (tau := options.get(PRESSURE_TAU.name)) is not None:
        most = (1.0 + 1e-9) * tau / (USUAL_ACTIONS * abs(options.dt))
        return max(1, int(min(MOST_STEPS, most)))
    return 1 if kind == MTK else USUAL_STEPS


def every_of_old(options: Options, memory: Memory) -> int | None:
    """``pressure_every`` of a checkpoint's run that did not name it; None if it is the default of now.

    Checkpoints without ``every`` come from versions where c-rescale acted every 10 steps by default."""
    kind = options.get(BAROSTAT.name) or C_RESCALE
    every = int(memory.get("every", USUAL_STEPS))
    return None if kind != C_RESCALE or every == every_of(kind, options) else every


def check_unpressed(options: Options) -> None:
    """Refuse options of a barostat without a pressure."""
    for option in OF_PRESSURE:
        if options.get(option.name) is not None:
            raise InputError(f"{option.name}: is an option of a barostat, which needs a pressure; give pressure too")


def check_pressed(system: Any, options: Options) -> None:
    """Refuse a System whose box no barostat can change, and options that do not fit together."""
    if not isinstance(system, System):
        raise InputError(f"pressure: a barostat needs particles, and {system.name!r} is an ODE")
    if not np.isfinite(system.volume):
        along = "in open space" if not system.box.periodic else "whose box is open along an axis"
        raise InputError(f"pressure: {system.name!r} is a system {along}, which has no volume")
    if system.fixed is not None:
        raise InputError("pressure: a barostat moves all particles with the box, and fixed particles stay in place")
    for force in system.forces:
        reason = force.fixes_box(system) if hasattr(force, "fixes_box") else "its class does not say that it does"
        if reason:
            raise InputError(f"pressure: force {force.name!r} does not scale with the box: {reason}")
    coupling = coupling_of(options)
    if coupling in APART and system.virtual_sites is not None and system.virtual_sites.normal.any():
        raise InputError(
            f"coupling: {coupling} needs the virial along each axis, and virtual sites beside the plane of their "
            "particles do not give it; take isotropic"
        )
    if system.dimensions == 2 and coupling == "semi-isotropic":
        raise InputError("coupling: semi-isotropic needs three dimensions; take isotropic or per-axis")
    if coupling in APART and coupling != FULL and system.box.tilts:
        raise InputError(f"coupling: {coupling} needs a rectangular box; a leaning box takes isotropic or full")
    for force in system.forces:
        if coupling in APART and (reason := force.fixes_shape(system)):
            raise InputError(f"coupling: {coupling} needs the virial along each axis, and {reason}; or take isotropic")
    for force in system.forces:
        if coupling == FULL and hasattr(force, "fixes_edges") and (reason := force.fixes_edges(system)):
            raise InputError(f"coupling: full does not go with force {force.name!r}: {reason}; take per-axis")
    if options.get(STRESS.name) is not None and coupling != FULL:
        raise InputError(f"stress: needs coupling = full, because {coupling} keeps angles between edges")
    if system.dimensions == 2 and any(stress_of(options)[2]):
        raise InputError("stress: zz, yz and xz must be zero in a plane")


def stress_of(options: Options) -> Floats:
    """Wanted stress (3, 3) beside the pressure; zeros if none is."""
    xx, yy, zz, yz, xz, xy = options.get(STRESS.name) or (0.0,) * 6
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], dtype=float)


class Barostat:
    """The barostat of one run.

    Attributes
    ----------
    pressed : its numbers for the loop of splitting methods
    flows : flows that it adds to the word of the method, by letter; empty if it acts between steps
    """

    def __init__(self, flow: Flow, options: Options, method: Lettered) -> None:
        system: Any = flow.subject
        check_pressed(system, options)
        self._kind = options.get(BAROSTAT.name) or C_RESCALE
        check_options(self._kind, options, method)
        self._live: Any = flow.live  # type: ignore[union-attr]
        self._reach = reach_of(system)
        self._coupling = coupling_of(options)
        self.piston = self._made(flow, options, method)
        free = self._coupling == FULL
        tied = [force for force in system.forces if hasattr(force, "keeps_edges") and force.keeps_edges(system)]
        self._ties = {force.name: force.keeps_edges(system) for force in tied}
        least, stress = 2.0 * self._reach, stress_of(options)
        self._shape = shape_of(self.piston, least, bool(tied), stress) if free else None
        self.flows: dict[str, BoundSubflow] = {}
        at, every = (0, 0), every_of(self._kind, options)
        own = mtk.LETTERS if self._kind == MTK else ""
        letters: Sequence[str] = method.word
        weights, further = method.weights, method.further
        if self._kind == MTK:
            letters, weights = mtk.word_with_box(method.word, weights, every)
        if system.constraints is not None:
            letters, weights = on_manifold(letters, weights, own)
            further += "".join(Manifold.letters)
        further += own
        self._rows = rows_of(letters, weights, further)
        if self._kind == MTK:
            pushes = (self._rows[3] != 0) & (self._rows[5] == further.index(mtk.PUSH))
            turns = mtk.Turns(every, int(np.flatnonzero(pushes)[-1]))
            kind, box = (mtk_shape, self._shape) if self._shape else (mtk, self.piston)
            made = kind.flows(box, options, turns)
            self.flows = {letter: bound.ready() for letter, bound in made.items()}
        else:
            self._action = self._between(options, len(system)).ready()
            at = self._action.address, self._action.work
        self.pressed = Pressed(
            np.array(at, np.int64),
            every,
            np.zeros(3, np.int64),
            self.piston.sums,
            np.zeros((3, len(system))),
            self.piston.felt,
        )

    def _between(self, options: Options, n: int) -> BoundSubflow:
        """The barostat as an action between two steps."""
        if self._kind == C_RESCALE:
            return (
                c_rescale_shape.action(self._shape, options) if self._shape else c_rescale.action(self.piston, options)
            )
        if self._shape:
            return monte_carlo_shape.action(self._shape, options, n)
        return monte_carlo.action(self.piston, options, n)

    def _made(self, flow: Flow, options: Options, method: Lettered) -> Piston:
        lengths: Floats = self._live.lengths
        shortest = self._live.lengths_of_height(2.0 * self._reach)
        group = [g if edge > 0 else -1 for g, edge in zip(GROUPS[self._coupling], lengths[:LENGTHS], strict=True)]
        bath = bathed(flow, options, (TEMPERATURE,), conserving=not method.drags)
        return Piston(
            bath, lengths,
            np.array(group, np.int64), np.bincount([g for g in group if g >= 0]).astype(float),
            float(options[PRESSURE.name]), shortest, np.zeros(3), flow.forces.along,
            np.zeros(3), np.zeros(1), np.zeros(8), np.zeros(8), *_centres(flow.subject, bath),
        )  # fmt: skip

    @property
    def stages(self) -> tuple[Floats, Floats]:
        """Stages and further stages of the method's word with the flows of constraints, then of the box; see
        `Splitting`."""
        return self._rows[:3].copy(), self._rows[3:6].copy()

    @property
    def added(self) -> list[tuple[BoundSubflow, bool]]:
        """The flows with whether each moves positions, in the order of their letters."""
        return [(bound, letter == mtk.STRETCH) for letter, bound in self.flows.items()]

    @property
    def accepted(self) -> float | None:
        """Part of the Monte Carlo moves that were accepted; None without any."""
        tried, taken = self.piston.state[[monte_carlo.TRIED, monte_carlo.ACCEPTED]]
        return float(taken / tried) if self._kind == MONTE_CARLO and tried else None

    @property
    def work(self) -> float:
        """Energy that the particles have got from the box since the state was set."""
        return float(self.piston.work[0])

    @property
    def warnings(self) -> list[str]:
        """A line if the shape of the box has changed as that of a fluid does."""
        if self._shape is None:
            return []
        edges = []
        for numbers in (self._shape.reference, self._shape.piston.lengths):
            rows = np.diag(np.where(numbers[:LENGTHS] > 0, numbers[:LENGTHS], 1.0))
            rows[[2, 2, 1], [1, 0, 0]] = numbers[LENGTHS:]
            edges.append(rows)
        axes = self._shape.piston.bath.axes
        stretches = np.linalg.svd(np.linalg.solve(*edges)[:axes, :axes], compute_uv=False)
        return [WANDERS] if stretches.max() > (1.0 + FAR) * stretches.min() else []

    @property
    def trouble(self) -> str:
        """Why the barostat stopped."""
        cause, which, value = self.piston.trouble
        if not np.isfinite(value):
            return "the barostat would make an edge of the box infinite; give a longer pressure_tau, or a shorter step"
        if cause == TOO_SHORT:
            reach, axis = self._reach, int(which)
            advice = (
                "a fluid does not hold the shape of its box, so take coupling = isotropic"
                if self._coupling in APART
                else "take more particles or another pressure"
            )
            height = 2.0 * reach * value / self.piston.shortest[axis] if reach and not self._shape else value
            tilted = self._shape or self._live.box.tilts
            edge = f"the box height across {'abc'[axis]}" if tilted else f"box edge {'xyz'[axis]}"
            return (
                f"the barostat would make {edge} {height:.6g}, shorter than twice the cutoff, "
                f"2 x {reach:.6g} = {2 * reach:.6g}; {advice}"
            )
        if cause == TOO_TILTED:
            name, why = next(iter(self._ties.items()))
            return (
                f"the tilt {('yz', 'xz', 'xy')[int(which)]} of the box is {value:.3g} of an edge, more than a half, "
                f"and the box cannot take other edges under force {name!r}: {why}; take coupling = per-axis"
            )
        if cause == TOO_STRAINED:
            return f"the barostat would strain the box by {which:.3g} at once; give a longer pressure_tau"
        return f"the barostat would change the volume by a factor of {which:.3g} at once; give a longer pressure_tau"

    @property
    def _arrays(self) -> dict[str, Any]:
        own = {"lengths": self._live.lengths, "place": self.pressed.place, SUMS: self.pressed.sums}
        own |= {"work": self.piston.work, "state": self.piston.state}
        own |= {} if self.piston.along is None else {ALONG: self.piston.along}
        own |= {} if self.piston.felt is None else {"felt": self.piston.felt}
        if self._shape:
            own |= {"reference": self._shape.reference, "strain": self._shape.state, "notes": self._shape.notes}
        chains = ((letter, getattr(bound.parts, "chain", None)) for letter, bound in self.flows.items())
        return own | {f"chain {letter}": chain.state for letter, chain in chains if chain}

    def reset(self) -> None:
        """Begin anew in the box of now."""
        for name, array in self._arrays.items():
            if name == "reference":
                array[...] = self._live.lengths
            elif name != "lengths":
                array[...] = 0
        self.pressed.place[ACTED] = NEVER
        self.piston.trouble[...] = 0.0

    def memory(self) -> Memory:
        """Copies of all that later actions depend on."""
        return {name: by_value(array) for name, array in self._arrays.items()} | {"every": self.pressed.every}

    def go_on_from(self, other: Barostat) -> None:
        """Go on from a barostat of another temperature or pressure, with its memory and the same work so far."""
        self.recall(other.memory())
        if self._kind == MTK and self.flows[mtk.THERMOSTAT].parts.chain.state.any():
            start = self.piston.state[mtk.START :] if self._shape is None else self._shape.notes[START:]
            start[0] += self._energy - other._energy

    @property
    def _energy(self) -> float:
        """Energy of the box under mtk that follows the temperature and the pressure: P V, its motion and its chain."""
        parts: Any = self.flows[mtk.THERMOSTAT].parts
        if self._shape is None:
            motion = float(parts.masses @ self.piston.state[: len(parts.masses)] ** 2)
        else:
            motion = float(parts.mass * (self._shape.state**2).sum())
        return self.piston.pressure * self._live.volume + 0.5 * motion + energy_of(parts.chain)

    def recall(self, memory: Memory) -> None:
        """Restore this from a memory, which may come from a file.

        Memories of version 0.2.0 lack the virials along the axes. The next action then evaluates all forces again."""
        for name, array in self._arrays.items():
            if name == ALONG and name not in memory:
                self.pressed.place[SUMMED] = 0
                continue
            given = np.asarray(memory[name])
            known = given[:OF_PAIRS] if name == SUMS else given
            if given.shape != array.shape or not np.all(np.isfinite(known)):
                raise InputError(f"checkpoint: {name} of its barostat does not fit a run of this system")
            if name == "lengths" and not np.array_equal(given[:LENGTHS] > 0, array[:LENGTHS] > 0):
                raise InputError("checkpoint: its box is open along other axes")
            array[...] = given


def _centres(system: Any, bath: Bathed) -> tuple[float, Floats | None, Floats | None]:
    """How many particles and molecules move on their own, molecules with constraints, and room for accelerations."""
    held = system.constraints
    if held is None:
        return bath.freedom / bath.axes, None, None
    free = np.count_nonzero(system.state.masses) - len(held.members[0]) + len(held.sizes) - (bath.apart != NONE)
    return float(free), parted(held), np.zeros((3, len(system)))


def pressure_warnings(dt: float, options: Options, system: Any) -> list[str]:
    """One line for each doubtful choice."""
    found = []
    tau = options.get(PRESSURE_TAU.name)
    if tau is not None and tau < SHORTEST_TAU * dt:
        found.append(f"pressure_tau = {tau:g} is {tau / dt:.3g} steps; use {SHORTEST_TAU} steps or more")
    every = every_of(options.get(BAROSTAT.name) or C_RESCALE, options)
    acts = every > 1 or options.get(COMPRESSIBILITY.name) is not None
    if tau is not None and acts and tau < FEWEST_ACTIONS * every * dt:
        actions = tau / (every * dt)
        found.append(
            f"pressure_tau = {tau:g} is {actions:.3g} actions of the barostat; use {FEWEST_ACTIONS} or more, "
            f"or a pressure_every below {every}"
        )
    for force in system.forces:
        cuts = isinstance(force, PairForce) and any(end.truncation == "cut" for end in force.ends(system.species))
        if cuts and not force.tail:
            found.append(
                f"pressure: {force.name} is cut, so its force jumps at the cutoff, and the virial lacks this impulse; "
                'take truncation = "shift", "force-shift" or "switch", or tail corrections'
            )
    return found
