"""Crystals in boxes that change their shape: components of the pressure, and lattice constants beside LAMMPS.

With ``coupling = "full"`` each barostat holds each component of the pressure tensor p. In the ensemble
exp(-(K + U + P V + H) / k_B T) V dm (see the page on constant pressure) the mean of p is that of P - (V0 / V) G^T s G,
for the stress s that is asked for beside the pressure P, and G = h0^-1 h of the edges h0 at the start and h of now. The
start is the end of the equilibration. So the difference of both has the mean zero, in each sample's own box. The shear
components of s are as large as the others, so a wrong component, a lost kinetic part or a lost work of the stress shows
here.

The frame turns with the box: a lies along x, and b in the x-y plane. This shifts the mean of xx by -2 k_B T / V and
that of zz by 2 k_B T / V. For edge vectors h = L Q, with a lower triangle L and a rotation Q, dm is the left-invariant
measure of L. A stretch of L from the right by 1 + e along axis k multiplies dm by (1 + e)^(4 - 2 k).

Lattice constants and thermal expansion of copper (embedded atoms of Zhou, Johnson & Wadley 2004) and silicon
(Stillinger & Weber 1985) at 300 K come from runs at 200, 300 and 400 K, beside LAMMPS' ``fix npt tri`` with the same
forces and starts. In ``mtk`` the energy less heat and work does not drift. A crystal of 108 Lennard-Jones particles
keeps it over a million steps.
"""

import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

import kickdrift as kd
from kickdrift.engines.job import Job
from kickdrift.engines.lammps import model_of
from kickdrift.engines.lammps_world import World
from kickdrift.integrators import INTEGRATORS
from kickdrift.integrators.options import Options
from kickdrift.model.starts.builders import lattice, maxwell_boltzmann
from kickdrift.statistics.blocks import block_average
from kickdrift.systemfile.files import shipped
from kickdrift_validation.claim import Claim, claim, main, not_run
from kickdrift_validation.example_forces import crystal

SIGMAS = 3.0
LARGEST = 1e-4  # error of what `mtk` conserves, of the energy
GPA = 1.0 / 160.2176634  # in eV per cubic angstrom
LAMMPS = "LAMMPS, fix npt tri"
BATHS = {"c-rescale": "csvr", "mtk": "nose-hoover", "monte-carlo": "csvr"}
SEEDS = {"c-rescale": 100, "monte-carlo": 200}
DT, STEPS, EVERY = 0.002, 20_000, 10
NAMES = ("xx", "yy", "zz", "yz", "xz", "xy")
ROWS, COLUMNS = (0, 1, 2, 1, 0, 0), (0, 1, 2, 2, 2, 1)
STRESS = (0.5 * GPA, -0.3 * GPA, 0.2 * GPA, 0.25 * GPA, 0.3 * GPA, 0.4 * GPA)
TEMPERATURES = (200.0, 300.0, 400.0)
QUICK: dict[str, dict[str, Any]] = {  # soft strains of copper relax ten times as slowly as its volume
    "c-rescale": {"pressure_tau": 0.05}, "mtk": {"pressure_tau": 0.5}, "monte-carlo": {},
}  # fmt: skip


def copper() -> kd.System:
    file = shipped()["copper-864"].with_name("Cu_zhou2004_smooth.eam.alloy")
    return crystal(kd.EmbeddedAtom(str(file)))


def silicon() -> kd.System:
    return crystal(kd.StillingerWeber())


def begun(system: kd.System, barostat: str, coupling: str, dt: float, **options: Any) -> kd.Simulation:
    """An equilibrated Simulation. Options that the barostat does not take are left out."""
    left_out = {"mtk": ("compressibility", "seed"), "monte-carlo": ("pressure_tau",)}.get(barostat, ())
    own = {} if barostat == "mtk" else {"pressure_every": 5, "seed": SEEDS[barostat] + len(coupling) + len(system)}
    given = {key: value for key, value in (own | options).items() if key not in left_out}
    sim = kd.Simulation(system, BATHS[barostat], dt, barostat=barostat, coupling=coupling, **given)
    sim.equilibrate(options["temperature"], 4000 * dt)
    return sim


def run_of(system: kd.System, barostat: str, coupling: str, dt: float, steps: int, **options: Any) -> Any:
    """The Simulation of `begun` after a run, and its report."""
    sim = begun(system, barostat, coupling, dt, **options)
    return sim, sim.run(steps, every=EVERY)


def settled(system: kd.System, **options: Any) -> kd.System:
    """The crystal in a box that has these pressure and stress, after a run that damps all swings of the box."""
    sim, _ = run_of(system, "c-rescale", "full", DT, 4000, **options | QUICK["c-rescale"])
    found: kd.System = sim.now()
    return found


