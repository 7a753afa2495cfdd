"""Metals, silicon, polymers and calculators at constant pressure: mean pressures, volumes, and copper beside LAMMPS.

Each barostat holds the pressure of each kind of force: the mean pressure of a run is the pressure that was asked for,
within three standard errors. Runs at two neighbouring pressures give the ratio of the two distributions of the volume.
In the right ensemble this is exp(-(P1 - P2) V / k_B T) for all forces (Shirts 2013, doi:10.1021/ct300688p).
The two runs have other random numbers.

Copper of Zhou, Johnson & Wadley 2004 has its lattice constant at 300 K and at 0 and 10 GPa beside LAMMPS' ``fix npt``.
The same crystal in a leaning box and in a rectangular box has the same mean volume. In ``mtk`` the energy less heat and
work does not drift.
"""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

import kickdrift as kd
from kickdrift.analysis.certify.certifying import ensemble_checks
from kickdrift.forces import FORCES
from kickdrift.statistics.blocks import block_average
from kickdrift_validation.claim import Claim, claim, main, not_run
from kickdrift_validation.crystal_boxes import BATHS, EVERY, GPA, SIGMAS, STEPS, run_of
from kickdrift_validation.example_forces import EXAMPLES, crystal, example

ASKED = "the pressure asked for"
LAMMPS = "LAMMPS, fix npt iso"
COUPLINGS = ("isotropic", "per-axis")


