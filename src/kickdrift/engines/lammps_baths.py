"""LAMMPS' heat baths: the fixes that take a step, in LAMMPS' own words."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from kickdrift.engines.job import Job

BATH = "bath"  # name of the fix whose scalar is minus the heat so far
_NVE = "fix move all nve"
FIXES = {
    "velocity-verlet": (_NVE,),
    "baoab": (_NVE, "fix bath all langevin {thermal!r} {thermal!r} {damping!r} {seed} tally yes"),
    "csvr": (_NVE, "fix bath all temp/csvr {thermal!r} {thermal!r} {tau!r} {seed}"),
    "nose-hoover": ("fix bath all nvt temp {thermal!r} {thermal!r} {tau!r} tchain {chain}",),
}


def fixes(job: Job, seed: int) -> tuple[str, ...]:
    """Commands of the fixes for a job. Temperatures are k_B T, as LAMMPS' k_B is 1 here."""
    options = job.options
    if not job.method.bath:
        return FIXES[job.method.name]
    given = {
        "thermal": float(job.system.units.boltzmann * options.temperature),
        "damping": 1.0 / options.friction if "friction" in job.method.tunable else None,
        "tau": options.get("tau"),
        "chain": options.get("chain"),
        "seed": seed,
    }
    found = tuple(line.format(**given) for line in FIXES[job.method.name])
    plane = job.method.drags and job.system.dimensions == 2
    return (*found, "fix plane all enforce2d") if plane else found
