"""Constants of the unit systems, as literature prints them, and one run of argon in two unit systems.

    python validation/unit_constants.py

CODATA 2022 (Mohr et al., doi:10.1103/RevModPhys.97.025002); the second, metre, kilogram and kelvin of 2019 make k, e
and c exact. IAU 2012 Resolution B2: the astronomical unit. GM of the Sun: JPL DE421 (Folkner, Williams & Boggs 2009,
IPN Progress Report 42-178). Gauss' constant: k = 0.01720209895, which G of the unit system astro must give to 1e-9,
since the mean Earth is no longer what defines the unit. A fluid in units metal (angstrom, ps, eV, u) must move as in
reduced units, with lengths and times times what the printed constants say.
"""

from __future__ import annotations

import math
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from claim import Claim, claim, not_run, show, where

import kickdrift as kd
from kickdrift.units import quantity, unit_system

BOLTZMANN, CHARGE, LIGHT = 1.380649e-23, 1.602176634e-19, 299_792_458.0  # J/K, C, m/s; exact
ATOMIC_MASS, ATOMIC_MASS_ERROR = 1.66053906892e-27, 5.2e-37  # kg
NEWTON, NEWTON_ERROR = 6.67430e-11, 1.5e-15  # m^3 / (kg s^2)
AU, DAY = 149_597_870_700.0, 86_400.0  # m, s; exact
GM_SUN = 1.32712440040944e20  # m^3 / s^2
GAUSS = 0.01720209895
CODATA, IAU = "CODATA 2022", "IAU 2012 B2; DE421"
EXACT = 1e-14  # a few roundings
INSTALL = "pip install 'kickdrift[ase]'"
YEARS_APART = 2e-9  # relative: CODATA 2018's atomic mass, which an older SciPy and ASE have, is 1.4e-9 off


def constants() -> list[Claim]:
    """One row each."""
    metal, si, astro = (unit_system(name) for name in ("metal", "si", "astro"))
    year = 365.25 * DAY
    rows = []
    for text, value, wanted, bound, reference in (
        ("metal: k_B in eV/K", metal.boltzmann, BOLTZMANN / CHARGE, EXACT, f"{CODATA}, exact"),
        ("metal: c in angstrom/ps", metal.light, LIGHT * 1e-2, EXACT, "exact"),
        ("metal: u in eV ps^2/angstrom^2", metal.coherent_mass, ATOMIC_MASS * 1e4 / CHARGE, YEARS_APART, CODATA),
        ("si: k_B", si.boltzmann, BOLTZMANN, EXACT, f"{CODATA}, exact"),
        ("si: G", si.gravity, NEWTON, NEWTON_ERROR / NEWTON, f"{CODATA}, its error"),
        ("si: c", si.light, LIGHT, EXACT, "exact"),
        ("astro: G in AU^3/(Msun yr^2)", astro.gravity, GM_SUN * year**2 / AU**3, EXACT, IAU),
        ("astro: G", astro.gravity, (365.25 * GAUSS) ** 2, 1e-9, "Gauss' constant"),
        ("astro: c in AU/yr", astro.light, LIGHT * year / AU, EXACT, IAU),
        ("1 nm in angstrom", quantity("1 nm", "length", metal), 10.0, EXACT, "SI prefix"),
        ("1 kcal/mol in eV", quantity("1 kcal/mol", "energy", metal), 4184 / 6.02214076e23 / CHARGE, EXACT, CODATA),
        ("120 K in eV", quantity("120 K", "energy", metal), 120 * BOLTZMANN / CHARGE, EXACT, CODATA),
        ("1 g/cm3 in u/angstrom^3", quantity("1 g/cm3", "density", metal), 1e-27 / ATOMIC_MASS, YEARS_APART, CODATA),
        ("1 bar in eV/angstrom^3", quantity("1 bar", "pressure", metal), 1e5 * 1e-30 / CHARGE, EXACT, "SI"),
    ):  # fmt: skip
        assert value is not None
        off = abs(value / wanted - 1.0)
        rows.append(
            claim(f"{text}: {value:.10g}, relative difference", off, f"at most {bound:.2g}", off <= bound, reference)
        )
    return rows


def ases() -> list[Claim]:
    """ASE's tables, from four years before."""
    text = "constants of ASE, largest relative difference"
    if find_spec("ase") is None:
        return [not_run(text, f"at most {YEARS_APART:g}", "ase.units", INSTALL)]
    from ase.units import create_units

    theirs, metal = create_units("2018"), unit_system("metal")
    ps = theirs["fs"] * 1000.0  # in angstrom sqrt(u / eV)
    pairs = {
        "k_B": (metal.boltzmann, theirs["kB"]),
        "u, by the length of a ps": (metal.coherent_mass, ps**-2.0),
        "kcal/mol": (quantity("1 kcal/mol", "energy", metal), theirs["kcal"] / theirs["mol"]),
        "GPa": (quantity("1 GPa", "pressure", metal), theirs["GPa"]),
    }
    rows = []
    for name, (ours, other) in pairs.items():
        off = abs(ours / other - 1.0)
        text = f"{name}, relative difference"
        rows.append(claim(text, off, f"at most {YEARS_APART:g}", off <= YEARS_APART, "ase.units, CODATA 2018"))
    return rows


def argon() -> list[Claim]:
    """Rahman's argon in metal, and as a reduced fluid."""
    steps = 100
    metal = kd.load("argon-864")
    assert isinstance(metal, kd.System)
    sigma, epsilon, mass = 3.4, 120.0 * BOLTZMANN / CHARGE, 39.948
    tau = sigma * math.sqrt(mass * ATOMIC_MASS * 1e4 / CHARGE / epsilon)  # ps
    state = metal.state
    reduced = kd.System(
        state.positions / sigma, state.velocities * (tau / sigma), box=[34.78 / sigma] * 3,
        forces=[kd.LennardJones(cutoff=7.65 / sigma, truncation="shift")],
    )  # fmt: skip
    runs = kd.Simulation(metal, "velocity-verlet", dt=0.01), kd.Simulation(reduced, "velocity-verlet", dt=0.01 / tau)
    rows, done = [], 0
    for step in (1, 10, steps):
        for sim in runs:
            sim.run(step - done, every=2**40)
        done = step
        x, y = (np.array(sim.state.positions) for sim in runs)
        moved = float(np.abs(y - reduced.state.positions).max())
        off = float(np.abs(x / sigma - y).max()) / moved
        bound = YEARS_APART
        text = f"argon, metal beside reduced units: positions after {step} steps, over the way gone"
        rows.append(claim(text, off, f"at most {bound:g}", off <= bound, f"scaled with the constants of {CODATA}"))
    samples = [sim.sample() for sim in runs]
    scales = {"energy": epsilon, "temperature": 120.0, "pressure": epsilon / sigma**3}
    for name, scale in scales.items():
        a, b = (sample.energies.total if name == "energy" else getattr(sample, name) for sample in samples)
        off = abs(a / (b * scale) - 1.0)
        rows.append(claim(f"argon: {name} after {steps} steps, relative difference", off, f"at most {YEARS_APART:g}",
                          off <= YEARS_APART, f"scaled with the constants of {CODATA}"))  # fmt: skip
    return rows


def claims(long: bool = False, figures: Path | None = None) -> list[Claim]:
    """The same with and without ``long``; no figure."""
    print(where())
    return [*constants(), *ases(), *argon()]


if __name__ == "__main__":
    sys.exit(show(claims()))
