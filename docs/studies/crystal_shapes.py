"""Crystals whose boxes change their shape: mean stresses, volumes, sheared crystals, and copper beside LAMMPS.

With ``coupling = "full"`` each barostat holds each component of the pressure, also with a stress beside it: its mean is
the wanted one, within three standard errors (see `kickdrift_validation.crystal_boxes`). Runs at two neighbouring
pressures give the ratio of the two distributions of the volume (Shirts 2013, doi:10.1021/ct300688p). The two runs have
other random numbers. Sheared crystals come back to their lattice. Copper of Zhou, Johnson & Wadley 2004 has its volume,
and the scatter of its tilts, beside LAMMPS' ``fix npt tri``.
"""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

import kickdrift as kd
from docs.studies import crystal_pressures
from docs.studies.crystal_pressures import conserved_claims
from kickdrift.analysis.certify.certifying import ensemble_checks
from kickdrift.model.live_box import in_box
from kickdrift.statistics.blocks import block_average
from kickdrift_validation.claim import Claim, claim, main, not_run
from kickdrift_validation.crystal_boxes import (
    BATHS,
    GPA,
    LAMMPS,
    QUICK,
    SIGMAS,
    STEPS,
    STRESS,
    component_claim,
    edges_of_lammps,
    run_of,
    settled,
    watched,
)


def systems() -> dict[str, tuple[kd.System, dict[str, Any]]]:
    """Crystals by name, with the options of bath and box. Silicon is hot, so that its vibrations exchange energy."""
    found = crystal_pressures.systems().items()
    hot = {"temperature": 1000.0}
    return {
        name: (system, options | (hot if "silicon" in name else {}))
        for name, (system, options, *_) in found
        if system.units.name == "metal"
    }


def strained(system: kd.System, box: np.ndarray) -> kd.System:
    """The crystal with other edge vectors, and the same fractional coordinates."""
    places = system.box.fractional(system.state.positions) @ box
    return in_box(system.at(np.array([places.T, system.state.phase[1]]), 0.0), kd.Box(matrix=box))


def all_component_claims(long: bool) -> Iterator[Claim]:
    """The mean of each component of the pressure, without and with a stress."""
    for name, (system, options) in systems().items():
        for barostat in BATHS:
            for own in ({}, {"stress": STRESS}):
                yield from component_claim(name, system, barostat, STEPS * (5 if long else 1), **options, **own)


def pair_claims(long: bool) -> Iterator[Claim]:
    """The ratio of the volumes' distributions at two pressures."""
    system, options = systems()["copper, embedded atoms"]
    for barostat in BATHS:
        quick = options | {"pressure_tau": (0.3 if barostat == "c-rescale" else 1.7) * options["pressure_tau"]}
        sims = []
        for seed, pressure in enumerate((options["pressure"], options["pressure"] + 0.7 * GPA)):
            given = quick | {"pressure": pressure, "seed": seed}
            sims.append(run_of(system, barostat, "full", 0.002, STEPS * (10 if long else 3), **given)[0])
        for check in (each for each in ensemble_checks(sims).rows if not each.run):
            text = f"{check.measured:.4g}, expected {check.expected:.4g}: z = {check.deviation:.2f}"
            print(f"  copper, {barostat}: {check.test}: {text}", flush=True)
            title = f"copper: {barostat}, full: {check.test} at two pressures"
            yield claim(title, text, f"|z| < {SIGMAS:g}", abs(check.deviation) < SIGMAS, "Shirts 2013")


def volume_of(edges: np.ndarray, atoms: int) -> Any:
    """Mean volume of an atom."""
    return block_average(np.linalg.det(edges) / atoms)


def shear_claims(long: bool) -> Iterator[Claim]:
    """A sheared crystal comes back to its lattice, and has the volume of the crystal that was not sheared."""
    for name, (system, options) in systems().items():
        edge = np.diag(system.box.matrix)
        box = np.diag(edge)
        box[1, 0], box[2, 0], box[2, 1] = 0.05 * edge[0], -0.04 * edge[0], 0.03 * edge[1]
        sheared = strained(system, box)
        for barostat in BATHS:
            steps = STEPS * (5 if long else 1)
            given = options | QUICK[barostat]
            found = [watched(each, barostat, steps, **given).edges for each in (system, sheared)]
            tilts = np.array([[e[1, 0] / e[0, 0], e[2, 0] / e[0, 0], e[2, 1] / e[1, 1]] for e in found[1]])
            means = [block_average(each) for each in tilts.T]
            off = max(abs(each.value) / each.error for each in means)
            text = ", ".join(f"{each.value:+.5f} ± {each.error:.5f}" for each in means)
            print(f"  {name}, {barostat}: tilts of the sheared crystal: {text}", flush=True)
            title = f"{name}: {barostat}: tilts over edges of a sheared crystal"
            yield claim(title, text, f"0 within {SIGMAS:g} standard errors", off <= SIGMAS, "a cubic crystal")
            one, other = (volume_of(each, len(system)) for each in found)
            off = abs(one.value - other.value) / math.hypot(one.error, other.error)
            text = f"{one.value:.4f} ± {one.error:.4f}, sheared {other.value:.4f} ± {other.error:.4f} Å^3"
            print(f"  {name}, {barostat}: {text}", flush=True)
            title = f"{name}: {barostat}: volume per atom, sheared and not"
            yield claim(title, text, f"within {SIGMAS:g} standard errors", off <= SIGMAS, "the same crystal")


def lammps_claims(long: bool) -> Iterator[Claim]:
    """Copper's volume, and the variances of its tilts, beside LAMMPS."""
    system, options = systems()["copper, embedded atoms"]
    steps = 400_000 if long else 60_000
    try:
        theirs = edges_of_lammps(system, options["temperature"], options["pressure"], steps, 0.3)
    except ImportError:
        yield not_run("copper: volume and tilts", "those of LAMMPS", LAMMPS)
        return
    ours = watched(settled(system, **options), "mtk", steps, **options).edges
    kinds = {
        "volume per atom": lambda e: np.linalg.det(e) / len(system),
        "variance of bx / ax, x 1e6": lambda e: 1e6 * (e[:, 1, 0] / e[:, 0, 0]) ** 2,
        "variance of cx / ax, x 1e6": lambda e: 1e6 * (e[:, 2, 0] / e[:, 0, 0]) ** 2,
        "variance of cy / by, x 1e6": lambda e: 1e6 * (e[:, 2, 1] / e[:, 1, 1]) ** 2,
    }
    for name, number in kinds.items():
        one, other = (block_average(number(each)) for each in (ours, theirs))
        off = abs(one.value - other.value) / math.hypot(one.error, other.error)
        text = f"{one.value:.5g} ± {one.error:.2g}, LAMMPS {other.value:.5g} ± {other.error:.2g}"
        print(f"  copper at 2 GPa: {name}: {text}, {off:.1f} standard errors", flush=True)
        yield claim(f"copper: {name}", text, f"within {SIGMAS:g} standard errors", off <= SIGMAS, LAMMPS)


def claims(long: bool = False) -> Iterator[Claim]:
    yield from all_component_claims(long)
    yield from pair_claims(long)
    yield from shear_claims(long)
    yield from lammps_claims(long)
    yield from conserved_claims(long, "full")


if __name__ == "__main__":
    main(claims, __doc__)