class Watched(NamedTuple):
    """A run from a settled box."""

    tensors: np.ndarray  # (f, 6) components of the pressure
    edges: np.ndarray  # (f, 3, 3)
    reference: np.ndarray  # (3, 3) edges at the end of the equilibration, in which the stress is the asked one
    report: Any


def watched(system: kd.System, barostat: str, steps: int, **options: Any) -> Watched:
    """A run with all six components of the box."""
    sim = begun(system, barostat, "full", DT, **options)
    reference = sim.state.box.matrix
    sim.run(2000, every=EVERY)
    edges: list[np.ndarray] = []
    report = sim.run(steps, every=EVERY, observe=lambda run: edges.append(run.state.box.matrix))
    tensors = np.array([each.columns["pressure_tensor"] for each in sim.record.samples])
    return Watched(tensors[-len(edges) :], np.array(edges), reference, report)


def wanted(edges: np.ndarray, reference: np.ndarray, pressure: float, stress: Sequence[float], kt: float) -> np.ndarray:
    """The mean components (f, 6) of the pressure in boxes with these edges (f, 3, 3), for k_B T = ``kt``."""
    tensor = np.zeros((3, 3))
    tensor[ROWS, COLUMNS] = tensor[COLUMNS, ROWS] = stress
    growth, volume = np.linalg.inv(reference) @ edges, np.linalg.det(edges)
    ratio = np.linalg.det(reference) / volume
    pull = ratio[:, None, None] * np.einsum("fki,kl,flj->fij", growth, tensor, growth)
    of_frame = 2.0 * kt / volume[:, None, None] * np.diag([-1.0, 0.0, 1.0])
    return (pressure * np.eye(3) - pull + of_frame)[:, ROWS, COLUMNS]


def component_claim(name: str, system: kd.System, barostat: str, steps: int, **options: Any) -> Iterator[Claim]:
    """The mean of each component of the pressure; and the drift of what `mtk` conserves."""
    system = settled(system, **options)
    found, edges, reference, report = watched(system, barostat, steps, **options | QUICK[barostat])
    stress = options.get("stress", (0.0,) * 6)
    kt = system.units.boltzmann * options["temperature"]
    aim = wanted(edges, reference, options["pressure"], stress, kt)
    off = [block_average(each) for each in (found - aim).T]
    worst = max(abs(each.value) / each.error for each in off)
    text = ", ".join(f"{k} {each.value / GPA:+.3f}({each.error / GPA:.3f})" for k, each in zip(NAMES, off, strict=True))
    title = f"{name}: {barostat}{', under stress' if any(stress) else ''}: pressure less the wanted one, in GPa"
    print(f"  {title}: {text}", flush=True)
    yield claim(title, text, f"0 within {SIGMAS:g} standard errors", worst <= SIGMAS, "the ensemble")
    if barostat == "mtk":
        rate, error = report.energy.drift_per_unit_time, report.energy.drift_error
        title = f"{name}: mtk: drift of energy less heat and work over {steps:,} steps"
        text = f"{rate:+.1e}({error:.1e}) per ps"
        print(f"  {title}: {text}", flush=True)
        yield claim(title, text, "0 within three standard errors", abs(rate) <= 1.5 * error, "the law of the barostat")


def component_claims(long: bool) -> Iterator[Claim]:
    """Each barostat with copper under a stress."""
    options = {"temperature": 300.0, "tau": 0.1, "pressure": 2.0 * GPA, "pressure_tau": 0.3, "stress": STRESS}
    for barostat in BATHS:
        steps = STEPS * (5 if long else 1)
        yield from component_claim("copper", copper(), barostat, steps, **options, compressibility=0.007 / GPA)


class Edges(NamedTuple):
    """Mean lattice constants with their errors, at each of TEMPERATURES."""

    means: np.ndarray
    errors: np.ndarray

    @property
    def expansion(self) -> tuple[float, float]:
        """Coefficient of linear expansion between the first and the last temperature, and its error."""
        span = self.means[1] * (TEMPERATURES[-1] - TEMPERATURES[0])
        return (self.means[-1] - self.means[0]) / span, math.hypot(self.errors[0], self.errors[-1]) / span


def edges_of(volumes: list[np.ndarray], cells: int) -> Edges:
    """Lattice constants from the volumes of boxes with so many unit cells along each edge."""
    found = [block_average(np.cbrt(each) / cells) for each in volumes]
    return Edges(np.array([each.value for each in found]), np.array([each.error for each in found]))


def thermal(system: kd.System, temperature: float) -> kd.System:
    """The crystal with this temperature in all its vibrations, which exchange energy slowly with each other."""
    sim = kd.Simulation(system, "baoab", DT, temperature=temperature, friction=2.0, seed=7)
    sim.advance(5000)
    found: kd.System = sim.now()
    return found


