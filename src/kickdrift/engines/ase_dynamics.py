"""ASE's molecular dynamics: VelocityVerlet, and its heat baths.

LangevinBAOAB and Andersen move the centre of mass. NoseHooverChainNVT conserves the total momentum and still counts 3 N
degrees of freedom. Bussi counts 3 N too, unless a FixCom constraint takes 3 of these, as it does here.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from kickdrift.engines.job import Job


def dynamics(atoms: Any, job: Job, seed: int) -> tuple[Any, Callable[[], float] | None]:
    """Dynamics for a job, and a function that returns the heat, or None if ASE does not tell it."""
    from ase import units

    name, options, dt = job.method.name, job.options, job.options.dt
    assert dt is not None
    if not job.method.bath:
        from ase.md.verlet import VelocityVerlet

        return VelocityVerlet(atoms, dt), None
    kelvin = job.system.units.boltzmann * options.temperature / units.kB  # ASE's k_B T is then the job's
    noise = np.random.default_rng(seed)
    if name == "baoab":
        from ase.md.langevinbaoab import LangevinBAOAB

        return LangevinBAOAB(atoms, dt, temperature_K=kelvin, T_tau=1.0 / options.friction, rng=noise), None
    if name == "andersen":
        from ase.md.andersen import Andersen

        chance = -math.expm1(-options.collision_rate * dt)
        return Andersen(atoms, dt, temperature_K=kelvin, andersen_prob=chance, fixcm=False, rng=noise), None
    if name == "csvr":
        from ase.constraints import FixCom
        from ase.md.bussi import Bussi

        atoms.set_constraint(FixCom())
        rescaling = Bussi(atoms, dt, temperature_K=kelvin, taut=options.tau, rng=noise)
        return rescaling, lambda: float(rescaling.transferred_energy)
    from ase.md.nose_hoover_chain import NoseHooverChainNVT

    chain = NoseHooverChainNVT(atoms, dt, temperature_K=kelvin, tdamp=options.tau, tchain=options.chain)
    return chain, lambda: atoms.get_total_energy() - chain.get_conserved_energy()
