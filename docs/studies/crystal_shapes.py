"""Crystals whose boxes change their shape: mean stresses, volumes, sheared crystals, and copper beside LAMMPS.

With ``coupling = "full"`` each barostat holds each component of the pressure: its mean is the pressure that was asked
for, within three standard errors. Where a stress is asked for beside the pressure, a first run finds the mean box. A
second run begins there. Runs at two neighbouring pressures give the ratio of the two distributions of the volume
(Shirts 2013, doi:10.1021/ct300688p). Sheared crystals come back to their lattice. Copper of Zhou, Johnson & Wadley 2004
has its volume, and the scatter of its tilts, beside LAMMPS' ``fix npt tri``.
"""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

import kickdrift as kd
from docs.studies import crystal_pressures
from docs.studies.crystal_pressures import ASKED, BAROSTATS, EVERY, GPA, SIGMAS, STEPS, conserved_claims, run_of
from kickdrift.analysis.certify.certifying import ensemble_checks
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.model.live_box import LiveBox, in_box
from kickdrift.statistics.blocks import block_average
from kickdrift_validation.claim import Claim, claim, main, not_run
from kickdrift_validation.example_forces import EXAMPLES

LAMMPS = "LAMMPS, fix npt tri"
NAMES = ("xx", "yy", "zz", "yz", "xz", "xy")
STRESS = (0.5 * GPA, -0.3 * GPA, 0.2 * GPA, 0.0, 0.3 * GPA, 0.4 * GPA)


def systems() -> dict[str, tuple[kd.System, dict[str, Any]]]:
    """Crystals by name, with the options of bath and box."""
    found = crystal_pressures.systems().items()
    return {name: (system, options) for name, (system, options, *_) in found if system.units.name == "metal"}


class Tensor:
    """The components of the pressure of a Simulation as it runs, in the order of ``NAMES``; and its edges (3, 3)."""

    def __init__(self, system: kd.System) -> None:
        self._live = LiveBox(system.box, free=True)
        self._forces = BoundForces(system, thin=True, live=self._live, apart=True)
        self._masses = system.coherent_masses
        self.parts: list[np.ndarray] = []
        self.edges: list[np.ndarray] = []

    def __call__(self, sim: kd.Simulation) -> None:
        state = sim.state
        self._live.box = state.box
        self._forces.measure(0.0, state.phase)
        assert self._forces.along is not None
        v = state.phase[1] - (state.phase[1] @ self._masses / self._masses.sum())[:, None]
        heat = np.einsum("n,in,jn->ij", self._masses, v, v)
        heat6 = heat[[0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]]
        self.parts.append((heat6 + self._forces.along.sum(axis=0).ravel()) / state.box.volume)
        self.edges.append(state.box.matrix)


def strained(system: kd.System, box: np.ndarray) -> kd.System:
    """The crystal with other edge vectors, and the same fractional coordinates."""
    places = system.box.fractional(system.state.positions) @ box
    return in_box(system.at(np.array([places.T, system.state.phase[1]]), 0.0), kd.Box(matrix=box))


def watched(system: kd.System, bath: str, barostat: str, dt: float, steps: int, **options: Any) -> Tensor:
    """The pressures and edges of an equilibrated run."""
    sim, _ = run_of(system, bath, barostat, "full", dt, 2000, **options)
    found = Tensor(system)
    sim.advance(steps, every=EVERY, visit=found)
    return found


