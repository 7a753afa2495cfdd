"""Steps of a splitting method."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.integrators.bath import bath_warnings
from kickdrift.integrators.loops import FRESH, splitting_loop
from kickdrift.integrators.stepping import FixedStepper
from kickdrift.integrators.subflows import FLOWS
from kickdrift.model.memory import Memory, by_value
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.integrators.flow import Flow
    from kickdrift.integrators.options import Options


class Word(NamedTuple):
    """A splitting method in the form for the compiled loop."""

    stages: Floats  # see Splitting.stages
    further: Further | None  # None for kicks and drifts alone: the loop is then compiled without further flows


class Further(NamedTuple):
    """Further flows of a word."""

    stages: Floats  # see Splitting.further_stages
    table: NDArray[np.int64]  # (flows, 3): addresses of machine code and of parts, and whether positions move


class Composition(Protocol):
    """Rows of a word over flows, as its steps use them; see ``Splitting``."""

    @property
    def stages(self) -> Floats: ...

    @property
    def further(self) -> str: ...

    @property
    def further_stages(self) -> Floats: ...

    @property
    def ends_fresh(self) -> bool: ...


class SplittingStepper(FixedStepper):
    """Steps of a word over flows. The workspace keeps the accelerations of the last kick while positions stay fixed."""

    def __init__(self, flow: Flow, method: Composition, options: Options) -> None:
        self._rows, self._options = [FLOWS[letter] for letter in method.further], options
        self._table = np.zeros((len(self._rows), 3), np.int64)
        self._bind(flow, options)
        self.warnings = bath_warnings(options.dt, options) if self._baths else []
        word = Word(method.stages, Further(method.further_stages, self._table) if self._rows else None)
        super().__init__(flow, splitting_loop, word, lambda shape: np.zeros(shape[1:]), options, kept=True)
        self.ends_fresh = method.ends_fresh

    def _bind(self, flow: Flow, options: Options) -> None:
        """Bind the further flows, and write where they are into the table that the loop reads."""
        rows = self._rows
        self._bound = [row.bind(flow, options).ready() for row in rows if row.bind]
        self._baths = [bound for bound, row in zip(self._bound, rows, strict=True) if row.bath]
        for place, bound, row in zip(self._table, self._bound, rows, strict=True):
            place[...] = bound.address, bound.work, row.moves

    def heat_to(self, temperature: float) -> None:
        """Go on with heat baths of another temperature, which keep their memory."""
        memory = by_value(self.baths)
        self._bind(self._flow, self._options.changed(temperature=temperature))
        self.baths = memory

    @property
    def heat(self) -> float:
        """Energy that baths have given since the state was set."""
        return float(sum(bound.parts.bath.heat[0] for bound in self._baths))

    @property
    def baths(self) -> list[Floats]:
        """The memory of all baths: heat, and the state of those that have one."""
        found = [bound.parts.bath.heat for bound in self._baths]
        return found + [bound.parts.state for bound in self._baths if hasattr(bound.parts, "state")]

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

    def memory(self) -> Memory:
        """See Stepper. The memory of a word without baths is that of version 0.1.0."""
        return super().memory() | ({"baths": by_value(self.baths)} if self._baths else {})

    def recall(self, memory: Memory) -> None:
        """See Stepper."""
        super().recall(memory)
        if self._baths:
            self.baths = memory["baths"]

    @property
    def fresh(self) -> bool:  # type: ignore[override]
        return bool(self._cursor[FRESH])
