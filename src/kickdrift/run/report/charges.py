"""What a run's report says of the forces between charges: the method with its parameters, and their error."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any
from weakref import WeakKeyDictionary

from kickdrift.forces.charges.coulomb import Coulomb
from kickdrift.forces.charges.radial import ALL_IMAGES, DAMPED_SHIFTED, DIRECT
from kickdrift.forces.charges.sampled import Errors, errors_of
from kickdrift.forces.charges.waves import waves_of
from kickdrift.model.system import System
from kickdrift.text import measured

CRYSTAL = 0.05  # size of the forces, in typical forces, below which errors are relative to the typical force
TYPICAL, SIZE = "the typical force", "the root-mean-square force"
_FOUND: WeakKeyDictionary[System, tuple[float, ChargeReport]] = WeakKeyDictionary()  # by the System, at a time


@dataclass(frozen=True)
class ChargeReport:
    """Method and parameters of the forces between charges, in the System's units, and root-mean-square errors.

    ``predicted_error`` follows from the parameters. ``measured_error`` is the difference from an exact sum for
    ``measured_particles`` at the end of the run, or at its start if the box has changed. Both are ``relative_to`` the
    size of the forces. Only sums over all images have these, and waves or a mesh with the order of its splines."""

    method: str
    accuracy: float | None = None
    alpha: float | None = None
    cutoff: float | None = None
    waves: int | None = None
    mesh: tuple[int, ...] | None = None
    order: int | None = None
    predicted_error: float | None = None
    measured_error: float | None = None
    measured_particles: int = 0
    relative_to: str = TYPICAL
    net_charge: float = 0.0

    def lines(self, length: str) -> list[tuple[str, str]]:
        """Lines for people; ``length`` is the unit of length."""
        said = [self.method]
        if self.cutoff is not None:
            said.append(f"cutoff = {measured(f'{self.cutoff:.5g}', length)}")
        if self.alpha is not None:
            said.append(f"alpha = {measured(f'{self.alpha:.5g}', length and f'1/{length}')}")
        if self.waves is not None:
            said.append(f"{self.waves:,} waves")
        if self.mesh is not None:
            said.append(f"mesh {' x '.join(map(str, self.mesh))}, order {self.order}")
        lines = [("charges", ", ".join(said))]
        if self.predicted_error is not None:
            found = f"{self.predicted_error:.1e} predicted"
            if self.measured_error is not None:
                found += f", {self.measured_error:.1e} measured for {self.measured_particles} particles"
            lines.append(("force error", f"{found}, of {self.relative_to}; asked {self.accuracy:.1e}"))
        return lines


def charge_report(system: Any, sim: Any) -> ChargeReport | None:
    """The ChargeReport of a System that a Simulation runs; None without a force between charges."""
    force = next((force for force in getattr(system, "forces", ()) if isinstance(force, Coulomb)), None)
    if force is None:
        return None
    state = sim.state
    if system not in _FOUND or _FOUND[system][0] != state.time:
        present = system.at(state.phase, state.time) if state.box == system.box else system
        _FOUND[system] = state.time, _made(force, present)
    return _FOUND[system][1]


def _made(force: Coulomb, system: System) -> ChargeReport:
    if force.method == DIRECT:
        return ChargeReport(force.method, net_charge=force.net_charge(system))
    split = force.split(system)
    given: dict[str, Any] = {"cutoff": split.cutoff, "net_charge": force.net_charge(system)}
    if force.method not in ALL_IMAGES:
        return ChargeReport(force.method, alpha=split.alpha if force.method == DAMPED_SHIFTED else None, **given)
    errors = errors_of(force, system)
    size, relative_to = _scale(errors)
    return ChargeReport(
        force.method,
        force.accuracy,
        split.alpha,
        waves=None if split.mesh else int(waves_of(system.box, split.waves).kept.sum()),
        mesh=split.mesh or None,
        order=split.order or None,
        predicted_error=errors.predicted / size,
        measured_error=None if errors.measured is None else errors.measured / size,
        measured_particles=errors.particles,
        relative_to=relative_to,
        **given,
    )


def _scale(errors: Errors) -> tuple[float, str]:
    """Size of the forces in typical forces, and its name. In a crystal the forces vanish."""
    return (errors.size, SIZE) if errors.size is not None and errors.size > CRYSTAL else (1.0, TYPICAL)


def charge_warnings(system: Any) -> list[str]:
    """Warnings of charges that nothing uses, and of a net charge in a periodic box."""
    if not isinstance(system, System) or system.charges is None or not system.charges.any():
        return []
    force = next((force for force in system.forces if isinstance(force, Coulomb)), None)
    if force is None:
        return ["charges have no effect, since no force acts between them; add the force coulomb"]
    net = force.net_charge(system)
    if force.method not in ALL_IMAGES or not net:
        return []
    charge = measured(f"{net:.6g}", system.units.symbol("charge"))
    energy = measured(f"{force.background(system) / system.volume:.6g}", system.units.symbol("energy"))
    return [
        f"the net charge is {charge}; a uniform background of the opposite charge neutralises it, with an energy of "
        f"{energy}"
    ]