def component_claims(long: bool) -> Iterator[Claim]:
    """The mean of each component of the pressure, without and with a stress."""
    for name, (system, options) in systems().items():
        for barostat, bath in BAROSTATS:
            for stress in (None, STRESS):
                start, given = system, dict(options)
                wanted = np.array([options["pressure"]] * 3 + [0.0] * 3)
                if stress is not None:
                    given["stress"] = stress
                    wanted = wanted - stress
                    first = watched(system, bath, barostat, 0.002, STEPS // 4, **given)
                    box = np.mean(first.edges, axis=0)
                    start = strained(system, box)
                seen = watched(start, bath, barostat, 0.002, STEPS * (5 if long else 1), **given)
                means = [block_average(each) for each in np.array(seen.parts).T]
                off = [(each.value - w) / each.error for each, w in zip(means, wanted, strict=True)]
                worst = int(np.argmax(np.abs(off)))
                text = ", ".join(f"{k} {m.value / GPA:.3f}" for k, m in zip(NAMES, means, strict=True))
                title = f"{name}: {barostat}{', under stress' if stress else ''}: components of the pressure"
                value = f"{text} GPa; {NAMES[worst]} is {off[worst]:+.1f} standard errors off"
                print(f"  {title}: {value}", flush=True)
                yield claim(title, value, f"within {SIGMAS:g} standard errors", abs(off[worst]) <= SIGMAS, ASKED)


def pair_claims(long: bool) -> Iterator[Claim]:
    """The ratio of the volumes' distributions at two pressures."""
    system, options = systems()["copper, embedded atoms"]
    for barostat, bath in BAROSTATS:
        quick = options | {"pressure_tau": (0.3 if barostat == "c-rescale" else 1.7) * options["pressure_tau"]}
        sims = []
        for seed, pressure in enumerate((options["pressure"], options["pressure"] + 0.7 * GPA)):
            given = quick | {"pressure": pressure, "seed": seed}
            sims.append(run_of(system, bath, barostat, "full", 0.002, STEPS * (10 if long else 3), **given)[0])
        for check in (each for each in ensemble_checks(sims).rows if not each.run):
            text = f"{check.measured:.4g}, expected {check.expected:.4g}: z = {check.deviation:.2f}"
            print(f"  copper, {barostat}: {check.test}: {text}", flush=True)
            title = f"copper: {barostat}, full: {check.test} at two pressures"
            yield claim(title, text, f"|z| < {SIGMAS:g}", abs(check.deviation) < SIGMAS, "Shirts 2013")


def volumes_of(seen: Tensor, atoms: int) -> Any:
    """Mean volume of an atom."""
    return block_average(np.array([np.linalg.det(each) for each in seen.edges]) / atoms)


def shear_claims(long: bool) -> Iterator[Claim]:
    """A sheared crystal comes back to its lattice, and has the volume of the crystal that was not sheared."""
    for name, (system, options) in systems().items():
        edge = np.diag(system.box.matrix)
        box = np.diag(edge)
        box[1, 0], box[2, 0], box[2, 1] = 0.05 * edge[0], -0.04 * edge[0], 0.03 * edge[1]
        sheared = strained(system, box)
        for barostat, bath in BAROSTATS:
            steps = STEPS * (5 if long else 1)
            found = [watched(each, bath, barostat, 0.002, steps, **options) for each in (system, sheared)]
            tilts = np.array([[e[1, 0] / e[0, 0], e[2, 0] / e[0, 0], e[2, 1] / e[1, 1]] for e in found[1].edges])
            means = [block_average(each) for each in tilts.T]
            off = max(abs(each.value) / each.error for each in means)
            text = ", ".join(f"{each.value:+.5f} ± {each.error:.5f}" for each in means)
            print(f"  {name}, {barostat}: tilts of the sheared crystal: {text}", flush=True)
            title = f"{name}: {barostat}: tilts over edges of a sheared crystal"
            yield claim(title, text, f"0 within {SIGMAS:g} standard errors", off <= SIGMAS, "a cubic crystal")
            one, other = (volumes_of(each, len(system)) for each in found)
            off = abs(one.value - other.value) / math.hypot(one.error, other.error)
            text = f"{one.value:.4f} ± {one.error:.4f}, sheared {other.value:.4f} ± {other.error:.4f} Å^3"
            print(f"  {name}, {barostat}: {text}", flush=True)
            title = f"{name}: {barostat}: volume per atom, sheared and not"
            yield claim(title, text, f"within {SIGMAS:g} standard errors", off <= SIGMAS, "the same crystal")


def edges_of_lammps(pressure: float, steps: int) -> np.ndarray:
    """Edges (f, 3, 3) of copper in LAMMPS."""
    from kickdrift.forces.external.lammps_library import lammps_class

    lmp = lammps_class()(cmdargs=["-log", "none", "-screen", "none"])
    lmp.commands_string(f"""
units metal
lattice fcc 3.615
region box prism 0 4 0 4 0 4 0 0 0
create_box 1 box
create_atoms 1 box
mass 1 63.546
pair_style eam/alloy
pair_coeff * * {EXAMPLES["eam"]["file"]} Cu
velocity all create 600.0 4928 mom yes rot no
timestep 0.002
fix pressed all npt temp 300.0 300.0 0.1 tri {pressure / GPA * 1e4} {pressure / GPA * 1e4} 0.3 mtk yes nreset 0
thermo 10000
run 4000 post no
""")
    found = []
    for _ in range(steps // EVERY):
        lmp.command(f"run {EVERY} pre no post no")
        low, high, xy, yz, xz, *_ = lmp.extract_box()
        x, y, z = np.array(high) - low
        found.append([[x, 0.0, 0.0], [xy, y, 0.0], [xz, yz, z]])
    lmp.close()
    return np.array(found)


def lammps_claims(long: bool) -> Iterator[Claim]:
    """Copper's volume, and the variances of its tilts, beside LAMMPS."""
    system, options = systems()["copper, embedded atoms"]
    steps = 400_000 if long else 60_000
    try:
        theirs = edges_of_lammps(options["pressure"], steps)
    except ImportError:
        yield not_run("copper: volume and tilts", "those of LAMMPS", LAMMPS)
        return
    ours = np.array(watched(system, "nose-hoover", "mtk", 0.002, steps, **options).edges)
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
    yield from component_claims(long)
    yield from pair_claims(long)
    yield from shear_claims(long)
    yield from lammps_claims(long)
    yield from conserved_claims(long, "full")


if __name__ == "__main__":
    main(claims, __doc__)
