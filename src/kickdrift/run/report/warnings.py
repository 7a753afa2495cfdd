"""Words of a report: warnings of a System, its drift and its melting, and means beside what was asked."""

from typing import Any

import numpy as np

from kickdrift.forces.charges.coulomb import Coulomb, coulomb_of
from kickdrift.forces.pairs.law import PairForce
from kickdrift.forces.seam.group import ListedForce
from kickdrift.looks.doubts import digits_doubt
from kickdrift.looks.record import Series
from kickdrift.model.body_checks import doubtful_forces
from kickdrift.model.freedom import NONE, apart_of
from kickdrift.model.molecules.relatives import molecules_of
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.run.report.charges import charge_warnings, slab_warning
from kickdrift.text import choices, measured

AGREES = 3.0  # standard errors
DIFFERS = "differs"
SLOW = "a long step makes velocities of this bath too slow, and configurations hardly at all"
DRAWN = "the bath draws velocities; no test of the motion"
JUMPS = "; the force jumps at the cutoff, see lj-1000-switch"
TOO_LONG = "; a shorter dt tells whether the step is too long"
LARGE = 10.0  # energy of the centre of mass that is worth a word, in heats of one particle
SHARE = 0.01  # of the kinetic energy
LEAST_LOOKS = 10
CHANGE = 0.05  # of the temperature; a smaller change leaves averages as they are
FLUCTUATIONS = 4.0  # standard deviations of the temperature in the second half
PROBES = 8  # particles whose nearest neighbours are measured
LINDEMANN = 0.3  # distances of neighbours that a particle is off its site; crystals melt near 0.1 to 0.15
EVEN = 1e-3  # spread of the nearest distances on a lattice, of their mean


def verdict(mean: float, error: float | None, asked: float) -> str:
    """A mean beside the number that was asked for, in words."""
    if not error:
        return "too short to judge"
    off = abs(mean - asked) / error
    return "agrees" if off <= AGREES else f"{DIFFERS} by {off:.1f} standard errors"


def cause_of_drift(system: System, fixed: bool) -> str:
    """Words on the likely cause of a secular drift under pair forces; ``fixed`` tells whether the step is."""
    pairs = [force for force in system.forces if isinstance(force, PairForce)]
    if any(force.jumps_at_cutoff(system.species) for force in pairs):
        return JUMPS
    return TOO_LONG if pairs and fixed else ""


def moving(system: System, drags: bool, series: Series) -> list[str]:
    """Return a line if the centre of mass moves much faster than heat would make it, so that this motion is no heat."""
    if series.temperatures is None or series.momentum is None or apart_of(system, drags) == NONE:
        return []
    masses, momentum = system.coherent_masses, series.momentum[0]
    energy = 0.5 * float(momentum @ momentum) / float(masses.sum())
    if energy <= max(SHARE * series.kinetic, LARGE * (series.kinetic - energy) / len(masses)):
        return []
    return [
        f"the particles move as a whole: their centre of mass has {energy / series.kinetic:.3g} of the kinetic energy, "
        "which is no heat; temperature and pressure are without this motion"
    ]


def melting(system: System, temperatures: Floats | None, run: Any, bath: bool = False) -> list[str]:
    """Return a warning if the temperature shows that the lattice of the start melts during the run. A ``bath`` changes
    the temperature by itself."""
    change = temperature_change(temperatures)
    if change is None or not has_melted(system, run.state.positions):
        return []
    first, later = change
    mean = measured(f"{later:.4g}", system.units.symbol("temperature"))
    sign = f"the lattice is melting: the temperature {'falls' if later < first else 'rises'} from {first:.4g} to {mean}"
    if bath:
        sign = f"the run starts from a lattice, which it leaves while the bath brings {first:.4g} to {mean}"
    return [
        f"{sign} (mean of the second half), so the run is not in equilibrium; equilibrate first, with [equilibrate] in "
        "the system file or with sim.equilibrate"
    ]


