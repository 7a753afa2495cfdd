"""Draw docs/own-forces.png: one run under each kind of force of docs/your-own-force.md, with the code of that page.

    python docs/own_forces.py [--output docs/own-forces.png] [--overwrite]

Prints for each run how well it kept what it should.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import kickdrift as kd
from kickdrift.plots.drawing import COLOURS, INK, checked_target, new_axes, new_figure, save_figure

DOCS = Path(__file__).parent
sys.path.insert(0, str(DOCS.parent))
from tests import pages  # noqa: E402


def laws() -> dict[str, Any]:
    """The laws and functions of the page, by name."""
    found: dict[str, Any] = {}
    folder = tempfile.mkdtemp(prefix="own-forces-")
    sys.path.insert(0, folder)
    for block in pages.blocks(DOCS / "your-own-force.md"):
        if block.title.endswith(".py"):
            (Path(folder) / block.title).write_text(block.code, encoding="utf-8")
            found |= vars(__import__(block.title.removesuffix(".py")))
        elif "def chain(" in block.code:
            exec(compile(block.code, "your-own-force.md", "exec"), found)
    return found


def _as_map(axes: Any) -> None:
    """Draw both axes to one scale, without numbers."""
    axes.set_aspect("equal")
    axes.set_xticks([])
    axes.set_yticks([])


def tweezer(axes: Any, own: dict[str, Any]) -> str:
    """Distances from the centre of the trap in a heat bath, and Boltzmann's law."""
    depth, temperature, n = 2.0, 0.12, 500
    rng = np.random.default_rng(1)
    atoms = kd.System(0.3 * rng.normal(size=(n, 3)), forces=[own["Tweezer"](depth=depth)])
    sim = kd.Simulation(atoms, "baoab", dt=0.05, temperature=temperature, friction=1.0, seed=2)
    sim.advance(400)
    distances: list[np.ndarray] = []
    sim.run(4000, every=40, observe=lambda s: distances.append(np.linalg.norm(s.state.positions, axis=1)))
    r = np.linspace(0.0, 1.2, 200)
    wanted = r**2 * np.exp(depth * np.exp(-0.5 * r**2) / temperature)
    axes.hist(np.concatenate(distances), 50, range=(0.0, 1.2), density=True, color=COLOURS[0], alpha=0.5)
    axes.plot(r, wanted / np.trapezoid(wanted, r), color=INK, linewidth=1.2)
    axes.set_xlabel("distance / width", fontsize=8)
    axes.set_yticks([])
    mean, theory = float(np.mean(distances)), float(np.trapezoid(r * wanted, r) / np.trapezoid(wanted, r))
    return f"mean distance {mean:.3f}, Boltzmann's law {theory:.3f}"


def morse(axes: Any, own: dict[str, Any]) -> str:
    """A gas in a plane, cooled until it condenses."""
    edge, count = 26.0, 400
    rng = np.random.default_rng(3)
    grid = (np.indices((20, 20)).reshape(2, -1).T + 0.5) * edge / 20 + rng.uniform(-0.1, 0.1, (count, 2))
    x = np.column_stack([grid, np.zeros(count)])
    gas = kd.System(x, box=(edge, edge), dimensions=2, forces=[own["Morse"](cutoff=2.5, truncation="force-shift")])
    for temperature, steps in ((0.4, 20_000), (0.3, 20_000), (0.2, 20_000), (0.05, 10_000)):
        sim = kd.Simulation(gas, "baoab", dt=0.01, temperature=temperature, friction=0.5, seed=4)
        sim.advance(steps)
        gas = gas.at(sim.state.phase, 0.0)
    x = gas.box.wrap(gas.state.positions)
    apart = np.linalg.norm(gas.box.minimum_image(x[:, None] - x[None]), axis=2)
    near = (apart < 1.5).sum(axis=1) - 1
    axes.scatter(x[:, 0], x[:, 1], s=10, c=np.where(near == 6, COLOURS[0], COLOURS[1]))
    _as_map(axes)
    return f"{float(np.mean(near == 6)):.0%} of the particles have six neighbours"


def chain_molecule(axes: Any, own: dict[str, Any]) -> str:
    """A stiff chain in a heat bath, seen from above."""
    n = 300
    topology = kd.Topology.chains(1, n, angles=True)
    stiff = [own["Quartic"](k=500.0), own["CosineSquared"](k=30.0, c=-1.0)]
    start = np.zeros((n, 3))
    start[:, 0] = np.arange(n)
    start += np.random.default_rng(5).normal(scale=0.02, size=(n, 3))
    sim = kd.Simulation(
        kd.System(start, topology=topology, forces=stiff), "baoab", dt=0.02, temperature=1.0, friction=0.05, seed=6
    )
    sim.advance(400_000)
    x = sim.state.positions - sim.state.positions.mean(axis=0)
    axes.scatter(x[:, 0], x[:, 1], s=5, c=np.arange(n), cmap="viridis")
    axes.plot(x[:, 0], x[:, 1], color=INK, linewidth=0.4)
    _as_map(axes)
    bonds = np.linalg.norm(np.diff(x, axis=0), axis=1)
    return f"mean bond {bonds.mean():.3f}, length at rest 1"