def volumes(system: kd.System, temperature: float, pressure: float, steps: int) -> np.ndarray:
    """Volumes in `mtk` of the full shape, from this state on."""
    options = {"temperature": temperature, "tau": 0.1, "pressure": pressure, "pressure_tau": 0.5}
    sim = kd.Simulation(system, "nose-hoover", DT, barostat="mtk", coupling="full", **options)
    sim.advance(4000)
    sim.run(steps, every=EVERY)
    return np.array([sample.volume for sample in sim.record.samples])


def edges_of_lammps(system: kd.System, temperature: float, pressure: float, steps: int, tau: float) -> np.ndarray:
    """Edges (f, 3, 3) of the same run in LAMMPS, from the same state on; ``tau`` is the time constant of the box."""
    job = Job(system, INTEGRATORS["velocity-verlet"], "velocity-verlet", Options(dt=DT))
    energy = system.units.boltzmann * temperature
    world = World()
    try:
        x = system.box.wrap(system.state.positions)
        world.reset(model_of(job, 1)._replace(fixes=()), x, system.state.velocities)
        world.lmp.commands_string(f"""
change_box all triclinic
velocity all zero linear
fix pressed all npt temp {energy!r} {energy!r} 0.1 tri {pressure!r} {pressure!r} {tau!r} mtk yes nreset 0
run 4000 post no
""")
        found = []
        for _ in range(steps // EVERY):
            world.run(EVERY)
            low, high, xy, yz, xz, *_ = world.lmp.extract_box()
            a, b, c = np.array(high) - low
            found.append([[a, 0.0, 0.0], [xy, b, 0.0], [xz, yz, c]])
    finally:
        world.close()
    return np.array(found)


def expansion_claims(long: bool) -> Iterator[Claim]:
    """Lattice constants at 300 K and thermal expansion, beside LAMMPS."""
    steps = STEPS * (10 if long else 1)
    for name, system in (("copper", copper()), ("silicon", silicon())):
        titles = f"{name}: lattice constant at 300 K in Å", f"{name}: linear expansion, 200 to 400 K, in 1e-6 / K"
        bound = f"within {SIGMAS:g} standard errors of LAMMPS'"
        starts = {each: thermal(system, each) for each in TEMPERATURES}
        ours = edges_of([volumes(start, each, 0.0, steps) for each, start in starts.items()], 4)
        try:
            boxes = [edges_of_lammps(start, each, 0.0, steps, 0.5) for each, start in starts.items()]
        except ImportError:
            yield from (not_run(title, bound, LAMMPS) for title in titles)
            continue
        theirs = edges_of([np.linalg.det(each) for each in boxes], 4)
        pairs = [((each.means[1], each.errors[1]), (1e6 * each.expansion[0], 1e6 * each.expansion[1]))
                 for each in (ours, theirs)]  # fmt: skip
        for title, (value, error), (other, their_error), digits in zip(titles, *pairs, (5, 2), strict=True):
            off = abs(value - other) / math.hypot(error, their_error)
            text = f"{value:.{digits}f}({error:.{digits}f}), LAMMPS {other:.{digits}f}({their_error:.{digits}f})"
            print(f"  {title}: {text}, {off:.1f} standard errors", flush=True)
            yield claim(title, text, bound, off <= SIGMAS, LAMMPS)


def million_claims() -> Iterator[Claim]:
    """What `mtk` conserves over a million steps, in a crystal whose box changes its shape."""
    x, edges = lattice("fcc", 108, 1.1)
    v = maxwell_boltzmann(np.ones(108), 0.8, 1.0, 1)
    system = kd.System(x, v, box=edges, forces=[kd.LennardJones(cutoff=2.0, truncation="switch")])
    options = {"temperature": 0.4, "tau": 0.5, "pressure": 3.0, "pressure_tau": 1.0}
    sim = kd.Simulation(system, BATHS["mtk"], DT, barostat="mtk", coupling="full", **options)
    sim.equilibrate(0.4, 20.0)
    energy = sim.run(1_000_000, every=200).energy
    rate, error, largest = energy.drift_per_unit_time, energy.drift_error, energy.max_relative_error
    text = f"largest {largest:.1e}, drift {rate:+.1e}({error:.1e}) per time unit"
    print(f"  mtk, 1,000,000 steps: {text}", flush=True)
    title = "Lennard-Jones crystal: mtk: energy less heat and work over 1,000,000 steps, of the energy"
    held = largest < LARGEST and abs(rate) <= 1.5 * error
    bound = f"below {LARGEST:g}, drift 0 within three standard errors"
    yield claim(title, text, bound, held, "the law of the barostat")


def claims(long: bool = False) -> Iterator[Claim]:
    yield from component_claims(long)
    yield from expansion_claims(long)
    yield from million_claims()


if __name__ == "__main__":
    main(claims, __doc__)
