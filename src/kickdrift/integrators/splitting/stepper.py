"""Steps of a splitting method."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.forces.bound.holding import held_groups
from kickdrift.forces.bound.sites import site_groups
from kickdrift.forces.pairs.sorted_steps import plan_of
from kickdrift.integrators.options import PRESSURE, RAMPED
from kickdrift.integrators.splitting.barostats.barostat import Barostat, Lettered, check_unpressed, pressure_warnings
from kickdrift.integrators.splitting.baths.bath import bath_warnings
from kickdrift.integrators.splitting.baths.nose_hoover import Chain
from kickdrift.integrators.splitting.constraints.flows import Manifold, on_manifold
from kickdrift.integrators.splitting.subflows import FLOWS, rows_of
from kickdrift.integrators.stepping.loops import FRESH, splitting_loop, sweeps
from kickdrift.integrators.stepping.stepper import STOPPED
from kickdrift.integrators.stepping.stepping import FixedStepper
from kickdrift.integrators.stepping.subflow_code import Pressed
from kickdrift.jit.threads.chunks import Chunks
from kickdrift.model.checks.values import whole_number
from kickdrift.model.memory import Memory, by_value
from kickdrift.model.state import Floats
from kickdrift.model.system import System

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.options import Options


class Word(NamedTuple):
    """A splitting method in the form for the compiled loop."""

    stages: Floats  # see Splitting.stages
    further: Further | None  # None for kicks and drifts alone: the loop is then compiled without further flows
    groups: Groups | None  # None for kicks by all forces
    chunks: Chunks  # of kicks and drifts
    plan: Floats  # for a force that takes steps by itself, see `sorted_steps`; else empty
    barostat: Pressed | None = None  # None in a box that keeps its size


class Further(NamedTuple):
    """Further flows of a word."""

    stages: Floats  # see Splitting.further_stages
    table: NDArray[np.int64]  # (flows, 3): addresses of machine code and of parts, and whether positions move


class Groups(NamedTuple):
    """Groups of forces, for a word that kicks by one group at a time."""

    forces: NDArray[np.int64]  # (forces,) group of each force
    kicks: NDArray[np.int64]  # (stages,) group of each stage's kick


class Composition(Lettered, Protocol):
    """Rows of a word over flows, as its steps use them; see ``Splitting``."""

    @property
    def stages(self) -> Floats: ...

    @property
    def further_stages(self) -> Floats: ...

    @property
    def ends_fresh(self) -> bool: ...

    @property
    def groups(self) -> int: ...

    @property
    def kick_groups(self) -> NDArray[np.int64]: ...

    @property
    def letters(self) -> tuple[str, ...]: ...

    @property
    def name(self) -> str: ...

    def timed(self, options: Options) -> Any: ...

    def mirrored(self) -> Any: ...

    def beside(self) -> Any: ...


class SplittingStepper(FixedStepper):
    """Steps of a word over flows. The workspace keeps the accelerations of the last kick while positions stay fixed."""

    def __init__(self, flow: Flow, method: Composition, options: Options) -> None:
        self._method, self._options = method, options
        self._begun = 0.0  # heat beside that of the baths, which keeps the sum where a temperature changes
        self.barostat: Barostat | None = None
        self.manifold: Manifold | None = None
        word = self._word(flow, options)
        self._warned = bath_warnings(options.dt, options) if self._baths else []
        if self.barostat:
            self._warned = [*self._warned, *pressure_warnings(options.dt, options, flow.subject)]
        if _walled(flow) and _pushed(flow) and not self._baths:
            self._warned += [
                "reflecting-wall: a bounce under other forces changes the energy by up to force x speed x dt, with "
                "either sign, so that the energy walks at random; a soft wall, such as harmonic-wall, keeps it"
            ]
        if groups := word.groups:
            self._warned += [
                f"no force has group = {group}, so its kicks do nothing; fast forces have group 0, slow forces group 1"
                for group in sorted({*groups.kicks.tolist()} - {*groups.forces.tolist()})
            ]
        some = (method.groups,) if groups else ()
        super().__init__(
            flow, splitting_loop, word, lambda shape: np.zeros((*some, *shape[1:])), options, kept=True,
        )  # fmt: skip
        self.ends_fresh, self._all_fresh = method.ends_fresh, (1 << max(1, method.groups)) - 1

    @property
    def warnings(self) -> list[str]:
        """One line for each doubtful choice, and for what the run has shown of it."""
        return [*self._warned, *(self.barostat.warnings if self.barostat else [])]

    @warnings.setter
    def warnings(self, lines: list[str]) -> None:
        self._warned = lines

    def _word(self, flow: Flow, options: Options) -> Word:
        """Bind the further flows and the barostat with these options."""
        walled, held = _walled(flow), getattr(flow.subject, "constraints", None) is not None
        if walled and held:
            raise InputError(
                "reflecting-wall: mirrors single particles, and constraints hold whole molecules; take a soft wall, "
                "such as harmonic-wall"
            )
        fixed = getattr(flow.subject, "fixed", None)
        if walled and fixed is not None and fixed.move:
            raise InputError("reflecting-wall: would turn fixed particles that move; take a soft wall")
        method = self._method.beside() if flow.of_particles and flow.carries else self._method  # type: ignore[union-attr]
        method = method.mirrored() if walled else method
        rows = [FLOWS[letter] for letter in method.further]
        stages, further_stages, kick_groups = method.stages, method.further_stages, method.kick_groups
        if held:
            letters, weights = on_manifold(method.letters, method.weights)
            own = rows_of(letters, weights, method.further + "".join(Manifold.letters))
            stages, further_stages, kick_groups = own[:3].copy(), own[3:6].copy(), own[6].astype(np.int64)
        acting, _, which = further_stages
        self._bound = [
            row.bind(flow, options, np.where(which == k, acting, 0.0)).ready() for k, row in enumerate(rows) if row.bind
        ]
        self._baths = [bound for bound, row in zip(self._bound, rows, strict=True) if row.bath]
        table = [(bound.address, bound.work, row.moves) for bound, row in zip(self._bound, rows, strict=True)]
        pressed = None
        if held:
            heat = self._baths[0].parts.bath.heat if self._baths else np.zeros(1)
            self.manifold = Manifold(flow, heat)
            table += [(bound.address, bound.work, False) for bound in self.manifold.flows]
        if options.get(PRESSURE.name) is not None:
            self.barostat = Barostat(flow, options, method)
            stages, further_stages = self.barostat.stages
            table += [(bound.address, bound.work, moves) for bound, moves in self.barostat.added]
            pressed = self.barostat.pressed
        elif self._baths:
            check_unpressed(options)
        further = Further(further_stages, np.array(table, np.int64)) if table else None
        groups = Groups(_forces_in(method, flow), kick_groups) if method.groups else None
        alone = flow.forces.takes_steps and not (further or groups or pressed or options.compensated)
        plan = plan_of(stages) if alone else np.zeros(0)
        if alone:
            flow.forces.keep_sorted()
        return Word(stages, further, groups, sweeps(len(flow.subject), flow.forces.threads), plan, pressed)

    def retimed(self, dt: float) -> Self:
        """See FixedStepper. Heat baths are bound anew, because their strength depends on the step."""
        if self._bound or self.barostat:
            options = self._options.changed(dt=dt)
            self._method = self._method.timed(options)
            self._stages = self._word(self._flow, options)
        return super().retimed(dt)

    def begin_from(self, run: SplittingStepper) -> None:
        """Start anew at the step point of another stepper of the same method, with the memory of its heat baths."""
        self.go_to(run.asked)
        self.reset(run.y.copy(), run.time, run.steps_done)
        self.baths, self._begun = by_value(run.baths), run._begun

    def advance(self, steps: int, until: float = np.inf) -> int:
        """See Stepper."""
        status = super().advance(steps, until)
        if status == STOPPED:
            self.trouble = (self.manifold and self.manifold.trouble) or (self.barostat and self.barostat.trouble) or ""
        return status

    @property
    def asked(self) -> dict[str, float | None]:
        """The temperature and the pressure that baths and the barostat hold now; None without one."""
        return {name: self._options.get(name) for name in RAMPED}

    def go_to(self, asked: Mapping[str, float | None]) -> None:
        """Go on with heat baths and a barostat of another temperature or pressure, which keep their memory."""
        options = self._options.changed(**asked)
        if options == self._options:
            return
        baths, given, barostat, before = by_value(self.baths), self.heat, self.barostat, self._options
        self._options = options
        self._stages = self._word(self._flow, options)
        self._addresses = None
        self.baths = baths
        for bound in self._baths:
            if isinstance(bound.parts, Chain):  # its heat is the energy of the chain, which is as its temperature
                bound.parts.bath.heat[0] *= options.temperature / before.temperature
        self._begun += given - self.heat
        if self.barostat and barostat:
            self.barostat.go_on_from(barostat)

    @property
    def heat(self) -> float:
        """Energy that baths have given since the state was set."""
        return self._begun + float(sum(bound.parts.bath.heat[0] for bound in self._baths))

    @property
    def work(self) -> float:
        """Energy that the particles have got from the change of their box since the state was set."""
        return self.barostat.work if self.barostat else 0.0

    @property
    def baths(self) -> list[Floats]:
        """The memory of all further flows: heat of baths, and the state of the flows that have one."""
        found = [bound.parts.bath.heat for bound in self._baths]
        return found + [bound.parts.state for bound in self._bound if hasattr(bound.parts, "state")]

    @baths.setter
    def baths(self, given: list[Floats]) -> None:
        there = self.baths
        if [np.shape(each) for each in given] != [each.shape for each in there]:
            raise InputError("checkpoint: baths do not fit a run of this system")
        for array, values in zip(there, given, strict=True):
            array[...] = values

    def reset(self, y: Floats, time: float, steps: int) -> None:
        super().reset(y, time, steps)
        for array in self.baths:
            array[...] = 0.0
        self._begun = 0.0
        if self.barostat:
            self.barostat.reset()

    def memory(self) -> Memory:
        """See Stepper. The memory of a word without baths is that of version 0.1.0."""
        pressed = {"barostat": self.barostat.memory()} if self.barostat else {}
        begun = {"begun": self._begun} if self._begun else {}
        return super().memory() | ({"baths": by_value(self.baths)} if self.baths else {}) | begun | pressed

    def recall(self, memory: Memory) -> None:
        """See Stepper."""
        if self.barostat:
            self.barostat.recall(memory["barostat"])  # the lists of the forces need the box
        super().recall(memory)
        if self.baths:
            self.baths, self._begun = memory["baths"], float(memory.get("begun", 0.0))
        if self.barostat:
            self.barostat.recall(memory["barostat"])

    @property
    def fresh(self) -> bool:  # type: ignore[override]
        return bool(self._cursor[FRESH] == self._all_fresh)


def _pushed(flow: Flow) -> bool:
    """Whether forces act beside the hard walls of the flow's System."""
    return any(not getattr(force, "reflects", False) for force in getattr(flow.subject, "forces", ()))


def _walled(flow: Flow) -> bool:
    """Whether the flow's System has hard walls."""
    return isinstance(flow.subject, System) and bool(flow.subject.acting("reflects"))


def _forces_in(method: Composition, flow: Flow) -> NDArray[np.int64]:
    """Group of each force. Raises InputError for a group that the word does not kick."""
    forces = [] if not isinstance(flow.subject, System) else flow.subject.forces
    groups = [whole_number(f"force {force.name}: group", getattr(force, "group", 0), 0) for force in forces]
    for force, group in zip(forces, groups, strict=True):
        if group >= method.groups:
            raise InputError(
                f"{method.name}: kicks by groups 0 to {method.groups - 1}, and force {force.name} has group = {group}"
            )
    beside = site_groups(flow.subject)
    return np.array([*beside, *groups, *beside, *held_groups(flow.subject)], np.int64)
