"""All bodies that a run has or has had, and the rows of its file: some leave, others come."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from kickdrift.errors import InputError, RunError
from kickdrift.forces.seam.named import named_function
from kickdrift.looks.columns import BODY_MASSES, BODY_RADII, MOST_NUMBERS, Column
from kickdrift.model.changing import next_id, with_empty_rows
from kickdrift.model.events.collision import Collision
from kickdrift.model.memory import Memory
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.run.watch.collisions import Change, New, bodies_memory, system_with

NEVER_BACK = -1  # survivor's id for a removed body


class Roster:
    """Bodies of a run with events.

    Attributes
    ----------
    first : the system at the start, or the Problem
    room : most bodies that collisions may add
    names : names of the bodies that collisions have added, in the order of their ids
    absorbed : id of the survivor, or ``NEVER_BACK``, by the id of each body that left or has not come yet
    """

    def __init__(self, first: Any, events: Sequence[Any]) -> None:
        self.first = first
        for event in events:
            if isinstance(event, Collision) and event.rule is not None:
                named_function(event.rule)  # this program may resume the run's file
        self.room = sum(event.new_bodies for event in events if isinstance(event, Collision) and event.adds)
        self.names: list[str] = []
        self.absorbed: dict[int, int] = {}
        if self.room:
            self.absorbed = dict.fromkeys(self.filed.state.ids[len(first) :].tolist(), NEVER_BACK)

    @property
    def filed(self) -> System:
        """The first system, with empty rows for all bodies that collisions may add."""
        return with_empty_rows(self.first, self.room)

    @property
    def next(self) -> New:
        return New(next_id(self.first) + len(self.names), len(self.names) + 1)

    def check_room(self, come: int) -> None:
        """Raise RunError if so many new bodies are too many."""
        left = self.room - len(self.names)
        if come > left:
            raise RunError(f"adds {come} bodies, and new_bodies = {self.room} leaves room for {left}")

    def change(self, before: System, change: Change) -> None:
        """Note who left and who came."""
        ids, first = before.state.ids, self.next.id
        for gone in change.gone:
            self.absorbed[int(ids[gone])] = NEVER_BACK if change.survivor is None else int(ids[change.survivor])
        for k in range(len(change.born)):
            del self.absorbed[first + k]
        now = change.system
        self.names += [now.body(row) for row in range(len(now) - len(change.born), len(now))]

    # --- the file's columns ---

    def columns(self) -> list[Column]:
        """Masses and radii of all bodies at each look, in the order of the file's rows; none if no body can come."""
        rows = len(self.first) + self.room if self.room else 0
        if not 0 < rows <= MOST_NUMBERS:
            return []
        return [
            Column(BODY_MASSES, "mass", (rows,), lambda sim: self._spread(sim.system, sim.system.state.masses)),
            Column(BODY_RADII, "length", (rows,), lambda sim: self._spread(sim.system, sim.integration.events.radii)),
        ]

    def _spread(self, system: System, values: Floats) -> Floats:
        """Values (n,) of the present bodies in the rows of the file, nan for the others."""
        ids = self.filed.state.ids
        found, order = np.full(len(ids), np.nan), np.argsort(ids)
        found[order[np.searchsorted(ids[order], system.state.ids)]] = values
        return found

    # --- checkpoints ---

    def memory(self, system: Any) -> Memory:
        """The present bodies, and those that came and left."""
        return {
            "bodies": bodies_memory(self.first, system),
            "absorbed": [[gone, survivor] for gone, survivor in self.absorbed.items()],
            "names": self.names,
        }

    def recall(self, memory: Memory) -> Any:
        """Restore a memory, and return the system with the bodies of then."""
        names = list(memory.get("names", ()))
        if len(names) > self.room or not all(isinstance(name, str) for name in names):
            raise InputError("checkpoint: holds more new bodies than the events of this run allow")
        system = self.first if memory["bodies"] is None else system_with(self.first, memory["bodies"])
        self.absorbed, self.names = dict(memory["absorbed"]), names
        return system
