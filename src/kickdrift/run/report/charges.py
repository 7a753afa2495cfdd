"""What a run's report says of the forces between charges: the method with its parameters, and their error."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from kickdrift.forces.charges.cores import coreless_pair
from kickdrift.forces.charges.coulomb import Coulomb, coulomb_of
from kickdrift.forces.charges.radial import ALL_IMAGES, DAMPED_SHIFTED, DIRECT, EWALD, PME
from kickdrift.forces.charges.sampled import Errors, errors_of
from kickdrift.forces.charges.waves import waves_of
from kickdrift.looks.report_lines import charge_lines
from kickdrift.model.state import Floats
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
    size of the forces. Only sums over all images have these, and waves or a mesh with the order of its splines.
    ``vacuum`` is the length along z between a slab and its images."""

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
    vacuum: float | None = None

    def lines(self, length: str) -> list[tuple[str, str]]:
        """Lines for people; ``length`` is the unit of length."""
        return charge_lines(asdict(self), length)


def charge_report(system: Any, sim: Any) -> ChargeReport | None:
    """The ChargeReport of a System that a Simulation runs; None without a force between charges."""
    if (force := coulomb_of(system)) is None:
        return None
    state = sim.state
    if system not in _FOUND or _FOUND[system][0] != state.time:
        present = system.at(state.phase, state.time) if state.box == system.box else system
        _FOUND[system] = state.time, _made(force.held(system), present)
    return _FOUND[system][1]


def charges_of(system: Any) -> ChargeReport | None:
    """The ChargeReport of a System as it is; None without a force between charges."""
    force = coulomb_of(system)
    return None if force is None else _made(force, system)


def _made(force: Coulomb, system: System) -> ChargeReport:
    if force.method == DIRECT:
        return ChargeReport(force.method, net_charge=force.net_charge(system))
    split = force.split(system)
    given: dict[str, Any] = {"cutoff": split.cutoff, "net_charge": force.net_charge(system)}
    if force.method not in ALL_IMAGES:
        return ChargeReport(force.method, alpha=split.alpha if force.method == DAMPED_SHIFTED else None, **given)
    errors, space = errors_of(force, system), force.space(system)
    size, relative_to = _scale(errors)
    return ChargeReport(
        PME if split.mesh else EWALD,
        force.accuracy,
        split.alpha,
        waves=None if split.mesh else int(waves_of(space, split.waves).kept.sum()),
        mesh=split.mesh or None,
        order=split.order or None,
        predicted_error=errors.predicted / size,
        measured_error=None if errors.measured is None else errors.measured / size,
        measured_particles=errors.particles,
        relative_to=relative_to,
        vacuum=None if space == system.box else float(space.matrix[2, 2] - system.box.matrix[2, 2]),
        **given,
    )


def _scale(errors: Errors) -> tuple[float, str]:
    """Size of the forces in typical forces, and its name. In a crystal the forces vanish."""
    return (errors.size, SIZE) if errors.size is not None and errors.size > CRYSTAL else (1.0, TYPICAL)


def charge_warnings(system: Any) -> list[str]:
    """Warnings of charges that nothing uses, of a net charge in a periodic box, and of opposite charges without a
    core."""
    if not isinstance(system, System) or system.charges is None or not system.charges.any():
        return []
    force = coulomb_of(system)
    if force is None:
        if any(getattr(each, "takes_charges", False) for each in system.forces):
            return []
        return ["charges have no effect, since no force acts between them; add the force coulomb"]
    found = []
    if pair := coreless_pair(force, system):
        both = " and ".join(map(system.body, pair))
        found.append(
            f"{both} have opposite charges and no core, so they can fall into each other; add a pair force with a "
            "core, such as lennard-jones"
        )
    found += [told] if (told := slab_warning(system, system.state.phase[0])) else []
    net = force.net_charge(system)
    if force.method not in ALL_IMAGES or not net:
        return found
    charge = measured(f"{net:.6g}", system.units.symbol("charge"))
    energy = measured(f"{force.background(system) / system.volume:.6g}", system.units.symbol("energy"))
    return [
        *found,
        f"the net charge is {charge}; a uniform background of the opposite charge neutralises it, with an energy of "
        f"{energy}",
    ]


def slab_warning(system: System, x: Floats) -> str:
    """Warning of charged particles at positions x (3, n) that spread beyond the edge z of a slab; "" without such."""
    force = coulomb_of(system)
    if force is None or force.space(system) == system.box:
        return ""
    spread, edge = float(np.ptp(x[2])), float(system.box.matrix[2, 2])
    if spread <= edge:
        return ""
    unit = system.units.symbol("length")
    return (
        f"particles spread over {measured(f'{spread:.6g}', unit)} along z, and the edge z of the box, which is the "
        f"thickness of a slab, is {measured(f'{edge:.6g}', unit)}; the forces between charges have larger errors then"
    )