def temperature_change(temperatures: Floats | None) -> tuple[float, float] | None:
    """Return the first temperature and the mean of the second half, if they differ by more than fluctuations."""
    if temperatures is None or len(temperatures) < LEAST_LOOKS or not np.isfinite(temperatures).all():
        return None
    later = temperatures[len(temperatures) // 2 :]
    first, mean = float(temperatures[0]), float(later.mean())
    change = abs(mean - first)
    return (first, mean) if change > CHANGE * mean and change > FLUCTUATIONS * float(later.std()) else None


def lattice_spacing(system: System) -> float | None:
    """Return the distance of nearest neighbours at the start if some particles, evenly chosen, all have the same.
    Particles of one molecule are no neighbours: their bonds are alike in a liquid too."""
    positions, count = system.state.positions, len(system)
    bonds = np.zeros((0, 2), np.int64) if system.topology is None else system.topology.bonds
    molecule = molecules_of(bonds, count)
    if count <= PROBES:
        return None
    nearest = []
    for i in np.linspace(0, count - 1, PROBES).astype(int):
        apart = system.box.minimum_image(positions - positions[i])
        distances = np.einsum("ij,ij->i", apart, apart)
        distances[molecule == molecule[i]] = np.inf
        nearest.append(np.sqrt(distances.min()))
    if not np.isfinite(nearest).all():
        return None
    return float(np.mean(nearest)) if np.ptp(nearest) <= EVEN * np.mean(nearest) else None


def has_melted(system: System, positions: Floats) -> bool:
    """Tell whether the run starts from a lattice, and the particles, now at ``positions`` (n, 3), unwrapped, are off
    their sites by more than a crystal's particles (Lindemann 1910, Phys. Z. 11, 609)."""
    start, spacing = system.state.positions, lattice_spacing(system)
    if spacing is None or positions.shape != start.shape:
        return False
    moved = positions - start
    moved = moved - moved.mean(axis=0)
    return float(np.sqrt(np.einsum("ij,ij->i", moved, moved).mean())) > LINDEMANN * spacing


def layer_warning(system: Any, phase: Any) -> str:
    """Return the warning for positions and velocities (2, 3, n); "" if they fill three dimensions.

    Pair forces keep such particles in their plane. The temperature then counts velocities that are always zero."""
    if not isinstance(system, System) or system.dimensions == 2 or len(system) < 3:
        return ""
    if not any(isinstance(force, ListedForce) for force in system.forces):
        return ""
    x, v = phase
    flat = np.flatnonzero((np.ptp(x, axis=1) == 0.0) & ~v.any(axis=1))
    if not flat.size:
        return ""
    axis = "xyz"[flat[0]]
    remedy = "give dimensions = 2" if axis == "z" else "let z be the constant coordinate and give dimensions = 2"
    return (
        f"all particles have {axis} = {x[flat[0], 0]:g} and never leave this plane, but temperature and pressure "
        f"count three dimensions; {remedy}"
    )


def pressure_warning(system: Any) -> str:
    """Return the warning that samples have no pressure, and why; "" if they have one, and in open space."""
    if not isinstance(system, System):
        return ""
    reasons = [force.no_pressure(system) for force in system.forces if hasattr(force, "no_pressure")]
    reasons = [reason for reason in reasons if reason]
    return f"pressure is left out: {'; '.join(reasons)}" if reasons else ""


def begins_badly(system: Any, phase: Floats | None = None) -> list[str]:
    """Return the warnings at the start of a run, at positions and velocities (2, 3, n); without these, the warnings
    that the System alone gives."""
    if not isinstance(system, System):
        return []
    found = [pressure_warning(system)]
    if phase is not None:
        x, v = phase[:, :, : len(system)]  # spins, if there are any, follow
        found = [layer_warning(system, (x, v)), *found, digits_doubt(system, x)]
    found.append(joining_constraint(system))
    return [*filter(None, found), *doubtful_forces(system), *unused_warnings(system), *charge_warnings(system)]


def joining_constraint(system: System) -> str:
    """Warning of a constraint between two molecules of the topology; "" without one."""
    held, topology = system.constraints, system.topology
    if held is None or topology is None or not len(topology.bonds):
        return ""
    molecule = molecules_of(topology.bonds, len(system))
    bonded = np.isin(held.pairs, topology.bonds).all(axis=1)
    apart = np.flatnonzero(bonded & (molecule[held.pairs[:, 0]] != molecule[held.pairs[:, 1]]))
    if not apart.size:
        return ""
    i, j = map(system.body, held.pairs[apart[0]].tolist())
    return f"constraint: {i} and {j} are of two molecules of the topology, which the constraint joins to one"


def ends_badly(system: Any, state: Any) -> list[str]:
    """Return the warnings of positions at the end of a run; a Batch keeps no state."""
    if not isinstance(system, System) or state is None or len(state) != len(system):
        return []
    x, topology = state.phase[0], system.topology
    paired = topology is not None and any(isinstance(force, PairForce | Coulomb) for force in system.forces)
    far = topology.far_special(state.box, x) if topology is not None and paired else ""
    return [digits_doubt(system, x), far, slab_warning(system, x)]


def _pairs_left_out(force: PairForce, system: System) -> str:
    """Return a warning of a force that names pairs of species, and has its default parameters for all others."""
    if not (rest := force.unset(system)):
        return ""
    values = " and ".join(f"{key} = {value:g}" for key, value in force.law._asdict().items())
    return f"{force.name}: pairs {choices(rest)} have {values}, the default, because only other pairs are named"


def unused_warnings(system: Any) -> list[str]:
    """Return warnings of factors that a System gives without a pair force, and of pairs of species whose parameters
    nobody gave, and of particles without any force."""
    if not isinstance(system, System):
        return []
    if not system.forces and not system.events and len(system) > 1:
        return ["no force acts; give force_field (--force-field) for a .pdb or .cif, or forces in a system file"]
    pairs = [force for force in system.forces if isinstance(force, PairForce)]
    found = [told for force in pairs if (told := _pairs_left_out(force, system))]
    topology, charged = system.topology, coulomb_of(system) is not None
    if topology is not None and not pairs and not charged and system.forces and len(topology.scaled.pairs):
        acting = " and ".join(dict.fromkeys(force.name for force in system.forces))
        found.append(f"topology: factors and exclusions have no effect: they are about pair forces, and not {acting}")
    return found