def charges(axes: Any, own: dict[str, Any]) -> str:
    """Two light charges about a heavy one of the other sign."""
    x, v = [[0.0, 0, 0], [0.7, 0, 0], [-3.0, 0.3, 0]], [[0.0, 0, 0], [0.0, 1.7, 0], [0.0, -0.65, 0]]
    ions = kd.System(x, v, masses=[50.0, 1.0, 1.0], forces=[own["Charges"]([3.0, -1.0, -1.0])])
    sim = kd.Simulation(ions, "gauss-radau15")
    paths: list[np.ndarray] = []
    report = sim.run(until=30.0, interval=0.02, observe=lambda s: paths.append(s.state.positions))
    about = np.array(paths) - np.array(paths)[:, :1]  # the heavy charge
    for k, colour in ((1, COLOURS[0]), (2, COLOURS[1])):
        axes.plot(*about[:, k, :2].T, color=colour, linewidth=0.8)
    axes.plot([0.0], [0.0], "o", color=INK, markersize=4)
    _as_map(axes)
    return f"energy error {report.energy.max_relative_error:.1e}"


def springs(axes: Any, own: dict[str, Any]) -> str:
    """A pulse that runs along a chain of springs and back."""
    n = 80
    places = np.arange(n)[:, None] * np.array([1.0, 0.0, 0.0])
    places[:, 0] += 0.25 * np.exp(-0.5 * ((np.arange(n) - 12) / 3.0) ** 2)
    force = kd.PythonForce(own["chain"], external=False)
    beads = kd.System(places, forces=[force])
    seen: list[np.ndarray] = []
    sim = kd.Simulation(beads, "yoshida4", dt=0.05)
    report = sim.run(until=80.0, every=5, observe=lambda s: seen.append(s.state.positions[:, 0] - np.arange(n)))
    axes.imshow(np.array(seen), aspect="auto", origin="lower", cmap="RdBu_r", vmin=-0.2, vmax=0.2, extent=(0, n, 0, 80))
    axes.set_xlabel("bead", fontsize=8)
    axes.set_ylabel("time", fontsize=8)
    return f"energy error {report.energy.max_relative_error:.1e}"


def copper(axes: Any, own: dict[str, Any]) -> str:
    """Energies of copper under ASE's EMT."""
    from ase.build import bulk
    from ase.calculators.emt import EMT

    atoms = bulk("Cu", a=3.61, cubic=True).repeat(3)
    crystal = kd.System.from_ase(atoms, [kd.CalculatorForce(EMT, {"asap_cutoff": True})])
    sim = kd.Simulation(crystal.with_velocities(temperature="600 K", seed=1), "velocity-verlet", dt="4 fs")
    report = sim.run(150, every=1)
    series, n = report.about.series, len(crystal)
    energies = {"kinetic": series.kinetics, "potential": series.total - series.kinetics, "total": series.total}
    for (name, energy), colour in zip(energies.items(), COLOURS, strict=False):
        axes.plot(series.times, 1000 * (energy - energy[0]) / n, color=colour, linewidth=1.0, label=name)
    axes.set_ylim(-80, 90)
    axes.legend(fontsize=7, frameon=False, ncols=3, loc="upper center")
    axes.set_xlabel("time / ps", fontsize=8)
    axes.set_ylabel("change / (meV per atom)", fontsize=8)
    return f"energy error {report.energy.rms_relative_error:.1e}"


PANELS = {
    "field law: atoms in a tweezer": tweezer,
    "pair law: Morse crystal": morse,
    "laws of bonds and angles: a chain": chain_molecule,
    "body law: charges": charges,
    "Python function: a pulse": springs,
    "ASE calculator: copper": copper,
}


def main() -> int:
    """Draw all panels and print how well each run went."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=DOCS / "own-forces.png")
    parser.add_argument("--overwrite", action="store_true")
    given = parser.parse_args()
    target = checked_target(given.output, given.overwrite)
    own, figure = laws(), new_figure(8.6, 5.8)
    for k, (title, draw) in enumerate(PANELS.items()):
        axes = new_axes(figure, (2, 3, k + 1))
        print(f"{title:36} {draw(axes, own)}")
        axes.set_title(title, fontsize=9.5, color=INK)
        axes.tick_params(labelsize=7)
        axes.grid(visible=False)
    print(save_figure(figure, target))
    return 0


if __name__ == "__main__":
    sys.exit(main())