def systems() -> dict[str, tuple[kd.System, dict[str, Any], float, int]]:
    """Systems by name, with the options of bath and box, the step and the number of steps."""
    metal = {"temperature": 300.0, "tau": 0.1, "pressure": 2.0 * GPA}
    copper, silicon = ({"pressure_tau": 0.3, "compressibility": b / GPA} for b in (0.007, 0.01))
    melt = {"temperature": 1.0, "tau": 0.5, "pressure": 5.0, "pressure_tau": 0.5, "compressibility": 0.02}
    return {
        "copper, embedded atoms": (crystal(example(FORCES["eam"])), metal | copper, 0.002, STEPS),
        "silicon, Stillinger-Weber": (crystal(kd.StillingerWeber()), metal | silicon, 0.002, STEPS // 2),
        "silicon, Tersoff": (crystal(kd.Tersoff()), metal | silicon, 0.002, STEPS // 2),
        "chains, fene and pairs": (kd.load("kremer-grest-1000"), melt, 0.004, STEPS),
    }


def pressure_claims(long: bool) -> Iterator[Claim]:
    """The mean pressure of each barostat, force and coupling."""
    for name, (system, options, dt, steps) in systems().items():
        unit, per = ("GPa", 1.0 / GPA) if system.units.name == "metal" else ("ε/σ^3", 1.0)
        for barostat in BATHS:
            for coupling in COUPLINGS if system.units.name == "metal" else COUPLINGS[:1]:
                _, report = run_of(system, barostat, coupling, dt, steps * (5 if long else 1), **options)
                off = abs(report.pressure - options["pressure"]) / report.pressure_error
                text = f"{report.pressure * per:.4f} ± {report.pressure_error * per:.4f} {unit}"
                print(f"  {name}, {barostat}, {coupling}: {text}, {off:.1f} standard errors", flush=True)
                bound = f"within {SIGMAS:g} standard errors of {options['pressure'] * per:.4g}"
                yield claim(f"{name}: {barostat}, {coupling}: mean pressure", text, bound, off <= SIGMAS, ASKED)


def pair_claims(long: bool) -> Iterator[Claim]:
    """The ratio of the volumes' distributions at two pressures."""
    chosen = systems()
    for name, apart in (("copper, embedded atoms", 0.7 * GPA), ("chains, fene and pairs", 0.15)):
        system, options, dt, steps = chosen[name]
        for barostat in BATHS:
            # The box of a crystal swings fast in mtk, and c-rescale needs many independent volumes.
            quick = options | {"pressure_tau": (0.3 if barostat == "c-rescale" else 1.7) * options["pressure_tau"]}
            sims = []
            for seed, pressure in enumerate((options["pressure"], options["pressure"] + apart)):
                given = quick | {"pressure": pressure, "seed": seed}
                sims.append(run_of(system, barostat, "isotropic", dt, steps * (10 if long else 4), **given)[0])
            checks = ensemble_checks(sims)
            for check in (each for each in checks.rows if not each.run):
                text = f"{check.measured:.4g}, expected {check.expected:.4g}: z = {check.deviation:.2f}"
                print(f"  {name}, {barostat}: {check.test}: {text}", flush=True)
                title = f"{name}: {barostat}: {check.test} at two pressures"
                yield claim(title, text, f"|z| < {SIGMAS:g}", abs(check.deviation) < SIGMAS, "Shirts 2013")


def lattice_constant(pressure: float, steps: int) -> tuple[float, float]:
    """Mean edge of copper's unit cell at 300 K, with its standard error, by kickdrift."""
    options = {"temperature": 300.0, "tau": 0.1, "pressure": pressure, "pressure_tau": 0.3}
    system = crystal(example(FORCES["eam"]))
    sim, _ = run_of(system, "mtk", "isotropic", 0.002, steps, **options)
    found = block_average(np.array([sample.volume for sample in sim.record.samples]) ** (1 / 3) / 4.0)
    return found.value, found.error


def lattice_constant_of_lammps(pressure: float, steps: int) -> tuple[float, float]:
    """The same by LAMMPS."""
    from kickdrift.forces.external.lammps_library import lammps_class

    lmp = lammps_class()(cmdargs=["-log", "none", "-screen", "none"])
    lmp.commands_string(f"""
units metal
lattice fcc 3.615
region box block 0 4 0 4 0 4
create_box 1 box
create_atoms 1 box
mass 1 63.546
pair_style eam/alloy
pair_coeff * * {EXAMPLES["eam"]["file"]} Cu
velocity all create 600.0 4928 mom yes rot no
timestep 0.002
fix pressed all npt temp 300.0 300.0 0.1 iso {pressure / GPA * 1e4} {pressure / GPA * 1e4} 0.3 mtk yes
thermo 10000
run 4000 post no
""")
    edges = []
    for _ in range(steps // EVERY):
        lmp.command(f"run {EVERY} pre no post no")
        edges.append(float(lmp.get_thermo("vol")) ** (1 / 3) / 4.0)
    lmp.close()
    found = block_average(np.array(edges))
    return found.value, found.error


def lattice_claims(long: bool) -> Iterator[Claim]:
    """Copper's lattice constant beside LAMMPS."""
    steps = 200_000 if long else 40_000
    for pressure in (0.0, 10.0 * GPA):
        text = f"copper at 300 K and {pressure / GPA:.0f} GPa: lattice constant"
        bound = f"within {SIGMAS:g} standard errors of LAMMPS'"
        ours, error = lattice_constant(pressure, steps)
        try:
            theirs, their_error = lattice_constant_of_lammps(pressure, steps)
        except ImportError:
            yield not_run(text, bound, LAMMPS)
            continue
        off = abs(ours - theirs) / math.hypot(error, their_error)
        value = f"{ours:.6f} ± {error:.6f}, LAMMPS {theirs:.6f} ± {their_error:.6f} Å"
        print(f"  {text}: {value}, {off:.1f} standard errors", flush=True)
        yield claim(text, value, bound, off <= SIGMAS, LAMMPS)


def leaning_claims(long: bool) -> Iterator[Claim]:
    """Copper in a leaning box, whose edges are vectors of the same lattice, has the volume of the rectangular box."""
    system, options, dt, steps = systems()["copper, embedded atoms"]
    edge = np.diag(system.box.matrix)
    matrix = np.diag(edge)
    matrix[1, 0], matrix[2, 0], matrix[2, 1] = 0.5 * edge[0], -0.25 * edge[0], 0.25 * edge[1]
    sites = system.state.positions
    leaning = kd.System(
        sites, system.state.velocities, system.state.masses, kd.Box(matrix=matrix), system.forces, "metal",
        species=["Cu"] * len(system),
    )  # fmt: skip
    for barostat in BATHS:
        found = []
        for each in (system, leaning):
            sim, _ = run_of(each, barostat, "isotropic", dt, steps * (5 if long else 1), **options)
            found.append(block_average(np.array([sample.volume for sample in sim.record.samples]) / len(system)))
        off = abs(found[0].value - found[1].value) / math.hypot(found[0].error, found[1].error)
        value = ", ".join(f"{each.value:.4f} ± {each.error:.4f}" for each in found) + " Å^3"
        print(f"  {barostat}: rectangular and leaning: {value}: {off:.1f} standard errors", flush=True)
        bound = f"within {SIGMAS:g} standard errors of each other"
        yield claim(f"{barostat}: volume per atom in both boxes", value, bound, off <= SIGMAS, "the same crystal")


def conserved_claims(long: bool, coupling: str = "per-axis") -> Iterator[Claim]:
    """The conserved quantity of ``mtk`` under embedded atoms."""
    system, options, dt, _ = systems()["copper, embedded atoms"]
    steps = 1_000_000 if long else 100_000
    sim, report = run_of(system, "mtk", coupling, dt, steps, **options)
    totals = np.array([sample.energies.total + sample.taken.energy for sample in sim.record.samples])
    energy = report.energy
    rate = f"{energy.drift_per_unit_time:+.1e} ± {energy.drift_error:.1e} per ps"
    print(f"  mtk, {coupling}: {rate}, scatter {totals.std():.2g} eV, {energy.verdict}", flush=True)
    held = abs(energy.drift_per_unit_time) <= 1.5 * energy.drift_error
    text = f"copper, mtk, {coupling}: drift of energy less heat and work over {steps:,} steps"
    yield claim(text, rate, "0 within three standard errors", held, "the law of the barostat")


def claims(long: bool = False) -> Iterator[Claim]:
    yield from pressure_claims(long)
    yield from pair_claims(long)
    yield from lattice_claims(long)
    yield from leaning_claims(long)
    yield from conserved_claims(long)


if __name__ == "__main__":
    main(claims, __doc__)
