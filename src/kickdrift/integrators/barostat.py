"""Barostats: what a run at constant pressure needs, refuses and keeps."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.fields import Springs
from kickdrift.forces.pair_law import PairForce
from kickdrift.integrators.bath import SHORTEST_TAU, bathed
from kickdrift.integrators.option import (
    BAROSTAT,
    COMPRESSIBILITY,
    COUPLING,
    PRESSURE,
    PRESSURE_EVERY,
    PRESSURE_TAU,
    TEMPERATURE,
)
from kickdrift.integrators.piston import TOO_SHORT, Piston
from kickdrift.integrators.pressing import ACTED, Pressed
from kickdrift.integrators.subflow_code import BoundSubflow
from kickdrift.model.memory import Memory, by_value
from kickdrift.model.system import System

if TYPE_CHECKING:
    from kickdrift.integrators.flow import Flow
    from kickdrift.integrators.options import Options

GROUPS = {"isotropic": (0, 0, 0), "semi-isotropic": (0, 0, 1), "per-axis": (0, 1, 2)}
NEVER = np.iinfo(np.int64).min


def check_pressed(system: Any, options: Options) -> None:
    """Refuse a System whose box no barostat can change, and options that do not fit together."""
    if not isinstance(system, System):
        raise InputError(f"pressure: a barostat needs particles, and {system.name!r} is an ODE")
    if not np.isfinite(system.volume):
        along = "in open space" if not system.box.periodic else "whose box is open along an axis"
        raise InputError(f"pressure: {system.name!r} is a system {along}, which has no volume")
    if system.box.triclinic:
        raise InputError("pressure: no barostat here changes a leaning box; give a rectangular one")
    for force in system.forces:
        if not isinstance(force, PairForce | Springs):
            raise InputError(f"pressure: force {force.name!r} does not scale with the box; a barostat takes pair forces")
    if system.dimensions == 2 and options.get(COUPLING.name) == "semi-isotropic":
        raise InputError("coupling: semi-isotropic needs three dimensions; take isotropic or per-axis")


class Barostat:
    """The barostat of one run.

    Attributes
    ----------
    pressed : its numbers for the loop of splitting methods
    """

    def __init__(self, flow: Flow, options: Options, drags: bool) -> None:
        system: Any = flow.subject
        check_pressed(system, options)
        self._options, self._live = options, flow.live  # type: ignore[union-attr]
        self._system = system
        n, coupling = len(system), options.get(COUPLING.name) or "isotropic"
        group = [g if edge > 0 else -1 for g, edge in zip(GROUPS[coupling], self._live.lengths, strict=True)]
        every = int(options.get(PRESSURE_EVERY.name) or PRESSURE_EVERY.default)
        cutoffs = [force.cutoff for force in system.forces if isinstance(force, PairForce)]
        bath = bathed(flow, options, (TEMPERATURE,), conserving=not drags)
        self.piston = Piston(
            bath, self._live.lengths, np.array(group), np.bincount([g for g in group if g >= 0]).astype(float),
            float(options[PRESSURE.name]), 2.0 * max(cutoffs, default=0.0), np.zeros(3), None, np.zeros(3), np.zeros(1),
            np.zeros(8), np.zeros(8),
        )  # fmt: skip
        self._bound = self._made().ready()
        self.pressed = Pressed(
            np.array([self._bound.address, self._bound.work]), every, np.zeros(3, np.int64), self.piston.sums,
            np.zeros((3, n)),
        )  # fmt: skip

    def _made(self) -> BoundSubflow:
        from kickdrift.integrators.c_rescale import Rescale

        for option in (PRESSURE_TAU, COMPRESSIBILITY):
            if self._options.get(option.name) is None:
                raise InputError(f"{option.name} is needed: a barostat has no default {option.name}")
        rate = float(self._options[COMPRESSIBILITY.name] / self._options[PRESSURE_TAU.name])
        return BoundSubflow(Rescale(self.piston, rate, np.arange(8), np.zeros((2, 8))))

    @property
    def work(self) -> float:
        """Energy that the particles have got from the box since the state was set."""
        return float(self.piston.work[0])

    @property
    def trouble(self) -> str:
        """Why the barostat stopped."""
        cause, which, value = self.piston.trouble
        if cause == TOO_SHORT:
            cutoff = 0.5 * self.piston.shortest
            return (
                f"the barostat would make box edge {'xyz'[int(which)]} {value:.6g}, shorter than twice the cutoff, "
                f"2 x {cutoff:.6g} = {2 * cutoff:.6g}; take more particles or a lower temperature"
            )
        return f"the barostat would change the volume by a factor of {which:.3g} at once; give a longer pressure_tau"

    @property
    def _arrays(self) -> dict[str, Any]:
        return {
            "lengths": self._live.lengths, "place": self.pressed.place, "sums": self.pressed.sums,
            "work": self.piston.work, "state": self.piston.state,
        }  # fmt: skip

    def reset(self) -> None:
        """Begin anew in the box of now."""
        for name, array in self._arrays.items():
            if name != "lengths":
                array[...] = 0
        self.pressed.place[ACTED] = NEVER
        self.piston.trouble[...] = 0.0

    def memory(self) -> Memory:
        """Copies of all that later actions depend on."""
        return {name: by_value(array) for name, array in self._arrays.items()}

    def recall(self, memory: Memory) -> None:
        """Restore this from a memory, which may come from a file."""
        for name, array in self._arrays.items():
            given = np.asarray(memory[name])
            if given.shape != array.shape or not np.all(np.isfinite(given)):
                raise InputError(f"checkpoint: {name} of its barostat does not fit a run of this system")
            if name == "lengths" and not np.array_equal(given > 0, array > 0):
                raise InputError("checkpoint: its box is open along other axes")
            array[...] = given


def pressure_warnings(dt: float, options: Options, system: Any) -> list[str]:
    """One line for each doubtful choice."""
    found = []
    tau = options.get(PRESSURE_TAU.name)
    if tau is not None and tau < SHORTEST_TAU * dt:
        found.append(f"pressure_tau = {tau:g} is {tau / dt:.3g} steps; use {SHORTEST_TAU} steps or more")
    for force in system.forces:
        if isinstance(force, PairForce) and force.truncation == "cut" and not force.tail:
            found.append(
                f"pressure: {force.name} is cut, so its force jumps at the cutoff, and the virial lacks this impulse; "
                'take truncation = "shift", "force-shift" or "switch", or tail corrections'
            )
    return found
